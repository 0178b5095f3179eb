/* Lets a library of the kernel follow the rays of a file, as scripts/check_kernel.py wrote it: follow LIBRARY IN OUT.

   The file: numbers of blocks, of pointers and of outputs, of the block of the plan, of that of the rays, and of rays,
   all int64; of each block its size and its bytes; of each pointer its block, its place there, and the block and the
   place that it points to; the blocks that are written to OUT afterwards. */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef void (*Follow)(const void *plan, void *rays, int64_t first, int64_t last, int64_t n_threads);

#if defined(_WIN32)
#include <windows.h>
static Follow load(const char *path) {
    HMODULE library = LoadLibraryA(path);
    return library ? (Follow)(void *)GetProcAddress(library, "kiriko_follow") : NULL;
}
#else
#include <dlfcn.h>
static Follow load(const char *path) {
    void *library = dlopen(path, RTLD_NOW);
    return library ? (Follow)dlsym(library, "kiriko_follow") : NULL;
}
#endif

static int64_t number(FILE *file) {
    int64_t n = 0;
    if (fread(&n, sizeof n, 1, file) != 1) exit(2);
    return n;
}

int main(int n_arguments, char **arguments) {
    if (n_arguments != 4) return 2;
    Follow follow = load(arguments[1]);
    FILE *in = fopen(arguments[2], "rb"), *out = fopen(arguments[3], "wb");
    if (!follow || !in || !out) return 3;
    int64_t n_blocks = number(in), n_pointers = number(in), n_outputs = number(in);
    int64_t plan = number(in), rays = number(in), n_rays = number(in);
    char **blocks = calloc((size_t)n_blocks, sizeof *blocks);
    int64_t *sizes = calloc((size_t)n_blocks, sizeof *sizes);
    for (int64_t i = 0; i < n_blocks; i++) {
        sizes[i] = number(in);
        blocks[i] = malloc((size_t)sizes[i] + 1);
        if (sizes[i] && fread(blocks[i], (size_t)sizes[i], 1, in) != 1) return 2;
    }
    for (int64_t i = 0; i < n_pointers; i++) {
        int64_t block = number(in), place = number(in), to = number(in), there = number(in);
        char *address = blocks[to] + there;
        memcpy(blocks[block] + place, &address, sizeof address);
    }
    follow(blocks[plan], blocks[rays], 0, n_rays, 2);
    for (int64_t i = 0; i < n_outputs; i++) {
        int64_t block = number(in);
        fwrite(blocks[block], (size_t)sizes[block], 1, out);
    }
    return fclose(out) ? 4 : 0;
}
