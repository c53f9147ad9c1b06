/* A fuzzing host for one FMU, FMI 2.0 or 3.0: calls in any order with any values, in several threads, for some seconds.

       fuzz LIBRARY FOLDER SECONDS SEED THREADS

   FOLDER holds the FMU's resources and fuzz.txt, its variables; tests/fuzzing.py compiles all, writes that table and runs this. Ends with 0
   if nothing was found: no crash, no call that took more than 60 s, no answer that FMI or the FMU's own interface forbids. Else it tells
   the seed and the last calls of the thread. With one thread a seed gives the same calls again. */

#include "../../examples/c_host/platform.h"

#include "fuzz.h"

#include <signal.h>
#include <unistd.h>

enum { LONGEST_CALL_S = 60 };

static unsigned long long seed;
static struct fmu fmu;
static struct table table;
static char *resources;
static int n_threads;
static struct thread *threads;
static __thread struct thread *self;
static pthread_mutex_t telling = PTHREAD_MUTEX_INITIALIZER;

void *symbol_of(void *library, const char *name) { return symbol(library, name); }

void said(void *environment, const char *text) {
    struct thread *t = environment;
    if (t) snprintf(t->last_text, sizeof t->last_text, "%s", text);
}

void begin(struct thread *t, const char *name, const struct instance *m, double detail) {
    t->calls[t->n_calls++ % LAST_CALLS] = (struct call){name, m->id, m->phase, detail, -1};
    t->began = now();
}

int end(struct thread *t, int status) {
    t->began = 0.0;
    t->calls[(t->n_calls - 1) % LAST_CALLS].status = status;
    t->n_refused += status > WARNING;
    if (status < OK || status > ERROR) found(t, "a status that means the end of the process, or none that FMI has");
    return status;
}

static void tell(const struct thread *t, const char *what) {
    fprintf(stderr, "\nFOUND: %s\nseed %llu, threads %d, thread %d, its call %lu; ", what, seed, n_threads, t->number, t->n_calls);
    fprintf(stderr, "the last calls, newest last:\n");
    for (unsigned long k = t->n_calls > LAST_CALLS ? t->n_calls - LAST_CALLS : 0; k < t->n_calls; k++) {
        const struct call *c = t->calls + k % LAST_CALLS;
        fprintf(stderr, "  instance %u, phase %d: %s (%g) -> %d\n", c->instance, (int)c->phase, c->name, c->detail, c->status);
    }
    fprintf(stderr, "the FMU said last: %s\n", t->last_text);
}

void found(struct thread *t, const char *what) {
    pthread_mutex_lock(&telling);
    tell(t, what);
    _exit(2);
}

/* A sanitizer calls this before it ends the process. */
static void at_death(void) {
    if (self) tell(self, "see the sanitizer's report");
}

static void at_signal(int number) {
    signal(number, SIG_DFL);
    if (self) tell(self, strsignal(number));
    raise(number);
}

#pragma weak __sanitizer_set_death_callback
void __sanitizer_set_death_callback(void (*)(void));

/* What FMI 3.0 has in place of a URI. */
static char *resources_path(const char *folder) {
    static const char inside[] = "/resources/";
    char *whole = absolute(folder);
    return whole ? strcat(realloc(whole, strlen(whole) + sizeof inside), inside) : NULL;
}

static void *run(void *argument) {
    struct thread *t = self = argument;
    while (now() < t->end) act(t);
    free_all(t);
    t->is_done = 1;
    return NULL;
}

static void prepare(struct thread *t, int number, double seconds) {
    *t = (struct thread){.number = number, .fmu = &fmu, .table = &table, .resources = resources, .end = now() + seconds};
    t->random.state = seed * 1000003 + (unsigned)number;
    t->references = calloc(table.n + 1, sizeof *t->references);
    t->values = calloc(table.n_elements + 1, sizeof *t->values);
    t->outputs = calloc(table.n_outputs + 1, sizeof *t->outputs);
    t->again = calloc(table.n_outputs + 1, sizeof *t->again);
}

/* Sleep until all is done, and see that no call hangs. */
static void watch(void) {
    for (int left = n_threads; left;) {
        nanosleep(&(struct timespec){.tv_nsec = 100000000}, NULL);
        left = n_threads;
        for (struct thread *t = threads; t < threads + n_threads; t++) {
            const double began = t->began;
            if (began > 0.0 && now() - began > LONGEST_CALL_S) found(t, "a call takes more than 60 s");
            left -= t->is_done;
        }
    }
}

int main(int argc, char **argv) {
    if (argc != 6) return fprintf(stderr, "usage: %s LIBRARY FOLDER SECONDS SEED THREADS\n", argv[0]), 1;
    const double seconds = atof(argv[3]);
    seed = strtoull(argv[4], NULL, 10);
    n_threads = atoi(argv[5]);
    void *library = load(argv[1]);
    if (!library) return fprintf(stderr, "%s does not load: %s\n", argv[1], load_error()), 1;
    table = read_table(argv[2]);
    const char *missing = table.version == 3 ? bind_fmi3(&fmu, library) : bind_fmi2(&fmu, library);
    if (missing) return fprintf(stderr, "%s has no function %s\n", argv[1], missing), 1;
    resources = table.version == 3 ? resources_path(argv[2]) : resources_uri(argv[2]);

    if (__sanitizer_set_death_callback)
        __sanitizer_set_death_callback(at_death);
    else
        for (int i = 0; i < 5; i++) signal((int[]){SIGSEGV, SIGABRT, SIGFPE, SIGILL, SIGBUS}[i], at_signal);
    threads = calloc((size_t)n_threads, sizeof *threads);
    for (int i = 0; i < n_threads; i++) {
        prepare(threads + i, i, seconds);
        pthread_create(&threads[i].thread, NULL, run, threads + i);
    }
    watch();
    unsigned long calls = 0, refused = 0, steps = 0;
    for (int i = 0; i < n_threads; i++) {
        pthread_join(threads[i].thread, NULL);
        calls += threads[i].n_calls, refused += threads[i].n_refused, steps += threads[i].n_steps;
    }
    if (!steps) return fprintf(stderr, "no step was done in %lu calls; the FMU said last: %s\n", calls, threads->last_text), 1;
    printf("nothing found in %lu calls, %lu of them refused, and %lu steps", calls, refused, steps);
    printf(" (seed %llu, threads %d)\n", seed, n_threads);
    return 0;
}
