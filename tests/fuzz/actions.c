/* What the fuzzing host does to an FMU: calls in any order, with values of any kind. What it passes is always as long as it says. */

#include "fuzz.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CALL(m, name, detail, call) (begin(t, name, m, detail), end(t, t->fmu->call))

static void demand(struct thread *t, int holds, const char *what) {
    if (!holds) found(t, what);
}

/* A call that the phase does not allow is refused. */
static int ordered(struct thread *t, const struct instance *m, int status, int phases, const char *what) {
    demand(t, status > WARNING || (m->phase & (phases | UNKNOWN)), what);
    return status <= WARNING;
}

static int chance(struct thread *t, size_t of) { return below(&t->random, of) == 0; }

/* -- life */

static void forget_states(struct thread *t, const struct instance *m) {
    for (struct state *s = t->states; s < t->states + MOST_STATES; s++)
        if (s->owner == m && s->owner_id == m->id && chance(t, 2)) s->pointer = NULL; /* the others dangle */
}

static void release(struct thread *t, struct instance *m) {
    forget_states(t, m);
    begin(t, "freeInstance", m, 0);
    t->fmu->free_instance(m->c);
    end(t, OK);
    m->c = NULL;
    m->id = 0;
}

static void make(struct thread *t, struct instance *m) {
    if (m->c) release(t, m);
    *m = (struct instance){.phase = INSTANTIATED, .id = ++t->n_instances};
    begin(t, "instantiate", m, 0);
    m->c = t->fmu->instantiate("fuzzed", t->table->token, t->resources, USUAL, t);
    end(t, m->c ? OK : ERROR);
    demand(t, m->c != NULL, "instantiate failed for what modelDescription.xml says");
}

static void make_wrong(struct thread *t) {
    static const char *const tokens[] = {NULL, "", "{00000000-0000-0000-0000-000000000000}", "%s%n%s", "\xff\xfe\x01"};
    static const char *const places[] = {NULL, "", "nonsense", "file:///none", "http://x/%zz%", "%", "file://", "file:%2", "\xff\xfe"};
    char long_text[10000], damaged[5000];
    memset(long_text, 'x', sizeof long_text - 1);
    long_text[sizeof long_text - 1] = 0;
    /* Files that tests/fuzzing.py made of those in the FMU's resources: cut off, too long, or changed. */
    snprintf(damaged, sizeof damaged, "%s/../damaged/%zu", t->resources, below(&t->random, 5));
    const char *token = t->table->token, *resources = t->resources, *name = "fuzzed";
    int way = USUAL, wrong = 0;
    switch (below(&t->random, 6)) {
    case 0: token = chance(t, 6) ? long_text : tokens[below(&t->random, sizeof tokens / sizeof *tokens)], wrong = 1; break;
    case 1: resources = chance(t, 6) ? long_text : places[below(&t->random, sizeof places / sizeof *places)]; break;
    case 2: resources = damaged; break;
    case 3: name = chance(t, 2) ? NULL : chance(t, 2) ? "" : long_text; break;
    case 4: way = WITHOUT_LOGGER; break;
    default: way = MODEL_EXCHANGE, wrong = 1;
    }
    struct instance made = {.phase = INSTANTIATED, .id = ++t->n_instances}, *m = &made;
    begin(t, "instantiate wrong", m, way);
    m->c = t->fmu->instantiate(name, token, resources, way, t);
    end(t, m->c ? OK : ERROR);
    demand(t, !(wrong && m->c), "instantiate took a wrong GUID, or model exchange that is not offered");
    if (!m->c) return;
    if (t->fmu->setup) CALL(m, "setup", 0.0, setup(m->c, 0.0));
    if (CALL(m, "enter", 0.0, enter(m->c, 0.0)) <= WARNING && CALL(m, "exit", 0, exit(m->c)) <= WARNING)
        CALL(m, "step", 1e-3, step(m->c, 0.0, 1e-3));
    release(t, m);
}

static void change_phase(struct thread *t, struct instance *m, size_t which) {
    const double start = chance(t, 20) ? NAN : 0.0;
    int done = 0;
    switch (which) {
    case 0:
        if (t->fmu->setup) ordered(t, m, CALL(m, "setup", start, setup(m->c, start)), INSTANTIATED, "setup out of order was taken");
        return;
    case 1:
        done = ordered(t, m, CALL(m, "enter", start, enter(m->c, start)), INSTANTIATED, "enter out of order was taken");
        if (done) m->phase = INITIALISING;
        return;
    case 2:
        done = ordered(t, m, CALL(m, "exit", 0, exit(m->c)), INITIALISING, "exit out of order was taken");
        if (done) m->phase = STEPPING;
        return;
    case 3:
        done = ordered(t, m, CALL(m, "terminate", 0, terminate(m->c)), STEPPING, "terminate out of order was taken");
        if (done) m->phase = TERMINATED;
        return;
    default:
        if (CALL(m, "reset", 0, reset(m->c)) <= WARNING) m->phase = INSTANTIATED, m->t = 0.0, m->steps = 0;
    }
}

/* -- values */

enum { SANE, SOME_WILD, ALL_WILD };

/* Set all or some Reals of these causalities. */
static int set(struct thread *t, struct instance *m, const char *causalities, int how, int all) {
    size_t n = 0, n_values = 0;
    const size_t only_wild = below(&t->random, t->table->n + 1);
    for (const struct variable *v = t->table->variables; v < t->table->variables + t->table->n; v++) {
        if (v->type != REAL || !strchr(causalities, v->causality) || !(all || chance(t, 3))) continue;
        t->references[n++] = v->reference;
        const int is_wild = how == ALL_WILD || (how == SOME_WILD && (v == t->table->variables + only_wild || chance(t, 30)));
        for (size_t k = 0; k < v->length; k++)
            t->values[n_values++] = is_wild ? wild(v, k, &t->random) : sane(v, k, m->steps, &t->random);
    }
    const int status = CALL(m, "set", (double)n, set_real(m->c, t->references, n, t->values, n_values));
    return ordered(t, m, n ? status : ERROR, INSTANTIATED | INITIALISING | STEPPING, "values after the end were taken");
}

/* All outputs; after a step that went well they are finite. */
static int get(struct thread *t, struct instance *m, double *into) {
    size_t n = 0;
    for (const struct variable *v = t->table->variables; v < t->table->variables + t->table->n; v++)
        if (v->type == REAL && v->causality == OUTPUT) t->references[n++] = v->reference;
    return CALL(m, "get", (double)n, get_real(m->c, t->references, n, into, t->table->n_outputs)) <= WARNING;
}

static int step(struct thread *t, struct instance *m, double at, double h) {
    const int status = CALL(m, "step", h, step(m->c, at, h));
    if (!ordered(t, m, status, STEPPING, "a step out of order was done")) return 0;
    demand(t, h >= 0.0 && isfinite(h), "a step of a length that is negative or not finite was done");
    t->n_steps++;
    m->steps++;
    m->t = at + h;
    demand(t, get(t, m, t->outputs), "outputs were not given after a step");
    const double *output = t->outputs;
    for (const struct variable *v = t->table->variables; v < t->table->variables + t->table->n; v++)
        for (size_t k = 0; v->type == REAL && v->causality == OUTPUT && k < v->length; k++, output++)
            if (!isfinite(*output)) {
                char what[512];
                snprintf(what, sizeof what, "after a step that went well, element %zu of output %s is %g", k, v->name, *output);
                found(t, what);
            }
    return 1;
}

static void step_wildly(struct thread *t, struct instance *m) {
    const struct variable any = {.min = 0.0, .max = 1.0, .starts = &m->t};
    const double h = wild(&any, 0, &t->random), at = wild(&any, 0, &t->random);
    step(t, m, chance(t, 2) ? m->t : at, chance(t, 2) ? 1e-3 : h);
}

static void wrong_references(struct thread *t, struct instance *m) {
    const uint32_t unknown[] = {t->table->unknown, UINT32_MAX, UINT32_MAX - 1, t->table->unknown + (uint32_t)next(&t->random) % 100000};
    enum { MANY = 5000 };
    static __thread double values[MANY];
    static __thread uint32_t references[MANY];
    static __thread int64_t integers[MANY];
    const char *text = "x";
    for (size_t i = 0; i < MANY; i++)
        references[i] = chance(t, 3) ? (uint32_t)next(&t->random) : (uint32_t)below(&t->random, t->table->unknown);
    const size_t n = 1 + below(&t->random, MANY), n_values = below(&t->random, MANY);
    const uint32_t *one = unknown + below(&t->random, 4);
    int status = ERROR;
    switch (below(&t->random, 12)) {
    case 0: status = CALL(m, "get unknown", *one, get_real(m->c, one, 1, values, 1)); break;
    case 1: status = CALL(m, "set unknown", *one, set_real(m->c, one, 1, values, 1)); break;
    case 2: status = CALL(m, "get unknown choice", *one, get_choice(m->c, one, 1, integers)); break;
    case 3: status = CALL(m, "set unknown choice", *one, set_choice(m->c, one, 1, integers)); break;
    case 4: status = CALL(m, "get unknown string", *one, get_string(m->c, one, 1, &text)); break;
    case 5: status = CALL(m, "set unknown string", *one, set_string(m->c, one, 1, &text)); break;
    case 6: status = CALL(m, "get without array", 1, get_real(m->c, NULL, 1, values, 1)); break;
    case 7: status = CALL(m, "set without array", 1, set_real(m->c, references, 1, NULL, 1)); break;
    case 8: CALL(m, "get nothing", 0, get_real(m->c, NULL, 0, NULL, 0)); break;
    case 9: CALL(m, "set nothing", 0, set_real(m->c, NULL, 0, NULL, 0)); break;
    case 10: CALL(m, "get many", (double)n, get_real(m->c, references, n, values, t->table->version == 3 ? n_values : MANY)); break;
    default: CALL(m, "set many", (double)n, set_real(m->c, references, n, values, t->table->version == 3 ? n_values : MANY));
    }
    demand(t, status > WARNING, "an unknown reference or a missing array was taken");
}

static void choices_and_strings(struct thread *t, struct instance *m) {
    const struct variable *v = t->table->variables + below(&t->random, t->table->n);
    const int64_t values[] = {1, 2, 3, 0, -1, INT32_MAX, INT32_MIN, INT64_MAX};
    static const char *const texts[] = {"", "nothing.stl", "/", "%s%n", "\xff"};
    int64_t value = values[below(&t->random, sizeof values / sizeof *values)];
    const char *text = texts[below(&t->random, sizeof texts / sizeof *texts)], *got = NULL;
    if (v->type == STRING) {
        CALL(m, "set string", v->reference, set_string(m->c, &v->reference, 1, &text));
        if (CALL(m, "get string", v->reference, get_string(m->c, &v->reference, 1, &got)) <= WARNING)
            demand(t, got && strlen(got) < 100000, "a string was given that is none");
    } else { /* of a Real, too: the FMU has to refuse that */
        const int status = CALL(m, "set choice", (double)value, set_choice(m->c, &v->reference, 1, &value));
        demand(t, v->type == CHOICE || status > WARNING, "a Real was set as an Integer");
        CALL(m, "get choice", v->reference, get_choice(m->c, &v->reference, 1, &value));
    }
}

/* -- whole state */

static struct state *any_state(struct thread *t) { return t->states + below(&t->random, MOST_STATES); }

static int is_own(const struct state *s, const struct instance *m) { return s->pointer && s->owner == m && s->owner_id == m->id; }

static int is_alive(const struct state *s) { return s->pointer && s->owner->id == s->owner_id; }

static void let_go(struct thread *t, struct state *s) {
    if (is_alive(s)) CALL(s->owner, "free state", 0, free_state(s->owner->c, &s->pointer));
    s->pointer = NULL;
}

static void save(struct thread *t, struct instance *m) {
    struct state *s = any_state(t);
    if (!is_own(s, m)) let_go(t, s); /* its own one may be used again */
    if (CALL(m, "get state", 0, get_state(m->c, &s->pointer)) > WARNING) return;
    s->owner = m, s->owner_id = m->id, s->phase = m->phase, s->t = m->t;
}

static void restore(struct thread *t, struct instance *m) {
    const struct state *s = any_state(t);
    if (CALL(m, "set state", 0, set_state(m->c, s->pointer)) > WARNING) return;
    demand(t, s->pointer != NULL, "a state that is NULL was taken");
    m->phase = is_own(s, m) ? s->phase : UNKNOWN;
    m->t = s->t;
}

static void free_wrongly(struct thread *t, struct instance *m) {
    struct state *s = any_state(t);
    void *none = NULL;
    CALL(m, "free no state", 0, free_state(m->c, &none));
    CALL(m, "free no place", 0, free_state(m->c, NULL));
    CALL(m, "get state without place", 0, get_state(m->c, NULL));
    if (is_own(s, m)) let_go(t, s);
    void *foreign = s->pointer; /* of another instance, or dangling; an FMU that takes it may have given it anew */
    if (foreign && CALL(m, "free foreign state", 0, free_state(m->c, &foreign)) <= WARNING)
        for (struct state *other = t->states; other < t->states + MOST_STATES; other++)
            if (other->pointer == s->pointer && other != s) other->pointer = NULL;
    if (!foreign) s->pointer = NULL;
}

/* Cut off, or some bits turned, most of them in the first bytes; the new length. */
static size_t damage(struct thread *t, unsigned char *bytes, size_t size) {
    if (chance(t, 2)) return below(&t->random, size);
    for (size_t n = 1 + below(&t->random, 4); n--;)
        bytes[below(&t->random, size > 64 && chance(t, 2) ? 64 : size)] ^= (unsigned char)(1 + below(&t->random, 255));
    return size;
}

static void deserialise(struct thread *t, struct instance *m, unsigned char *bytes, size_t size, const struct state *of) {
    const int is_damaged = chance(t, 2);
    unsigned char *sound = memcpy(malloc(size), bytes, size);
    const size_t n = is_damaged ? damage(t, bytes, size) : size;
    const int differs = n != size || memcmp(bytes, sound, size); /* two turns of a bit may cancel */
    unsigned char *exact = memcpy(malloc(n + !n), bytes, n);     /* so that a read beyond the end is seen */
    void *read = NULL;
    const char *name = differs ? "deserialise damaged" : "deserialise";
    const int status = CALL(m, name, (double)n, deserialise(m->c, n ? exact : NULL, n, &read));
    free(exact);
    free(sound);
    demand(t, !differs || status > WARNING, "damaged bytes were taken for a state");
    if (status > WARNING) return;
    const struct state made = {read, m, m->id, is_own(of, m) ? of->phase : UNKNOWN, of->t};
    struct state *s = any_state(t);
    let_go(t, s);
    *s = made;
}

static void serialise(struct thread *t, struct instance *m) {
    const struct state *s = any_state(t);
    size_t size = 0;
    if (CALL(m, "size", 0, size(m->c, s->pointer, &size)) > WARNING || !size) return;
    unsigned char *bytes = malloc(size);
    if (chance(t, 4)) {
        const int status = CALL(m, "serialise short", (double)size, serialise(m->c, s->pointer, bytes, size - 1));
        demand(t, status > WARNING, "a state was written into less than its size");
    }
    if (CALL(m, "serialise", (double)size, serialise(m->c, s->pointer, bytes, size)) <= WARNING) deserialise(t, m, bytes, size, s);
    free(bytes);
}

/* From one state the same inputs give the same outputs, to the bit. */
static void replay(struct thread *t, struct instance *m) {
    void *state = NULL;
    if (m->phase != STEPPING || !set(t, m, "u", SANE, 1)) return;
    if (CALL(m, "get state", 0, get_state(m->c, &state)) > WARNING) return;
    const struct instance before = *m;
    const int first = step(t, m, m->t, 1e-3);
    memcpy(t->again, t->outputs, t->table->n_outputs * sizeof *t->again);
    const int back = CALL(m, "set state", 0, set_state(m->c, state)) <= WARNING;
    m->t = before.t, m->steps = before.steps;
    demand(t, back, "its own state was refused");
    const int second = step(t, m, m->t, 1e-3);
    demand(t, first == second, "a step that went well from a state did not from the same one, or the other way round");
    const int same = !memcmp(t->again, t->outputs, t->table->n_outputs * sizeof *t->again);
    demand(t, !first || same, "the same step from the same state gave other outputs");
    CALL(m, "free state", 0, free_state(m->c, &state));
}

/* -- all of it */

static void drive(struct thread *t, struct instance *m) {
    if (m->phase != STEPPING) {
        change_phase(t, m, 4);
        if (chance(t, 2)) set(t, m, "p", SANE, 0);
        change_phase(t, m, 0);
        change_phase(t, m, 1);
        set(t, m, "u", SANE, 1);
        change_phase(t, m, 2);
    }
    for (size_t n = below(&t->random, chance(t, 8) ? 100 : 6); n-- && m->phase == STEPPING;) {
        set(t, m, "u", SANE, 1);
        if (!step(t, m, m->t, 1e-3)) break;
    }
}

static void crowd(struct thread *t) {
    struct instance many[CROWD] = {{0}};
    for (struct instance *m = many; m < many + CROWD; m++) make(t, m);
    for (struct instance *m = many; m < many + CROWD; m++) {
        change_phase(t, m, 1);
        change_phase(t, m, 2);
        if (set(t, m, "u", SANE, 1)) step(t, m, 0.0, 1e-3);
    }
    for (struct instance *m = many; m < many + CROWD; m++) release(t, m);
}

void act(struct thread *t) {
    struct instance *m = t->instances + below(&t->random, MOST_INSTANCES);
    if (chance(t, 4000)) crowd(t);
    if (!m->c || chance(t, 300)) make(t, m);
    switch (below(&t->random, 24)) {
    case 0: make_wrong(t); break;
    case 1: change_phase(t, m, below(&t->random, 5)); break;
    case 2: change_phase(t, m, below(&t->random, 3)); break;
    case 3: set(t, m, "pu", SOME_WILD, chance(t, 2)); break;
    case 4: set(t, m, "u", SOME_WILD, 1), step(t, m, m->t, 1e-3); break;
    case 5: set(t, m, chance(t, 2) ? "u" : "puy", ALL_WILD, chance(t, 2)), step(t, m, m->t, 1e-3); break;
    case 6: step_wildly(t, m); break;
    case 7: get(t, m, t->outputs); break;
    case 8: wrong_references(t, m); break;
    case 9: choices_and_strings(t, m); break;
    case 10: save(t, m); break;
    case 11: restore(t, m); break;
    case 12: free_wrongly(t, m); break;
    case 13: serialise(t, m); break;
    case 14: CALL(m, "other", 0, other(m->c, (unsigned)next(&t->random))); break;
    case 15: t->fmu->free_instance(NULL), CALL(m, "step of NULL", 0, step(NULL, 0.0, 1e-3)); break;
    case 16: CALL(m, "get of NULL", 0, get_real(NULL, t->references, 1, t->values, 1)); break;
    case 17: replay(t, m); break;
    default: drive(t, m);
    }
}

void free_all(struct thread *t) {
    for (struct instance *m = t->instances; m < t->instances + MOST_INSTANCES; m++)
        if (m->c) release(t, m);
}
