/* Trains a network to read sigma_t, albedo and g off a picture, and tries it: tables 1 and 2 of
   Che et al., "Inverse Transport Networks" (2018).

   You learn: how the three networks of the paper differ, which is in their loss alone: the
   regressor (rn) is told the right answer; the inverse transport network (itn) also how well its
   answer reproduces the picture when rendered; the single-scattering network (ssn) renders that
   with one scattering only. And how to stop and go on without a trace.

   Compile: cc -O3 -march=native train.c -o train -lm -lpthread
   Run:     ./train --model rn --data data --epochs 4 --checkpoint warm.net
            ./train --model itn --data data --start warm.net --epochs 10 --checkpoint itn.net
            ./train --model itn --data data --checkpoint itn.net --evaluate
            ./train --checkpoint itn.net --export ../scenes/data.net
   Prints:  model,split,rmse_sigma_t,rmse_albedo,rmse_g,rmse_image,one_minus_ms_ssim
            itn,train,35.2,0.05236,0.1474,0.01451,0.007087
            ...
   Writes:  the network with Adam's state (itn.net), what else defines the run (itn.net.txt), the
            loss of every step (itn.net.csv) and its chart (itn.net.svg); --evaluate writes the
            table (itn.net.table.csv), every answer (itn.net.answers.csv) and a chart of these
            (itn.net.answers.svg). `--model truth --evaluate` answers with the truth, in
            other samples: its errors are those that noise alone makes. --export writes the network
            without Adam's state, a third of the size, for `invert --net`.
   --channels sets how wide a new network is: layer 1 has that many, each further one twice as many.
   --bend (12) is how much the shapes in the pictures are bent, so that they are less easily learnt
   by heart; some steps at the end with 0 bring back what is lost on known shapes. --bend none shows
   pictures just as they are, and of shapes no variants, as the paper's networks were trained.
   --units own judges answers as equation (3) has it: by their errors in the parameters' own units,
   each over its deviation in the data, which is what the table tells; --units coordinates, the
   default, by those in coordinates (itn_parameter_to_coordinate).
   --start from a network of the same model and units keeps its lambda; --resume keeps all but
   --epochs and -t.
   --leave cube,bolt trains without these of the training shapes; --evaluate of such a network has a
   row `left` of them, as they are, in place of the three splits of the tests: choose by it, then
   test once. The row `train` is of all pictures that were trained on, variants of shapes too.
   --save (120) is how many seconds of training a crash may cost: so often the checkpoint is
   written, to a file of its own that then takes the place of the old one: there is always a whole
   one.
   The image term needs the scenes of all of them: in the whole data 720, 5 GB, of which each of
   several processes holds its part.
   The number of steps that the network has taken says all about where a run is: the order of the
   pictures is a function of (seed, epoch), random numbers of (seed, step, picture). So a run that
   was stopped by Ctrl-C or a crash and goes on with --resume gives the same bits as one that was
   not, on any number of threads.

   On several machines (or processes), each of which takes the same places of every batch and keeps
   the pictures and scenes of these only; once a step they sum the gradients, after which all have
   the same network. Training only; same results but for the rounding of that sum:
            mpicc -DUSE_MPI -O3 -march=native train.c -o train_mpi -lm -lpthread
            mpirun -np 4 ./train_mpi --model itn --data data ... -t 1

   The image term compares pictures of 32 x 32 pixels, which Gaussians of some 50 of the data's
   make, so that both pictures have seen the same filter: what tells materials apart is smooth, and
   noise, of which the gradient is a product of two, is small there. At equal time the gradient is
   three to four times less noisy than that of the data's own pixels.

   A picture is read in five sizes (itn_net_read). Answers are cut to sigma_t 20 to 300, albedo
   .35 to .97, g -.1 to .9. Their errors are in their own units, over all pictures of a split. Of
   --images pictures (default: all) of each split the scene is rendered with the answer and with
   the truth, by the same samples (--spp, 8 unless given, of each pixel of the data's fine film),
   and both once more by others. The two differences of answer and truth have independent noise,
   so that their product is in the mean the square of what the answer does to the picture,
   without any noise; rmse_image is the root of its mean over pixels and pictures, in units of
   the mean brightness of the training pictures. MS-SSIM (Wang, Simoncelli and Bovik 2003) is of
   the means of both runs, and tells noise as well: window 11x11, Gaussian of deviation 1.5, four
   levels (of 128, 64, 32 and 16 pixels) with the first four of the published weights, scaled to
   sum to 1; data range: the largest value of the picture with the truth. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#include "dataset.h"

#include <limits.h>
#include <signal.h>
#ifdef USE_MPI
#include <mpi.h>
#endif

static const char *const usage =
    "usage: train --model rn|ssn|itn|truth --data DIR --checkpoint FILE [--start FILE] [--resume]\n"
    "       [--epochs N] [--batch N] [--rate X] [--spp N] [--lambda X] [--seed N] [-t THREADS]\n"
    "       [--channels N] [--bend PIXELS|none] [--units coordinates|own]\n"
    "       [--leave SHAPE,SHAPE...] [--save SECONDS] [--evaluate] [--images MOST]\n"
    "       train --checkpoint FILE --export FILE\n";

/* ---- several processes ---- */

/* Which of how many processes this one is. */
typedef struct process {
    int rank, count;
} process;

/* A process that ends before its work is done ends the others, which would wait for it. */
#ifdef USE_MPI
static void abandon(void) {
    int done;
    MPI_Finalized(&done);
    if (!done) MPI_Abort(MPI_COMM_WORLD, 1);
}
#endif

static process begin_processes(int *argc, char ***argv) {
    process p = {0, 1};
#ifdef USE_MPI
    int level; /* only the main thread of a process talks to others */
    MPI_Init_thread(argc, argv, MPI_THREAD_FUNNELED, &level);
    MPI_Comm_rank(MPI_COMM_WORLD, &p.rank);
    MPI_Comm_size(MPI_COMM_WORLD, &p.count);
    atexit(abandon);
#endif
    (void)argc, (void)argv;
    return p;
}

static void end_processes(void) {
#ifdef USE_MPI
    MPI_Finalize();
#endif
}

/* Every process gets the sums over all of them. */
static void sum_over_processes(float *values, size_t count) {
#ifdef USE_MPI
    MPI_Allreduce(MPI_IN_PLACE, values, (int)count, MPI_FLOAT, MPI_SUM, MPI_COMM_WORLD);
#endif
    (void)values, (void)count;
}

/* ---- settings ---- */

typedef struct settings {
    const char *data, *checkpoint, *start, *shipped; /* shipped: where to export to */
    process process;
    int epochs, threads, resume, evaluate, most_images, spp, channels; /* 0 = the default */
    double save; /* seconds from checkpoint to checkpoint */
    model model;
} settings;

/* One training step's mean losses. */
typedef struct row {
    int step;
    double parameters, image; /* image: in units of the mean brightness squared */
} row;

/* The paper's three networks differ only in the loss they are trained with, equation (3): without
   the image term, with single scattering in it, with full transport. */
typedef enum network_kind { KIND_RN, KIND_SSN, KIND_ITN } network_kind;

typedef struct trainer {
    const settings *options;
    network_kind kind;
    pictures pictures;
    stages stages; /* a regressor has one scene, for coordinates */
    itn_net *net;
    int *order;           /* of the pictures in this epoch */
    float *targets;       /* [batch][SMALL_PIXELS], not of rn, */
    float reduce[SMALL * FILM]; /* and the weights of pixels in them, see line_weights */
    float *inputs;        /* [batch][2][PIXELS] */
    float *larger;        /* [batch] see vary_picture */
    float *answers, *gradients; /* [batch][3] coordinates */
    float *sums;          /* what processes add up: all gradients of a step, then its three sums */
    row *losses;          /* [batch] of single pictures; image: not in units */
    double spreads[3];    /* the deviations of the parameters in the data */
    int first, step;      /* of the batch: its place in the order; how many steps came before */
    row *rows;            /* the curve so far */
    int row_count;
} trainer;

static volatile sig_atomic_t stop_asked;
static void ask_to_stop(int signal_number) { (void)signal_number, stop_asked = 1; }
static void catch_signals(void) { /* every time that they come, unlike signal() */
#ifdef _WIN32
    signal(SIGINT, ask_to_stop);
#else
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = ask_to_stop, action.sa_flags = SA_RESTART;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL), sigaction(SIGTERM, &action, NULL);
#endif
}

/* ---- pictures shown otherwise ---- */

enum { KNOTS = 8 }; /* of what bends a picture, each way */

static float draw_float(uint64_t *random) { return (float)draw(random); }

/* The first of the four knots whose cubic B-splines reach a pixel (of a line or a column), and what
   these are there. */
static int reaching_knots(int pixel, float splines[4]) {
    float place = (float)pixel * (KNOTS - 3) / FILM, t = place - floorf(place), s = 1 - t;
    splines[0] = s * s * s / 6, splines[1] = (4 + t * t * (3 * t - 6)) / 6;
    splines[2] = (4 + s * s * (3 * s - 6)) / 6, splines[3] = t * t * t / 6;
    return (int)place;
}

/* The sum of four knots, `apart` from each other, times their splines. */
static float blend_knots(const float splines[4], const float *knots, int apart) {
    return splines[0] * knots[0] + splines[1] * knots[apart] + splines[2] * knots[2 * apart] +
           splines[3] * knots[3 * apart];
}

/* Draws knots[KNOTS][KNOTS] of a smooth random function on the film; each is at most `most`. */
static void draw_bend(uint64_t *random, float most, float *knots) {
    int i;
    for (i = 0; i < KNOTS * KNOTS; i++) knots[i] = most * draw_float(random);
}

/* Its values on a line of the film. */
static void bend_line(const float *knots, int y, float values[FILM]) {
    float splines[4], across[KNOTS];
    int first = reaching_knots(y, splines), i, x;
    for (i = 0; i < KNOTS; i++)
        across[i] = blend_knots(splines, knots + first * KNOTS + i, KNOTS);
    for (x = 0; x < FILM; x++) {
        first = reaching_knots(x, splines);
        values[x] = blend_knots(splines, across + first, 1);
    }
}

/* Shows the object otherwise, so that a network reads the material and does not just recognise the
   shape: moved, turned, mirrored, sheared and stretched a little; up to 1.8 times as large or as
   small; bent, its points moved by about a fourth of `bend` pixels each way; and with more noise.
   Returns the logarithm of how much larger. Nothing in the scene but the ground has a size of its
   own, so an object that looks s times as large is that object, with sigma_t / s; for the rest the
   material stays about as it is, though where a picture is bent it is larger or smaller, too.
   Pixels are copied from the nearest: a mean of several would have less noise than the pictures
   that the network is to read. */
static float vary_picture(const float *picture, int bend, uint64_t random, float *varied) {
    float larger = .6f * draw_float(&random), stretched = .25f * draw_float(&random);
    float turned = .15f * draw_float(&random), sheared = .1f * draw_float(&random);
    float right = 4 * draw_float(&random), down = 4 * draw_float(&random);
    float noise = .3f * sqrtf(3) * (draw_float(&random) + 1) / 2; /* of a uniform number */
    float across = expf(-larger - stretched) * (draw(&random) < 0 ? -1.f : 1.f);
    float along = expf(-larger + stretched), middle = (FILM - 1) / 2.f;
    float sine = sinf(turned), cosine = cosf(turned);
    float bends[2][KNOTS * KNOTS], bent[2][FILM]; /* to the right, down */
    int x, y;
    draw_bend(&random, (float)bend, bends[0]), draw_bend(&random, (float)bend, bends[1]);
    for (y = 0; y < FILM; y++) {
        bend_line(bends[0], y, bent[0]), bend_line(bends[1], y, bent[1]);
        for (x = 0; x < FILM; x++) {
            float u = (float)x - middle - right + bent[0][x];
            float v = (float)y - middle - down + bent[1][x];
            float column = middle + across * (cosine * u + (sheared - sine) * v);
            float line = middle + along * (sine * u + cosine * v);
            int from_x = (int)floorf(fmaxf(0, fminf(FILM - 1, column)) + .5f);
            int from_y = (int)floorf(fmaxf(0, fminf(FILM - 1, line)) + .5f);
            varied[y * FILM + x] =
                picture[from_y * FILM + from_x] * (1 + noise * draw_float(&random));
        }
    }
    return larger;
}

/* ---- the loss of a batch ---- */

/* The deviation, in pixels, of what makes small pictures of the data's: theirs together with it is
   that of a small film's filter, half of a pixel there. */
#define REDUCE sqrt(pow(.5 * FILM / SMALL, 2) - DEVIATION * DEVIATION)

static void truth_coordinates(const itn_scene *scene, const int parameters[3], const float *theta,
                              float *truth) {
    int k;
    for (k = 0; k < 3; k++)
        truth[k] = (float)itn_parameter_to_coordinate(itn_parameter_get(scene, parameters[k]),
                                                      (double)theta[k]);
}

static void prepare_input(void *task, int index) {
    trainer *t = (trainer *)task;
    const model *m = &t->options->model;
    int picture = t->order[t->first + index];
    float *input = t->inputs + (size_t)index * 2 * PIXELS, *pixels = input, varied[PIXELS];
    get_picture(&t->pictures, picture, pixels);
    if (t->kind != KIND_RN)
        weigh_picture(pixels, FILM, t->reduce, FILM, 1, SMALL,
                      t->targets + (size_t)index * SMALL_PIXELS);
    t->larger[index] = 0;
    if (m->bend < 0) memcpy(varied, pixels, sizeof varied);
    else
        t->larger[index] =
            vary_picture(pixels, m->bend,
                         mix((uint64_t)m->seed + 1, (uint64_t)t->step, (uint64_t)picture), varied);
    network_input(varied, m->mean, input);
}

/* The squared error of an answer and its gradient, both in coordinates, where the error itself is
   told in the parameters' own units, over their spreads. */
static double own_loss(const trainer *t, const float answer[3], const float theta[3],
                       float gradient[3]) {
    double loss = 0;
    int k;
    for (k = 0; k < 3; k++) {
        const itn_parameter *p = itn_parameter_get(t->stages.any, t->stages.parameters[k]);
        double value = itn_parameter_from_coordinate(p, (double)answer[k]);
        double error = (value - (double)theta[k]) / t->spreads[k];
        loss += error * error;
        gradient[k] = (float)(2 * error * itn_parameter_slope(p, value) / t->spreads[k]);
    }
    return loss;
}

/* The loss of one picture and its gradient in the network's answer, which becomes the answer about
   the picture as it was before it was varied: that one is rendered again. The image term sees the
   answer cut to sensible values, and has no say in an answer beyond them. */
static void picture_loss(void *task, int index) {
    trainer *t = (trainer *)task;
    const model *m = &t->options->model;
    int picture = t->order[t->first + index], k;
    const itn_scene *scene = scene_of(&t->stages, &t->pictures, picture);
    const int *parameters = t->stages.parameters;
    float *answer = t->answers + 3 * index;
    float *gradient = t->gradients + 3 * index, truth[3], cut[3], own_gradient[3];
    itn_render_options options = ITN_ZERO;
    double image_loss = 0, slopes[3] = {0, 0, 0}, lambda = m->lambda / (m->mean * m->mean);
    itn_error error;
    if (!scene) scene = t->stages.any;
    answer[0] += t->larger[index]; /* the coordinate of sigma_t is its logarithm */
    truth_coordinates(scene, parameters, t->pictures.thetas[picture], truth);
    cut_answer(scene, parameters, answer, cut);
    options.spp = m->spp, options.walks = 1, options.max_scatter = t->kind == KIND_SSN ? 1 : 0;
    options.seed = mix((uint64_t)m->seed, (uint64_t)t->step, (uint64_t)picture);
    if (t->kind != KIND_RN && lambda != 0 &&
        itn_loss_image(scene, NULL, &options, t->targets + (size_t)index * SMALL_PIXELS,
                       parameters, 3, cut, &image_loss, slopes, &error))
        fail(error.message, "");
    t->losses[index].image = image_loss;
    t->losses[index].parameters =
        m->own_units ? own_loss(t, answer, t->pictures.thetas[picture], own_gradient)
                     : itn_loss_parameters(3, answer, truth, own_gradient);
    for (k = 0; k < 3; k++)
        gradient[k] = own_gradient[k] + (float)(cut[k] == answer[k] ? lambda * slopes[k] : 0);
}

/* Losses and gradients of the answers of a batch. Returns the mean losses. */
static row answer_losses(trainer *t, int batch) {
    row r;
    int k, threads = t->options->threads;
    double mean = t->options->model.mean;
    memset(&r, 0, sizeof r);
    parallel_for(batch, picture_loss, t, &threads);
    for (k = 0; k < batch; k++) {
        r.parameters += t->losses[k].parameters / batch;
        r.image += t->losses[k].image / (mean * mean) / batch;
    }
    return r;
}

/* The same after the network has answered for the pictures from place `first` of the order on. */
static row batch_losses(trainer *t, int first, int batch) {
    itn_error error;
    int threads = t->options->threads;
    t->first = first;
    parallel_for(batch, prepare_input, t, &threads);
    if (itn_net_forward(t->net, batch, t->inputs, t->answers, &error)) fail(error.message, "");
    return answer_losses(t, batch);
}

/* ---- the order of the pictures, and whose they are ---- */

/* Each place of a batch has an equal part of the pictures for itself, those from part(place) to
   before part(place + 1), one of them in every batch of an epoch. So a process that takes the same
   places of every batch needs the pictures of these only, and how many processes there are makes no
   difference to the batches. */
static int part(const trainer *t, int place) {
    return (int)((int64_t)place * t->pictures.count / t->options->model.batch);
}

/* The first place of a batch that is not for the processes before the one of this rank. */
static int place_of(const trainer *t, int rank) {
    return (int)((int64_t)t->options->model.batch * rank / t->options->process.count);
}

/* How many of the places before this one have a picture in a batch; all, but in the last of an
   epoch. */
static int taken_before(const trainer *t, int batch, int place) {
    int i, taken = 0;
    for (i = 0; i < place; i++) taken += part(t, i + 1) - part(t, i) > batch;
    return taken;
}

/* Puts the pictures in an order, batch after batch. */
static void draw_order(trainer *t, uint64_t seed) {
    int *shuffled = (int *)need((size_t)t->pictures.count, sizeof *shuffled);
    int places = t->options->model.batch, next = 0, batch, place;
    for (place = 0; place < places; place++)
        shuffle(shuffled + part(t, place), part(t, place + 1) - part(t, place),
                mix(seed, (uint64_t)place, 3));
    for (batch = 0; next < t->pictures.count; batch++)
        for (place = 0; place < places; place++)
            if (part(t, place) + batch < part(t, place + 1))
                t->order[next++] = part(t, place) + shuffled[part(t, place) + batch];
    free(shuffled);
}

/* A batch of the order: how many pictures it has, of them `mine` from place `first` of the order on
   for this process. */
typedef struct share {
    int count, first, mine;
} share;

static share share_of(const trainer *t, int batch) {
    int rank = t->options->process.rank, before = taken_before(t, batch, place_of(t, rank));
    share s;
    s.count = taken_before(t, batch, t->options->model.batch);
    s.first = batch * t->options->model.batch + before;
    s.mine = taken_before(t, batch, place_of(t, rank + 1)) - before;
    return s;
}

/* One step with a batch of the order. Returns whether a process was asked to stop. */
static int train_step(trainer *t, int batch) {
    share s = share_of(t, batch);
    itn_error error;
    size_t count;
    float *gradients = itn_net_gradients(t->net, &count), *sums = t->sums + count;
    int k;
    row r;
    memset(&r, 0, sizeof r);
    t->step = (int)itn_net_steps(t->net);
    itn_net_zero_gradients(t->net);
    if (s.mine) {
        r = batch_losses(t, s.first, s.mine);
        for (k = 0; k < 3 * s.mine; k++) t->gradients[k] /= (float)s.count;
        if (itn_net_backward(t->net, s.mine, t->gradients, &error)) fail(error.message, "");
    }
    sums[0] = (float)(r.parameters * s.mine / s.count);
    sums[1] = (float)(r.image * s.mine / s.count);
    sums[2] = stop_asked ? 1.f : 0.f;
    if (t->options->process.count > 1) {
        memcpy(t->sums, gradients, count * sizeof *gradients);
        sum_over_processes(t->sums, count + 3);
        memcpy(gradients, t->sums, count * sizeof *gradients);
    }
    if (itn_net_step(t->net, t->options->model.rate, &error)) fail(error.message, "");
    r.step = t->step + 1, r.parameters = (double)sums[0], r.image = (double)sums[1];
    t->rows[t->row_count++] = r;
    return sums[2] > 0;
}

/* ---- curves and checkpoints ---- */

/* The mean losses of all epochs, as polylines on a logarithmic scale. */
static void save_chart(const trainer *t, int steps_per_epoch) {
    static const char *const colours[] = {"#1f77b4", "#d62728"};
    static const char *const names[] = {"parameters", "image"};
    char path[PATH_SIZE];
    int epochs = t->row_count ? (t->rows[t->row_count - 1].step - 1) / steps_per_epoch + 1 : 1;
    double(*means)[3] = (double(*)[3])need((size_t)epochs, sizeof *means);
    double low = 1e300, high = 1e-300, decades;
    FILE *file;
    int i, k;
    for (i = 0; i < t->row_count; i++) {
        double *mean = means[(t->rows[i].step - 1) / steps_per_epoch];
        mean[0] += t->rows[i].parameters, mean[1] += t->rows[i].image, mean[2]++;
    }
    for (i = 0; i < epochs; i++)
        for (k = 0; k < 2; k++) {
            double mean = means[i][k] /= fmax(means[i][2], 1);
            if (mean > 0) low = fmin(low, mean), high = fmax(high, mean);
        }
    low = pow(10, floor(log10(fmin(low, high)))), high = pow(10, ceil(log10(high)));
    decades = fmax(log10(high / low), 1);
    snprintf(path, sizeof path, "%s.svg", t->options->checkpoint);
    file = begin_file(path);
    fprintf(file, "<svg xmlns='http://www.w3.org/2000/svg' width='640' height='360' font-size='13' "
            "font-family='sans-serif'><rect width='640' height='360' fill='white'/>"
            "<text x='60' y='20'>%s: mean loss of an epoch</text><path d='M60 30V320H520' "
            "stroke='#888' fill='none'/><text x='240' y='350'>epoch (1 to %d)</text>",
            t->options->model.name, epochs);
    for (i = 0; i <= (int)(decades + .5); i++)
        fprintf(file, "<path d='M56 %.1fH520' stroke='#ddd'/><text x='8' y='%.1f'>%.0e</text>",
                320 - 290 * i / decades, 324 - 290 * i / decades, low * pow(10, i));
    for (k = 0; k < 2; k++) {
        fprintf(file, "<polyline fill='none' stroke-width='2' stroke='%s' points='", colours[k]);
        for (i = 0; i < epochs; i++)
            if (means[i][k] > 0)
                fprintf(file, "%.1f,%.1f ", 60 + 460. * i / (epochs > 1 ? epochs - 1 : 1),
                        320 - 290 * log10(means[i][k] / low) / decades);
        fprintf(file, "'/><text x='530' y='%d' fill='%s'>%s</text>", 50 + 20 * k, colours[k],
                names[k]);
    }
    fprintf(file, "</svg>\n");
    end_file(file, path);
    free(means);
}

/* The curve first: rows beyond the network's steps are dropped when it is read. All are always of
   one run, as another is not begun over them. */
static void save_checkpoint(const trainer *t) {
    char path[PATH_SIZE];
    itn_error error;
    FILE *file;
    int i;
    snprintf(path, sizeof path, "%s.csv", t->options->checkpoint);
    file = begin_file(path);
    fprintf(file, "step,parameters,image\n");
    for (i = 0; i < t->row_count; i++)
        fprintf(file, "%d,%.17g,%.17g\n", t->rows[i].step, t->rows[i].parameters, t->rows[i].image);
    end_file(file, path);
    save_model(t->options->checkpoint, &t->options->model);
    if (itn_net_save(t->net, t->options->checkpoint, 0, &error)) fail(error.message, "");
}

static void load_curve(trainer *t, const char *network) {
    char path[PATH_SIZE];
    int steps = (int)itn_net_steps(t->net);
    FILE *file;
    row r;
    snprintf(path, sizeof path, "%s.csv", network);
    file = fopen(path, "r");
    if (!file) fail(path, "cannot be read");
    if (fscanf(file, "step,parameters,image") < 0) fail(path, "is empty");
    while (t->row_count < steps &&
           fscanf(file, "%d,%lf,%lf", &r.step, &r.parameters, &r.image) == 3 &&
           r.step == t->row_count + 1 && isfinite(r.parameters) && isfinite(r.image))
        t->rows[t->row_count++] = r;
    fclose(file);
    if (t->row_count < steps) fail(path, "does not hold every step of the network, in order");
}

/* ---- a run ---- */

/* Starts the outputs at the mean of all answers, so that training need not bring them there. */
static void set_biases(trainer *t) {
    size_t count;
    float *weights = itn_net_parameters(t->net, &count), truth[3];
    int i, k;
    for (i = 0; i < t->pictures.count; i++) {
        truth_coordinates(t->stages.any, t->stages.parameters, t->pictures.thetas[i], truth);
        for (k = 0; k < 3; k++)
            weights[count - 3 + (size_t)k] += truth[k] / (float)t->pictures.count;
    }
}

/* The deviations of the three parameters in the pictures' truths. */
static void measure_spreads(const pictures *p, double spreads[3]) {
    int i, k;
    for (k = 0; k < 3; k++) {
        double sum = 0, squares = 0;
        for (i = 0; i < p->count; i++) sum += (double)p->thetas[i][k] / p->count;
        for (i = 0; i < p->count; i++) squares += pow((double)p->thetas[i][k] - sum, 2) / p->count;
        spreads[k] = squares > 0 ? sqrt(squares) : 1;
    }
}

/* The mean image loss of the true answers for the batch that was answered last: its noise. */
static double noise_loss(trainer *t, int batch) {
    network_kind kind = t->kind;
    double noise;
    int k;
    for (k = 0; k < batch; k++) {
        const float *theta = t->pictures.thetas[t->order[t->first + k]];
        truth_coordinates(t->stages.any, t->stages.parameters, theta, t->answers + 3 * k);
        t->larger[k] = 0;
    }
    t->kind = KIND_ITN;
    noise = answer_losses(t, batch).image;
    t->kind = kind;
    return noise;
}

/* Makes both terms of the loss about equally large over some pictures. Their noise, of which no
   answer can rid the image term, does not count. */
static void choose_lambda(trainer *t, model *m) {
    int rounds = 0, all = t->pictures.count < 128 ? t->pictures.count : 128;
    double parameters = 0, image = 0, noise = 0;
    m->lambda = 1; /* so that it renders */
    draw_order(t, mix((uint64_t)m->seed, 0, 2));
    do {
        share s = share_of(t, rounds);
        float sums[3] = {0, 0, 0};
        if (s.mine) {
            row r = batch_losses(t, s.first, s.mine);
            double weight = (double)s.mine / s.count;
            sums[0] = (float)(r.parameters * weight), sums[1] = (float)(r.image * weight);
            sums[2] = (float)(noise_loss(t, s.mine) * weight);
        }
        sum_over_processes(sums, 3);
        parameters += (double)sums[0], image += (double)sums[1], noise += (double)sums[2];
    } while ((++rounds + 1) * m->batch <= all);
    if (!(image > 0))
        fail("--lambda", "cannot be chosen, as noise hides the image loss: take more --spp, or name "
             "one");
    m->lambda = parameters / fmax(image - noise, .1 * image);
    if (!t->options->process.rank)
        fprintf(stderr, "%s: losses of parameters %.4g, of images %.4g, of which noise %.4g: "
                "lambda %.4g\n", m->name, parameters / rounds, image / rounds, noise / rounds,
                m->lambda);
}

/* The pictures that a process trains with, from *first to before *end; one that has no place in a
   batch keeps one all the same, as it needs a scene. */
static void find_pictures(const trainer *t, int *first, int *end) {
    *first = part(t, place_of(t, t->options->process.rank));
    *end = part(t, place_of(t, t->options->process.rank + 1));
    if (*first == *end && *first == t->pictures.count) --*first;
    if (*first == *end) *end = *first + 1;
}

/* from: the file of the network to go on with, or NULL for a new one. */
static void make_trainer(trainer *t, const settings *o, const char *from) {
    itn_net_desc desc = ITN_ZERO;
    itn_context context = ITN_ZERO;
    itn_error error;
    size_t batch = (size_t)o->model.batch, count;
    int first, end;
    t->options = o;
    load_pictures(o->data, SPLIT_TRAIN, &t->pictures);
    keep_shapes(&t->pictures, o->model.leave, 0, o->model.bend < 0);
    if (!t->pictures.count) fail(o->data, "has no pictures for this");
    measure_spreads(&t->pictures, t->spreads);
    find_pictures(t, &first, &end);
    t->kind = !strcmp(o->model.name, "itn") ? KIND_ITN
              : !strcmp(o->model.name, "ssn") ? KIND_SSN : KIND_RN;
    load_stages(&t->pictures, first, end, t->kind == KIND_RN ? 1 : end - first, FILM_SMALL,
                o->data, o->threads, &t->stages);
    context.parallel_for = parallel_for, context.parallel_user = (void *)&o->threads;
    desc.batch = o->model.batch, desc.seed = (uint64_t)o->model.seed;
    desc.first_channels = o->channels;
    if (from) {
        t->net = open_network(from, o->model.batch, &context);
        if (o->channels && itn_net_shape(t->net).first_channels != o->channels)
            fail(from, "has another number of --channels");
    } else if (itn_net_create(&desc, &context, &t->net, &error)) fail(error.message, "");
    line_weights(FILM, SMALL, 0, FILM / SMALL, REDUCE, t->reduce);
    itn_net_parameters(t->net, &count);
    t->sums = (float *)need(count + 3, sizeof *t->sums);
    t->order = (int *)need((size_t)t->pictures.count, sizeof *t->order);
    t->targets = (float *)need(batch, SMALL_PIXELS * sizeof(float));
    t->inputs = (float *)need(batch, 2 * PIXELS * sizeof(float));
    t->larger = (float *)need(batch, sizeof(float));
    t->answers = (float *)need(batch, 3 * sizeof(float));
    t->gradients = (float *)need(batch, 3 * sizeof(float));
    t->losses = (row *)need(batch, sizeof *t->losses);
}

static void free_trainer(trainer *t) {
    free_stages(&t->stages);
    itn_net_free(t->net);
    free_pictures(&t->pictures);
    free(t->rows), free(t->losses), free(t->gradients), free(t->answers);
    free(t->larger), free(t->inputs), free(t->targets), free(t->order), free(t->sums);
}

static void show_progress(const trainer *t, int steps, double start, int first_step) {
    const row *r = &t->rows[t->row_count - 1];
    double rate = (r->step - first_step) / (seconds() - start);
    fprintf(stderr, "\r%s: step %d of %d, loss %.4f + %.3g x %.4g, %.1f images/s, %.0f s left    ",
            t->options->model.name, r->step, steps, r->parameters, t->options->model.lambda,
            r->image, rate * t->options->model.batch, (steps - r->step) / rate);
}

/* Loads the start or the checkpoint; settings that a resumed run shares with it are its own. */
static void begin(trainer *t, settings *o, int *last_step, int *per_epoch) {
    const char *from = o->resume ? o->checkpoint : o->start;
    double lambda = o->model.lambda;
    model before, asked = o->model;
    int first, end;
    if (!o->resume && !o->process.rank && !access(o->checkpoint, F_OK) &&
        (!o->start || strcmp(o->start, o->checkpoint)))
        fail(o->checkpoint, "is there already: go on with --resume, or name another one");
    if (o->resume) load_model(o->checkpoint, &o->model);
    if (strcmp(asked.name, o->model.name)) fail(o->checkpoint, "is of another --model");
    if (!o->process.rank) try_file(o->checkpoint);
    make_trainer(t, o, from);
    o->model.mean = mean_brightness(&t->pictures);
    *per_epoch = (t->pictures.count + o->model.batch - 1) / o->model.batch;
    if (o->epochs > INT_MAX / *per_epoch) fail("--epochs", "needs a smaller number");
    *last_step = *per_epoch * o->epochs;
    if (itn_net_steps(t->net) > (uint64_t)*last_step) fail(from, "has more --epochs behind it");
    t->rows = (row *)need((size_t)*last_step + 1, sizeof *t->rows);
    if (from) {
        load_model(from, &before);
        if (before.batch != o->model.batch || before.seed != o->model.seed ||
            before.mean != o->model.mean || strcmp(before.leave, o->model.leave))
            fail(from, "was trained with another batch, seed or data, or leaves out other shapes");
        load_curve(t, from);
    } else {
        set_biases(t);
    }
    if (o->model.batch > t->pictures.count) fail("--batch", "is more than there are pictures");
    find_pictures(t, &first, &end);
    if (o->process.count > 1) keep_pixels(&t->pictures, first, end);
    if (o->resume) return;
    if (t->kind == KIND_RN) o->model.lambda = 0;
    else if (lambda < 0 && from && !strcmp(before.name, o->model.name) &&
             before.own_units == o->model.own_units)
        o->model.lambda = before.lambda; /* the same loss goes on */
    else if (lambda < 0) choose_lambda(t, &o->model);
}

static int train(settings *o) {
    static trainer t;
    int last, per_epoch, step, epoch = -1, first_step;
    int stop = 0, first_process = !o->process.rank;
    double start = seconds(), saved = start, shown = 0;
    catch_signals();
    begin(&t, o, &last, &per_epoch);
    first_step = step = (int)itn_net_steps(t.net);
    start = seconds();
    for (; step < last && !stop; step++) {
        if (epoch != step / per_epoch) {
            epoch = step / per_epoch;
            draw_order(&t, mix((uint64_t)o->model.seed, (uint64_t)epoch, 1));
        }
        stop = train_step(&t, step % per_epoch);
        if (!first_process) continue;
        if (seconds() - shown > .5) show_progress(&t, last, start, first_step), shown = seconds();
        if (seconds() - saved > o->save) save_checkpoint(&t), saved = seconds();
    }
    if (first_process && (step > first_step || !o->resume)) save_checkpoint(&t);
    if (first_process) save_chart(&t, per_epoch);
    if (first_process && step > first_step) {
        show_progress(&t, last, start, first_step);
        fputc('\n', stderr);
        printf("%s: steps %d to %d in %.1f s, loss %.4f + %.4g x %.4g\n", o->model.name,
               first_step + 1, step, seconds() - start, t.rows[t.row_count - 1].parameters,
               o->model.lambda, t.rows[t.row_count - 1].image);
    }
    free_trainer(&t);
    return step < last ? 3 : 0;
}

/* ---- how alike pictures look ---- */

typedef struct similarity {
    double structure, whole; /* means of contrast x structure; of that x luminance */
} similarity;

/* SSIM of two pictures of size x size pixels with values up to `range` (Wang et al. 2004), over all
   windows that lie inside. */
static similarity compare_level(const float *a, const float *b, int size, double range) {
    enum { WINDOW = 11 };
    double weights[WINDOW], sum = 0, c1 = pow(.01 * range, 2), c2 = pow(.03 * range, 2);
    int x, y, i, j, windows = size - WINDOW + 1;
    similarity mean = {0, 0};
    for (i = 0; i < WINDOW; i++) sum += weights[i] = exp(-pow((i - 5) / 1.5, 2) / 2);
    for (y = 0; y < windows; y++)
        for (x = 0; x < windows; x++) {
            double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0, structure;
            for (j = 0; j < WINDOW; j++)
                for (i = 0; i < WINDOW; i++) {
                    double w = weights[i] * weights[j] / (sum * sum);
                    double va = a[(y + j) * size + x + i], vb = b[(y + j) * size + x + i];
                    ma += w * va, mb += w * vb;
                    aa += w * va * va, bb += w * vb * vb, ab += w * va * vb;
                }
            aa -= ma * ma, bb -= mb * mb, ab -= ma * mb;
            structure = (2 * ab + c2) / (aa + bb + c2);
            mean.structure += structure;
            mean.whole += structure * (2 * ma * mb + c1) / (ma * ma + mb * mb + c1);
        }
    mean.structure /= windows * windows, mean.whole /= windows * windows;
    return mean;
}

static void halve(float *picture, int size) {
    int x, y, half = size / 2;
    for (y = 0; y < half; y++)
        for (x = 0; x < half; x++) {
            const float *p = picture + 2 * y * size + 2 * x;
            picture[y * half + x] = (p[0] + p[1] + p[size] + p[size + 1]) / 4;
        }
}

/* MS-SSIM of `picture` and `other`, which are used up. */
static double ms_ssim(float *picture, float *other) {
    static const double weights[4] = {.0448, .2856, .3001, .2363};
    double range = 0, result = 1;
    int i, level, size = FILM;
    for (i = 0; i < PIXELS; i++) range = fmax(range, picture[i]);
    for (level = 0; level < 4; level++, size /= 2) {
        similarity s = compare_level(picture, other, size, range > 0 ? range : 1);
        double term = level < 3 ? s.structure : s.whole;
        result *= pow(fmax(term, 0), weights[level] / .8668);
        halve(picture, size), halve(other, size);
    }
    return result;
}

/* ---- evaluation ---- */

enum { MOST_NETS = 16 }; /* with more, opening them takes longer than it saves */

static const char *const result_endings[3] = {"table.csv", "answers.csv", "answers.svg"};

typedef struct answer {
    float truth[3], coordinates[3], values[3];
    /* NaN where the picture was not rendered again; mse can fall below 0 by chance */
    double mse, one_minus_ms_ssim;
} answer;

/* A split and what the network says about it. */
typedef struct trial {
    const settings *options;
    split in;
    pictures pictures;
    stages stages;
    int judged; /* how many are rendered again */
    float weights[FILM * FINE]; /* fine_weights */
    answer *answers;
    itn_net *const *nets; /* [net_count], one for a thread; NULL: the truth is the answer */
    int net_count;
} trial;

/* A picture of a scene with three parameters changed. */
static void render_values(const trial *t, const itn_scene *scene, const float values[3],
                          uint64_t seed, float *picture) {
    int spp = t->options->spp ? t->options->spp : 8;
    render_picture(scene, t->stages.parameters, values, t->weights, spp, seed, picture);
}

/* Renders one of the scenes with the predicted parameters and with the true ones, each twice, and
   compares. */
static void judge(void *task, int index) {
    trial *t = (trial *)task;
    int i = evenly(index, t->judged, t->pictures.count);
    answer *a = &t->answers[i];
    const itn_scene *scene = scene_of(&t->stages, &t->pictures, i);
    uint64_t seed = mix((uint64_t)t->options->model.seed, (uint64_t)t->in, (uint64_t)i);
    int other = !strcmp(t->options->model.name, "truth"), k; /* other samples */
    float *truths[2], *images[2];
    double sum = 0;
    for (k = 0; k < 2; k++) {
        truths[k] = (float *)need(2 * PIXELS, sizeof(float)), images[k] = truths[k] + PIXELS;
        render_values(t, scene, a->truth, seed + 2 * (uint64_t)k, truths[k]);
        render_values(t, scene, a->values, seed + 2 * (uint64_t)k + (uint64_t)other, images[k]);
    }
    for (k = 0; k < PIXELS; k++) {
        sum += (double)(truths[0][k] - images[0][k]) * (double)(truths[1][k] - images[1][k]);
        truths[0][k] = (truths[0][k] + truths[1][k]) / 2;
        images[0][k] = (images[0][k] + images[1][k]) / 2;
    }
    a->mse = sum / PIXELS / pow(t->options->model.mean, 2);
    a->one_minus_ms_ssim = 1 - ms_ssim(truths[0], images[0]);
    free(truths[0]), free(truths[1]);
}

/* Asks one of the networks about its share of the pictures. */
static void ask(void *task, int index) {
    trial *t = (trial *)task;
    itn_net *net = t->nets[index];
    float *picture = (float *)need(PIXELS, sizeof(float));
    const itn_scene *scene = t->stages.any;
    const int *parameters = t->stages.parameters;
    int i, k;
    for (i = index; i < t->pictures.count; i += t->net_count) {
        answer *a = &t->answers[i];
        float *coordinates = a->coordinates;
        memcpy(a->truth, t->pictures.thetas[i], sizeof a->truth);
        a->mse = a->one_minus_ms_ssim = NAN;
        truth_coordinates(scene, parameters, a->truth, coordinates);
        if (net) {
            get_picture(&t->pictures, i, picture);
            read_picture(net, t->options->model.mean, scene, parameters, picture, coordinates);
        }
        for (k = 0; k < 3; k++)
            a->values[k] = (float)itn_parameter_from_coordinate(
                itn_parameter_get(scene, parameters[k]), (double)coordinates[k]);
    }
    free(picture);
}

/* Where some shapes were left out of training, they take the place of the last split. */
static int is_of_left(const trial *t) {
    return strcmp(t->options->model.leave, "none") && t->in != SPLIT_TRAIN;
}
static const char *trial_name(const trial *t) {
    return is_of_left(t) ? "left" : split_names[t->in];
}

/* One row of tables 1 and 2. */
static void print_row(const trial *t, FILE *file) {
    double sums[5] = {0, 0, 0, 0, 0};
    int i, k, count = t->pictures.count;
    for (i = 0; i < count; i++) {
        const answer *a = &t->answers[i];
        for (k = 0; k < 3; k++) sums[k] += pow((double)(a->values[k] - a->truth[k]), 2) / count;
        if (isnan(a->mse)) continue;
        sums[3] += a->mse / t->judged, sums[4] += a->one_minus_ms_ssim / t->judged;
    }
    fprintf(file, "%s,%s,%.4g,%.4g,%.4g,%.4g,%.4g\n", t->options->model.name,
            trial_name(t), sqrt(sums[0]), sqrt(sums[1]), sqrt(sums[2]), sqrt(fmax(sums[3], 0)),
            sums[4]);
}

static void print_answers(const trial *t, FILE *file) {
    int i;
    for (i = 0; i < t->pictures.count; i++) {
        const answer *a = &t->answers[i];
        const shard *s = &t->pictures.shards[t->pictures.shard_of[i]];
        fprintf(file, "%s,%s,%d,%g,%g,%g,%.5g,%.5g,%.5g,%.5g,%.5g\n", trial_name(t),
                shape_names[s->shape], s->azimuth, (double)a->truth[0], (double)a->truth[1],
                (double)a->truth[2], (double)a->values[0], (double)a->values[1],
                (double)a->values[2], isnan(a->mse) ? NAN : sqrt(fmax(a->mse, 0)),
                a->one_minus_ms_ssim);
    }
}

/* Dots of answer over truth: some 600 of each split, a colour a split and a frame a parameter. */
static void draw_answers(const trial *t, FILE *file) {
    static const char *const colours[SPLITS] = {"#999999", "#2ca02c", "#1f77b4", "#d62728"};
    static const char *const names[3] = {"sigma_t (logarithmic)", "albedo", "g"};
    int every = 1 + (t->pictures.count - 1) / 600, i, k;
    for (k = 0; k < 3 && t->in == SPLIT_TRAIN; k++)
        fprintf(file, "<rect x='%d' y='40' width='240' height='240' fill='none' stroke='#888'/>"
                "<path d='M%d 280l240 -240' stroke='#ccc'/><text x='%d' y='30'>%s, %g to %g</text>",
                40 + 280 * k, 40 + 280 * k, 40 + 280 * k, names[k], (double)lowest_answer[k],
                (double)highest_answer[k]);
    fprintf(file, "<text x='%d' y='310' fill='%s'>%s</text><g fill='%s' fill-opacity='.5'>",
            440 + 60 * (int)t->in, colours[t->in], trial_name(t), colours[t->in]);
    for (i = 0; i < t->pictures.count; i += every)
        for (k = 0; k < 3; k++) {
            double at[3], low = lowest_answer[k], high = highest_answer[k], shift = i % 9 - 4;
            at[0] = t->answers[i].truth[k], at[1] = t->answers[i].values[k], at[2] = high;
            if (k == 0) at[0] = log(at[0] / low), at[1] = log(at[1] / low), at[2] = log(high / low);
            else at[0] -= low, at[1] -= low, at[2] -= low;
            fprintf(file, "<circle cx='%.1f' cy='%.1f' r='2'/>", /* spread a little to be seen */
                    40 + 280 * k + 240 * at[0] / at[2] + shift, 280 - 240 * at[1] / at[2]);
        }
    fprintf(file, "</g>");
}

static void result_path(const char *checkpoint, int result, char path[PATH_SIZE]) {
    snprintf(path, PATH_SIZE, "%s.%s", checkpoint, result_endings[result]);
}

static void try_split(trial *t, FILE *files[3]) {
    int threads = t->options->threads, left = is_of_left(t);
    const model *m = &t->options->model;
    load_pictures(t->options->data, left ? SPLIT_TRAIN : t->in, &t->pictures);
    if (t->in == SPLIT_TRAIN || left) keep_shapes(&t->pictures, m->leave, left, m->bend < 0);
    if (!t->pictures.count) {
        fprintf(stderr, "%s: no pictures\n", trial_name(t));
        free_pictures(&t->pictures);
        return;
    }
    t->judged = t->pictures.count;
    if (t->options->most_images && t->judged > t->options->most_images)
        t->judged = t->options->most_images;
    t->answers = (answer *)need((size_t)t->pictures.count, sizeof *t->answers);
    fine_weights(t->weights);
    load_stages(&t->pictures, 0, t->pictures.count, t->judged, FILM_FINE, t->options->data, threads,
                &t->stages);
    parallel_for(t->net_count, ask, t, &threads);
    parallel_for(t->judged, judge, t, &threads);
    print_row(t, stdout), print_row(t, files[0]);
    print_answers(t, files[1]);
    draw_answers(t, files[2]);
    fflush(stdout);
    free_stages(&t->stages);
    free(t->answers);
    free_pictures(&t->pictures);
}

static int evaluate(settings *o) {
    static const char *const head =
        "model,split,rmse_sigma_t,rmse_albedo,rmse_g,rmse_image,one_minus_ms_ssim\n";
    itn_net *nets[MOST_NETS] = {NULL};
    int truth = !strcmp(o->model.name, "truth"), net_count = 1, in, k;
    char path[PATH_SIZE];
    FILE *files[3];
    if (!truth) {
        model asked = o->model;
        load_model(o->checkpoint, &o->model);
        if (strcmp(asked.name, o->model.name)) fail(o->checkpoint, "is of another --model");
        o->model.seed = asked.seed;
        if ((net_count = o->threads) > MOST_NETS) net_count = MOST_NETS;
        for (k = 0; k < net_count; k++) nets[k] = open_reader(o->checkpoint);
    } else {
        pictures p;
        load_pictures(o->data, SPLIT_TRAIN, &p);
        keep_shapes(&p, o->model.leave, 0, o->model.bend < 0); /* as make_trainer */
        o->model.mean = mean_brightness(&p);
        free_pictures(&p);
    }
    for (in = 0; in < 3; in++)
        result_path(o->checkpoint, in, path), files[in] = begin_file(path);
    fprintf(files[1], "split,shape,azimuth,sigma_t,albedo,g,answer_sigma_t,answer_albedo,answer_g,"
            "rmse_image,one_minus_ms_ssim\n");
    fprintf(files[2], "<svg xmlns='http://www.w3.org/2000/svg' width='880' height='330' font-size="
            "'13' font-family='sans-serif'><rect width='880' height='330' fill='white'/>"
            "<text x='40' y='310'>%s: answers (up) over truths (right); splits:</text>",
            o->model.name);
    fprintf(files[0], "%s", head), printf("%s", head);
    for (in = 0; in < SPLITS; in++) {
        static trial t;
        if (strcmp(o->model.leave, "none") && (in == SPLIT_SHAPE || in == SPLIT_LIGHT)) continue;
        memset(&t, 0, sizeof t);
        t.options = o, t.in = (split)in, t.nets = nets, t.net_count = net_count;
        try_split(&t, files);
    }
    fprintf(files[2], "</svg>\n");
    for (in = 0; in < 3; in++) result_path(o->checkpoint, in, path), end_file(files[in], path);
    for (k = 0; k < net_count; k++) itn_net_free(nets[k]);
    return 0;
}

/* Whether both are there and one file. */
static int is_same_file(const char *a, const char *b) {
    struct stat one, other;
    return !stat(a, &one) && !stat(b, &other) && one.st_dev == other.st_dev &&
           one.st_ino == other.st_ino;
}

/* Refuses to write a network over a file of the checkpoint. */
static void keep_checkpoint(const char *checkpoint, const char *shipped) {
    static const char *const endings[] = {"", ".txt", ".csv"};
    char from[PATH_SIZE], to[PATH_SIZE];
    int i, k;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 2; k++) {
            snprintf(from, sizeof from, "%s%s", checkpoint, endings[i]);
            snprintf(to, sizeof to, "%s%s", shipped, endings[k]);
            if (is_same_file(from, to)) fail(to, "is a file of the checkpoint itself");
        }
}

/* Writes the network of the checkpoint without Adam's state, to be used and not trained further. */
static int export_network(settings *o) {
    itn_net *net;
    itn_error error;
    char path[PATH_SIZE];
    load_model(o->checkpoint, &o->model);
    keep_checkpoint(o->checkpoint, o->shipped);
    net = open_reader(o->checkpoint);
    snprintf(path, sizeof path, "%s.txt", o->shipped);
    remove(path); /* without it, a network that is there alone is refused */
    if (itn_net_save(net, o->shipped, 1, &error)) fail(error.message, "");
    save_model(o->shipped, &o->model);
    itn_net_free(net);
    return 0;
}

/* The names of training shapes after --leave. */
static void take_leave(const char *list, model *m) {
    size_t length = 0;
    int i, count = 0;
    for (i = 0; i < TRAINING_SHAPES; i++)
        if (is_listed(shape_names[i], list)) length += strlen(shape_names[i]) + 1, count++;
    if (length != strlen(list) + 1 || count == TRAINING_SHAPES)
        fail("--leave", "needs names of training shapes with commas, not of all of them");
    snprintf(m->leave, sizeof m->leave, "%s", list);
}

/* Whether the units after --units are the parameters' own. */
static int take_units(const char *units) {
    int own = !strcmp(units, "own");
    if (!own && strcmp(units, "coordinates")) fail("--units", "needs own or coordinates");
    return own;
}

/* What a model keeps of --bend. */
static int take_bend(const char *pixels) {
    int bend = strcmp(pixels, "none") ? whole("--bend", pixels, 0) : -1;
    if (bend > FILM) fail("--bend", "needs `none` or a number from 0 to 128");
    return bend;
}

/* The truth has nothing to be trained, but can be tried. */
static int is_model(const char *name, int tried) {
    return !strcmp(name, "rn") || !strcmp(name, "ssn") || !strcmp(name, "itn") ||
           (tried && !strcmp(name, "truth"));
}

static int show_usage(void) {
    fprintf(stderr, "%s", usage);
    return 1;
}

int main(int argc, char **argv) {
    static settings o;
    const char *name = "";
    int i, status;
    o.process = begin_processes(&argc, &argv);
    o.epochs = 50, o.model.batch = 16, o.model.seed = 1, o.model.rate = 1e-4, o.model.lambda = -1;
    o.model.bend = 12, o.save = 120;
    snprintf(o.model.leave, sizeof o.model.leave, "none");
    o.threads = default_threads();
    for (i = 1; i < argc; i++) {
        const char *option = argv[i], *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (!strcmp(option, "--resume")) { o.resume = 1; continue; }
        if (!strcmp(option, "--evaluate")) { o.evaluate = 1; continue; }
        if (!value) fail(option, "unknown option, or its value is missing");
        i++;
        if (!strcmp(option, "--model")) name = value;
        else if (!strcmp(option, "--data")) o.data = short_path(value);
        else if (!strcmp(option, "--checkpoint")) o.checkpoint = short_path(value);
        else if (!strcmp(option, "--start")) o.start = short_path(value);
        else if (!strcmp(option, "--export")) o.shipped = short_path(value);
        else if (!strcmp(option, "--epochs")) o.epochs = whole(option, value, 1);
        else if (!strcmp(option, "--batch")) o.model.batch = whole(option, value, 1);
        else if (!strcmp(option, "--rate")) o.model.rate = number(option, value, 1e-9, 1);
        else if (!strcmp(option, "--spp")) o.spp = whole(option, value, 2);
        else if (!strcmp(option, "--lambda")) o.model.lambda = number(option, value, 0, 1e9);
        else if (!strcmp(option, "--channels")) o.channels = whole(option, value, 1);
        else if (!strcmp(option, "--seed")) o.model.seed = whole(option, value, 0);
        else if (!strcmp(option, "--bend")) o.model.bend = take_bend(value);
        else if (!strcmp(option, "--units")) o.model.own_units = take_units(value);
        else if (!strcmp(option, "--leave")) take_leave(value, &o.model);
        else if (!strcmp(option, "--save")) o.save = number(option, value, 0, 1e9);
        else if (!strcmp(option, "--images")) o.most_images = whole(option, value, 1);
        else if (!strcmp(option, "-t")) o.threads = whole(option, value, 1);
        else fail(option, "unknown option");
    }
    snprintf(o.model.name, sizeof o.model.name, "%s", name);
    o.model.spp = o.spp ? o.spp : 16;
    if (o.checkpoint && o.shipped) status = export_network(&o);
    else if (!o.data || !o.checkpoint || !is_model(name, o.evaluate)) status = show_usage();
    else status = o.evaluate ? evaluate(&o) : train(&o);
    end_processes();
    return status;
}
