/* itn.h within a program that has threads, memory and a cancel button of its own.

   You learn: itn_context, which hands a caller's allocator and parallel loops to all that is made
   with it, and progress callbacks, which report and cancel. Results are the same bits as with one
   thread.

   Compile: cc -O3 -march=native host.c -o host -lm -lpthread
   Run:     ./host ../../scenes/default.itn */
#define ITN_IMPLEMENTATION
#include "../../itn.h"
#include <pthread.h>

/* ---- a pool: workers sleep until there is a loop, and take its steps one after the other ---- */
enum { WORKERS = 3 };
typedef struct pool {
    pthread_t threads[WORKERS];
    pthread_mutex_t mutex;
    pthread_cond_t work, done;
    void (*body)(void *task, int index);
    void *task;
    int next, count, busy, stop;
} pool;

/* Takes steps of the loop that is under way until none is left. Called, and returns, locked. */
static void take_part(pool *p) {
    while (p->next < p->count) {
        int index = p->next++;
        p->busy++;
        pthread_mutex_unlock(&p->mutex);
        p->body(p->task, index);
        pthread_mutex_lock(&p->mutex);
        if (!--p->busy && p->next >= p->count) pthread_cond_broadcast(&p->done);
    }
}
static void *worker(void *user) {
    pool *p = (pool *)user;
    pthread_mutex_lock(&p->mutex);
    for (; !p->stop; take_part(p))
        while (!p->stop && p->next >= p->count) pthread_cond_wait(&p->work, &p->mutex);
    pthread_mutex_unlock(&p->mutex);
    return NULL;
}
static void parallel_for(int count, void (*body)(void *task, int index), void *task, void *user) {
    pool *p = (pool *)user;
    pthread_mutex_lock(&p->mutex);
    p->body = body, p->task = task, p->next = 0, p->count = count;
    pthread_cond_broadcast(&p->work);
    take_part(p);
    while (p->busy) pthread_cond_wait(&p->done, &p->mutex);
    pthread_mutex_unlock(&p->mutex);
}

/* ---- memory that is counted, called from all threads ---- */
typedef struct heap {
    pthread_mutex_t mutex;
    size_t blocks, calls;
} heap;
static void count_block(heap *h, int change) {
    pthread_mutex_lock(&h->mutex);
    h->blocks += (size_t)change, h->calls += change > 0;
    pthread_mutex_unlock(&h->mutex);
}
static void *allocate(size_t bytes, void *user) {
    void *block = malloc(bytes);
    if (block) count_block((heap *)user, 1);
    return block;
}
static void deallocate(void *block, void *user) {
    if (block) count_block((heap *)user, -1);
    free(block);
}

/* ---- a progress bar, whose user gives up half-way ---- */
static int bar(void *user, double fraction) {
    printf("\r%3.0f %%", 100 * fraction), fflush(stdout);
    return fraction > *(const double *)user;
}

int main(int argc, char **argv) {
    static pool p = {.mutex = PTHREAD_MUTEX_INITIALIZER, .work = PTHREAD_COND_INITIALIZER,
                     .done = PTHREAD_COND_INITIALIZER};
    static heap h = {.mutex = PTHREAD_MUTEX_INITIALIZER};
    const char *path = argc > 1 ? argv[1] : "../../scenes/default.itn";
    itn_context context = ITN_ZERO;
    itn_render_options options = ITN_ZERO;
    itn_scene *scene, *alone;
    itn_image image, same;
    itn_error error;
    double patience = .5;
    context.allocate = allocate, context.deallocate = deallocate, context.memory_user = &h;
    context.parallel_for = parallel_for, context.parallel_user = &p;
    for (int i = 0; i < WORKERS; i++)
        if (pthread_create(&p.threads[i], NULL, worker, &p)) return 1;
    if (itn_scene_load(path, &context, &scene, &error) ||
        itn_scene_load(path, NULL, &alone, &error))
        return fprintf(stderr, "%s\n", error.message), 1;

    options.spp = 8, options.progress = bar, options.progress_user = &patience;
    itn_result cancelled = itn_render(scene, NULL, &options, NULL, 0, &image, &error);
    printf("\n%s\n", itn_result_text(cancelled));
    options.progress = NULL;
    if (itn_render(scene, NULL, &options, NULL, 0, &image, &error) ||
        itn_render(alone, NULL, &options, NULL, 0, &same, &error))
        return fprintf(stderr, "%s\n", error.message), 1;
    size_t size = (size_t)image.width * (size_t)image.height * sizeof(float);
    int differ = memcmp(image.pixels, same.pixels, size) != 0;
    printf("%s with four threads and with one\n", differ ? "other bits" : "the same bits");

    itn_image_free(&image), itn_image_free(&same), itn_scene_free(scene), itn_scene_free(alone);
    pthread_mutex_lock(&p.mutex);
    p.stop = 1, pthread_cond_broadcast(&p.work);
    pthread_mutex_unlock(&p.mutex);
    for (int i = 0; i < WORKERS; i++) pthread_join(p.threads[i], NULL);
    printf("%lu blocks were allocated, %lu are left\n", (unsigned long)h.calls,
           (unsigned long)h.blocks);
    return differ || h.blocks || cancelled != ITN_ERROR_CANCELLED;
}
