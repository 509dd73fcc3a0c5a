/* FMI 2.0 for co-simulation; see fmi_instance.h. */
#include "fmi2Functions.h"

#include "fmi_instance.h"

typedef struct {
    fmi_data data;
    fmi2CallbackLogger log;
    fmi2ComponentEnvironment environment;
    char name[64];
} component;

static fmi2Status said(const component *c, fmi2Status status, const char *category, const char *text)
{
    if (c->log != NULL) {
        c->log(c->environment, c->name, status, category, text); /* no text has a % */
    }
    return status;
}

static fmi2Status failed(const component *c, const char *text) { return said(c, fmi2Error, "logStatusError", text); }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component i, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)i;
    (void)on;
    (void)n;
    (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *functions,
    fmi2Boolean visible, fmi2Boolean logging)
{
    component *c = (component *)calloc(1, sizeof *c);
    (void)resources;
    (void)visible;
    (void)logging;
    if (c == NULL) {
        return NULL;
    }
    c->log = (functions != NULL) ? functions->logger : NULL;
    c->environment = (functions != NULL) ? functions->componentEnvironment : NULL;
    (void)snprintf(c->name, sizeof c->name, "%s", (name != NULL) ? name : "");
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, TOKEN) != 0) {
        (void)failed(c, "this FMU is for co-simulation, and its guid must be that of its modelDescription.xml");
        free(c);
        return NULL;
    }
    fmi_start(&c->data);
    return c;
}

void fmi2FreeInstance(fmi2Component i) { free(i); }

fmi2Status fmi2SetupExperiment(
    fmi2Component i, fmi2Boolean tolerance_given, fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_given,
    fmi2Real stop)
{
    (void)tolerance_given;
    (void)tolerance;
    (void)stop_given;
    (void)stop;
    ((component *)i)->data.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component i)
{
    ((component *)i)->data.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component i)
{
    component *c = (component *)i;
    const char *wrong = fmi_begin(&c->data);
    return (wrong != NULL) ? failed(c, wrong) : fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component i)
{
    ((component *)i)->data.phase = STOPPED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component i)
{
    fmi_start(&((component *)i)->data);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component i, fmi2Real point, fmi2Real length, fmi2Boolean no_set_before)
{
    component *c = (component *)i;
    (void)point;
    (void)no_set_before;
    if (c->data.phase != STEPPING) {
        return failed(c, "a step before the end of the initialisation");
    }
    const char *warning = NULL;
    const char *wrong = fmi_advance(&c->data, length, &warning);
    if (wrong != NULL) {
        return failed(c, wrong);
    }
    return (warning != NULL) ? said(c, fmi2Warning, "logStatusWarning", warning) : fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component i, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    component *c = (component *)i;
    for (size_t k = 0; k < n; ++k) {
        const real_t *found = fmi_real(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Real variable" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = (fmi2Real)*found;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component i, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    component *c = (component *)i;
    for (size_t k = 0; k < n; ++k) {
        real_t *found = fmi_real(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Real variable" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = fmi_number(value[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component i, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    component *c = (component *)i;
    for (size_t k = 0; k < n; ++k) {
        const bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean variable" : fmi_before_get(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        value[k] = *found ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component i, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    component *c = (component *)i;
    for (size_t k = 0; k < n; ++k) {
        bool *found = fmi_boolean(&c->data, vr[k]);
        const char *wrong = (found == NULL) ? "no such Boolean variable" : fmi_forbidden(&c->data, vr[k]);
        if (wrong != NULL) {
            return failed(c, wrong);
        }
        *found = value[k] != fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(
    fmi2Component i, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[])
{
    component *c = (component *)i;
    for (size_t k = 0; k < n; ++k) {
        if (order[k] != 1 || fmi_real(&c->data, vr[k]) != &c->data.input[0]) {
            return failed(c, "only the first derivative of the first input is known");
        }
        c->data.slope = (real_t)value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component i, fmi2FMUstate *state)
{
    if (*state == NULL) {
        *state = malloc(sizeof(fmi_data));
    }
    if (*state == NULL) {
        return failed((component *)i, "no memory for the state");
    }
    memcpy(*state, &((component *)i)->data, sizeof(fmi_data));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component i, fmi2FMUstate state)
{
    memcpy(&((component *)i)->data, state, sizeof(fmi_data));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component i, fmi2FMUstate *state)
{
    (void)i;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component i, fmi2FMUstate state, size_t *size)
{
    (void)i;
    (void)state;
    *size = sizeof(fmi_data);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component i, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size < sizeof(fmi_data)) {
        return failed((component *)i, "the array is too small for the state");
    }
    memcpy(bytes, state, sizeof(fmi_data));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component i, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
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
    return fmi2OK;
}

/* What this FMU has not: it says so. */

static fmi2Status missing(fmi2Component i) { return failed((component *)i, "not supported by this FMU"); }

#define ACCESS(kind, type) \
    fmi2Status fmi2Get##kind(fmi2Component i, const fmi2ValueReference vr[], size_t n, type value[]) \
    { \
        (void)vr; \
        (void)value; \
        return (n == 0) ? fmi2OK : missing(i); \
    } \
    fmi2Status fmi2Set##kind(fmi2Component i, const fmi2ValueReference vr[], size_t n, const type value[]) \
    { \
        (void)vr; \
        (void)value; \
        return (n == 0) ? fmi2OK : missing(i); \
    }

ACCESS(Integer, fmi2Integer)
ACCESS(String, fmi2String)

fmi2Status fmi2GetDirectionalDerivative(
    fmi2Component i, const fmi2ValueReference unknown[], size_t n, const fmi2ValueReference known[], size_t m,
    const fmi2Real seed[], fmi2Real value[])
{
    (void)unknown;
    (void)n;
    (void)known;
    (void)m;
    (void)seed;
    (void)value;
    return missing(i);
}

fmi2Status fmi2GetRealOutputDerivatives(
    fmi2Component i, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)n;
    (void)order;
    (void)value;
    return missing(i);
}

fmi2Status fmi2CancelStep(fmi2Component i) { return missing(i); }

#define STATUS(kind, type) \
    fmi2Status fmi2Get##kind##Status(fmi2Component i, const fmi2StatusKind asked, type *value) \
    { \
        (void)asked; \
        (void)value; \
        return missing(i); \
    }

fmi2Status fmi2GetStatus(fmi2Component i, const fmi2StatusKind asked, fmi2Status *value)
{
    (void)asked;
    (void)value;
    return missing(i);
}
STATUS(Integer, fmi2Integer)
STATUS(Boolean, fmi2Boolean)
STATUS(String, fmi2String)

fmi2Status fmi2GetRealStatus(fmi2Component i, const fmi2StatusKind asked, fmi2Real *value)
{
    if (asked != fmi2LastSuccessfulTime) {
        return missing(i);
    }
    *value = ((component *)i)->data.time;
    return fmi2OK;
}
