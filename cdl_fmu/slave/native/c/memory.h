/* What kernels get beside the block, and how a state copies it: shared by memory.c and state.c alone. */

#ifndef MEMORY_H
#define MEMORY_H

#include "instance.h"

/* Copy of a row and its marks, shared by all that hold it. */
struct copy {
    size_t n_holders;
    unsigned char bytes[];
};

struct memory {
    void **arrays;
    int64_t *extents;
    int64_t growth[2];  /* rows that a step may take; most rows */
    double *made_for;   /* parameters */
    struct copy **kept; /* of each row, as it was last saved or restored */
    size_t row, mark;   /* bytes of a row and its marks */
    int is_open;        /* the library of others */
};

/* FNV-1a of bytes, going on from that of others: what tells damage. */
static const uint64_t NO_SUM = 0xcbf29ce484222325;
uint64_t sum_of(uint64_t sum, const void *data, size_t n);
int has_rows(void);
size_t block_bytes(void);
struct copy *hold(struct copy *);
void let_go(struct copy *);
int64_t *head_of(const struct memory *);
int64_t *marks_of(const struct memory *, int64_t row);
unsigned char *row_of(const struct memory *, int64_t row);
int memory_resize(const struct instance *, int64_t rows);

#endif
