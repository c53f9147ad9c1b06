/* Life of an instance: values, checks, initialisation and steps, and what is said of them. The order of things is that of
   cdl_fmu/slave/model.py, to the bit. */

#include "instance.h"

#include <cpuid.h>
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LONGEST = 2048 }; /* STATUS_SPAN and LATEST come from model.py, by way of the compiler's command line */

static const struct table *const model = &model_table;

/* Whether the processor has what LLVM calls x86-64-v3; kernels choose by it among twins of the same bits. */
__attribute__((visibility("hidden"))) int32_t cpu_has_vectors;

/* By the processor's own word: __builtin_cpu_supports is empty in zig. AVX counts only if the system keeps its registers. */
__attribute__((constructor)) static void look_at_cpu(void)
{
    unsigned a, b, c, d, more, kept;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA) || !(c & bit_MOVBE) || !(c & bit_OSXSAVE) || !(c & bit_F16C))
        return;
    __asm__("xgetbv" : "=a"(kept), "=d"(more) : "c"(0));
    if ((kept & 6) != 6 || !__get_cpuid(0x80000001, &a, &b, &c, &d) || !(c & bit_LZCNT))
        return;
    if (__get_cpuid_count(7, 0, &a, &b, &c, &d))
        cpu_has_vectors = (b & bit_AVX2) && (b & bit_BMI) && (b & bit_BMI2);
}

static char *copied(const char *text)
{
    char *copy = malloc(strlen(text) + 1);
    return copy ? strcpy(copy, text) : NULL;
}

int refuse(const struct instance *m, const char *format, ...)
{
    char text[LONGEST];
    int used = snprintf(text, sizeof text, "%s: ", m->name);
    if (used < 0 || used >= LONGEST)
        used = 0;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, sizeof text - (size_t)used, format, arguments);
    va_end(arguments);
    m->say(m, ERROR, text);
    return ERROR;
}

int allowed(const struct instance *m, const char *function, int phases)
{
    if (m->phase & phases)
        return OK;
    const char *now = m->phase == INSTANTIATED   ? "before initialisation"
                      : m->phase == INITIALISING ? "in initialisation mode"
                      : m->phase == STEPPING     ? "during the run"
                                                 : "after it was terminated";
    return refuse(m, "%s is not allowed %s", function, now);
}

/* As Python writes it: C has no common way to write what is not finite. */
static void write_number(char *text, size_t room, const char *format, double value)
{
    if (isfinite(value))
        snprintf(text, room, format, value);
    else
        snprintf(text, room, "%s", isnan(value) ? "nan" : value > 0.0 ? "inf" : "-inf");
}

static void write_message(char *text, size_t room, const struct message *message, const double *block, int64_t index, const double *numbers)
{
    text[0] = 0;
    for (int64_t i = 0; i < message->n_pieces; i++) {
        const struct piece *piece = message->pieces + i;
        size_t used = strlen(text);
        if (piece->kind == TEXT)
            snprintf(text + used, room - used, "%s", piece->text);
        else if (piece->kind == INDEX)
            snprintf(text + used, room - used, "%d", (int)index + 1);
        else
            write_number(text + used, room - used, piece->text,
                         piece->kind == BLOCK ? block[piece->offset + piece->stride * index] : numbers[piece->offset]);
    }
}

/* Refuse the first of the doubles [from, to) that is out of its bounds; an infinite bound is the largest number, so that one comparison
   also refuses infinities and NaN. */
static int check_bounds(const struct instance *m, int64_t from, int64_t to, const char *kind, double t)
{
    const struct variable *variables = model->variables;
    for (int64_t i = from; i < to; i++) {
        double value = m->block[i];
        const struct variable *v = variables + i;
        if (v->lower <= value && value <= v->upper)
            continue;
        char is[64], bound[64], when[64] = "";
        write_number(is, sizeof is, "%g", value);
        write_number(bound, sizeof bound, "%g", value < v->lower ? v->lower : v->upper);
        if (t == t)
            snprintf(when, sizeof when, " at t = %.6g s", t);
        if (v->options)
            return refuse(m, "%s %s = %s is no item of %s%s", kind, v->name, is, v->options, when);
        if (!isfinite(value))
            return refuse(m, "%s %s = %s%s: it must be finite (%s)%s", kind, v->name, is, v->unit, v->description, when);
        return refuse(m, "%s %s = %s%s: it must be at %s %s%s (%s)%s", kind, v->name, is, v->unit, value < v->lower ? "least" : "most",
                      bound, v->unit, v->description, when);
    }
    return OK;
}

static int check_parameters(const struct instance *m)
{
    if (check_bounds(m, 0, model->n_p, "parameter", NAN))
        return ERROR;
    for (int64_t i = 0; i < model->n_p; i++)
        if (model->variables[i].is_built_in && m->block[i] != model->starts[i])
            return refuse(m, "parameter %s = %g%s: what this FMU holds was made for %.17g; build it with the other value (cdl build --native %s "
                             "--set %s=...)",
                          model->variables[i].name, m->block[i], model->variables[i].unit, model->starts[i], model->identifier,
                          model->variables[i].name);
    double *numbers = calloc((size_t)model->n_numbers + 1, sizeof *numbers);
    int32_t broken = 0;
    void *raised = NULL;
    if (!numbers || model_check(&broken, &raised, m->block, numbers)) {
        free(numbers);
        return refuse(m, "its parameters cannot be checked");
    }
    if (broken) {
        char text[LONGEST];
        write_message(text, sizeof text, model->rules + broken - 1, m->block, 0, numbers);
        m->say(m, ERROR, text);
    }
    free(numbers);
    return broken ? ERROR : OK;
}

/* What a step's status means; NULL if it means nothing. */
static const struct message *event_of(int32_t status)
{
    for (int64_t i = 0; i < model->n_events; i++)
        if (model->events[i].status == status % STATUS_SPAN)
            return model->events + i;
    return NULL;
}

/* Say what a step's status means: an error, or a warning that is given once. */
static int report(struct instance *m, int32_t status, double t)
{
    const struct message *event = event_of(status);
    if (!event)
        return refuse(m, "its step ended with the unknown status %d (t = %.6g s)", (int)status, t);
    if (!event->is_error) {
        for (size_t i = 0; i < m->n_told; i++)
            if (m->told[i] == status)
                return OK;
        int32_t *more = realloc(m->told, (m->n_told + 1) * sizeof *more);
        if (!more)
            return OK;
        m->told = more;
        m->told[m->n_told++] = status;
    }
    char said[LONGEST], text[LONGEST];
    write_message(said, sizeof said, event, m->block, status / STATUS_SPAN, NULL);
    snprintf(text, sizeof text, "%.500s: %.1400s (t = %.6g s)", m->name, said, t);
    m->say(m, event->is_error ? ERROR : WARNING, text);
    return event->is_error ? ERROR : WARNING;
}

static int check_time(const struct instance *m, double t)
{
    if (fabs(t) <= LATEST)
        return OK;
    char is[64];
    write_number(is, sizeof is, "%g", t);
    return refuse(m, "t = %s s: it must be within %g s of 0", is, LATEST);
}

static int check_inputs(const struct instance *m, double t)
{
    return check_bounds(m, model->n_p, model->n_p + model->n_u, "input", t);
}

/* Outputs at the start are those of a step of no length, which leaves no trace; what is missing yet may still come. */
static int show_start(struct instance *m)
{
    if (check_inputs(m, m->time))
        return ERROR;
    struct saved *before = state_save(m, NULL);
    if (!before || memory_reserve(m))
        return ERROR;
    int64_t outputs = model->n_p + model->n_u + model->n_x;
    size_t bytes = (size_t)model->n_y * sizeof(double);
    int32_t status = 0;
    void *raised = NULL;
    int failed = model_step(&status, &raised, m->time, 0.0, m->block, memory_arrays(m->memory), memory_extents(m->memory));
    if (failed)
        refuse(m, "its first outputs failed");
    else if (status && (!event_of(status) || event_of(status)->is_error))
        failed = report(m, status, m->time) == ERROR;
    double *shown = malloc(bytes + 1);
    if (!shown)
        failed = refuse(m, "out of memory");
    else
        memcpy(shown, m->block + outputs, bytes);
    if (state_restore(m, before))
        failed = ERROR;
    if (shown)
        memcpy(m->block + outputs, shown, bytes);
    free(shown);
    state_free(m, before);
    return failed ? ERROR : OK;
}

static int initialise(struct instance *m)
{
    if (check_time(m, m->time) || check_parameters(m))
        return ERROR;
    memory_free(m->memory);
    m->memory = memory_new(m);
    if (!m->memory)
        return ERROR;
    int32_t result = 0;
    void *raised = NULL;
    if (model_initialise(&result, &raised, m->time, m->block, memory_arrays(m->memory), memory_extents(m->memory)))
        return refuse(m, "its initialisation failed");
    if (model->has_feedthrough && show_start(m))
        return ERROR;
    m->is_fresh = 1;
    return OK;
}

/* -- life */

struct instance *instance_new(const char *name, const char *guid, const char *resources,
                              void (*say)(const struct instance *, int, const char *), void *logger, void *environment)
{
    struct instance *m = calloc(1, sizeof *m);
    if (!m)
        return NULL;
    m->say = say;
    m->logger = logger;
    m->environment = environment;
    m->name = copied(name && *name ? name : model->identifier);
    m->resources = copied(resources ? resources : "");
    m->block = malloc((size_t)(model->n_p + model->n_u + model->n_x + model->n_y) * sizeof(double) + 1);
    if (!m->name || !m->resources || !m->block) {
        instance_free(m);
        return NULL;
    }
    if (!guid || strcmp(guid, model->guid)) {
        refuse(m, "its binary is of %s %s, but modelDescription.xml says %s: both must come from one FMU; unpack it again", model->identifier,
               model->guid, guid ? guid : "nothing");
        instance_free(m);
        return NULL;
    }
    instance_reset(m);
    return m;
}

int instance_reset(struct instance *m)
{
    memory_free(m->memory);
    m->memory = NULL;
    m->phase = INSTANTIATED;
    m->is_fresh = 0;
    m->time = 0.0;
    m->n_told = 0;
    memcpy(m->block, model->starts, (size_t)(model->n_p + model->n_u + model->n_x + model->n_y) * sizeof(double));
    return OK;
}

void instance_free(struct instance *m)
{
    if (!m)
        return;
    while (m->saves)
        state_free(m, m->saves);
    memory_free(m->memory);
    free(m->told);
    free(m->block);
    free(m->resources);
    free(m->name);
    free(m);
}

int instance_enter(struct instance *m, double start)
{
    m->time = start;
    m->is_fresh = 0;
    m->phase = INITIALISING;
    return OK;
}

int instance_exit(struct instance *m)
{
    if ((!m->is_fresh || !m->memory) && initialise(m))
        return ERROR;
    m->phase = STEPPING;
    return OK;
}

int instance_step(struct instance *m, double t, double h)
{
    if (!(h >= 0.0 && h <= DBL_MAX)) {
        char is[64];
        write_number(is, sizeof is, "%g", h);
        return refuse(m, "step length h = %s s at t = %.6g s: it must be finite and not negative", is, t);
    }
    if (check_time(m, t) || check_inputs(m, t) || memory_reserve(m))
        return ERROR;
    int32_t status = 0;
    void *raised = NULL;
    if (model_step(&status, &raised, t, h, m->block, memory_arrays(m->memory), memory_extents(m->memory)))
        return refuse(m, "its step failed (t = %.6g s)", t);
    int result = status ? report(m, status, t) : OK;
    const int64_t first = model->n_p + model->n_u + model->n_x;
    for (int64_t i = first; i < first + model->n_y && result != ERROR; i++)
        if (!isfinite(m->block[i]))
            result = refuse(m, "the output with the reference %d is not finite after the step at t = %.6g s", (int)i, t);
    if (result != ERROR)
        m->time = t + h;
    return result;
}

/* -- values */

static const char *kind_of(int is_choice)
{
    return is_choice ? "enumeration" : "real";
}

int ready_to_get(struct instance *m)
{
    return m->phase == INITIALISING && !m->is_fresh ? initialise(m) : OK;
}

size_t run_of(const uint32_t *references, size_t n)
{
    size_t k = 1;
    while (k < n && references[k] == references[0] + k)
        k++;
    return k;
}

/* Whether all of these are variables of one type. */
static int are_of(int64_t first, int64_t n, int is_choice)
{
    for (int64_t i = first; i < first + n; i++)
        if ((i < model->n_p && model->variables[i].options ? 1 : 0) != is_choice)
            return 0;
    return 1;
}

int get_values(struct instance *m, uint32_t first, size_t n, int is_choice, double *values)
{
    int64_t inputs_end = model->n_p + model->n_u, outputs = inputs_end + model->n_x, end = (int64_t)first + (int64_t)n;
    if (end > outputs + model->n_y || (end > inputs_end && first < outputs) || !are_of(first, (int64_t)n, is_choice))
        return refuse(m, "it has no %s variables with the references %u to %lld", kind_of(is_choice), (unsigned)first, (long long)end - 1);
    memcpy(values, m->block + first, n * sizeof *values);
    return OK;
}

int set_values(struct instance *m, uint32_t first, size_t n, int is_choice, const double *values)
{
    int64_t end = (int64_t)first + (int64_t)n;
    if (end > model->n_p + model->n_u || !are_of(first, (int64_t)n, is_choice))
        return refuse(m, "it has no %s parameters or inputs with the references %u to %lld", kind_of(is_choice), (unsigned)first,
                      (long long)end - 1);
    if (m->phase == STEPPING && first < model->n_p)
        return refuse(m, "parameter %s is fixed: set it before initialisation ends, not during the run", model->variables[first].name);
    if (m->phase != STEPPING)
        m->is_fresh = 0;
    memcpy(m->block + first, values, n * sizeof *values);
    return OK;
}

int set_file(struct instance *m, size_t i, const char *value)
{
    const struct file *file = model->files + i;
    if (!value || strcmp(value, file->start))
        return refuse(m, "%s = '%s': this FMU holds what it needs of '%s'; build it with the other file (cdl build --native %s --file %s=...) (%s)",
                      file->name, value ? value : "", file->start, model->identifier, file->name, file->description);
    return OK;
}
