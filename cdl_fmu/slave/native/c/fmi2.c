/* FMI 2.0 for co-simulation. */

#include "fmi2Functions.h"
#include "instance.h"

#include <stdlib.h>
#include <string.h>

static const struct table *const model = &model_table;

enum { BEFORE = INSTANTIATED | INITIALISING, LIVING = BEFORE | STEPPING, ALWAYS = LIVING | TERMINATED };

/* Every function begins so: without an instance there is nobody to say anything to. */
#define INSTANCE(phases)                                       \
    struct instance *m = c;                                    \
    if (!m || allowed(m, __func__, phases))                    \
        return fmi2Error;

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* The logger takes a format as printf does, but hosts in Python can read no arguments of it: the text is the format. */
static void say(const struct instance *m, int status, const char *text)
{
    fmi2CallbackLogger logger = (fmi2CallbackLogger)m->logger;
    if (!logger)
        return;
    char format[4096], *end = format;
    for (; *text && end < format + sizeof format - 3; text++) {
        if (*text == '%')
            *end++ = '%';
        *end++ = *text;
    }
    *end = 0;
    logger(m->environment, m->name, (fmi2Status)status, status == WARNING ? "logStatusWarning" : "logStatusError", format);
}

/* The value of a hexadecimal digit, -1 for other characters. */
static int digit(char c)
{
    return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* Path of a URI: file:///home/x, file:/home/x, file://localhost/home/x or file:///C:/x, with %20 for a blank; a path is left as it is. */
static char *path_of(const char *uri)
{
    char *path = malloc(strlen(uri) + 1), *end = path;
    if (!path)
        return NULL;
    int is_uri = strncmp(uri, "file:", 5) == 0;
    if (is_uri) {
        uri += 5;
#ifdef _WIN32
        if (uri[0] == '/' && uri[1] == '/' && (uri[2] == '/' || !strncmp(uri + 2, "localhost/", 10)))
            uri = strchr(uri + 2, '/'); /* others are a server's name, with which Windows' paths begin, too */
#else
        if (uri[0] == '/' && uri[1] == '/') {
            uri += 2;
            while (*uri && *uri != '/') /* the host */
                uri++;
        }
#endif
#ifdef _WIN32
        if (uri[0] == '/' && uri[1] && uri[2] == ':')
            uri++;
#endif
    }
    for (; *uri; uri++)
        if (is_uri && uri[0] == '%' && digit(uri[1]) >= 0 && digit(uri[2]) >= 0) {
            *end++ = (char)(16 * digit(uri[1]) + digit(uri[2]));
            uri += 2;
        } else
            *end++ = *uri;
    *end = 0;
    return path;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    (void)visible, (void)logging;
    void *logger = callbacks ? (void *)callbacks->logger : NULL, *environment = callbacks ? callbacks->componentEnvironment : NULL;
    char *path = path_of(resources ? resources : "");
    struct instance *m = path ? instance_new(name, guid, path, say, logger, environment) : NULL;
    free(path);
    if (m && type != fmi2CoSimulation) {
        refuse(m, "it is for co-simulation, not for model exchange");
        instance_free(m);
        m = NULL;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    instance_free(c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)on, (void)n, (void)categories; /* warnings and errors are always given, and there is nothing else */
    return c ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start, fmi2Boolean has_stop, fmi2Real stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    INSTANCE(INSTANTIATED)
    m->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    INSTANCE(INSTANTIATED)
    return (fmi2Status)instance_enter(m, m->time);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    INSTANCE(INITIALISING)
    return (fmi2Status)instance_exit(m);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    INSTANCE(STEPPING)
    m->phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)instance_reset(m);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_return)
{
    (void)no_return;
    INSTANCE(STEPPING)
    return (fmi2Status)instance_step(m, t, h);
}

/* -- values */

#define VALUES(phases)                                    \
    INSTANCE(phases)                                      \
    if (n && (!references || !values))                    \
        return (fmi2Status)refuse(m, "%s got no array", __func__);

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Real values[])
{
    VALUES(ALWAYS)
    if (ready_to_get(m))
        return fmi2Error;
    for (size_t i = 0, k; i < n; i += k) {
        k = run_of(references + i, n - i);
        if (get_values(m, references[i], k, 0, values + i))
            return fmi2Error;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Real values[])
{
    VALUES(LIVING)
    for (size_t i = 0, k; i < n; i += k) {
        k = run_of(references + i, n - i);
        if (set_values(m, references[i], k, 0, values + i))
            return fmi2Error;
    }
    return fmi2OK;
}

/* Enumerations are exchanged as Integers. */
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Integer values[])
{
    VALUES(ALWAYS)
    for (size_t i = 0; i < n; i++) {
        double value;
        if (get_values(m, references[i], 1, 1, &value))
            return fmi2Error;
        values[i] = (fmi2Integer)value;
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Integer values[])
{
    VALUES(LIVING)
    for (size_t i = 0; i < n; i++) {
        double value = values[i];
        if (set_values(m, references[i], 1, 1, &value))
            return fmi2Error;
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Boolean values[])
{
    VALUES(ALWAYS)
    return n ? (fmi2Status)refuse(m, "it has no Boolean variable") : fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Boolean values[])
{
    VALUES(LIVING)
    return n ? (fmi2Status)refuse(m, "it has no Boolean variable") : fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2String values[])
{
    VALUES(ALWAYS)
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= (uint64_t)model->n_files)
            return (fmi2Status)refuse(m, "it has no String variable with the reference %u", (unsigned)references[i]);
        values[i] = model->files[references[i]].start;
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2String values[])
{
    VALUES(LIVING)
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= (uint64_t)model->n_files)
            return (fmi2Status)refuse(m, "it has no String variable with the reference %u", (unsigned)references[i]);
        if (set_file(m, references[i], values[i]))
            return fmi2Error;
    }
    return fmi2OK;
}

/* -- whole state */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_get(m, state, __func__);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_set(m, state, __func__);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_free(m, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_size(m, state, size, __func__);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_write(m, state, bytes, size, __func__);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)handle_read(m, bytes, size, state, __func__);
}

/* -- what modelDescription.xml says that it cannot do */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns, const fmi2ValueReference knowns[],
                                        size_t n_knowns, const fmi2Real along[], fmi2Real derivatives[])
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)along, (void)derivatives;
    INSTANCE(ALWAYS)
    return (fmi2Status)refuse(m, "it has no directional derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Integer order[],
                                       const fmi2Real values[])
{
    (void)references, (void)n, (void)order, (void)values;
    INSTANCE(ALWAYS)
    return (fmi2Status)refuse(m, "it takes no derivatives of inputs");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Integer order[],
                                        fmi2Real values[])
{
    (void)references, (void)n, (void)order, (void)values;
    INSTANCE(ALWAYS)
    return (fmi2Status)refuse(m, "it has no derivatives of outputs");
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    INSTANCE(ALWAYS)
    return (fmi2Status)refuse(m, "its steps are done when fmi2DoStep returns: there is none to cancel");
}

#define NEVER(name, type)                                                                 \
    fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type *value)              \
    {                                                                                     \
        (void)kind, (void)value;                                                          \
        INSTANCE(ALWAYS)                                                                  \
        return fmi2Discard; /* only steps that go on after fmi2DoStep have a status */    \
    }

NEVER(fmi2GetStatus, fmi2Status)
NEVER(fmi2GetRealStatus, fmi2Real)
NEVER(fmi2GetIntegerStatus, fmi2Integer)
NEVER(fmi2GetBooleanStatus, fmi2Boolean)
NEVER(fmi2GetStringStatus, fmi2String)
