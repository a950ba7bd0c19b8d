/* A search for bytes that break what fuzz.h says, by Clang's libFuzzer: make -C tests fuzz, or by
   hand, from within tests, with FUZZ one of scene obj ply exr pfm png net desc:

     clang -g1 -O1 -fsanitize=fuzzer,address,undefined fuzz.c -o build/fuzz -lm
     mkdir -p build/obj; FUZZ=obj build/fuzz -max_total_time=600 -max_len=1000 build/obj

   It begins with what is in corpus/, which is written to build/. Given files, it tries these alone.
   A line for the corpus:  od -An -v -tx1 FILE | tr -d '\n' | tr ' ' '\\'; echo */
#define ITN_NO_STDIO
#define ITN_STATIC
#define ITN_IMPLEMENTATION
#include "../itn.h"
#include <stdio.h>
#define FUZZ_HOLDS(condition)                                                                      \
    do {                                                                                           \
        if (!(condition)) printf("%s:%d: %s\n", __FILE__, __LINE__, #condition), abort();          \
    } while (0)
#include "fuzz.h"


static void unpack(const char *kind, int number, const unsigned char *bytes, size_t size) {
    char path[100];
    snprintf(path, sizeof path, "build/%s/corpus%d", kind, number);
    FILE *file = fopen(path, "wb");
    if (file) fwrite(bytes, 1, size, file), fclose(file);
}
int LLVMFuzzerInitialize(int *count, char ***words);
int LLVMFuzzerInitialize(int *count, char ***words) {
    (void)count, (void)words;
    if (!getenv("FUZZ") || !fuzz_corpus(getenv("FUZZ"), unpack))
        printf("FUZZ is not a kind, or this is not the folder tests\n"), exit(2);
    return 0;
}
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    fuzz_one(getenv("FUZZ"), bytes, size, 0);
    return 0;
}
