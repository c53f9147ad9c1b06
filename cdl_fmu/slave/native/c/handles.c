/* States as a host holds them: pointers that it may mix up. */

#include "instance.h"

static int is_strange(const struct instance *m, const void *state, const char *function)
{
    return is_state_of(m, state) ? OK : refuse(m, "%s got a state that this instance did not give, or that was freed", function);
}

int handle_get(struct instance *m, void **state, const char *function)
{
    if (!state)
        return refuse(m, "%s got no place for the state", function);
    if (*state && !is_state_of(m, *state))
        return refuse(m, "%s got a state that it did not give: pass NULL for a new one", function);
    struct saved *saved = state_save(m, *state);
    if (!saved)
        return ERROR;
    *state = saved;
    return OK;
}

int handle_set(struct instance *m, void *state, const char *function)
{
    return is_strange(m, state, function) ? ERROR : state_restore(m, state);
}

int handle_free(struct instance *m, void **state)
{
    if (!state || !*state)
        return OK;
    int status = state_free(m, *state);
    *state = NULL;
    return status;
}

int handle_size(struct instance *m, void *state, size_t *size, const char *function)
{
    if (!size)
        return refuse(m, "%s got no place for the size", function);
    if (is_strange(m, state, function))
        return ERROR;
    *size = state_size(state);
    return OK;
}

int handle_write(struct instance *m, void *state, void *bytes, size_t size, const char *function)
{
    if (is_strange(m, state, function))
        return ERROR;
    if (!bytes || size < state_size(state))
        return refuse(m, "%s got room for %zu bytes: the state has %zu", function, bytes ? size : 0, state_size(state));
    state_write(state, bytes);
    return OK;
}

int handle_read(struct instance *m, const void *bytes, size_t size, void **state, const char *function)
{
    if (!state)
        return refuse(m, "%s got no place for the state", function);
    struct saved *saved = state_read(m, bytes, size);
    if (!saved)
        return ERROR;
    *state = saved;
    return OK;
}
