/* FMI 3.0 for co-simulation: the block of FMI 2 with an array for each variable. */

#include "fmi3Functions.h"
#include "instance.h"

#include <stdlib.h>
#include <string.h>

static const struct table *const model = &model_table;

enum { LIVING = INSTANTIATED | INITIALISING | STEPPING, ALWAYS = LIVING | TERMINATED };

#define INSTANCE(phases)                                       \
    struct instance *m = c;                                    \
    if (!m || allowed(m, __func__, phases))                    \
        return fmi3Error;

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

static void say(const struct instance *m, int status, const char *text)
{
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)m->logger;
    if (logger)
        logger(m->environment, (fmi3Status)status, status == WARNING ? "logStatusWarning" : "logStatusError", text);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)visible, (void)logging, (void)events, (void)early_return, (void)intermediate, (void)n, (void)update;
    return instance_new(name, token, resources, say, (void *)logger, environment);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    return NULL; /* modelDescription.xml offers co-simulation alone */
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)logger, (void)update, (void)lock,
        (void)unlock;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c)
{
    instance_free(c);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)on, (void)n, (void)categories; /* warnings and errors are always given, and there is nothing else */
    return c ? fmi3OK : fmi3Error;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    INSTANCE(INSTANTIATED)
    return (fmi3Status)instance_enter(m, start);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    INSTANCE(INITIALISING)
    return (fmi3Status)instance_exit(m);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    INSTANCE(STEPPING)
    m->phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)instance_reset(m);
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_return, fmi3Boolean *needs_event, fmi3Boolean *terminate,
                      fmi3Boolean *early, fmi3Float64 *reached)
{
    (void)no_return;
    INSTANCE(STEPPING)
    fmi3Status status = (fmi3Status)instance_step(m, t, h);
    if (needs_event)
        *needs_event = fmi3False;
    if (terminate)
        *terminate = fmi3False;
    if (early)
        *early = fmi3False;
    if (reached)
        *reached = m->time;
    return status;
}

/* -- values */

#define VALUES(phases)                                                 \
    INSTANCE(phases)                                                   \
    if ((n && !references) || (n_values && !values))                   \
        return (fmi3Status)refuse(m, "%s got no array", __func__);

/* Doubles of the variable with this reference; 0: there is none, or no room for them. */
static size_t length_of(const struct instance *m, uint32_t reference, size_t left)
{
    int64_t n_block = model->n_p + model->n_u + model->n_x + model->n_y;
    int64_t length = reference < n_block ? model->lengths[reference] : 0;
    if (length == 0)
        refuse(m, "it has no variable with the reference %u", (unsigned)reference);
    else if ((size_t)length > left)
        refuse(m, "the variable with the reference %u has %d elements: there is an array for %zu", (unsigned)reference, (int)length, left);
    return length > 0 && (size_t)length <= left ? (size_t)length : 0;
}

static fmi3Status all_used(const struct instance *m, size_t left)
{
    return left ? (fmi3Status)refuse(m, "%zu values are left over: give as many as the variables have elements", left) : fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t n, fmi3Float64 values[], size_t n_values)
{
    VALUES(ALWAYS)
    if (ready_to_get(m))
        return fmi3Error;
    const uint32_t time = (uint32_t)(model->n_p + model->n_u + model->n_x + model->n_y);
    size_t left = n_values;
    for (size_t i = 0; i < n; i++) {
        if (references[i] == time && left) {
            *values++ = m->time;
            left--;
            continue;
        }
        size_t length = length_of(m, references[i], left);
        if (!length)
            return fmi3Error;
        if (get_values(m, references[i], length, 0, values))
            return fmi3Error;
        values += length;
        left -= length;
    }
    return all_used(m, left);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t n, const fmi3Float64 values[], size_t n_values)
{
    VALUES(LIVING)
    size_t left = n_values;
    for (size_t i = 0; i < n; i++) {
        size_t length = length_of(m, references[i], left);
        if (!length)
            return fmi3Error;
        if (set_values(m, references[i], length, 0, values))
            return fmi3Error;
        values += length;
        left -= length;
    }
    return all_used(m, left);
}

/* Enumerations are exchanged as Int64. */
fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference references[], size_t n, fmi3Int64 values[], size_t n_values)
{
    VALUES(ALWAYS)
    if (n != n_values)
        return (fmi3Status)refuse(m, "%s got %zu references and %zu values: enumerations are scalars", __func__, n, n_values);
    for (size_t i = 0; i < n; i++) {
        double value;
        if (get_values(m, references[i], 1, 1, &value))
            return fmi3Error;
        values[i] = (fmi3Int64)value;
    }
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference references[], size_t n, const fmi3Int64 values[], size_t n_values)
{
    VALUES(LIVING)
    if (n != n_values)
        return (fmi3Status)refuse(m, "%s got %zu references and %zu values: enumerations are scalars", __func__, n, n_values);
    for (size_t i = 0; i < n; i++) {
        double value = (double)values[i];
        if (set_values(m, references[i], 1, 1, &value))
            return fmi3Error;
    }
    return fmi3OK;
}

/* Strings are numbered after time, which comes after the block. */
static int64_t file_of(const struct instance *m, uint32_t reference)
{
    int64_t i = (int64_t)reference - (model->n_p + model->n_u + model->n_x + model->n_y) - 1;
    if (i >= 0 && i < model->n_files)
        return i;
    refuse(m, "it has no String variable with the reference %u", (unsigned)reference);
    return -1;
}

fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference references[], size_t n, fmi3String values[], size_t n_values)
{
    VALUES(ALWAYS)
    if (n != n_values)
        return (fmi3Status)refuse(m, "%s got %zu references and %zu values: strings are scalars", __func__, n, n_values);
    for (size_t i = 0; i < n; i++) {
        int64_t file = file_of(m, references[i]);
        if (file < 0)
            return fmi3Error;
        values[i] = model->files[file].start;
    }
    return fmi3OK;
}

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference references[], size_t n, const fmi3String values[], size_t n_values)
{
    VALUES(LIVING)
    if (n != n_values)
        return (fmi3Status)refuse(m, "%s got %zu references and %zu values: strings are scalars", __func__, n, n_values);
    for (size_t i = 0; i < n; i++) {
        int64_t file = file_of(m, references[i]);
        if (file < 0 || set_file(m, (size_t)file, values[i]))
            return fmi3Error;
    }
    return fmi3OK;
}

/* -- whole state */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_get(m, state, __func__);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_set(m, state, __func__);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_free(m, state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_size(m, state, size, __func__);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_write(m, state, bytes, size, __func__);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    INSTANCE(ALWAYS)
    return (fmi3Status)handle_read(m, bytes, size, state, __func__);
}

/* -- what modelDescription.xml says that it has not */

#define NO_TYPE(type)                                                                                                                        \
    fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference references[], size_t n, fmi3##type values[], size_t n_values)          \
    {                                                                                                                                        \
        VALUES(ALWAYS)                                                                                                                       \
        return n ? (fmi3Status)refuse(m, "it has no " #type " variable") : fmi3OK;                                                           \
    }                                                                                                                                        \
    fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference references[], size_t n, const fmi3##type values[], size_t n_values)    \
    {                                                                                                                                        \
        VALUES(ALWAYS)                                                                                                                       \
        return n ? (fmi3Status)refuse(m, "it has no " #type " variable") : fmi3OK;                                                           \
    }

NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(Int32)
NO_TYPE(UInt32)
NO_TYPE(UInt64)
NO_TYPE(Boolean)

/* What is left takes arguments of all kinds, none of which is looked at. */
#define NOTHING(name, ...)                                      \
    fmi3Status name(fmi3Instance c, ##__VA_ARGS__)              \
    {                                                           \
        INSTANCE(ALWAYS)                                        \
        return (fmi3Status)refuse(m, #name " is not offered");  \
    }
#define REFERENCES const fmi3ValueReference r[], size_t n

NOTHING(fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t n_values)
NOTHING(fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t n_values)
NOTHING(fmi3GetClock, REFERENCES, fmi3Clock values[])
NOTHING(fmi3SetClock, REFERENCES, const fmi3Clock values[])
NOTHING(fmi3GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n)
NOTHING(fmi3GetVariableDependencies, fmi3ValueReference r, size_t a[], fmi3ValueReference b[], size_t d[], fmi3DependencyKind k[], size_t n)
NOTHING(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference k[], size_t nk, const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd)
NOTHING(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference k[], size_t nk, const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd)
NOTHING(fmi3EnterConfigurationMode)
NOTHING(fmi3ExitConfigurationMode)
NOTHING(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 i[], fmi3IntervalQualifier q[])
NOTHING(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 a[], fmi3UInt64 b[], fmi3IntervalQualifier q[])
NOTHING(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 s[])
NOTHING(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 a[], fmi3UInt64 b[])
NOTHING(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 i[])
NOTHING(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 a[], const fmi3UInt64 b[])
NOTHING(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 s[])
NOTHING(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 a[], const fmi3UInt64 b[])
NOTHING(fmi3EvaluateDiscreteStates)
NOTHING(fmi3UpdateDiscreteStates, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *t)
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 o[], fmi3Float64 v[], size_t nv)
NOTHING(fmi3ActivateModelPartition, fmi3ValueReference r, fmi3Float64 t)
NOTHING(fmi3EnterContinuousTimeMode)
NOTHING(fmi3CompletedIntegratorStep, fmi3Boolean n, fmi3Boolean *e, fmi3Boolean *t)
NOTHING(fmi3SetTime, fmi3Float64 t)
NOTHING(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n)
NOTHING(fmi3GetContinuousStateDerivatives, fmi3Float64 x[], size_t n)
NOTHING(fmi3GetEventIndicators, fmi3Float64 x[], size_t n)
NOTHING(fmi3GetContinuousStates, fmi3Float64 x[], size_t n)
NOTHING(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n)
NOTHING(fmi3GetNumberOfEventIndicators, size_t *n)
NOTHING(fmi3GetNumberOfContinuousStates, size_t *n)
