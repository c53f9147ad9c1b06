/* FMI 3.0. */

#include "fmu.h"

#include <stdio.h>

#include "fmi3FunctionTypes.h"

#define FUNCTIONS(ONE)                                                                                                        \
    ONE(InstantiateCoSimulation) ONE(InstantiateModelExchange) ONE(FreeInstance) ONE(EnterInitializationMode)                 \
    ONE(ExitInitializationMode) ONE(Terminate) ONE(Reset) ONE(DoStep) ONE(SetFloat64) ONE(GetFloat64) ONE(SetInt64)           \
    ONE(GetInt64) ONE(SetString) ONE(GetString) ONE(GetFMUState) ONE(SetFMUState) ONE(FreeFMUState)                           \
    ONE(SerializedFMUStateSize) ONE(SerializeFMUState) ONE(DeserializeFMUState) ONE(GetVersion) ONE(SetDebugLogging)          \
    ONE(GetDirectionalDerivative) ONE(GetAdjointDerivative) ONE(GetFloat32) ONE(SetInt32) ONE(GetBoolean) ONE(SetBinary)      \
    ONE(GetClock) ONE(EnterConfigurationMode) ONE(ExitConfigurationMode) ONE(EnterEventMode) ONE(EnterStepMode)               \
    ONE(EvaluateDiscreteStates) ONE(GetNumberOfVariableDependencies) ONE(GetOutputDerivatives)

#define DECLARE(name) static fmi3##name##TYPE *p##name;
FUNCTIONS(DECLARE)

static void logger(void *environment, fmi3Status status, fmi3String category, fmi3String message) {
    (void)status, (void)category;
    said(environment, message);
}

static void *instantiate(const char *name, const char *token, const char *resources, int way, void *environment) {
    if (way == MODEL_EXCHANGE) return pInstantiateModelExchange(name, token, resources, 0, 1, environment, logger);
    fmi3LogMessageCallback log = way == WITHOUT_LOGGER ? NULL : logger;
    return pInstantiateCoSimulation(name, token, resources, 0, 1, 0, 0, NULL, 0, environment, log, NULL);
}
static void free_instance(void *c) { pFreeInstance(c); }
static int enter(void *c, double start) { return pEnterInitializationMode(c, 0, 0.0, start, 0, 0.0); }
static int leave(void *c) { return pExitInitializationMode(c); }
static int terminate(void *c) { return pTerminate(c); }
static int reset(void *c) { return pReset(c); }
static int set_real(void *c, const uint32_t *r, size_t n, const double *v, size_t m) { return pSetFloat64(c, r, n, v, m); }
static int get_real(void *c, const uint32_t *r, size_t n, double *v, size_t m) { return pGetFloat64(c, r, n, v, m); }
static int set_choice(void *c, const uint32_t *r, size_t n, const int64_t *v) { return pSetInt64(c, r, n, v, n); }
static int get_choice(void *c, const uint32_t *r, size_t n, int64_t *v) { return pGetInt64(c, r, n, v, n); }
static int set_string(void *c, const uint32_t *r, size_t n, const char *const *v) { return pSetString(c, r, n, (const fmi3String *)v, n); }
static int get_string(void *c, const uint32_t *r, size_t n, const char **v) { return pGetString(c, r, n, v, n); }
static int get_state(void *c, void **s) { return pGetFMUState(c, s); }
static int set_state(void *c, void *s) { return pSetFMUState(c, s); }
static int free_state(void *c, void **s) { return pFreeFMUState(c, s); }
static int size_of(void *c, void *s, size_t *n) { return pSerializedFMUStateSize(c, s, n); }
static int serialise(void *c, void *s, unsigned char *b, size_t n) { return pSerializeFMUState(c, s, b, n); }
static int deserialise(void *c, const unsigned char *b, size_t n, void **s) { return pDeserializeFMUState(c, b, n, s); }

static int step(void *c, double t, double h) {
    fmi3Boolean event, stop, early;
    fmi3Float64 reached;
    return pDoStep(c, t, h, 1, &event, &stop, &early, &reached);
}

static int other(void *c, unsigned which) {
    const fmi3ValueReference references[2] = {0, 1};
    const fmi3Int32 integers[2] = {1, 1};
    const fmi3Byte byte = 0;
    const fmi3Binary binaries[2] = {&byte, &byte};
    const size_t sizes[2] = {1, 1};
    fmi3Float64 reals[2] = {0.0, 1.0};
    fmi3Float32 floats[2];
    fmi3Boolean booleans[2];
    fmi3Clock clocks[2];
    size_t n;
    switch (which % 16) {
    case 0: return !pGetVersion();
    case 1: return pSetDebugLogging(c, 1, 0, NULL);
    case 2: return pGetDirectionalDerivative(c, references, 2, references, 2, reals, 2, reals, 2);
    case 3: return pGetAdjointDerivative(c, references, 2, references, 2, reals, 2, reals, 2);
    case 4: return pGetFloat32(c, references, 2, floats, 2);
    case 5: return pSetInt32(c, references, 2, integers, 2);
    case 6: return pGetBoolean(c, references, 2, booleans, 2);
    case 7: return pSetBinary(c, references, 2, sizes, binaries, 2);
    case 8: return pGetClock(c, references, 2, clocks);
    case 9: return pEnterConfigurationMode(c);
    case 10: return pExitConfigurationMode(c);
    case 11: return pEnterEventMode(c);
    case 12: return pEnterStepMode(c);
    case 13: return pEvaluateDiscreteStates(c);
    case 14: return pGetNumberOfVariableDependencies(c, 0, &n);
    default: return pGetOutputDerivatives(c, references, 2, integers, reals, 2);
    }
}

const char *bind_fmi3(struct fmu *f, void *library) {
#define BIND(name) \
    if (!(p##name = (fmi3##name##TYPE *)symbol_of(library, "fmi3" #name))) return "fmi3" #name;
    FUNCTIONS(BIND)
    *f = (struct fmu){
        .instantiate = instantiate, .free_instance = free_instance, .enter = enter, .exit = leave, .terminate = terminate,
        .reset = reset, .step = step, .set_real = set_real, .get_real = get_real, .set_choice = set_choice,
        .get_choice = get_choice, .set_string = set_string, .get_string = get_string, .get_state = get_state,
        .set_state = set_state, .free_state = free_state, .size = size_of, .serialise = serialise, .deserialise = deserialise,
        .other = other,
    };
    return NULL;
}
