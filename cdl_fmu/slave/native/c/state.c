/* The whole state of an instance: the block, and of rows copies, which states share where nothing changed in between. Its form as bytes is
   that of the FMU in Python (state.py, pool.py), so that one reader serves both. */

#include "memory.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct table *const model = &model_table;

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

static size_t bytes_of_head(const struct memory *memory)
{
    return (size_t)memory->extents[model->arrays[0].n_extents + 2] * sizeof(int64_t);
}

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
    saved->head_bytes = bytes_of_head(memory);
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
        clear(saved);
        saved->has_memory = 0; /* restored, it can be reset and no more */
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
    if (saved->row_bytes != memory->row + memory->mark || saved->head_bytes != bytes_of_head(memory) || saved->head[0] != n)
        return refuse(m, "a state is damaged: it has %lld rows of %zu bytes", (long long)n, saved->row_bytes);
    if (n > memory->extents[0] && memory_resize(m, n))
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

/* A restore that fails leaves an instance that can be reset or freed, and do nothing else. */
static int lost(struct instance *m)
{
    m->phase = TERMINATED;
    m->is_fresh = 0;
    return ERROR;
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
        return saved->phase == STEPPING ? lost(m) : OK;
    }
    if (!m->memory || memcmp(m->memory->made_for, m->block, (size_t)model->n_p * sizeof(double))) {
        memory_free(m->memory);
        m->memory = memory_new(m);
        if (!m->memory)
            return lost(m);
    }
    return has_rows() && restore_rows(m, saved) ? lost(m) : OK;
}

/* -- as bytes: GUID, length of the header, header in JSON, block; then of rows their number, the numbers of marks and of the head, and the
      row's shape, with the number of all these before them, and the head, the marks of all rows and the rows. */

enum { LONGEST = 512 };

/* Extents of one row, and of its marks. */
static int64_t n_shape(void)
{
    return model->arrays[0].n_extents - 1;
}

static const int64_t *shape(void)
{
    return model->extents + 1;
}

static int64_t n_marks(void)
{
    return model->extents[model->arrays[0].n_extents + 1];
}

static size_t body_size(const struct saved *saved)
{
    if (!saved->has_memory || !has_rows())
        return block_bytes();
    return block_bytes() + (size_t)(4 + n_shape()) * sizeof(int64_t) + saved->head_bytes + (size_t)saved->n_rows * saved->row_bytes;
}

/* The header is padded to one length, so that its size is known before the sum in it. */
static void write_header(char *header, const struct saved *saved, uint64_t sum)
{
    uint64_t time;
    memcpy(&time, &saved->time, sizeof time);
    int n = snprintf(header, LONGEST + 1,
                     "{\"block\": %zu, \"files\": {}, \"has_pool\": %s, \"native\": {\"phase\": %d, \"is_fresh\": %d, \"has_memory\": %d, \"time\": \"%016" PRIx64
                     "\", \"sum\": \"%016" PRIx64 "\"}}",
                     block_bytes(), saved->has_memory && model->n_arrays ? "true" : "false", (int)saved->phase, saved->is_fresh,
                     saved->has_memory, time, sum);
    memset(header + n, ' ', (size_t)(LONGEST - n));
}

/* Of the header, with 0 in place of the sum, and of what follows it. */
static uint64_t sum_of_state(const struct saved *saved, const unsigned char *body, size_t n)
{
    char header[LONGEST + 1];
    write_header(header, saved, 0);
    return sum_of(sum_of(NO_SUM, header, LONGEST), body, n);
}

static unsigned char *put(unsigned char *at, const void *from, size_t n)
{
    memcpy(at, from, n);
    return at + n;
}

size_t state_size(const struct saved *saved)
{
    return strlen(model->guid) + sizeof(int64_t) + LONGEST + body_size(saved);
}

void state_write(const struct saved *saved, unsigned char *bytes)
{
    const int64_t length = LONGEST;
    unsigned char *header = put(put(bytes, model->guid, strlen(model->guid)), &length, sizeof length), *body = header + LONGEST;
    unsigned char *at = put(body, saved->block, block_bytes());
    if (saved->has_memory && has_rows()) {
        int64_t sizes[4] = {3 + n_shape(), saved->n_rows, n_marks(), (int64_t)(saved->head_bytes / sizeof(int64_t))};
        size_t mark = (size_t)n_marks() * sizeof(int64_t), row = saved->row_bytes - mark;
        at = put(put(at, sizes, sizeof sizes), shape(), (size_t)n_shape() * sizeof(int64_t));
        at = put(at, saved->head, saved->head_bytes);
        for (int64_t r = 0; r < saved->n_rows; r++)
            at = put(at, saved->rows[r]->bytes + row, mark);
        for (int64_t r = 0; r < saved->n_rows; r++)
            at = put(at, saved->rows[r]->bytes, row);
    }
    char text[LONGEST + 1];
    write_header(text, saved, sum_of_state(saved, body, (size_t)(at - body)));
    memcpy(header, text, LONGEST);
}

/* Copies of the rows in n bytes; 0 if these cannot be what state_write wrote, or there is no memory for them. */
static int read_rows(struct saved *saved, const unsigned char *at, size_t n)
{
    int64_t sizes[4];
    size_t start = sizeof sizes + (size_t)n_shape() * sizeof(int64_t), mark = (size_t)n_marks() * sizeof(int64_t), row = 8;
    for (int64_t k = 0; k < n_shape(); k++)
        row *= (size_t)shape()[k];
    if (n < start)
        return 0;
    memcpy(sizes, at, sizeof sizes);
    size_t n_rows = (size_t)sizes[1], n_head = (size_t)sizes[3];
    if (sizes[2] != n_marks() || n_head > n / sizeof(int64_t) || n_rows > n / row
        || n != start + n_head * sizeof(int64_t) + n_rows * (row + mark))
        return 0;
    saved->row_bytes = row + mark;
    saved->head_bytes = n_head * sizeof(int64_t);
    saved->rows = calloc(n_rows + 1, sizeof *saved->rows);
    saved->head = malloc(saved->head_bytes + 1);
    if (!saved->rows || !saved->head)
        return 0;
    memcpy(saved->head, at + start, saved->head_bytes);
    const unsigned char *marks = at + start + saved->head_bytes, *rows = marks + n_rows * mark;
    for (size_t r = 0; r < n_rows; r++) {
        struct copy *copy = malloc(sizeof *copy + row + mark);
        if (!copy)
            return 0;
        copy->n_holders = 1;
        memcpy(copy->bytes, rows + r * row, row);
        memcpy(copy->bytes + row, marks + r * mark, mark);
        saved->rows[r] = copy;
        saved->n_rows = (int64_t)r + 1;
    }
    return 1;
}

struct saved *state_read(struct instance *m, const unsigned char *bytes, size_t n)
{
    size_t guid = strlen(model->guid), start = guid + sizeof(int64_t) + LONGEST;
    struct saved *saved = new_state(m);
    if (!saved)
        return NULL;
    char text[LONGEST + 1] = "", again[LONGEST + 1] = "";
    uint64_t sum = 0, time = 0;
    int phase = 0, is_fresh = 0, has_memory = 0, sound = bytes && n >= start + block_bytes() && !memcmp(bytes, model->guid, guid);
    if (sound) {
        int64_t length;
        memcpy(&length, bytes + guid, sizeof length);
        memcpy(text, bytes + start - LONGEST, LONGEST);
        const char *native = strstr(text, "\"native\"");
        sound = native && length == LONGEST
                && sscanf(native, "\"native\": {\"phase\": %d, \"is_fresh\": %d, \"has_memory\": %d, \"time\": \"%" SCNx64 "\", \"sum\": \"%" SCNx64,
                          &phase, &is_fresh, &has_memory, &time, &sum)
                       == 5
                && (phase == INSTANTIATED || phase == INITIALISING || ((phase == STEPPING || phase == TERMINATED) && has_memory));
    }
    if (sound) {
        saved->phase = (enum phase)phase;
        saved->is_fresh = is_fresh;
        memcpy(&saved->time, &time, sizeof time);
        saved->has_memory = has_memory;
        memcpy(saved->block, bytes + start, block_bytes());
        write_header(again, saved, sum);
        sound = !memcmp(text, again, LONGEST) && sum == sum_of_state(saved, bytes + start, n - start);
    }
    size_t left = sound ? n - start - block_bytes() : 0;
    if (sound)
        sound = saved->has_memory && has_rows() ? read_rows(saved, bytes + n - left, left) : left == 0;
    if (!sound) {
        refuse(m, "these %zu bytes are no state of this FMU, or damaged: take a state that the same build of the FMU serialised", n);
        state_free(m, saved);
        return NULL;
    }
    return saved;
}
