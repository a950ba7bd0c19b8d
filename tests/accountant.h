/* Memory that counts, and fails at a chosen call. Include after itn.h. */
#ifndef ACCOUNTANT_H
#define ACCOUNTANT_H
#include <stdlib.h>

typedef struct accountant {
    long calls, fail_at, live;
    double largest; /* bytes asked for at once */
} accountant;

static void *count_allocate(size_t bytes, void *user) {
    accountant *a = (accountant *)user;
    void *block;
    if ((double)bytes > a->largest) a->largest = (double)bytes;
    if (++a->calls == a->fail_at) return NULL;
    block = malloc(bytes);
    a->live += block != NULL;
    return block;
}
static void count_free(void *block, void *user) {
    ((accountant *)user)->live--;
    free(block);
}
static itn_context count_context(accountant *a) {
    itn_context context = ITN_ZERO;
    context.allocate = count_allocate;
    context.deallocate = count_free;
    context.memory_user = a;
    return context;
}
#endif
