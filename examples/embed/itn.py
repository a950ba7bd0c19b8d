"""itn.h from Python: ctypes and NumPy, one file.

Once, in this folder: cc -O3 -march=native -shared -fPIC -DITN_THREADS -DITN_IMPLEMENTATION -x c ../../itn.h -o libitn.so -lm
Then, a notebook's ten lines:

    import itn
    scene = itn.Scene("../../scenes/default.itn")
    image, derivatives = scene.render(spp=16, derivatives=["milk.albedo", "milk.g"])
    itn.save_png(image, "picture.png")
    guess = dict(scene.values, **{"milk.albedo": .8})
    loss, gradient = scene.loss(image, guess, ["milk.albedo"])      # what an autograd function calls
    print(scene.refine(image, guess, ["milk.albedo"]))              # {name: (value, error, determined)}

Images are arrays [channels][height][width], parameters dicts of names; what the library refuses is raised as itn.Error.
"""
import ctypes as c
import os
import sys

import numpy as np

lib = c.CDLL(os.environ.get("ITN_LIBRARY", os.path.join(os.path.dirname(os.path.abspath(__file__)), "libitn.so")))
FLOATS = c.POINTER(c.c_float)

def struct(name, fields):
    """A struct of the header, of the size that it has there, or an error."""
    made = type(name, (c.Structure,), {"_fields_": fields})
    if c.sizeof(made) != lib.itn_size_of(name.encode()):
        raise ImportError("%s: libitn.so is of another version than itn.py" % name)
    return made

lib.itn_size_of.restype = c.c_size_t
Context = struct("itn_context", [("pointers", c.c_void_p * 5), ("threads", c.c_int)])
ErrorText = struct("itn_error", [("code", c.c_int), ("line", c.c_int), ("message", c.c_char * 1000)])
Image = struct("itn_image", [("width", c.c_int), ("height", c.c_int), ("plane_count", c.c_int), ("names", c.c_void_p),
                             ("pixels", FLOATS), ("codes", c.c_int), ("gamma", c.c_float), ("context", Context)])
Parameter = struct("itn_parameter", [("name", c.c_char * 64), ("value", c.c_float), ("lower", c.c_float),
                                     ("upper", c.c_float), ("transform", c.c_int)])
Options = struct("itn_render_options", [
    ("spp", c.c_int), ("seed", c.c_uint64), ("max_scatter", c.c_int), ("mode", c.c_int), ("sampler", c.c_int),
    ("estimator", c.c_int), ("walks", c.c_int), ("pointers", c.c_void_p * 4)])  # samples, progress, user, stats
Refine = struct("itn_refine_options", [
    ("iterations", c.c_int), ("max_scatter", c.c_int), ("spp", c.c_int), ("final_spp", c.c_int), ("seed", c.c_uint64),
    ("seconds", c.c_double), ("target_variance", FLOATS), ("pointers", c.c_void_p * 4)])
Estimate = struct("itn_estimate", [("value", c.c_double), ("error", c.c_double), ("determined", c.c_int)])
lib.itn_parameter_get.restype = c.POINTER(Parameter)

Error = type("Error", (Exception,), {})

def call(function, *arguments):
    error = ErrorText()
    if function(*arguments, c.byref(error)):
        raise Error(error.message.decode())

def floats(array):
    """A pointer to float32 numbers, which keeps them alive."""
    return np.ascontiguousarray(array, np.float32).ctypes.data_as(FLOATS)

def save_png(image, path):
    count, height, width = image.shape
    names = c.create_string_buffer(64 * count)
    held = Image(width, height, count, c.addressof(names), floats(image))
    call(lib.itn_image_save_png, c.byref(held), 0, count, 0, c.c_float(0), path.encode())

class Scene:
    def __init__(self, path):
        self.handle = c.c_void_p()
        call(lib.itn_scene_load, path.encode(), None, c.byref(self.handle))
        held = [lib.itn_parameter_get(self.handle, i)[0] for i in range(lib.itn_parameter_count(self.handle))]
        self.values = {p.name.decode(): p.value for p in held}
        self.names = list(self.values)

    def __del__(self):
        lib.itn_scene_free(self.handle)

    def theta(self, values, names):
        """Values as the array of all parameters, and the indices of names."""
        known = dict(self.values, **(values or {}))
        return [known[n] for n in self.names], (c.c_int * max(len(names), 1))(*[self.names.index(n) for n in names])

    def render(self, values=None, spp=64, seed=0, derivatives=()):
        """The picture and {name: its derivative}."""
        theta, asked = self.theta(values, derivatives)
        image, options = Image(), Options(spp=spp, seed=seed)
        call(lib.itn_render, self.handle, floats(theta), c.byref(options), asked, len(derivatives), c.byref(image))
        planes = np.ctypeslib.as_array(image.pixels, (image.plane_count, image.height, image.width)).copy()
        lib.itn_image_free(c.byref(image))
        planes = planes.reshape(1 + len(derivatives), 2, -1, *planes.shape[1:])[:, 0]  # without variances
        return planes[0], dict(zip(derivatives, planes[1:]))

    def loss(self, target, values, names, spp=16, seed=0):
        """The mean of (picture - target)^2 at the values and its gradient, both without bias."""
        theta, asked = self.theta(values, names)
        loss, gradient, options = c.c_double(), (c.c_double * len(names))(), Options(spp=spp, seed=seed)
        call(lib.itn_loss_gradient, self.handle, floats(theta), c.byref(options), floats(target), asked, len(names),
             c.byref(loss), gradient)
        return loss.value, np.array(gradient)

    def refine(self, target, values, names, spp=16, seconds=60):
        """{name: (value, standard error, whether the picture determines it)}."""
        theta, asked = self.theta(values, names)
        estimates, options = (Estimate * len(names))(), Refine(spp=spp, seconds=seconds)
        call(lib.itn_refine, self.handle, floats(theta), floats(target), asked, len(names), c.byref(options),
             estimates)
        return {n: (e.value, e.error, bool(e.determined)) for n, e in zip(names, estimates)}

if __name__ == "__main__":
    scene = Scene(sys.argv[1] if len(sys.argv) > 1 else "../../scenes/default.itn")
    image, slopes = scene.render(spp=8, derivatives=["milk.albedo"])
    guess = dict(scene.values, **{"milk.albedo": .8})
    loss, gradient = scene.loss(image, guess, ["milk.albedo"])
    value, error, determined = scene.refine(image, guess, ["milk.albedo"])["milk.albedo"]
    print("loss %.3g, gradient %.3g; albedo %.4f +- %.4f" % (loss, gradient[0], value, error))
    save_png(image, "python.png")
    try:
        scene.render({"milk.albedo": 7})
    except Error as refused:
        print("refused:", refused)
        sys.exit(0 if determined and gradient[0] < 0 and abs(value - scene.values["milk.albedo"]) < 4 * error else 1)
