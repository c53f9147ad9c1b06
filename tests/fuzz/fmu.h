/* An FMU's functions, the same for FMI 2.0 and 3.0, as the fuzzing host calls them: fmi2.c and fmi3.c fill the table. */

#ifndef FMU_H
#define FMU_H

#include <stddef.h>
#include <stdint.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { USUAL, WITHOUT_LOGGER, MODEL_EXCHANGE };

struct fmu {
    void *(*instantiate)(const char *name, const char *token, const char *resources, int way, void *environment);
    void (*free_instance)(void *c);
    int (*setup)(void *c, double start); /* NULL: FMI 3.0 has none */
    int (*enter)(void *c, double start);
    int (*exit)(void *c);
    int (*terminate)(void *c);
    int (*reset)(void *c);
    int (*step)(void *c, double t, double h);
    int (*set_real)(void *c, const uint32_t *references, size_t n, const double *values, size_t n_values);
    int (*get_real)(void *c, const uint32_t *references, size_t n, double *values, size_t n_values);
    int (*set_choice)(void *c, const uint32_t *references, size_t n, const int64_t *values);
    int (*get_choice)(void *c, const uint32_t *references, size_t n, int64_t *values);
    int (*set_string)(void *c, const uint32_t *references, size_t n, const char *const *values);
    int (*get_string)(void *c, const uint32_t *references, size_t n, const char **values);
    int (*get_state)(void *c, void **state);
    int (*set_state)(void *c, void *state);
    int (*free_state)(void *c, void **state);
    int (*size)(void *c, void *state, size_t *size);
    int (*serialise)(void *c, void *state, unsigned char *bytes, size_t size);
    int (*deserialise)(void *c, const unsigned char *bytes, size_t size, void **state);
    int (*other)(void *c, unsigned which); /* a function that is hardly ever offered */
};

/* Both return the name of a function that the library lacks, or NULL. */
const char *bind_fmi2(struct fmu *, void *library);
const char *bind_fmi3(struct fmu *, void *library);

void *symbol_of(void *library, const char *name);
/* Called with every message of the FMU; environment as given to instantiate. */
void said(void *environment, const char *text);

#endif
