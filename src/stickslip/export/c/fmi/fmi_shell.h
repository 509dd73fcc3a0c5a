/* The functions that FMI 2.0 and 3.0 share; fmi2.c and fmi3.c define the names and types of their version:
 * FMI(name), FMI_NUMBERS(verb), FMI_STATE(verb, end), FMI_DESERIALIZE, fmi_real_t, fmi_state, fmi_logger,
 * FMI_LOG (the call of the logger), FMI_COUNT and FMI_COUNT_UNUSED (a further argument of getters and setters), FMI_TIME
 * (the reference of the time, if it is a variable).
 */
#ifndef FMI_SHELL_H
#define FMI_SHELL_H

#include "fmi_instance.h"

typedef struct {
    fmi_data data;
    fmi_logger log;
    void *environment;
    char name[64];
} component;

static FMI(Status) said(const component *c, FMI(Status) status, const char *category, const char *text)
{
    if (c->log != NULL) {
        FMI_LOG(c, status, category, text); /* no text has a % */
    }
    return status;
}

static FMI(Status) failed(const component *c, const char *text)
{
    return said(c, FMI(Error), "logStatusError", text);
}

static FMI(Status) missing(void *i) { return failed((component *)i, "not supported by this FMU"); }

/* Return a new instance; NULL, with the message `wrong` to the logger, if the importer's token or kind is wrong. */
static void *instantiated(const char *name, fmi_logger log, void *environment, bool right, const char *wrong)
{
    component *c = (component *)calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    c->log = log;
    c->environment = environment;
    (void)snprintf(c->name, sizeof c->name, "%s", (name != NULL) ? name : "");
    if (!right) {
        (void)failed(c, wrong);
        free(c);
        return NULL;
    }
    fmi_start(&c->data);
    return c;
}

static FMI(Status) stepped(component *c, double length)
{
    const char *warning = NULL;
    const char *wrong = (c->data.phase != STEPPING) ? "a step before the end of the initialisation"
                                                    : fmi_advance(&c->data, length, &warning);
    if (wrong != NULL) {
        return failed(c, wrong);
    }
    return (warning != NULL) ? said(c, FMI(Warning), "logStatusWarning", warning) : FMI(OK);
}

const char *FMI(GetVersion)(void) { return FMI(Version); }

FMI(Status) FMI(SetDebugLogging)(void *i, FMI(Boolean) on, size_t n, const FMI(String) categories[])
{
    (void)i;
    (void)on;
    (void)n;
    (void)categories;
    return FMI(OK);
}

void FMI(FreeInstance)(void *i) { free(i); }

FMI(Status) FMI(ExitInitializationMode)(void *i)
{
    component *c = (component *)i;
    const char *wrong = fmi_begin(&c->data);
    return (wrong != NULL) ? failed(c, wrong) : FMI(OK);
}

FMI(Status) FMI(Terminate)(void *i)
{
    ((component *)i)->data.phase = STOPPED;
    return FMI(OK);
}

FMI(Status) FMI(Reset)(void *i)
{
    fmi_start(&((component *)i)->data);
    return FMI(OK);
}

FMI(Status) FMI_NUMBERS(Get)(void *i, const FMI(ValueReference) vr[], size_t n, fmi_real_t value[] FMI_COUNT)
{
    component *c = (component *)i;
    FMI_COUNT_UNUSED
    for (size_t k = 0; k < n; ++k) {
        const real_t *found = fmi_real(&c->data, vr[k]);
#ifdef FMI_TIME
        if (vr[k] == FMI_TIME) {
            value[k] = c->data.time;
            continue;
        }
#endif
        const char *wrong = (found == NULL) ? "no such number" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = (fmi_real_t)*found;
    }
    return FMI(OK);
}

FMI(Status) FMI_NUMBERS(Set)(void *i, const FMI(ValueReference) vr[], size_t n, const fmi_real_t value[] FMI_COUNT)
{
    component *c = (component *)i;
    FMI_COUNT_UNUSED
    for (size_t k = 0; k < n; ++k) {
        real_t *found = fmi_real(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such number" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = fmi_number(value[k]);
    }
    return FMI(OK);
}

FMI(Status) FMI(GetBoolean)(void *i, const FMI(ValueReference) vr[], size_t n, FMI(Boolean) value[] FMI_COUNT)
{
    component *c = (component *)i;
    FMI_COUNT_UNUSED
    for (size_t k = 0; k < n; ++k) {
        const bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = *found ? FMI(True) : FMI(False);
    }
    return FMI(OK);
}

FMI(Status) FMI(SetBoolean)(void *i, const FMI(ValueReference) vr[], size_t n, const FMI(Boolean) value[] FMI_COUNT)
{
    component *c = (component *)i;
    FMI_COUNT_UNUSED
    for (size_t k = 0; k < n; ++k) {
        bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = value[k] != FMI(False);
    }
    return FMI(OK);
}

/* Copy a state, from another one or from its bytes, to *state; allocate memory if *state is NULL. */
static FMI(Status) copied(void *i, fmi_state *state, const void *source)
{
    if (*state == NULL) {
        *state = malloc(sizeof(fmi_data));
    }
    if (*state == NULL) {
        return failed((component *)i, "no memory for the state");
    }
    memcpy(*state, source, sizeof(fmi_data));
    return FMI(OK);
}

FMI(Status) FMI_STATE(Get, )(void *i, fmi_state *state) { return copied(i, state, &((component *)i)->data); }

FMI(Status) FMI_STATE(Set, )(void *i, fmi_state state)
{
    memcpy(&((component *)i)->data, state, sizeof(fmi_data));
    return FMI(OK);
}

FMI(Status) FMI_STATE(Free, )(void *i, fmi_state *state)
{
    (void)i;
    free(*state);
    *state = NULL;
    return FMI(OK);
}

FMI(Status) FMI_STATE(Serialized, Size)(void *i, fmi_state state, size_t *size)
{
    (void)i;
    (void)state;
    *size = sizeof(fmi_data);
    return FMI(OK);
}

FMI(Status) FMI_STATE(Serialize, )(void *i, fmi_state state, FMI(Byte) bytes[], size_t size)
{
    if (size < sizeof(fmi_data)) {
        return failed((component *)i, "the array is too small for the state");
    }
    memcpy(bytes, state, sizeof(fmi_data));
    return FMI(OK);
}

FMI(Status) FMI_DESERIALIZE(void *i, const FMI(Byte) bytes[], size_t size, fmi_state *state)
{
    if (size != sizeof(fmi_data)) {
        return failed((component *)i, "the bytes are no state of this FMU");
    }
    return copied(i, state, bytes);
}

#endif
