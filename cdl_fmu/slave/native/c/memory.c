/* What kernels get beside the block: rows that grow between steps (pool.py, RowPool), constants from the FMU's resources, and memory that
   means nothing between steps. */

#include "memory.h"

#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#endif

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct table *const model = &model_table;

int has_rows(void)
{
    return model->n_arrays > 0 && model->arrays[0].kind == ROWS;
}

size_t block_bytes(void)
{
    return (size_t)(model->n_p + model->n_u + model->n_x + model->n_y) * sizeof(double);
}

struct copy *hold(struct copy *copy)
{
    copy->n_holders++;
    return copy;
}

void let_go(struct copy *copy)
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

uint64_t sum_of(uint64_t sum, const void *data, size_t n)
{
    const unsigned char *bytes = data;
    for (size_t i = 0; i < n; i++)
        sum = (sum ^ bytes[i]) * 0x100000001b3;
    return sum;
}

/* A file by its path in UTF-8, which Windows has to be told. */
static FILE *opened(const char *path)
{
#ifdef _WIN32
    wchar_t wide[4096];
    return MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096) ? _wfopen(wide, L"rb") : NULL;
#else
    return fopen(path, "rb");
#endif
}

/* Read the constants: the FMU's GUID, by which they belong to it, their sum, and then all of them in order. */
static int read_content(const struct instance *m, struct memory *memory)
{
    FILE *file = NULL;
    char path[4096], guid[64] = "";
    size_t length = strlen(model->guid);
    int done = 0;
    uint64_t wanted = 0, sum = NO_SUM;
    const int64_t *extents = memory->extents;
    for (int64_t i = 0; i < model->n_arrays; extents += model->arrays[i++].n_extents) {
        if (model->arrays[i].kind != CONTENT)
            continue;
        if (!file) {
            snprintf(path, sizeof path, "%s/constants.bin", m->resources);
            file = opened(path);
            if (!file)
                return refuse(m, "%s is missing, in which the FMU keeps its terrain and meshes: unpack the FMU again, and give the location "
                                 "of its resources at instantiation", path);
            done = length < sizeof guid && fread(guid, 1, length, file) == length && !memcmp(guid, model->guid, length)
                   && fread(&wanted, sizeof wanted, 1, file) == 1;
        }
        size_t bytes = bytes_of(model->arrays + i, extents);
        done = done && fread(memory->arrays[i], 1, bytes, file) == bytes;
        sum = sum_of(sum, memory->arrays[i], bytes);
    }
    if (!file)
        return OK;
    done = done && fgetc(file) == EOF && sum == wanted;
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

int64_t *head_of(const struct memory *memory)
{
    return memory->arrays[2];
}

int64_t *marks_of(const struct memory *memory, int64_t row)
{
    return (int64_t *)((unsigned char *)memory->arrays[1] + (size_t)row * memory->mark);
}

unsigned char *row_of(const struct memory *memory, int64_t row)
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

int memory_resize(const struct instance *m, int64_t capacity)
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
    return memory_resize(m, 2 * capacity < limit ? 2 * capacity : limit);
}
