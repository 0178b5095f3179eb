/* Shares work out among threads, which last as long as one call. */

#include <stdatomic.h>

#include "kiriko.h"

#define MOST_THREADS 64

typedef struct {
    Work work;
    void *context;
    int64_t n, at_once;
    atomic_llong next;
} Shared;

static void take_turns(Shared *shared) {
    for (;;) {
        int64_t first = atomic_fetch_add(&shared->next, shared->at_once);
        if (first >= shared->n) return;
        int64_t last = first + shared->at_once;
        shared->work(shared->context, first, last < shared->n ? last : shared->n);
    }
}

#if defined(_WIN32)

#include <windows.h>

typedef HANDLE Thread;

static DWORD WINAPI run(void *shared) {
    take_turns(shared);
    return 0;
}

static bool begin(Thread *thread, Shared *shared) {
    *thread = CreateThread(NULL, 0, run, shared, 0, NULL);
    return *thread != NULL;
}

static void end(Thread thread) {
    WaitForSingleObject(thread, INFINITE);
    CloseHandle(thread);
}

#else

#include <pthread.h>

typedef pthread_t Thread;

static void *run(void *shared) {
    take_turns(shared);
    return NULL;
}

static bool begin(Thread *thread, Shared *shared) { return pthread_create(thread, NULL, run, shared) == 0; }

static void end(Thread thread) { pthread_join(thread, NULL); }

#endif

/* Do work of n parts, so many at once, in that many threads, this one among them. Where no more can be had, fewer do. */
void share_out(Work work, void *context, int64_t n, int64_t at_once, int64_t n_threads) {
    Shared shared = {.work = work, .context = context, .n = n, .at_once = at_once};
    Thread threads[MOST_THREADS];
    int64_t n_begun = 0, most = (n + at_once - 1) / at_once;
    atomic_init(&shared.next, 0);
    if (n_threads > MOST_THREADS) n_threads = MOST_THREADS;
    if (n_threads > most) n_threads = most;
    while (n_begun < n_threads - 1 && begin(&threads[n_begun], &shared)) n_begun++;
    take_turns(&shared);
    for (int64_t k = 0; k < n_begun; k++) end(threads[k]);
}
