"""PyTorch beside `build/bench cnn`: the network of the paper, on one core, in images per second.

    make bench && for round in 1 2 3; do
        taskset -c 0 build/bench cnn; taskset -c 0 python3 torch_cnn.py; done

Needs PyTorch, which nothing else of the project does. Both sides take the best of three rounds of
at least three steps; training is forward, backward and a step of Adam.
"""
import time
import torch
from torch import nn

CHANNELS = [2, 16, 32, 64, 128, 256, 512, 1024]
SIZE, OUTPUTS = 128, 3


def make_network():
    layers = []
    for before, after in zip(CHANNELS, CHANNELS[1:]):
        layers += [nn.Conv2d(before, after, 3, padding=1), nn.ReLU(), nn.MaxPool2d(2)]
    network = nn.Sequential(*layers, nn.Flatten(), nn.Linear(CHANNELS[-1], OUTPUTS))
    return network.to(memory_format=torch.channels_last)  # the faster of the two


def rate(step, batch):
    steps, best = max(3, 64 // batch), float("inf")
    step()
    for _ in range(3):
        start = time.perf_counter()
        for _ in range(steps):
            step()
        best = min(best, (time.perf_counter() - start) / steps)
    return batch / best


def images_of(batch):
    images = 3.4 * (torch.rand(batch, CHANNELS[0], SIZE, SIZE) - .5)
    return images.to(memory_format=torch.channels_last)


def training_rate(network, batch):
    images, truth = images_of(batch), torch.rand(batch, OUTPUTS)
    adam = torch.optim.Adam(network.parameters(), 1e-4)

    def step():
        adam.zero_grad()
        nn.functional.mse_loss(network(images), truth).backward()
        adam.step()

    return rate(step, batch)


def inference_rate(network, batch):
    images = images_of(batch)
    with torch.inference_mode():
        return rate(lambda: network(images), batch)


if __name__ == "__main__":
    torch.set_num_threads(1)
    torch.manual_seed(1)
    made = make_network()
    print(f"PyTorch {torch.__version__}: training {training_rate(made, 60):.1f} images/s at batch "
          f"60; inference of single images {inference_rate(made, 1):.1f} images/s")
