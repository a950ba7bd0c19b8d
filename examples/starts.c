/* What a network's answer is worth as the start of a search: table 3 of Che et al., "Inverse
   Transport Networks" (2018); and pictures of what the networks' answers look like.

   You learn: how to go on from a network's estimate with plain stochastic gradient descent on
   itn_loss_gradient, as the paper does, and with itn_refine's Gauss-Newton.

   Compile: cc -O3 -march=native starts.c -o starts -lm -lpthread
   Run:     ./starts --data data -o out rn.net ssn.net itn.net
   Writes:  out/table3.csv with lines as
            start,method,iteration,images,loss,log_sigma_t,albedo,g
            rn,sgd,1,40,0.0254,1.45,0.00407,0.171
            and out/figure.png, with numbers in out/figure.svg: two pictures of each split, then
            each network's answer rendered.
   The table holds medians over --images pictures of each shape of the split `both`: the image loss
   in units of the mean brightness squared, without the noise of renders but with the picture's own,
   and the squared errors of log sigma_t, albedo and g. Iteration 1 is the start. Descent steps in
   the optimiser's coordinates.
   A row lm, 20 is what itn_refine returns after 20 iterations at most (a tenth of --iterations).
   Searches start from the answers of rn and itn.
   Results are the same bits for any number of threads. */
#define _POSIX_C_SOURCE 200809L
#define _DARWIN_C_SOURCE /* else macOS hides sysconf's number of processors */
#include "dataset.h"

static const char *const usage =
    "usage: starts --data DIR -o DIR [--images N] [--iterations N] [--spp N] [--rate X]\n"
    "              [--seed N] [-t THREADS] NETWORK...\n";

enum {
    MOST_NETWORKS = 4,
    MOST_MARKS = 16,
    MARK = 50, /* iterations from mark to mark */
    MOST_SEARCHES = 4096,
    FIGURE_ROWS = 2 * SPLITS,
    FIGURE_EFFORT = 4 /* its samples to those of a step, for calm pictures */
};

typedef struct settings {
    const char *data, *out, *networks[MOST_NETWORKS];
    int network_count, images, iterations, spp, seed, threads;
    double rate;
} settings;

/* Where a search stands at iterations 1, 50, 100, ... of descent or at the end of refinement. */
typedef struct mark {
    double loss, errors[3];
} mark;

enum { DESCENT, REFINEMENT };

/* One picture, one network's answer, one method. */
typedef struct search {
    int picture, network;
    int method;
    float answer[3];   /* coordinates */
    double mean;       /* of the pictures' brightness, in whose units the network's losses are */
    mark marks[MOST_MARKS];
} search;

typedef struct searches {
    const settings *settings;
    pictures pictures;
    stages stages;
    int count;
    search list[MOST_SEARCHES];
} searches;

/* Descent marks its first iteration, then every 50th. */
static int mark_count(const settings *s, int method) {
    return method == REFINEMENT ? 2 : 1 + s->iterations / MARK;
}

static int mark_iteration(const settings *s, int method, int index) {
    if (index == 0) return 1;
    return method == REFINEMENT ? (s->iterations + 9) / 10 : index * MARK;
}

/* ---- searching ---- */

static void set_theta(const searches *all, const itn_scene *scene, const double *coordinates,
                      float *theta) {
    int k;
    itn_parameter_values(scene, theta);
    for (k = 0; k < 3; k++)
        theta[all->stages.parameters[k]] = (float)itn_parameter_from_coordinate(
            itn_parameter_get(scene, all->stages.parameters[k]), coordinates[k]);
}

/* Judges theta with more samples than a step of the search takes. */
static mark judge(const searches *all, const search *one, const itn_scene *scene,
                  const float *theta, const float *target) {
    const float *truth = all->pictures.thetas[one->picture];
    itn_render_options options = ITN_ZERO;
    itn_error error;
    mark m;
    int k;
    options.spp = 4 * all->settings->spp;
    options.seed = mix((uint64_t)all->settings->seed, (uint64_t)one->picture, 7);
    if (itn_loss_gradient(scene, theta, &options, target, NULL, 0, &m.loss, NULL, &error))
        fail(error.message, "");
    m.loss /= one->mean * one->mean;
    for (k = 0; k < 3; k++) {
        double value = theta[all->stages.parameters[k]], right = truth[k];
        m.errors[k] = k ? pow(value - right, 2) : pow(log(value / right), 2);
    }
    return m;
}

/* Plain descent: a fixed rate; no step is longer than half a unit in a coordinate. */
static void descend(const searches *all, search *one, const itn_scene *scene, float *theta,
                    const float *target) {
    const settings *s = all->settings;
    double coordinates[3], gradient[3], loss;
    int i, k;
    for (k = 0; k < 3; k++) coordinates[k] = one->answer[k];
    for (i = 1; i <= s->iterations; i++) {
        itn_render_options options = ITN_ZERO;
        itn_error error;
        options.spp = s->spp, options.walks = 1;
        options.seed = mix((uint64_t)s->seed, (uint64_t)one->picture, 100 + (uint64_t)i);
        set_theta(all, scene, coordinates, theta);
        if (i == 1) one->marks[0] = judge(all, one, scene, theta, target);
        if (itn_loss_gradient(scene, theta, &options, target, all->stages.parameters, 3, &loss,
                              gradient, &error))
            fail(error.message, "");
        for (k = 0; k < 3; k++) {
            const itn_parameter *p = itn_parameter_get(scene, all->stages.parameters[k]);
            double value = theta[all->stages.parameters[k]];
            double step = s->rate * gradient[k] * itn_parameter_slope(p, value);
            double low = itn_parameter_to_coordinate(p, (double)lowest_answer[k]);
            double high = itn_parameter_to_coordinate(p, (double)highest_answer[k]);
            step /= one->mean * one->mean;
            coordinates[k] -= fmax(-.5, fmin(.5, step));
            coordinates[k] = fmax(low, fmin(high, coordinates[k]));
        }
        if (i % MARK) continue;
        set_theta(all, scene, coordinates, theta);
        one->marks[i / MARK] = judge(all, one, scene, theta, target);
    }
}

static void refine(const searches *all, search *one, const itn_scene *scene, float *theta,
                   const float *target) {
    itn_refine_options options = ITN_ZERO;
    itn_estimate estimates[3];
    itn_error error;
    double coordinates[3];
    int k;
    for (k = 0; k < 3; k++) coordinates[k] = one->answer[k];
    set_theta(all, scene, coordinates, theta);
    one->marks[0] = judge(all, one, scene, theta, target);
    options.iterations = mark_iteration(all->settings, REFINEMENT, 1);
    options.spp = all->settings->spp;
    options.seed = mix((uint64_t)all->settings->seed, (uint64_t)one->picture, 8);
    if (itn_refine(scene, theta, target, all->stages.parameters, 3, &options, estimates, &error))
        fail(error.message, "");
    one->marks[1] = judge(all, one, scene, theta, target);
}

static void run_search(void *task, int index) {
    searches *all = (searches *)task;
    search *one = &all->list[index];
    const itn_scene *scene = scene_of(&all->stages, &all->pictures, one->picture);
    float *theta = (float *)need((size_t)itn_parameter_count(scene), sizeof *theta);
    float *target = (float *)need(PIXELS, sizeof *target);
    get_picture(&all->pictures, one->picture, target);
    if (one->method == REFINEMENT) refine(all, one, scene, theta, target);
    else descend(all, one, scene, theta, target);
    fprintf(stderr, ".");
    free(target);
    free(theta);
}

/* ---- networks ---- */

static itn_net *open_start(const char *path, model *m) {
    load_model(path, m);
    return open_reader(path);
}

/* ---- table 3 ---- */

/* The median of column `column` (0: loss, 1 to 3: errors) of searches like `like`. */
static double median(const searches *all, const search *like, int at, int column) {
    static double values[MOST_SEARCHES];
    int i, count = 0;
    for (i = 0; i < all->count; i++) {
        const search *one = &all->list[i];
        if (one->network != like->network || one->method != like->method) continue;
        values[count++] = column ? one->marks[at].errors[column - 1] : one->marks[at].loss;
    }
    qsort(values, (size_t)count, sizeof *values, ascending);
    return (values[(count - 1) / 2] + values[count / 2]) / 2;
}

/* Chooses pictures, by chance but for good, and lists a search for each network and method. */
static void list_searches(searches *all) {
    const settings *s = all->settings;
    int *order = (int *)need((size_t)all->pictures.count, sizeof *order);
    int taken[SHAPES] = {0}, i, n, method;
    shuffle(order, all->pictures.count, mix((uint64_t)s->seed, 9, 9));
    for (n = 0; n < s->network_count; n++) {
        model m;
        itn_net *net = open_start(s->networks[n], &m);
        memset(taken, 0, sizeof taken);
        for (i = 0; i < all->pictures.count && strcmp(m.name, "ssn"); i++) {
            int shard_number = all->pictures.shard_of[order[i]];
            float picture[PIXELS], answer[3];
            if (taken[all->pictures.shards[shard_number].shape]++ >= s->images) continue;
            get_picture(&all->pictures, order[i], picture);
            read_picture(net, m.mean, scene_of(&all->stages, &all->pictures, order[i]),
                         all->stages.parameters, picture, answer);
            if (all->count + 2 > MOST_SEARCHES) fail("--images", "makes more than 4096 searches");
            for (method = 0; method < 2; method++) {
                search *one = &all->list[all->count++];
                one->picture = order[i], one->network = n, one->mean = m.mean;
                one->method = method;
                memcpy(one->answer, answer, sizeof answer);
            }
        }
        itn_net_free(net);
    }
    free(order);
}

static void print_table(const searches *all) {
    const settings *s = all->settings;
    char path[PATH_SIZE];
    int n, method, at, i, column, used;
    FILE *file;
    snprintf(path, sizeof path, "%s/table3.csv", s->out);
    file = begin_file(path);
    fprintf(file, "start,method,iteration,images,loss,log_sigma_t,albedo,g\n");
    for (method = 0; method < 2; method++)
        for (n = 0; n < s->network_count; n++) {
            model m;
            search like;
            memset(&like, 0, sizeof like);
            like.network = n, like.method = method;
            load_model(s->networks[n], &m);
            for (i = used = 0; i < all->count; i++)
                used += all->list[i].network == n && all->list[i].method == like.method;
            for (at = 0; used && at < mark_count(s, like.method); at++) {
                fprintf(file, "%s,%s,%d,%d", m.name, method ? "lm" : "sgd",
                        mark_iteration(s, like.method, at), used);
                for (column = 0; column < 4; column++)
                    fprintf(file, ",%.4g", median(all, &like, at, column));
                fprintf(file, "\n");
            }
        }
    end_file(file, path);
    fprintf(stderr, "\n"), printf("table: %s\n", path);
}

static void make_table(const settings *s) {
    static searches all;
    int threads = s->threads;
    all.settings = s;
    load_pictures(s->data, SPLIT_BOTH, &all.pictures);
    load_stages(&all.pictures, 0, all.pictures.count, all.pictures.count, FILM_ONE, s->data,
                threads, &all.stages);
    list_searches(&all);
    parallel_for(all.count, run_search, &all, &threads);
    print_table(&all);
    free_stages(&all.stages);
    free_pictures(&all.pictures);
}

/* ---- the figure ---- */

/* A tile of the figure: a picture and its numbers; column 0 is the input. */
typedef struct tile {
    const itn_scene *scene;
    const int *parameters;
    float values[3], pixels[PIXELS];
    char caption[96];
} tile;

typedef struct figure {
    const settings *settings;
    float weights[FILM * FINE]; /* fine_weights */
    tile tiles[FIGURE_ROWS][MOST_NETWORKS + 1];
} figure;

static void render_tile(void *task, int index) {
    figure *f = (figure *)task;
    tile *t = &f->tiles[index / MOST_NETWORKS][1 + index % MOST_NETWORKS];
    if (t->scene)
        render_picture(t->scene, t->parameters, t->values, f->weights,
                       FIGURE_EFFORT * f->settings->spp, (uint64_t)index, t->pixels);
}

static void write_caption(tile *t, const char *name) {
    snprintf(t->caption, sizeof t->caption, "%s %.0f %.2f %.2f", name, (double)t->values[0],
             (double)t->values[1], (double)t->values[2]);
}

/* Fills row `row` with picture `index` and the networks' answers. */
static void fill_row(figure *f, int row, const pictures *p, int index, const itn_scene *scene,
                     const int parameters[3]) {
    tile *tiles = f->tiles[row];
    int n, k;
    get_picture(p, index, tiles[0].pixels);
    memcpy(tiles[0].values, p->thetas[index], sizeof tiles[0].values);
    write_caption(&tiles[0], split_names[p->shards[0].in]);
    for (n = 0; n < f->settings->network_count; n++) {
        tile *t = &tiles[n + 1];
        float answer[3];
        model m;
        itn_net *net = open_start(f->settings->networks[n], &m);
        read_picture(net, m.mean, scene, parameters, tiles[0].pixels, answer);
        t->scene = scene, t->parameters = parameters;
        for (k = 0; k < 3; k++)
            t->values[k] = (float)itn_parameter_from_coordinate(
                itn_parameter_get(scene, parameters[k]), (double)answer[k]);
        write_caption(t, m.name);
        itn_net_free(net);
    }
}

/* Appends a file in base 64 (RFC 4648). */
static void put_base64(FILE *out, const char *path) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    unsigned char bytes[3];
    size_t count;
    FILE *in = fopen(path, "rb");
    if (!in) fail(path, "cannot be read");
    while (memset(bytes, 0, 3), (count = fread(bytes, 1, 3, in)) > 0) {
        unsigned long all = (unsigned long)bytes[0] << 16 | (unsigned long)bytes[1] << 8 |
                            bytes[2];
        fputc(digits[all >> 18], out), fputc(digits[all >> 12 & 63], out);
        fputc(count > 1 ? digits[all >> 6 & 63] : '=', out);
        fputc(count > 2 ? digits[all & 63] : '=', out);
    }
    if (ferror(in) | fclose(in)) fail(path, "cannot be read");
}

/* The pictures of all tiles as one PNG. */
static void save_tiles(const figure *f, int columns, const char *path) {
    int row, column, y, width = columns * FILM;
    itn_image image;
    itn_error error;
    if (itn_image_create(width, FIGURE_ROWS * FILM, 1, NULL, &image, &error))
        fail(error.message, "");
    for (row = 0; row < FIGURE_ROWS; row++)
        for (column = 0; column < columns; column++)
            for (y = 0; y < FILM; y++)
                memcpy(image.pixels + (row * FILM + y) * width + column * FILM,
                       f->tiles[row][column].pixels + y * FILM, FILM * sizeof(float));
    if (itn_image_save_png(&image, 0, 1, ITN_PNG_TONE, 0, path, &error)) fail(error.message, "");
    itn_image_free(&image);
}

/* Pictures as PNG, and a chart that holds them with sigma_t, albedo and g. */
static void save_figure(const figure *f) {
    int columns = f->settings->network_count + 1, row, column, width = columns * FILM;
    char path[PATH_SIZE], picture[PATH_SIZE];
    FILE *file;
    snprintf(picture, sizeof picture, "%s/figure.png", f->settings->out);
    save_tiles(f, columns, picture);
    snprintf(path, sizeof path, "%s/figure.svg", f->settings->out);
    file = begin_file(path);
    fprintf(file, "<svg xmlns='http://www.w3.org/2000/svg' "
            "xmlns:xlink='http://www.w3.org/1999/xlink' width='%d' height='%d' "
            "font-size='11' font-family='sans-serif'><image width='%d' height='%d' "
            "xlink:href='data:image/png;base64,", width, FIGURE_ROWS * FILM, width,
            FIGURE_ROWS * FILM);
    put_base64(file, picture);
    fprintf(file, "'/>");
    for (row = 0; row < FIGURE_ROWS; row++)
        for (column = 0; column < columns; column++)
            fprintf(file, "<rect x='%d' y='%d' width='128' height='14' fill='white'/><text x='%d' "
                    "y='%d'>%s</text>", column * FILM, row * FILM, column * FILM + 3,
                    row * FILM + 11, f->tiles[row][column].caption);
    fprintf(file, "</svg>\n");
    end_file(file, path);
}

static void make_figure(const settings *s) {
    static figure f;
    itn_scene *scenes[FIGURE_ROWS] = {NULL};
    int parameters[3], row, threads = s->threads;
    f.settings = s, fine_weights(f.weights);
    for (row = 0; row < FIGURE_ROWS; row++) {
        pictures p;
        const shard *in;
        int index;
        load_pictures(s->data, (split)(row / 2), &p);
        if (!p.count) {
            free_pictures(&p);
            continue;
        }
        index = evenly(1 + 2 * (row % 2), 4, p.count);
        in = &p.shards[p.shard_of[index]];
        scenes[row] = load_theta_scene(in, variant_of(in, p.thetas[index]), FILM_FINE,
                                       s->data, parameters);
        fill_row(&f, row, &p, index, scenes[row], parameters);
        free_pictures(&p);
    }
    parallel_for(FIGURE_ROWS * MOST_NETWORKS, render_tile, &f, &threads);
    save_figure(&f);
    for (row = 0; row < FIGURE_ROWS; row++) itn_scene_free(scenes[row]);
}

int main(int argc, char **argv) {
    static settings s;
    int i;
    s.images = 10, s.iterations = 200, s.spp = 16, s.rate = 10, s.seed = 1;
    s.threads = default_threads();
    for (i = 1; i < argc; i++) {
        const char *option = argv[i], *value = i + 1 < argc ? argv[i + 1] : NULL;
        if (option[0] != '-') {
            if (s.network_count == MOST_NETWORKS) fail(option, "is a fifth network: 4 at most");
            s.networks[s.network_count++] = short_path(option);
            continue;
        }
        if (!value) fail(option, "unknown option, or its value is missing");
        i++;
        if (!strcmp(option, "--data")) s.data = short_path(value);
        else if (!strcmp(option, "-o")) s.out = short_path(value);
        else if (!strcmp(option, "--images")) s.images = whole(option, value, 1);
        else if (!strcmp(option, "--iterations")) s.iterations = whole(option, value, 1);
        else if (!strcmp(option, "--spp")) s.spp = whole(option, value, 2);
        else if (!strcmp(option, "--rate")) s.rate = number(option, value, 1e-9, 1e9);
        else if (!strcmp(option, "--seed")) s.seed = whole(option, value, 0);
        else if (!strcmp(option, "-t")) s.threads = whole(option, value, 1);
        else fail(option, "unknown option");
    }
    if (s.iterations / MARK >= MOST_MARKS)
        fail("--iterations", "needs a number of at most 799");
    if (!s.data || !s.out || !s.network_count)
        return fprintf(stderr, "%s", usage), 1;
    make_folder(s.out);
    make_figure(&s);
    make_table(&s);
    return 0;
}
