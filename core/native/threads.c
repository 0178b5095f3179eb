/* Distributes work among threads, which last for one call, or until their work is ended. */

#include <stdatomic.h>
#include <stdlib.h>

#include "kiriko.h"

#define MOST_THREADS 64

typedef struct {
    Work work;
    void *context;
    int64_t n, at_once;
    atomic_llong next, n_done;
} Shared;

static void take_turns(Shared *shared) {
    for (;;) {
        int64_t first = atomic_fetch_add(&shared->next, shared->at_once);
        if (first >= shared->n) return;
        int64_t last = first + shared->at_once;
        shared->work(shared->context, first, last < shared->n ? last : shared->n);
        atomic_fetch_add(&shared->n_done, shared->at_once);
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

/* Work in progress. */
struct Begun {
    Shared shared;
    Thread threads[MOST_THREADS];
    int64_t n_threads; /* in addition to the calling thread */
};

static void begin_threads(Begun *begun, int64_t n_threads) {
    const Shared *shared = &begun->shared;
    int64_t most = (shared->n + shared->at_once - 1) / shared->at_once;
    if (n_threads > MOST_THREADS) n_threads = MOST_THREADS;
    if (n_threads > most) n_threads = most;
    begun->n_threads = 0;
    while (begun->n_threads < n_threads && begin(&begun->threads[begun->n_threads], &begun->shared))
        begun->n_threads++;
}

static void end_threads(Begun *begun) {
    for (int64_t k = 0; k < begun->n_threads; k++) end(begun->threads[k]);
}

/* Do work of n parts, `at_once` at a time, in up to n_threads threads including this one. */
void share_out(Work work, void *context, int64_t n, int64_t at_once, int64_t n_threads) {
    Begun begun = {.shared = {.work = work, .context = context, .n = n, .at_once = at_once}};
    atomic_init(&begun.shared.next, 0);
    atomic_init(&begun.shared.n_done, 0);
    /* this thread works as well */
    int64_t most = (n + at_once - 1) / at_once;
    begin_threads(&begun, (n_threads < most ? n_threads : most) - 1);
    take_turns(&begun.shared);
    end_threads(&begun);
}

/* Begin work of n parts in n_threads - 1 other threads; this one is free until kiriko_end. NULL if memory is short. */
Begun *begin_work(Work work, void *context, int64_t n, int64_t n_threads) {
    Begun *begun = malloc(sizeof *begun);
    if (!begun) return NULL;
    begun->shared.work = work;
    begun->shared.context = context;
    begun->shared.n = n;
    begun->shared.at_once = 1;
    atomic_init(&begun->shared.next, 0);
    atomic_init(&begun->shared.n_done, 0);
    begin_threads(begun, n_threads - 1);
    return begun;
}

/* True if all parts of the work are done, or no thread could be started, so that kiriko_end does them. */
KIRIKO_API int64_t kiriko_is_done(Begun *begun) {
    return !begun->n_threads || atomic_load(&begun->shared.n_done) >= begun->shared.n;
}

/* End work, with the help of this thread; parts not begun are dropped unless wanted. */
KIRIKO_API void kiriko_end(Begun *begun, int64_t is_wanted) {
    if (!begun) return;
    if (!is_wanted) atomic_store(&begun->shared.next, begun->shared.n);
    take_turns(&begun->shared);
    end_threads(begun);
    free(begun);
}
