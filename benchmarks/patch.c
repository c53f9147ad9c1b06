/* What it costs to set and get arrays of an FMU whose library has the functions of FMI 2.0 and of FMI 3.0, as our native ones have:

       patch LIBRARY GUID REFERENCE:LENGTH...

   FMI 2.0 exchanges an array as LENGTH references that follow each other, FMI 3.0 as one. patch.py compiles and runs this. */

#include "platform.h"

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

enum { ROUNDS = 20000 };

static void *needed(void *library, const char *name) {
    void *function = symbol(library, name);
    if (!function) fprintf(stderr, "the library has no function %s\n", name), exit(1);
    return function;
}

static void checked(int status, const char *call) {
    if (status) fprintf(stderr, "%s returned %d\n", call, status), exit(1);
}

static void show(const char *version, size_t n_references, size_t n, double set_s, double get_s) {
    printf("%-8s %10zu %8zu %10.3f %10.3f\n", version, n_references, n, 1e6 * set_s / ROUNDS, 1e6 * get_s / ROUNDS);
}

static void measure2(void *library, const char *guid, const fmi2ValueReference *references, size_t n, fmi2Real *values) {
    static const fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};
    fmi2SetRealTYPE *set = (fmi2SetRealTYPE *)needed(library, "fmi2SetReal");
    fmi2GetRealTYPE *get = (fmi2GetRealTYPE *)needed(library, "fmi2GetReal");
    fmi2Component c = ((fmi2InstantiateTYPE *)needed(library, "fmi2Instantiate"))("patch", fmi2CoSimulation, guid, "", &callbacks, 0, 0);
    if (!c) fprintf(stderr, "fmi2Instantiate failed\n"), exit(1);
    checked(((fmi2EnterInitializationModeTYPE *)needed(library, "fmi2EnterInitializationMode"))(c), "fmi2EnterInitializationMode");
    checked(((fmi2ExitInitializationModeTYPE *)needed(library, "fmi2ExitInitializationMode"))(c), "fmi2ExitInitializationMode");
    const double begin = now();
    for (int i = 0; i < ROUNDS; i++) checked(set(c, references, n, values), "fmi2SetReal");
    const double middle = now();
    for (int i = 0; i < ROUNDS; i++) checked(get(c, references, n, values), "fmi2GetReal");
    show("FMI 2.0", n, n, middle - begin, now() - middle);
    ((fmi2FreeInstanceTYPE *)needed(library, "fmi2FreeInstance"))(c);
}

static void measure3(void *library, const char *token, const fmi3ValueReference *references, size_t n, double *values, size_t n_values) {
    fmi3SetFloat64TYPE *set = (fmi3SetFloat64TYPE *)needed(library, "fmi3SetFloat64");
    fmi3GetFloat64TYPE *get = (fmi3GetFloat64TYPE *)needed(library, "fmi3GetFloat64");
    fmi3InstantiateCoSimulationTYPE *make = (fmi3InstantiateCoSimulationTYPE *)needed(library, "fmi3InstantiateCoSimulation");
    fmi3Instance c = make("patch", token, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    if (!c) fprintf(stderr, "fmi3InstantiateCoSimulation failed\n"), exit(1);
    fmi3EnterInitializationModeTYPE *enter = (fmi3EnterInitializationModeTYPE *)needed(library, "fmi3EnterInitializationMode");
    checked(enter(c, 0, 0.0, 0.0, 0, 0.0), "fmi3EnterInitializationMode");
    checked(((fmi3ExitInitializationModeTYPE *)needed(library, "fmi3ExitInitializationMode"))(c), "fmi3ExitInitializationMode");
    const double begin = now();
    for (int i = 0; i < ROUNDS; i++) checked(set(c, references, n, values, n_values), "fmi3SetFloat64");
    const double middle = now();
    for (int i = 0; i < ROUNDS; i++) checked(get(c, references, n, values, n_values), "fmi3GetFloat64");
    show("FMI 3.0", n, n_values, middle - begin, now() - middle);
    ((fmi3FreeInstanceTYPE *)needed(library, "fmi3FreeInstance"))(c);
}

int main(int argc, char **argv) {
    if (argc < 4) return fprintf(stderr, "usage: %s LIBRARY GUID REFERENCE:LENGTH...\n", argv[0]), 1;
    void *library = load(argv[1]);
    if (!library) return fprintf(stderr, "%s does not load: %s\n", argv[1], load_error()), 1;
    const int n_arrays = argc - 3;
    unsigned *firsts = calloc((size_t)n_arrays, sizeof *firsts), *all = NULL, length;
    size_t n = 0;
    for (int i = 0; i < n_arrays; i++) {
        if (sscanf(argv[3 + i], "%u:%u", firsts + i, &length) != 2) return fprintf(stderr, "%s: write REFERENCE:LENGTH\n", argv[3 + i]), 1;
        all = realloc(all, (n + length) * sizeof *all);
        for (unsigned k = 0; k < length; k++) all[n++] = firsts[i] + k;
    }
    double *values = calloc(n, sizeof *values);
    printf("%-8s %10s %8s %10s %10s\n", "", "references", "values", "set [us]", "get [us]");
    measure2(library, argv[2], all, n, values);
    measure3(library, argv[2], firsts, (size_t)n_arrays, values, n);
    return 0;
}
