/* The Linux binary of an FMU in Python: brings Python into hosts that are not Python, and hands every call on to pythonfmu's wrapper.

   That wrapper expects Python's symbols in the process's global scope, and so do NumPy's modules. Where no Python runs in the process,
   fmi2Instantiate starts one: that of CDL_PYTHON, else python3 on PATH. It is never ended, as NumPy cannot be started twice in a process
   and other FMUs may run in it. Whatever fails is said through FMI's logger, and there is no instance. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <link.h>
#include <pthread.h>
#include <spawn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include <wchar.h>

extern char **environ;
extern const char cdl_probe[]; /* text of embedding.py */
extern const char cdl_needs[]; /* what that Python must have: "cdl-fmu 0.1.0" */
extern const char cdl_wrapper[]; /* file name of the wrapper, beside this library */

#define EXPORT __attribute__((visibility("default")))

enum { ERROR = 3, LINE = 2 * PATH_MAX /* two paths and a few words */ };

typedef struct {
    void (*logger)(void *environment, const char *instance, int status, const char *category, const char *message, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, int);
    void *environment;
} Callbacks;

typedef void *Instantiate(const char *, int, const char *, const char *, const Callbacks *, int, int);

/* -- Calls handed on: a jump keeps all arguments as they are, whatever the function's signature. -- */

#define FORWARDED(X) \
    X(fmi2SetDebugLogging) X(fmi2FreeInstance) X(fmi2SetupExperiment) X(fmi2EnterInitializationMode) X(fmi2ExitInitializationMode) \
    X(fmi2Terminate) X(fmi2Reset) X(fmi2GetReal) X(fmi2GetInteger) X(fmi2GetBoolean) X(fmi2GetString) X(fmi2SetReal) X(fmi2SetInteger) \
    X(fmi2SetBoolean) X(fmi2SetString) X(fmi2GetFMUstate) X(fmi2SetFMUstate) X(fmi2FreeFMUstate) X(fmi2SerializedFMUstateSize) \
    X(fmi2SerializeFMUstate) X(fmi2DeSerializeFMUstate) X(fmi2GetDirectionalDerivative) X(fmi2SetRealInputDerivatives) \
    X(fmi2GetRealOutputDerivatives) X(fmi2DoStep) X(fmi2CancelStep) X(fmi2GetStatus) X(fmi2GetRealStatus) X(fmi2GetIntegerStatus) \
    X(fmi2GetBooleanStatus) X(fmi2GetStringStatus) X(finalizePythonInterpreter)

/* What a call does before there was an instance, such as freeing none. */
static int no_instance(void) { return ERROR; }

#define JUMP(name) \
    __attribute__((used, visibility("hidden"))) void *to_##name = (void *)no_instance; \
    __asm__(".pushsection .text\n.globl " #name "\n.type " #name ", @function\n" #name ":\n\tjmp *to_" #name "(%rip)\n.popsection\n");
FORWARDED(JUMP)

static const struct { const char *name; void **to; } forwarded[] = {
#define ROW(name) {#name, &to_##name},
    FORWARDED(ROW)
};

static Instantiate *instantiate;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static char folder[PATH_MAX]; /* of this library */

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

/* Now, as the path may be relative and the host may change its working directory later. */
__attribute__((constructor)) static void find_folder(void)
{
    Dl_info info;
    if (!dladdr((void *)no_instance, &info) || !realpath(info.dli_fname, folder))
        folder[0] = '\0';
    char *end = strrchr(folder, '/');
    if (end)
        end[1] = '\0';
}

/* -- Python -- */

typedef struct { char text[2 * LINE]; } Problem;

static int fails(Problem *problem, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    vsnprintf(problem->text, sizeof problem->text, format, values);
    va_end(values);
    return 0;
}

/* Path of a Python library that the host loaded, perhaps for itself alone: NumPy's modules need it global. */
static int find_loaded(struct dl_phdr_info *info, size_t size, void *path)
{
    const char *base = strrchr(info->dlpi_name, '/');
    int major, minor;
    if (base && sscanf(base, "/libpython%d.%d", &major, &minor) == 2)
        snprintf(path, PATH_MAX, "%s", info->dlpi_name);
    return 0;
}

/* The line that embedding.py writes in this python, without its first field, or NULL. */
static char *ask(const char *python, char *line, Problem *problem)
{
    int ends[2];
    if (pipe(ends)) {
        fails(problem, "no pipe to ask '%s': %s", python, strerror(errno));
        return NULL;
    }
    char *arguments[] = {(char *)python, "-c", (char *)cdl_probe, NULL};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_addclose(&actions, ends[0]);
    posix_spawn_file_actions_addclose(&actions, ends[1]);
    pid_t child;
    int error = posix_spawnp(&child, python, &actions, NULL, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    FILE *answer = fdopen(ends[0], "r");
    char *found = NULL;
    /* Other lines may come from what this Python runs at its start. */
    while (!found && !error && fgets(line, LINE, answer))
        if (!strncmp(line, "cdl-fmu\t", 8))
            found = line + 8;
    fclose(answer);
    if (error)
        fails(problem, "'%s' does not run: %s", python, strerror(error));
    else {
        waitpid(child, NULL, 0);
        if (!found)
            fails(problem, "'%s' is no Python that answers, see its messages", python);
    }
    return found;
}

/* Load the library of a python that has the package, and tell it which environment it is. */
static int load_python(Problem *problem)
{
    const char *named = getenv("CDL_PYTHON");
    const char *python = named && *named ? named : "python3";
    const char *from = named && *named ? "CDL_PYTHON" : "python3 on PATH";
    char line[LINE], why[LINE];
    Problem asked;
    char *rest = ask(python, line, &asked);
    if (!rest)
        return fails(problem, "%s: %s", from, asked.text);
    rest[strcspn(rest, "\n")] = '\0';
    char *version = strsep(&rest, "\t"), *executable = strsep(&rest, "\t"), *library = strsep(&rest, "\t");
    if (!library || !rest)
        return fails(problem, "%s: '%s' gave half an answer", from, python);
    snprintf(why, sizeof why, "%s is Python %s, %s,", from, version, executable);
    if (!*rest) /* of another version the FMU itself will say so */
        return fails(problem, "%s which has no cdl-fmu", why);
    if (!*library)
        return fails(problem, "%s which has no shared library libpython: use a Python that was built with --enable-shared", why);
    if (!dlopen(library, RTLD_NOW | RTLD_GLOBAL))
        return fails(problem, "%s whose library does not load: %s", why, dlerror());
    wchar_t *(*decode)(const char *, size_t *) = dlsym(RTLD_DEFAULT, "Py_DecodeLocale");
    void (*set_program_name)(const wchar_t *) = dlsym(RTLD_DEFAULT, "Py_SetProgramName");
    if (!decode || !set_program_name)
        return fails(problem, "%s which is too new for this FMU", why);
    set_program_name(decode(executable, NULL)); /* Python keeps the pointer */
    return 1;
}

static int start_python(Problem *problem)
{
    char loaded[PATH_MAX] = "";
    if (!dlsym(RTLD_DEFAULT, "Py_IsInitialized"))
        dl_iterate_phdr(find_loaded, loaded);
    if (*loaded)
        dlopen(loaded, RTLD_NOW | RTLD_GLOBAL | RTLD_NOLOAD);
    if (!dlsym(RTLD_DEFAULT, "Py_IsInitialized") && !load_python(problem))
        return 0;
    int (*is_initialised)(void) = dlsym(RTLD_DEFAULT, "Py_IsInitialized");
    void (*initialise)(int) = dlsym(RTLD_DEFAULT, "Py_InitializeEx");
    void *(*release)(void) = dlsym(RTLD_DEFAULT, "PyEval_SaveThread");
    if (!is_initialised || !initialise || !release)
        return fails(problem, "the Python in this process lacks Py_InitializeEx");
    if (!is_initialised()) {
        initialise(0); /* signals stay the host's */
        release();
    }
    return 1;
}

/* pythonfmu 0.7.0 releases its state when the process ends and then once more where it was, unless it is released before. */
static void release_wrapper(void) { ((void (*)(void))to_finalizePythonInterpreter)(); }

static int load_wrapper(Problem *problem)
{
    char path[PATH_MAX + 64];
    snprintf(path, sizeof path, "%s%s", folder, cdl_wrapper);
    void *wrapper = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!wrapper)
        return fails(problem, "pythonfmu's wrapper does not load: %s", dlerror());
    for (size_t i = 0; i < sizeof forwarded / sizeof *forwarded; i++) {
        void *function = dlsym(wrapper, forwarded[i].name);
        if (!function)
            return fails(problem, "pythonfmu's wrapper has no function %s", forwarded[i].name);
        *forwarded[i].to = function;
    }
    instantiate = dlsym(wrapper, "fmi2Instantiate");
    if (!instantiate)
        return fails(problem, "pythonfmu's wrapper has no function fmi2Instantiate");
    atexit(release_wrapper);
    return 1;
}

static void report(const char *instance, const Callbacks *callbacks, const Problem *problem)
{
    static const char form[] = "this FMU runs in Python 3.11 or newer with %s, and %s. Set the environment variable CDL_PYTHON to a python "
                               "that has it, or use the native FMU (cdl build --native)";
    char text[sizeof problem->text + 512], message[2 * sizeof text], *to = message;
    snprintf(text, sizeof text, form, cdl_needs, problem->text);
    for (const char *from = text; *from; from++) { /* the logger takes a format */
        if (*from == '%')
            *to++ = '%';
        *to++ = *from;
    }
    *to = '\0';
    if (callbacks && callbacks->logger)
        callbacks->logger(callbacks->environment, instance, ERROR, "logStatusError", message);
    else
        fprintf(stderr, "%s: %s\n", instance, text);
}

EXPORT void *fmi2Instantiate(const char *instance, int type, const char *guid, const char *resources, const Callbacks *callbacks,
                             int visible, int logging)
{
    Problem problem;
    pthread_mutex_lock(&lock);
    int loaded = instantiate || (start_python(&problem) && load_wrapper(&problem));
    pthread_mutex_unlock(&lock);
    if (!loaded) {
        report(instance, callbacks, &problem);
        return NULL;
    }
    /* The wrapper says why there is no instance only if it may log. */
    void *component = instantiate(instance, type, guid, resources, callbacks, visible, 1);
    if (component && !logging)
        ((int (*)(void *, int, size_t, const char *const *))to_fmi2SetDebugLogging)(component, 0, 0, NULL);
    return component;
}
