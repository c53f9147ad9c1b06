/* The FMU's variables and values for them. */

#include "fuzz.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void damaged(const char *path) {
    fprintf(stderr, "%s is damaged: let tests/fuzzing.py write it\n", path);
    exit(1);
}

struct table read_table(const char *folder) {
    struct table t = {0};
    char path[4096];
    snprintf(path, sizeof path, "%s/fuzz.txt", folder);
    FILE *file = fopen(path, "r");
    if (!file || fscanf(file, "%d %255s %255s %zu", &t.version, t.identifier, t.token, &t.n) != 4) damaged(path);
    t.variables = calloc(t.n + 1, sizeof *t.variables);
    for (struct variable *v = t.variables; v < t.variables + t.n; v++) {
        if (fscanf(file, " %c %c %u %zu", &v->causality, &v->type, &v->reference, &v->length) != 4) damaged(path);
        if (fscanf(file, " %lf %lf %255s", &v->min, &v->max, v->name) != 3) damaged(path);
        v->starts = calloc(v->length, sizeof *v->starts);
        for (size_t k = 0; k < v->length; k++)
            if (fscanf(file, "%lf", v->starts + k) != 1) damaged(path);
        t.n_elements += v->length;
        if (v->causality == OUTPUT && v->type == REAL) t.n_outputs += v->length;
        if (v->reference + v->length > t.unknown) t.unknown = v->reference + (uint32_t)v->length;
    }
    t.unknown += 1000; /* states lie between, without a name */
    fclose(file);
    return t;
}

uint64_t next(struct random *r) { /* splitmix64: Steele, Lea & Flood 2014 */
    uint64_t z = (r->state += 0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
}

size_t below(struct random *r, size_t n) { return (size_t)(next(r) % n); }

double uniform(struct random *r, double from, double to) { return from + (to - from) * ((double)(next(r) >> 11) * 0x1p-53); }

/* Row-major place of an element in its array: as FMI 3.0 counts it, or from the name, as in wheel[1].T[2,3]. */
static size_t place(const struct variable *v, size_t element) {
    unsigned row, column;
    const char *bracket = strrchr(v->name, '[');
    if (v->length > 1 || !bracket) return element;
    const int n = sscanf(bracket, "[%u,%u]", &row, &column);
    return n == 2 ? 3 * (row - 1) + column - 1 : n == 1 ? row - 1 : 0;
}

double sane(const struct variable *v, size_t element, unsigned step, struct random *r) {
    const double start = v->starts[element], angle = 0.004 * step, c = cos(angle), s = sin(angle);
    const size_t i = place(v, element) % 9;
    double value = start + (v->causality == PARAMETER ? 0.05 * start : 0.01) * uniform(r, -1.0, 1.0);
    /* The names are those of the contact interface: a wheel that rolls along x, more or less deep in the ground or a body below it. */
    const double z = strstr(v->name, "body[") || strstr(v->name, "rock[") ? 0.0 : 0.12 + 0.02 * sin(0.05 * step);
    if (strstr(v->name, ".T")) value = (double[]){c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c}[i];
    if (strstr(v->name, ".r_0")) value = i == 0 ? 5e-4 * step : i == 2 ? z + uniform(r, -1e-3, 1e-3) : 0.0;
    if (strstr(v->name, ".v_0")) value = i == 0 ? 0.5 : uniform(r, -0.1, 0.1);
    if (strstr(v->name, ".w_0")) value = i == 1 ? 4.0 : 0.0;
    return fmin(fmax(value, v->min), v->max);
}

double wild(const struct variable *v, size_t element, struct random *r) {
    const double start = v->starts[element];
    const double values[] = {
        NAN,  INFINITY, -INFINITY,     1e300,  -1e300,       DBL_MAX,       DBL_TRUE_MIN, -DBL_TRUE_MIN, 0.0,    -0.0,   1.0,
        -1.0, 1e6,      -1e6,          1e-6,   2e9,          -start,        1e3 * start,  1e-3 * start,  v->min, v->max, v->min,
        v->max, nextafter(v->min, -INFINITY), nextafter(v->max, INFINITY),
    };
    const size_t n = sizeof values / sizeof *values, i = below(r, n + 3);
    double value = i < n ? values[i] : uniform(r, fmax(v->min, -1e6), fmin(v->max, 1e6));
    if (i == n) {
        const uint64_t bits = next(r);
        memcpy(&value, &bits, sizeof value);
    }
    return value;
}
