/* What Linux and Windows do in different ways: load a library, tell the time, name a folder. Include it first. */

#ifndef PLATFORM_H
#define PLATFORM_H

#define _XOPEN_SOURCE 700

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>

#define PLATFORM "win64"
#define SUFFIX ".dll"
static void *load(const char *path) { return (void *)LoadLibraryExA(path, NULL, LOAD_WITH_ALTERED_SEARCH_PATH); }
static void *symbol(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
static const char *load_error(void) { return "LoadLibrary failed"; }
static char *absolute(const char *path) { return _fullpath(NULL, path, 0); }
static double now(void) {
    LARGE_INTEGER count, frequency;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&frequency);
    return (double)count.QuadPart / (double)frequency.QuadPart;
}
#else
#include <dlfcn.h>
#include <time.h>

#define PLATFORM "linux64"
#define SUFFIX ".so"
static void *load(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *symbol(void *library, const char *name) { return dlsym(library, name); }
static const char *load_error(void) { return dlerror(); }
static char *absolute(const char *path) { return realpath(path, NULL); }
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
#endif

/* URI of an FMU's resources, with all letters escaped that a URI may not hold; the caller frees it. NULL: no such folder. */
static inline char *resources_uri(const char *folder) {
    char *whole = absolute(folder);
    char *uri = whole ? calloc(3 * strlen(whole) + 32, 1) : NULL;
    if (uri) {
        char *end = uri + sprintf(uri, whole[0] == '/' ? "file://" : "file:///");
        for (const char *c = whole; *c; c++) {
            if (*c == '\\')
                *end++ = '/';
            else if (strchr("/:-_.~", *c) || (*c >= '0' && *c <= '9') || ((*c | 32) >= 'a' && (*c | 32) <= 'z'))
                *end++ = *c;
            else
                end += sprintf(end, "%%%02X", (unsigned char)*c);
        }
        strcpy(end, "/resources");
    }
    free(whole);
    return uri;
}

#endif
