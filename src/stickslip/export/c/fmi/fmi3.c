/* FMI 3.0 for co-simulation; see fmi_instance.h. */
#include "fmi3Functions.h"

#include "fmi_instance.h"

typedef struct {
    fmi_data data;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} component;

static fmi3Status said(const component *c, fmi3Status status, const char *category, const char *text)
{
    if (c->log != NULL) {
        c->log(c->environment, status, category, text);
    }
    return status;
}

static fmi3Status failed(const component *c, const char *text) { return said(c, fmi3Error, "logStatusError", text); }

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)i;
    (void)on;
    (void)n;
    (void)categories;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    component *c = (component *)calloc(1, sizeof *c);
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)events;
    (void)early_return;
    (void)required;
    (void)n;
    (void)update;
    if (c == NULL) {
        return NULL;
    }
    c->log = log;
    c->environment = environment;
    if (token == NULL || strcmp(token, TOKEN) != 0) {
        (void)failed(c, "the instantiation token must be that of the FMU's modelDescription.xml");
        free(c);
        return NULL;
    }
    fmi_start(&c->data);
    return c;
}

void fmi3FreeInstance(fmi3Instance i) { free(i); }

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance i, fmi3Boolean tolerance_given, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stop_given,
    fmi3Float64 stop)
{
    component *c = (component *)i;
    (void)tolerance_given;
    (void)tolerance;
    (void)stop_given;
    (void)stop;
    c->data.time = start;
    c->data.phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance i)
{
    component *c = (component *)i;
    const char *wrong = fmi_begin(&c->data);
    return (wrong != NULL) ? failed(c, wrong) : fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance i)
{
    ((component *)i)->data.phase = STOPPED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance i)
{
    fmi_start(&((component *)i)->data);
    return fmi3OK;
}

fmi3Status fmi3DoStep(
    fmi3Instance i, fmi3Float64 point, fmi3Float64 length, fmi3Boolean no_set_before, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    component *c = (component *)i;
    (void)point;
    (void)no_set_before;
    *event = fmi3False;
    *terminate = fmi3False;
    *early = fmi3False;
    *last = c->data.time;
    if (c->data.phase != STEPPING) {
        return failed(c, "a step before the end of the initialisation");
    }
    const char *warning = NULL;
    const char *wrong = fmi_advance(&c->data, length, &warning);
    *last = c->data.time;
    if (wrong != NULL) {
        return failed(c, wrong);
    }
    return (warning != NULL) ? said(c, fmi3Warning, "logStatusWarning", warning) : fmi3OK;
}

fmi3Status fmi3GetFloat64(
    fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t values)
{
    component *c = (component *)i;
    (void)values;
    for (size_t k = 0; k < n; ++k) {
        const real_t *found = fmi_real(&c->data, vr[k]);
        if (vr[k] == 0U) {
            value[k] = c->data.time;
            continue;
        }
        const char *wrong = (found == NULL) ? "no such Float64 variable" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = (fmi3Float64)*found;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(
    fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[], size_t values)
{
    component *c = (component *)i;
    (void)values;
    for (size_t k = 0; k < n; ++k) {
        real_t *found = fmi_real(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Float64 variable" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = fmi_number(value[k]);
    }
    return fmi3OK;
}

fmi3Status fmi3GetBoolean(
    fmi3Instance i, const fmi3ValueReference vr[], size_t n, fmi3Boolean value[], size_t values)
{
    component *c = (component *)i;
    (void)values;
    for (size_t k = 0; k < n; ++k) {
        const bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean variable" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = *found;
    }
    return fmi3OK;
}

fmi3Status fmi3SetBoolean(
    fmi3Instance i, const fmi3ValueReference vr[], size_t n, const fmi3Boolean value[], size_t values)
{
    component *c = (component *)i;
    (void)values;
    for (size_t k = 0; k < n; ++k) {
        bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean variable" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = value[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(fmi_data));
    }
    if (*state == NULL) {
        return failed((component *)i, "no memory for the state");
    }
    memcpy(*state, &((component *)i)->data, sizeof(fmi_data));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState state)
{
    memcpy(&((component *)i)->data, state, sizeof(fmi_data));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *state)
{
    (void)i;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState state, size_t *size)
{
    (void)i;
    (void)state;
    *size = sizeof(fmi_data);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    if (size < sizeof(fmi_data)) {
        return failed((component *)i, "the array is too small for the state");
    }
    memcpy(bytes, state, sizeof(fmi_data));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    if (size != sizeof(fmi_data)) {
        return failed((component *)i, "the bytes are no state of this FMU");
    }
    if (*state == NULL) {
        *state = malloc(sizeof(fmi_data));
    }
    if (*state == NULL) {
        return failed((component *)i, "no memory for the state");
    }
    memcpy(*state, bytes, sizeof(fmi_data));
    return fmi3OK;
}

#include "fmi3_missing.h"
