/* An instance of the model, the same for FMI 2 and FMI 3: fmi2.c and fmi3.c translate, instance.c, memory.c, state.c and handles.c do the work. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"

/* As FMI 2 and FMI 3 number them. */
enum { OK, WARNING, DISCARD, ERROR, FATAL };

enum phase { INSTANTIATED = 1, INITIALISING = 2, STEPPING = 4, TERMINATED = 8 };

struct saved;
struct memory;

struct instance {
    char *name, *resources;
    void (*say)(const struct instance *, int status, const char *text);
    void *logger, *environment; /* for say */
    enum phase phase;
    int is_fresh; /* state and outputs are those of the values as they are now */
    double time; /* of the last step's end, or the start */
    double *block;
    struct memory *memory;
    int32_t *told; /* warnings that were given */
    size_t n_told;
    struct saved *saves; /* all that were handed out */
};

/* instance.c: every function returns a status, and says through the logger what is wrong. */
struct instance *instance_new(const char *name, const char *guid, const char *resources,
                              void (*say)(const struct instance *, int, const char *), void *logger, void *environment);
void instance_free(struct instance *);
int instance_reset(struct instance *);
int refuse(const struct instance *, const char *format, ...);
int allowed(const struct instance *, const char *function, int phases);
int instance_enter(struct instance *, double start);
int instance_exit(struct instance *);
int instance_step(struct instance *, double t, double h);
/* Consecutive values; is_choice: the type under which the caller knows the variables. */
int get_values(struct instance *, uint32_t first, size_t n, int is_choice, double *values);
int set_values(struct instance *, uint32_t first, size_t n, int is_choice, const double *values);
/* How many of n references, the first included, are consecutive. */
size_t run_of(const uint32_t *references, size_t n);
int ready_to_get(struct instance *);
int set_file(struct instance *, size_t i, const char *value);

/* memory.c: what kernels get beside the block. */
struct memory *memory_new(const struct instance *); /* for the parameters as they are; NULL: it said why not */
void memory_free(struct memory *);
void **memory_arrays(const struct memory *);
const int64_t *memory_extents(const struct memory *);
int memory_reserve(const struct instance *); /* room for a step */
struct saved *state_save(struct instance *, struct saved *into); /* NULL: it said why not */
int state_restore(struct instance *, const struct saved *);
int state_free(struct instance *, struct saved *);
size_t state_size(const struct saved *);
void state_write(const struct saved *, unsigned char *bytes);
struct saved *state_read(struct instance *, const unsigned char *bytes, size_t n);
int is_state_of(const struct instance *, const struct saved *);

/* handles.c: states as a host holds them, for both versions of FMI; ``function`` is the one that it called. */
int handle_get(struct instance *, void **state, const char *function);
int handle_set(struct instance *, void *state, const char *function);
int handle_free(struct instance *, void **state);
int handle_size(struct instance *, void *state, size_t *size, const char *function);
int handle_write(struct instance *, void *state, void *bytes, size_t size, const char *function);
int handle_read(struct instance *, const void *bytes, size_t size, void **state, const char *function);

#endif
