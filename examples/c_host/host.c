/* A host in plain C for systems that 'cdl export EXPERIMENT --unpacked DIR' writes: FMI 2.0 co-simulation, Jacobi exchange.

   Of FMI it needs the headers alone (https://fmi-standard.org; FMPy has them in its folder c-code):

       cc -std=c99 -O2 -I HEADERS host.c -o host -ldl -lm                   on Linux
       python -m ziglang cc -target x86_64-windows-gnu -O2 -I HEADERS host.c -o host.exe
       ./host DIR result.csv [--times]

   All instances step from t to t + H on the outputs of t. What system.txt holds is said in its first lines. */

#include "platform.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

typedef struct {
    size_t n;
    fmi2ValueReference *references; /* ascending, each once */
    fmi2Real *values;
} Variables;

typedef struct {
    char name[256], identifier[256], guid[256];
    fmi2Component component;
    fmi2SetRealTYPE *set_real;
    fmi2GetRealTYPE *get_real;
    fmi2DoStepTYPE *do_step;
    fmi2SetupExperimentTYPE *setup_experiment;
    fmi2EnterInitializationModeTYPE *enter_initialization_mode;
    fmi2ExitInitializationModeTYPE *exit_initialization_mode;
    fmi2TerminateTYPE *terminate;
    fmi2FreeInstanceTYPE *free_instance;
    Variables inputs, outputs;
    int fed_by_later;
    double set_s, step_s, get_s;
} Slave;

typedef struct {
    unsigned from, to;
    fmi2ValueReference source_reference, target_reference;
    const fmi2Real *source;
    fmi2Real *target;
} Connection;

typedef struct {
    unsigned from;
    fmi2ValueReference reference;
    char name[512];
    const fmi2Real *value;
} Signal;

typedef struct {
    double start, step, stop;
    unsigned n_slaves, n_connections, n_signals;
    Slave *slaves;
    Connection *connections;
    Signal *signals;
} System;

static void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
    exit(1);
}

static void *zeros(size_t n, size_t size) {
    void *memory = calloc(n ? n : 1, size);
    if (!memory) fail("no memory for %zu values", n);
    return memory;
}

/* -- the table */

static void scan(FILE *table, int n, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    if (vfscanf(table, format, arguments) != n) fail("system.txt: expected '%s' at byte %ld", format, ftell(table));
    va_end(arguments);
}

static System read_table(const char *folder) {
    System s;
    char path[4096];
    int c;
    snprintf(path, sizeof path, "%s/system.txt", folder);
    FILE *table = fopen(path, "r");
    if (!table) fail("%s: no such file; write it with 'cdl export EXPERIMENT --unpacked %s'", path, folder);
    while ((c = getc(table)) == '#')
        while ((c = getc(table)) != '\n' && c != EOF) {}
    ungetc(c, table);
    scan(table, 4, " start %lf step %lf stop %lf instances %u", &s.start, &s.step, &s.stop, &s.n_slaves);
    s.slaves = zeros(s.n_slaves, sizeof *s.slaves);
    for (Slave *i = s.slaves; i < s.slaves + s.n_slaves; i++) scan(table, 3, " %255s %255s %255s", i->name, i->identifier, i->guid);
    scan(table, 1, " connections %u", &s.n_connections);
    s.connections = zeros(s.n_connections, sizeof *s.connections);
    for (Connection *i = s.connections; i < s.connections + s.n_connections; i++) {
        scan(table, 4, " %u %u %u %u", &i->from, &i->source_reference, &i->to, &i->target_reference);
        if (i->from >= s.n_slaves || i->to >= s.n_slaves) fail("%s: connection from %u to %u: no such instance", path, i->from, i->to);
    }
    scan(table, 1, " signals %u", &s.n_signals);
    s.signals = zeros(s.n_signals, sizeof *s.signals);
    for (Signal *i = s.signals; i < s.signals + s.n_signals; i++) {
        scan(table, 3, " %u %u %511s", &i->from, &i->reference, i->name);
        if (i->from >= s.n_slaves) fail("%s: signal %s: no instance %u", path, i->name, i->from);
    }
    fclose(table);
    return s;
}

/* -- what is exchanged: one call each way for an instance */

static int by_reference(const void *a, const void *b) {
    const fmi2ValueReference x = *(const fmi2ValueReference *)a, y = *(const fmi2ValueReference *)b;
    return (x > y) - (x < y);
}

static void unite(Variables *v) {
    size_t n = 0;
    qsort(v->references, v->n, sizeof *v->references, by_reference);
    for (size_t i = 0; i < v->n; i++)
        if (!n || v->references[n - 1] != v->references[i]) v->references[n++] = v->references[i];
    v->n = n;
}

static fmi2Real *value_of(const Variables *v, fmi2ValueReference reference) {
    const fmi2ValueReference *found = bsearch(&reference, v->references, v->n, sizeof reference, by_reference);
    return v->values + (found - v->references);
}

static void bind_variables(System *s) {
    for (Slave *i = s->slaves; i < s->slaves + s->n_slaves; i++) {
        const size_t most = (size_t)s->n_connections + s->n_signals;
        i->inputs.references = zeros(most, sizeof(fmi2ValueReference));
        i->outputs.references = zeros(most, sizeof(fmi2ValueReference));
        i->inputs.values = zeros(most, sizeof(fmi2Real));
        i->outputs.values = zeros(most, sizeof(fmi2Real));
    }
    for (Connection *i = s->connections; i < s->connections + s->n_connections; i++) {
        Slave *from = s->slaves + i->from, *to = s->slaves + i->to;
        from->outputs.references[from->outputs.n++] = i->source_reference;
        to->inputs.references[to->inputs.n++] = i->target_reference;
        if (from >= to) to->fed_by_later = 1;
    }
    for (Signal *i = s->signals; i < s->signals + s->n_signals; i++) {
        Variables *outputs = &s->slaves[i->from].outputs;
        outputs->references[outputs->n++] = i->reference;
    }
    for (Slave *i = s->slaves; i < s->slaves + s->n_slaves; i++) unite(&i->inputs), unite(&i->outputs);
    for (Connection *i = s->connections; i < s->connections + s->n_connections; i++) {
        i->source = value_of(&s->slaves[i->from].outputs, i->source_reference);
        i->target = value_of(&s->slaves[i->to].inputs, i->target_reference);
    }
    for (Signal *i = s->signals; i < s->signals + s->n_signals; i++) i->value = value_of(&s->slaves[i->from].outputs, i->reference);
}

static void route(const System *s) {
    for (const Connection *i = s->connections; i < s->connections + s->n_connections; i++) *i->target = *i->source;
}

/* -- FMUs */

static void logger(void *environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String message, ...) {
    va_list arguments;
    va_start(arguments, message);
    fprintf(stderr, "%s: ", instance);
    vfprintf(stderr, message, arguments); /* in FMI 2.0 a message is a format of printf */
    fputc('\n', stderr);
    va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

static void instantiate(Slave *s, const char *folder) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", folder, s->name);
    char *resources = resources_uri(path);
    if (!resources) fail("%s: no such folder", path);
    snprintf(path, sizeof path, "%s/%s/binaries/" PLATFORM "/%s" SUFFIX, folder, s->name, s->identifier);
    void *library = load(path);
    if (!library) fail("%s: %s does not load: %s", s->name, path, load_error());
    fmi2InstantiateTYPE *instantiate_slave;
    const struct {
        void *function;
        const char *name;
    } functions[] = {
        {&instantiate_slave, "fmi2Instantiate"},
        {&s->set_real, "fmi2SetReal"},
        {&s->get_real, "fmi2GetReal"},
        {&s->do_step, "fmi2DoStep"},
        {&s->setup_experiment, "fmi2SetupExperiment"},
        {&s->enter_initialization_mode, "fmi2EnterInitializationMode"},
        {&s->exit_initialization_mode, "fmi2ExitInitializationMode"},
        {&s->terminate, "fmi2Terminate"},
        {&s->free_instance, "fmi2FreeInstance"},
    };
    for (size_t i = 0; i < sizeof functions / sizeof *functions; i++) {
        void *function = symbol(library, functions[i].name);
        if (!function) fail("%s: %s has no function %s: it is no FMI 2.0 co-simulation FMU", s->name, path, functions[i].name);
        memcpy(functions[i].function, &function, sizeof function);
    }
    s->component = instantiate_slave(s->name, fmi2CoSimulation, s->guid, resources, &callbacks, fmi2False, fmi2True);
    if (!s->component) fail("%s: fmi2Instantiate failed for %s", s->name, path);
    free(resources);
}

static void check(const Slave *s, fmi2Status status, const char *call, double t) {
    static const char *names[] = {"fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending"};
    if (status > fmi2Warning) fail("%s: %s at t = %g s returned %s", s->name, call, t, names[status <= fmi2Pending ? status : fmi2Fatal]);
}

static void set(Slave *s, double t) {
    if (s->inputs.n) check(s, s->set_real(s->component, s->inputs.references, s->inputs.n, s->inputs.values), "fmi2SetReal", t);
}

static void get(Slave *s, double t) {
    if (s->outputs.n) check(s, s->get_real(s->component, s->outputs.references, s->outputs.n, s->outputs.values), "fmi2GetReal", t);
}

static void initialise(System *s) {
    for (Slave *i = s->slaves; i < s->slaves + s->n_slaves; i++) {
        check(i, i->setup_experiment(i->component, fmi2False, 0.0, s->start, fmi2True, s->stop), "fmi2SetupExperiment", s->start);
        check(i, i->enter_initialization_mode(i->component), "fmi2EnterInitializationMode", s->start);
        route(s);
        if (!i->fed_by_later) set(i, s->start);
        check(i, i->exit_initialization_mode(i->component), "fmi2ExitInitializationMode", s->start);
        get(i, s->start);
    }
}

static void advance(Slave *s, double t, double h) {
    const double begin = now();
    set(s, t);
    const double set_done = now();
    check(s, s->do_step(s->component, t, h, fmi2True), "fmi2DoStep", t);
    const double step_done = now();
    get(s, t + h);
    s->set_s += set_done - begin;
    s->step_s += step_done - set_done;
    s->get_s += now() - step_done;
}

/* -- the run */

static void record(const System *s, FILE *csv, double t) {
    fprintf(csv, "%.17g", t);
    for (const Signal *i = s->signals; i < s->signals + s->n_signals; i++) fprintf(csv, ",%.17g", *i->value);
    fputc('\n', csv);
}

int main(int argc, char **argv) {
    if (argc < 3 || argc > 4 || (argc == 4 && strcmp(argv[3], "--times"))) fail("usage: %s DIR RESULT.csv [--times]", argv[0]);
    System s = read_table(argv[1]);
    FILE *csv = fopen(argv[2], "w");
    if (!csv) fail("%s cannot be written", argv[2]);
    bind_variables(&s);
    for (unsigned i = 0; i < s.n_slaves; i++) instantiate(s.slaves + i, argv[1]);
    initialise(&s);

    fprintf(csv, "\"time\"");
    for (unsigned i = 0; i < s.n_signals; i++) fprintf(csv, ",\"%s\"", s.signals[i].name);
    fputc('\n', csv);
    record(&s, csv, s.start);
    const long n_steps = lround((s.stop - s.start) / s.step);
    double route_s = 0.0;
    for (long k = 0; k < n_steps; k++) {
        const double t = s.start + (double)k * s.step, begin = now();
        route(&s);
        route_s += now() - begin;
        for (unsigned i = 0; i < s.n_slaves; i++) advance(s.slaves + i, t, s.step);
        record(&s, csv, s.start + (double)(k + 1) * s.step);
    }
    if (fclose(csv)) fail("%s could not be written to its end", argv[2]);
    for (unsigned i = 0; i < s.n_slaves; i++) check(s.slaves + i, s.slaves[i].terminate(s.slaves[i].component), "fmi2Terminate", s.stop);
    for (unsigned i = 0; i < s.n_slaves; i++) s.slaves[i].free_instance(s.slaves[i].component);

    if (argc == 4 && n_steps) {
        const double us = 1e6 / (double)n_steps;
        printf("%-16s %10s %10s %10s %8s %8s\n", "us a step", "set", "doStep", "get", "inputs", "outputs");
        for (const Slave *i = s.slaves; i < s.slaves + s.n_slaves; i++)
            {
            printf("%-16s %10.3f %10.3f %10.3f", i->name, us * i->set_s, us * i->step_s, us * i->get_s);
            printf(" %8zu %8zu\n", i->inputs.n, i->outputs.n);
        }
        printf("%-16s %10.3f\n", "routing", us * route_s);
    }
    return 0;
}
