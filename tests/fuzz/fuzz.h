/* What the files of the fuzzing host share. */

#ifndef FUZZ_H
#define FUZZ_H

#include "fmu.h"

#include <pthread.h>

enum { MOST_INSTANCES = 8, CROWD = 200, MOST_STATES = 8, LAST_CALLS = 32, LONGEST_TEXT = 200 };

/* Where an instance is in FMI's state machine; UNKNOWN after it got a state that may be anybody's. */
enum phase { INSTANTIATED = 1, INITIALISING = 2, STEPPING = 4, TERMINATED = 8, UNKNOWN = 16 };

/* -- values.c: the FMU's variables, from a table that tests/fuzzing.py writes, and values for them */

enum { PARAMETER = 'p', INPUT = 'u', OUTPUT = 'y' };
enum { REAL = 'R', CHOICE = 'I', STRING = 'S' };

struct variable {
    char causality, type, name[256];
    uint32_t reference;
    size_t length; /* elements: 1 in FMI 2.0 */
    double min, max;
    double *starts;
};

struct table {
    int version; /* of FMI: 2 or 3 */
    char identifier[256], token[256];
    size_t n, n_elements, n_outputs; /* variables; elements of all, and of Real outputs */
    uint32_t unknown;                /* a reference above all there are */
    struct variable *variables;
};

struct table read_table(const char *folder);

struct random {
    uint64_t state;
};

uint64_t next(struct random *);
size_t below(struct random *, size_t n);
double uniform(struct random *, double from, double to);
/* A value near what a rover has at this step; a value near the bounds, beyond them, or none at all. */
double sane(const struct variable *, size_t element, unsigned step, struct random *);
double wild(const struct variable *, size_t element, struct random *);

/* -- fuzz.c: the threads, and what is told when something is found */

struct instance {
    void *c; /* NULL: none here */
    enum phase phase;
    double t;
    unsigned id, steps;
};

struct state {
    void *pointer; /* NULL: none here */
    const struct instance *owner;
    unsigned owner_id; /* another one than the owner's: the owner was freed, and the state with it */
    enum phase phase;
    double t;
};

struct call {
    const char *name;
    unsigned instance;
    enum phase phase;
    double detail;
    int status;
};

struct thread {
    pthread_t thread;
    int number;
    struct random random;
    const struct fmu *fmu;
    const struct table *table;
    const char *resources;
    double end; /* [s], of now() */
    struct instance instances[MOST_INSTANCES];
    struct state states[MOST_STATES];
    unsigned n_instances; /* made so far */
    uint32_t *references;
    double *values, *outputs, *again;
    /* For reports, and for the thread that watches. */
    struct call calls[LAST_CALLS];
    unsigned long n_calls, n_refused, n_steps;
    volatile double began; /* the call that runs, 0 between calls */
    volatile int is_done;
    char last_text[LONGEST_TEXT];
};

void begin(struct thread *, const char *call, const struct instance *, double detail);
int end(struct thread *, int status);
/* Tell what was found, with the seed and the last calls, and end the process. */
void found(struct thread *, const char *what);

/* -- actions.c */

void act(struct thread *);
void free_all(struct thread *);

#endif
