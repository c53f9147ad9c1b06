/* Sends recorded inputs to an FMU of FMI 2.0, step by step, and records its outputs:

       replay FOLDER IDENTIFIER GUID FIRST_INPUT N_INPUTS FIRST_OUTPUT N_OUTPUTS STEPS STEP_LENGTH INPUTS OUTPUTS

   References are consecutive; files hold doubles, a row for each step. */

#include "platform.h"

#include <stdarg.h>

#include "fmi2FunctionTypes.h"

static void say(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...) {
    (void)environment, (void)category;
    va_list arguments;
    va_start(arguments, message);
    fprintf(stderr, "%s: status %d: ", name, (int)status);
    vfprintf(stderr, message, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

static void *found(void *library, const char *name) {
    void *function = symbol(library, name);
    if (!function) fprintf(stderr, "no %s\n", name), exit(2);
    return function;
}

static void check(fmi2Status status, const char *what) {
    if (status > fmi2Warning) fprintf(stderr, "%s ended with status %d\n", what, (int)status), exit(3);
}

int main(int n_arguments, char **arguments) {
    if (n_arguments != 12) return fputs("11 arguments are needed\n", stderr), 1;
    const char *folder = arguments[1], *identifier = arguments[2];
    size_t first_u = strtoul(arguments[4], NULL, 10), n_u = strtoul(arguments[5], NULL, 10);
    size_t first_y = strtoul(arguments[6], NULL, 10), n_y = strtoul(arguments[7], NULL, 10), steps = strtoul(arguments[8], NULL, 10);
    double h = strtod(arguments[9], NULL);
    char path[4096];
    snprintf(path, sizeof path, "%s/binaries/" PLATFORM "/%s" SUFFIX, folder, identifier);
    void *library = load(path);
    if (!library) return fprintf(stderr, "%s: %s\n", path, load_error()), 2;
    fmi2CallbackFunctions callbacks = {say, calloc, free, NULL, NULL};
    fmi2Component c = ((fmi2InstantiateTYPE *)found(library, "fmi2Instantiate"))("it", fmi2CoSimulation, arguments[3], resources_uri(folder),
                                                                                &callbacks, fmi2False, fmi2True);
    if (!c) return fputs("not instantiated\n", stderr), 2;
    fmi2SetRealTYPE *set = found(library, "fmi2SetReal");
    fmi2GetRealTYPE *get = found(library, "fmi2GetReal");
    fmi2DoStepTYPE *step = found(library, "fmi2DoStep");
    check(((fmi2SetupExperimentTYPE *)found(library, "fmi2SetupExperiment"))(c, fmi2False, 0.0, 0.0, fmi2False, 0.0), "setup");
    check(((fmi2EnterInitializationModeTYPE *)found(library, "fmi2EnterInitializationMode"))(c), "enter");
    check(((fmi2ExitInitializationModeTYPE *)found(library, "fmi2ExitInitializationMode"))(c), "exit");
    fmi2ValueReference *references = calloc(n_u + n_y, sizeof *references);
    double *u = calloc(n_u + 1, sizeof *u), *y = calloc(n_y + 1, sizeof *y);
    for (size_t i = 0; i < n_u; i++) references[i] = (fmi2ValueReference)(first_u + i);
    for (size_t i = 0; i < n_y; i++) references[n_u + i] = (fmi2ValueReference)(first_y + i);
    FILE *in = fopen(arguments[10], "rb"), *out = fopen(arguments[11], "wb");
    if (!in || !out) return fputs("no file\n", stderr), 2;
    for (size_t k = 0; k < steps; k++) {
        if (fread(u, sizeof *u, n_u, in) != n_u) return fputs("too few inputs\n", stderr), 2;
        check(set(c, references, n_u, u), "set");
        check(step(c, (double)k * h, h, fmi2True), "step");
        check(get(c, references + n_u, n_y, y), "get");
        fwrite(y, sizeof *y, n_y, out);
    }
    fclose(in);
    fclose(out);
    ((fmi2FreeInstanceTYPE *)found(library, "fmi2FreeInstance"))(c);
    return 0;
}
