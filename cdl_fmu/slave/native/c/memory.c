/* What kernels get beside the block: rows that grow between steps (pool.py, RowPool), constants from the FMU's resources, and memory that
   means nothing between steps. And the whole state, which shares copies of rows that did not change. */

#include "instance.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct table *const model = &model_table;

/* Copy of a row and its marks, shared by all that hold it. */
struct copy {
    size_t n_holders;
    unsigned char bytes[];
};

struct memory {
    void **arrays;
    int64_t *extents;
    int64_t growth[2];   /* rows that a step may take; most rows */
    double *made_for;    /* parameters */
    struct copy **kept;  /* of each row, as it was last saved or restored */
    size_t row, mark;    /* bytes of a row and its marks */
    int is_open;         /* the library of others */
};

struct saved {
    struct saved *next;
    enum phase phase;
    int is_fresh;
    double time;
    double *block;
    int has_memory;
    int64_t n_rows;
    size_t row_bytes, head_bytes; /* of a row with its marks, and of the head */
    struct copy **rows;
    int64_t *head;
};

static int has_rows(void)
{
    return model->n_arrays > 0 && model->arrays[0].kind == ROWS;
}

static size_t block_bytes(void)
{
    return (size_t)(model->n_p + model->n_u + model->n_x + model->n_y) * sizeof(double);
}

static struct copy *hold(struct copy *copy)
{
    copy->n_holders++;
    return copy;
}

static void let_go(struct copy *copy)
{
    if (copy && --copy->n_holders == 0)
        free(copy);
}

/* -- memory */

/* Bytes of an array, SIZE_MAX if there are too many. */
static size_t bytes_of(const struct array *array, const int64_t *extents)
{
    size_t bytes = (size_t)array->item_size;
    for (int64_t k = 0; k < array->n_extents; k++) {
        if (extents[k] < 0 || (extents[k] > 0 && bytes > SIZE_MAX / 4 / (size_t)extents[k]))
            return SIZE_MAX;
        bytes *= (size_t)extents[k];
    }
    return bytes;
}

/* Read the constants: the FMU's GUID, by which they belong to it, and then all of them in order. */
static int read_content(const struct instance *m, struct memory *memory)
{
    FILE *file = NULL;
    char path[4096], guid[64] = "";
    size_t length = strlen(model->guid);
    int done = 0;
    const int64_t *extents = memory->extents;
    for (int64_t i = 0; i < model->n_arrays; extents += model->arrays[i++].n_extents) {
        if (model->arrays[i].kind != CONTENT)
            continue;
        if (!file) {
            snprintf(path, sizeof path, "%s/constants.bin", m->resources);
            file = fopen(path, "rb");
            if (!file)
                return refuse(m, "%s is missing, in which the FMU keeps its terrain and meshes: unpack the FMU again, and give the location "
                                 "of its resources at instantiation", path);
            done = length < sizeof guid && fread(guid, 1, length, file) == length && !memcmp(guid, model->guid, length);
        }
        size_t bytes = bytes_of(model->arrays + i, extents);
        done = done && fread(memory->arrays[i], 1, bytes, file) == bytes;
    }
    if (!file)
        return OK;
    done = done && fgetc(file) == EOF;
    fclose(file);
    return done ? OK : refuse(m, "%s is damaged or of another FMU: unpack the FMU again", path);
}

#ifdef MODEL_OPENS
/* The arrays that belong to a library. */
static void **foreign_of(const struct memory *memory)
{
    int64_t i = 0;
    while (model->arrays[i].kind != FOREIGN)
        i++;
    return memory->arrays + i;
}
#endif

void memory_free(struct memory *memory)
{
    if (!memory)
        return;
#ifdef MODEL_OPENS
    if (memory->is_open)
        model_close(foreign_of(memory));
#endif
    if (memory->kept)
        for (int64_t r = 0; r < memory->extents[0]; r++)
            let_go(memory->kept[r]);
    if (memory->arrays)
        for (int64_t i = 0; i < model->n_arrays && model->arrays[i].kind != FOREIGN; i++)
            free(memory->arrays[i]);
    free(memory->kept);
    free(memory->arrays);
    free(memory->extents);
    free(memory->made_for);
    free(memory);
}

struct memory *memory_new(const struct instance *m)
{
    struct memory *memory = calloc(1, sizeof *memory);
    size_t bytes = (size_t)model->n_p * sizeof(double), total = 0;
    if (!memory)
        return refuse(m, "out of memory"), NULL;
    memory->extents = calloc((size_t)model->n_extents + 1, sizeof(int64_t));
    memory->arrays = calloc((size_t)model->n_arrays + 1, sizeof(void *));
    memory->made_for = malloc(bytes + 1);
    if (!memory->extents || !memory->arrays || !memory->made_for) {
        memory_free(memory);
        return refuse(m, "out of memory"), NULL;
    }
    memcpy(memory->made_for, m->block, bytes);
    memcpy(memory->extents, model->extents, (size_t)model->n_extents * sizeof(int64_t));
    memcpy(memory->growth, model->extents + model->n_extents, sizeof memory->growth);
    int32_t result = 0;
    void *raised = NULL;
    if (model->can_resize)
        model_resize(&result, &raised, m->block, memory->extents, memory->growth);
    const int64_t *extents = memory->extents;
    for (int64_t i = 0; i < model->n_arrays && model->arrays[i].kind != FOREIGN; extents += model->arrays[i++].n_extents) {
        bytes = bytes_of(model->arrays + i, extents);
        total = bytes == SIZE_MAX || total > SIZE_MAX - bytes ? SIZE_MAX : total + bytes;
        memory->arrays[i] = bytes == SIZE_MAX ? NULL : calloc(bytes + 1, 1);
        if (!memory->arrays[i]) {
            memory_free(memory);
            return refuse(m, "%.3g MB are needed and not to be had: check the parameters that give sizes", (double)total / 1e6), NULL;
        }
    }
    if (has_rows()) {
        memory->row = bytes_of(model->arrays, memory->extents) / (size_t)(memory->extents[0] ? memory->extents[0] : 1);
        memory->mark = (size_t)memory->extents[model->arrays[0].n_extents + 1] * sizeof(int64_t);
        memory->kept = calloc((size_t)memory->extents[0] + 1, sizeof *memory->kept);
    }
    if ((has_rows() && !memory->kept) || read_content(m, memory)) {
        memory_free(memory);
        return NULL;
    }
#ifdef MODEL_OPENS
    const char *wrong = model_open(memory->arrays, foreign_of(memory));
    if (wrong) {
        memory_free(memory);
        return refuse(m, "%s", wrong), NULL;
    }
    memory->is_open = 1;
#endif
    return memory;
}

void **memory_arrays(const struct memory *memory)
{
    return memory->arrays;
}

const int64_t *memory_extents(const struct memory *memory)
{
    return memory->extents;
}

static int64_t *head_of(const struct memory *memory)
{
    return memory->arrays[2];
}

static size_t head_bytes(const struct memory *memory)
{
    return (size_t)memory->extents[model->arrays[0].n_extents + 2] * sizeof(int64_t);
}

static int64_t *marks_of(const struct memory *memory, int64_t row)
{
    return (int64_t *)((unsigned char *)memory->arrays[1] + (size_t)row * memory->mark);
}

static unsigned char *row_of(const struct memory *memory, int64_t row)
{
    return (unsigned char *)memory->arrays[0] + (size_t)row * memory->row;
}

static void *grown(void *old, size_t used, size_t bytes)
{
    unsigned char *more = calloc(bytes + 1, 1);
    if (more)
        memcpy(more, old, used);
    return more;
}

static int resize(const struct instance *m, int64_t capacity)
{
    struct memory *memory = m->memory;
    size_t now = (size_t)memory->extents[0], then = (size_t)capacity;
    void *rows = grown(memory->arrays[0], now * memory->row, then * memory->row);
    void *marks = grown(memory->arrays[1], now * memory->mark, then * memory->mark);
    void *kept = grown(memory->kept, now * sizeof *memory->kept, then * sizeof *memory->kept);
    if (!rows || !marks || !kept) {
        free(rows);
        free(marks);
        free(kept);
        return refuse(m, "%.3g MB are needed and not to be had", (double)then * (double)memory->row / 1e6);
    }
    free(memory->arrays[0]);
    free(memory->arrays[1]);
    free(memory->kept);
    memory->arrays[0] = rows;
    memory->arrays[1] = marks;
    memory->kept = kept;
    memory->extents[0] = memory->extents[model->arrays[0].n_extents] = capacity;
    return OK;
}

int memory_reserve(const struct instance *m)
{
    const struct memory *memory = m->memory;
    if (!has_rows())
        return OK;
    int64_t capacity = memory->extents[0], limit = memory->growth[1];
    if (capacity - head_of(memory)[0] >= memory->growth[0] || capacity >= limit)
        return OK;
    return resize(m, 2 * capacity < limit ? 2 * capacity : limit);
}

/* -- whole state */

static void clear(struct saved *saved)
{
    for (int64_t r = 0; saved->rows && r < saved->n_rows; r++)
        let_go(saved->rows[r]);
    free(saved->rows);
    free(saved->head);
    saved->rows = NULL;
    saved->head = NULL;
    saved->n_rows = 0;
    saved->row_bytes = saved->head_bytes = 0;
}

static struct saved *new_state(struct instance *m)
{
    struct saved *saved = calloc(1, sizeof *saved);
    if (!saved || !(saved->block = malloc(block_bytes() + 1))) {
        free(saved);
        refuse(m, "out of memory for a state");
        return NULL;
    }
    saved->next = m->saves;
    return m->saves = saved;
}

int is_state_of(const struct instance *m, const struct saved *saved)
{
    const struct saved *known = m->saves;
    while (known && known != saved)
        known = known->next;
    return known != NULL;
}

int state_free(struct instance *m, struct saved *saved)
{
    struct saved **link = &m->saves;
    while (*link && *link != saved)
        link = &(*link)->next;
    if (!*link)
        return refuse(m, "a state is freed that it did not give, or that was freed before");
    *link = saved->next;
    clear(saved);
    free(saved->block);
    free(saved);
    return OK;
}

/* Copies of the rows in use; those that did not change share theirs with the save before. */
static int save_rows(const struct instance *m, struct saved *saved)
{
    const struct memory *memory = m->memory;
    int64_t n = head_of(memory)[0];
    saved->row_bytes = memory->row + memory->mark;
    saved->head_bytes = head_bytes(memory);
    saved->rows = calloc((size_t)n + 1, sizeof *saved->rows);
    saved->head = malloc(saved->head_bytes + 1);
    if (!saved->rows || !saved->head)
        return ERROR;
    memcpy(saved->head, head_of(memory), saved->head_bytes);
    for (int64_t r = 0; r < n; r++) {
        int64_t *marks = marks_of(memory, r);
        if (!memory->kept[r] || marks[0]) {
            struct copy *copy = malloc(sizeof *copy + memory->row + memory->mark);
            if (!copy)
                return ERROR;
            marks[0] = 0;
            copy->n_holders = 1;
            memcpy(copy->bytes, row_of(memory, r), memory->row);
            memcpy(copy->bytes + memory->row, marks, memory->mark);
            let_go(memory->kept[r]);
            memory->kept[r] = copy;
        }
        saved->rows[r] = hold(memory->kept[r]);
        saved->n_rows = r + 1;
    }
    return OK;
}

struct saved *state_save(struct instance *m, struct saved *into)
{
    struct saved *saved = into ? into : new_state(m);
    if (!saved)
        return NULL;
    clear(saved);
    saved->phase = m->phase;
    saved->is_fresh = m->is_fresh;
    saved->time = m->time;
    saved->has_memory = m->memory != NULL;
    memcpy(saved->block, m->block, block_bytes());
    if (m->memory && has_rows() && save_rows(m, saved)) {
        refuse(m, "out of memory for a state");
        if (!into)
            state_free(m, saved);
        return NULL;
    }
    return saved;
}

static int restore_rows(const struct instance *m, const struct saved *saved)
{
    struct memory *memory = m->memory;
    int64_t n = saved->n_rows, used = head_of(memory)[0];
    if (saved->row_bytes != memory->row + memory->mark || saved->head_bytes != head_bytes(memory) || saved->head[0] != n)
        return refuse(m, "a state is damaged: it has %lld rows of %zu bytes", (long long)n, saved->row_bytes);
    if (n > memory->extents[0] && resize(m, n))
        return ERROR;
    for (int64_t r = 0; r < n; r++) {
        int64_t *marks = marks_of(memory, r);
        if (memory->kept[r] == saved->rows[r] && !marks[0])
            continue;
        memcpy(row_of(memory, r), saved->rows[r]->bytes, memory->row);
        memcpy(marks, saved->rows[r]->bytes + memory->row, memory->mark);
        hold(saved->rows[r]);
        let_go(memory->kept[r]);
        memory->kept[r] = saved->rows[r];
    }
    for (int64_t r = n; r < used; r++) {
        memset(row_of(memory, r), 0, memory->row);
        memset(marks_of(memory, r), 0, memory->mark);
        let_go(memory->kept[r]);
        memory->kept[r] = NULL;
    }
    memcpy(head_of(memory), saved->head, saved->head_bytes);
    return OK;
}

int state_restore(struct instance *m, const struct saved *saved)
{
    memcpy(m->block, saved->block, block_bytes());
    m->phase = saved->phase;
    m->is_fresh = saved->is_fresh;
    m->time = saved->time;
    if (!saved->has_memory) {
        memory_free(m->memory);
        m->memory = NULL;
        return OK;
    }
    if (!m->memory || memcmp(m->memory->made_for, m->block, (size_t)model->n_p * sizeof(double))) {
        memory_free(m->memory);
        m->memory = memory_new(m);
        if (!m->memory)
            return ERROR;
    }
    return has_rows() ? restore_rows(m, saved) : OK;
}

/* A state as bytes: a header of numbers, the block, the head, the rows with their marks, and a sum over all that tells damage. */
enum { MAGIC, PHASE, FRESH, TIME, HAS_MEMORY, N_ROWS, ROW_BYTES, HEAD_BYTES, HEADER };
static const int64_t A_STATE = 0x31455441545344; /* "DSTATE1" */

static uint64_t sum_of(const unsigned char *bytes, size_t n)
{
    uint64_t sum = 0xcbf29ce484222325; /* FNV-1a; it begins with the build, as states of another one mean something else */
    for (const char *c = model->guid; *c; c++)
        sum = (sum ^ (unsigned char)*c) * 0x100000001b3;
    for (size_t i = 0; i < n; i++)
        sum = (sum ^ bytes[i]) * 0x100000001b3;
    return sum;
}

size_t state_size(const struct saved *saved)
{
    return HEADER * sizeof(int64_t) + block_bytes() + saved->head_bytes + (size_t)saved->n_rows * saved->row_bytes + sizeof(uint64_t);
}

void state_write(const struct saved *saved, unsigned char *bytes)
{
    int64_t header[HEADER] = {A_STATE, saved->phase, saved->is_fresh, 0, saved->has_memory, saved->n_rows, (int64_t)saved->row_bytes,
                              (int64_t)saved->head_bytes};
    memcpy(header + TIME, &saved->time, sizeof saved->time);
    unsigned char *at = bytes;
    memcpy(at, header, sizeof header);
    memcpy(at += sizeof header, saved->block, block_bytes());
    at += block_bytes();
    if (saved->head_bytes)
        memcpy(at, saved->head, saved->head_bytes);
    at += saved->head_bytes;
    for (int64_t r = 0; r < saved->n_rows; r++, at += saved->row_bytes)
        memcpy(at, saved->rows[r]->bytes, saved->row_bytes);
    uint64_t sum = sum_of(bytes, (size_t)(at - bytes));
    memcpy(at, &sum, sizeof sum);
}

struct saved *state_read(struct instance *m, const unsigned char *bytes, size_t n)
{
    int64_t header[HEADER];
    uint64_t sum;
    size_t least = sizeof header + block_bytes() + sizeof sum;
    int sound = bytes && n >= least;
    if (sound) {
        memcpy(header, bytes, sizeof header);
        memcpy(&sum, bytes + n - sizeof sum, sizeof sum);
        size_t left = n - least, head = (size_t)header[HEAD_BYTES], row = (size_t)header[ROW_BYTES], rows = (size_t)header[N_ROWS];
        sound = header[MAGIC] == A_STATE && sum == sum_of(bytes, n - sizeof sum) && head <= left
                && (rows ? row > 0 && rows <= (left - head) / row && rows * row == left - head : head == left);
    }
    if (!sound) {
        refuse(m, "these %zu bytes are no state of this FMU, or damaged: take a state that the same build of the FMU serialised", n);
        return NULL;
    }
    struct saved *saved = new_state(m);
    if (!saved)
        return NULL;
    saved->phase = (enum phase)header[PHASE];
    saved->is_fresh = header[FRESH] != 0;
    memcpy(&saved->time, header + TIME, sizeof saved->time);
    saved->has_memory = header[HAS_MEMORY] != 0;
    saved->row_bytes = (size_t)header[ROW_BYTES];
    saved->head_bytes = (size_t)header[HEAD_BYTES];
    const unsigned char *at = bytes + sizeof header;
    memcpy(saved->block, at, block_bytes());
    at += block_bytes();
    saved->rows = calloc((size_t)header[N_ROWS] + 1, sizeof *saved->rows);
    saved->head = malloc(saved->head_bytes + 1);
    int full = !saved->rows || !saved->head;
    if (!full)
        memcpy(saved->head, at, saved->head_bytes);
    at += saved->head_bytes;
    for (int64_t r = 0; !full && r < header[N_ROWS]; r++, at += saved->row_bytes) {
        struct copy *copy = malloc(sizeof *copy + saved->row_bytes);
        full = !copy;
        if (full)
            break;
        copy->n_holders = 1;
        memcpy(copy->bytes, at, saved->row_bytes);
        saved->rows[r] = copy;
        saved->n_rows = r + 1;
    }
    if (full) {
        refuse(m, "out of memory for a state");
        state_free(m, saved);
        return NULL;
    }
    return saved;
}
