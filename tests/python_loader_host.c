/* A host in C: LIBRARY GUID RESOURCES INPUTS OUTPUTS for each FMU, with INPUTS as reference=value,... and OUTPUTS as reference,...
   All FMUs are instantiated, step 100 times by 1 ms in turn, and are unloaded; a line of output values for each. Twice, as hosts repeat
   simulations. HOST_LIBPYTHON names a Python library that the host starts for itself beforehand. */

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"

enum { MOST = 64 };

typedef struct {
    void *library;
    fmi2Component component;
} Slave;

static void require(int good, const char *what)
{
    if (good)
        return;
    printf("failed: %s\n", what);
    exit(1);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String message,
                   ...)
{
    va_list values;
    va_start(values, message);
    printf("%s: status %d: ", instance, (int)status);
    vprintf(message, values);
    puts("");
    va_end(values);
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

#define CALL(slave, name, ...) ((name##TYPE *)dlsym((slave).library, #name))(__VA_ARGS__)

static Slave begin(char **text)
{
    Slave slave = {dlopen(text[0], RTLD_NOW | RTLD_LOCAL), NULL};
    require(slave.library != NULL, "dlopen");
    require(!strcmp(CALL(slave, fmi2GetVersion, ), "2.0"), "version");
    slave.component = CALL(slave, fmi2Instantiate, "slave", fmi2CoSimulation, text[1], text[2], &callbacks, fmi2False, fmi2False);
    if (!slave.component) {
        CALL(slave, fmi2FreeInstance, NULL);
        exit(3);
    }
    require(!CALL(slave, fmi2SetupExperiment, slave.component, fmi2False, 0.0, 0.0, fmi2False, 0.0), "set up");
    for (char *at = text[3]; *at;) {
        fmi2ValueReference reference = strtoul(at, &at, 10);
        double value = strtod(at + 1, &at);
        require(!CALL(slave, fmi2SetReal, slave.component, &reference, 1, &value), "set");
        at += *at == ',';
    }
    require(!CALL(slave, fmi2EnterInitializationMode, slave.component), "enter initialisation");
    require(!CALL(slave, fmi2ExitInitializationMode, slave.component), "exit initialisation");
    return slave;
}

static void end(Slave slave, char **text)
{
    for (char *at = text[4]; *at;) {
        fmi2ValueReference reference = strtoul(at, &at, 10);
        double value;
        require(!CALL(slave, fmi2GetReal, slave.component, &reference, 1, &value), "get");
        printf("%.17g ", value);
        at += *at == ',';
    }
    puts("");
    require(!CALL(slave, fmi2Terminate, slave.component), "terminate");
    CALL(slave, fmi2FreeInstance, slave.component);
    dlclose(slave.library);
}

static void start_own_python(const char *path)
{
    void *python = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    require(python != NULL, "libpython");
    ((void (*)(void))dlsym(python, "Py_Initialize"))();
    ((void *(*)(void))dlsym(python, "PyEval_SaveThread"))();
}

int main(int count, char **arguments)
{
    int n = (count - 1) / 5;
    Slave slaves[MOST];
    require(n <= MOST, "too many FMUs");
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (getenv("HOST_LIBPYTHON"))
        start_own_python(getenv("HOST_LIBPYTHON"));
    for (int repeat = 0; repeat < 2; repeat++) {
        for (int i = 0; i < n; i++)
            slaves[i] = begin(arguments + 1 + 5 * i);
        for (int k = 0; k < 100; k++)
            for (int i = 0; i < n; i++)
                require(!CALL(slaves[i], fmi2DoStep, slaves[i].component, 1e-3 * k, 1e-3, fmi2True), "step");
        for (int i = 0; i < n; i++)
            end(slaves[i], arguments + 1 + 5 * i);
    }
    return 0;
}
