/* What a model's object file holds: four functions, and one table of all that is declared of the model. cdl_fmu/slave/native/table.py
   writes the table, field by field as here; every number is a double or an int64_t, so that no padding depends on a compiler. */

#ifndef MODEL_H
#define MODEL_H

#include <stdint.h>

/* A double of the parameters or inputs, in the order of the block [p|u|x|y], whose index is its value reference. */
struct variable {
    const char *name, *unit, *description; /* unit: with a blank before it, or "" */
    const char *options;                   /* of a choice: "1 constant, 2 mapped"; else NULL */
    double lower, upper;
    int64_t is_built_in; /* what the FMU holds was made for its start value */
};

struct file {
    const char *name, *start, *description;
};

/* A piece of a message: text, or a printf format of a number. */
enum { TEXT, INDEX, BLOCK, NUMBER };
struct piece {
    int64_t kind;
    const char *text;
    int64_t offset, stride; /* BLOCK: value block[offset + stride * index]; NUMBER: number[offset] of a rule */
};

/* What a status of a step, or the number of a broken rule, means. */
struct message {
    int64_t status, is_error, n_pieces;
    const struct piece *pieces;
};

/* Memory that kernels get beside the block. Rows that grow come first where there are such, then their marks and the head (see pool.py);
   what belongs to a library comes last. */
enum { ROWS, MARKS, HEAD, ZEROS, CONTENT, FOREIGN };
struct array {
    int64_t kind, item_size, n_extents;
};

struct table {
    const char *identifier, *guid;
    int64_t n_p, n_u, n_x, n_y;
    int64_t has_feedthrough;
    const double *starts;             /* of the block */
    const struct variable *variables; /* [n_p + n_u] */
    const int64_t *lengths;           /* [n_p + n_u + n_x + n_y]: of the FMI 3 variable that begins there, 0 where none does */
    int64_t n_files;
    const struct file *files;
    int64_t n_rules, n_numbers;
    const struct message *rules;
    int64_t n_events;
    const struct message *events;
    int64_t n_arrays, n_extents;
    const struct array *arrays;
    int64_t can_resize;     /* all parameters may change: model_resize knows the extents */
    const int64_t *extents; /* of all arrays as the FMU was built; then rows that a step may take, and most rows there may be */
};

extern const struct table model_table;

/* Each puts what it has to say into result, and returns non-zero if a kernel raised, which none does. */
int32_t model_initialise(int32_t *result, void **raised, double t, double *block, void **arrays, const int64_t *extents);
int32_t model_step(int32_t *result, void **raised, double t, double h, double *block, void **arrays, const int64_t *extents);
/* Number of the first rule that the parameters break, from 1, and the numbers that its message tells; 0 = none. */
int32_t model_check(int32_t *result, void **raised, const double *block, double *numbers);
/* Write over extents and growth what is another for these parameters than for those that the table was made for. */
int32_t model_resize(int32_t *result, void **raised, const double *block, int64_t *extents, int64_t *growth);

#ifdef MODEL_OPENS
/* A model that works with a library (library.py): set all FOREIGN arrays, from ``own`` on, to what the library's objects hold, made anew
   for an instance whose other arrays are as at the start; and free them. Returns what went wrong, or NULL. */
const char *model_open(void *const *arrays, void **own);
void model_close(void **own);
#endif

#endif
