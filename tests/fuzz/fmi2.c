/* FMI 2.0. */

#include "fmu.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

#define FUNCTIONS(ONE)                                                                                                        \
    ONE(Instantiate) ONE(FreeInstance) ONE(SetupExperiment) ONE(EnterInitializationMode) ONE(ExitInitializationMode)          \
    ONE(Terminate) ONE(Reset) ONE(DoStep) ONE(SetReal) ONE(GetReal) ONE(SetInteger) ONE(GetInteger) ONE(SetBoolean)           \
    ONE(GetBoolean) ONE(SetString) ONE(GetString) ONE(GetFMUstate) ONE(SetFMUstate) ONE(FreeFMUstate)                         \
    ONE(SerializedFMUstateSize) ONE(SerializeFMUstate) ONE(DeSerializeFMUstate) ONE(GetTypesPlatform) ONE(GetVersion)         \
    ONE(SetDebugLogging) ONE(GetDirectionalDerivative) ONE(SetRealInputDerivatives) ONE(GetRealOutputDerivatives)             \
    ONE(CancelStep) ONE(GetStatus) ONE(GetRealStatus) ONE(GetIntegerStatus) ONE(GetBooleanStatus) ONE(GetStringStatus)

#define DECLARE(name) static fmi2##name##TYPE *p##name;
FUNCTIONS(DECLARE)

static void logger(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String format, ...) {
    char text[4096];
    va_list arguments;
    (void)name, (void)status, (void)category;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    said(environment, text);
}

static void *instantiate(const char *name, const char *token, const char *resources, int way, void *environment) {
    static __thread fmi2CallbackFunctions callbacks; /* an FMU may keep the pointer; a thread has one environment */
    static fmi2CallbackFunctions silent = {NULL, calloc, free, NULL, NULL};
    callbacks = (fmi2CallbackFunctions){logger, calloc, free, NULL, environment};
    const fmi2Type type = way == MODEL_EXCHANGE ? fmi2ModelExchange : fmi2CoSimulation;
    return pInstantiate(name, type, token, resources, way == WITHOUT_LOGGER ? &silent : &callbacks, fmi2False, fmi2True);
}
static void free_instance(void *c) { pFreeInstance(c); }
static int setup(void *c, double start) { return pSetupExperiment(c, fmi2False, 0.0, start, fmi2False, 0.0); }
static int enter(void *c, double start) { return (void)start, pEnterInitializationMode(c); }
static int leave(void *c) { return pExitInitializationMode(c); }
static int terminate(void *c) { return pTerminate(c); }
static int reset(void *c) { return pReset(c); }
static int step(void *c, double t, double h) { return pDoStep(c, t, h, fmi2True); }
static int set_real(void *c, const uint32_t *r, size_t n, const double *v, size_t m) { return (void)m, pSetReal(c, r, n, v); }
static int get_real(void *c, const uint32_t *r, size_t n, double *v, size_t m) { return (void)m, pGetReal(c, r, n, v); }
static int set_string(void *c, const uint32_t *r, size_t n, const char *const *v) { return pSetString(c, r, n, (const fmi2String *)v); }
static int get_string(void *c, const uint32_t *r, size_t n, const char **v) { return pGetString(c, r, n, v); }
static int get_state(void *c, void **s) { return pGetFMUstate(c, s); }
static int set_state(void *c, void *s) { return pSetFMUstate(c, s); }
static int free_state(void *c, void **s) { return pFreeFMUstate(c, s); }
static int size_of(void *c, void *s, size_t *n) { return pSerializedFMUstateSize(c, s, n); }
static int serialise(void *c, void *s, unsigned char *b, size_t n) { return pSerializeFMUstate(c, s, (fmi2Byte *)b, n); }
static int deserialise(void *c, const unsigned char *b, size_t n, void **s) { return pDeSerializeFMUstate(c, (const fmi2Byte *)b, n, s); }

static int set_choice(void *c, const uint32_t *references, size_t n, const int64_t *values) {
    int *narrow = values ? calloc(n + 1, sizeof *narrow) : NULL;
    for (size_t i = 0; narrow && i < n; i++) narrow[i] = (int)values[i];
    const int status = pSetInteger(c, references, n, narrow);
    free(narrow);
    return status;
}

static int get_choice(void *c, const uint32_t *references, size_t n, int64_t *values) {
    int *narrow = values ? calloc(n + 1, sizeof *narrow) : NULL;
    const int status = pGetInteger(c, references, n, narrow);
    for (size_t i = 0; narrow && i < n; i++) values[i] = narrow[i];
    free(narrow);
    return status;
}

static int other(void *c, unsigned which) {
    const fmi2ValueReference references[2] = {0, 1};
    const fmi2Integer orders[2] = {1, 1};
    fmi2Real reals[2] = {0.0, 1.0};
    fmi2Integer integer;
    fmi2Boolean booleans[2] = {0, 1};
    fmi2Status status;
    fmi2String text;
    switch (which % 14) {
    case 0: return !pGetTypesPlatform();
    case 1: return !pGetVersion();
    case 2: return pSetDebugLogging(c, fmi2True, 0, NULL);
    case 3: return pGetDirectionalDerivative(c, references, 2, references, 2, reals, reals);
    case 4: return pSetRealInputDerivatives(c, references, 2, orders, reals);
    case 5: return pGetRealOutputDerivatives(c, references, 2, orders, reals);
    case 6: return pCancelStep(c);
    case 7: return pGetStatus(c, fmi2DoStepStatus, &status);
    case 8: return pGetRealStatus(c, fmi2LastSuccessfulTime, reals);
    case 9: return pGetIntegerStatus(c, fmi2PendingStatus, &integer);
    case 10: return pGetBooleanStatus(c, fmi2Terminated, booleans);
    case 11: return pGetStringStatus(c, fmi2PendingStatus, &text);
    case 12: return pGetBoolean(c, references, 2, booleans);
    default: return pSetBoolean(c, references, 2, booleans);
    }
}

const char *bind_fmi2(struct fmu *f, void *library) {
#define BIND(name) \
    if (!(p##name = (fmi2##name##TYPE *)symbol_of(library, "fmi2" #name))) return "fmi2" #name;
    FUNCTIONS(BIND)
    *f = (struct fmu){
        .instantiate = instantiate, .free_instance = free_instance, .setup = setup, .enter = enter, .exit = leave,
        .terminate = terminate, .reset = reset, .step = step, .set_real = set_real, .get_real = get_real,
        .set_choice = set_choice, .get_choice = get_choice, .set_string = set_string, .get_string = get_string,
        .get_state = get_state, .set_state = set_state, .free_state = free_state, .size = size_of, .serialise = serialise,
        .deserialise = deserialise, .other = other,
    };
    return NULL;
}
