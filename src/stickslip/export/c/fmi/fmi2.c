/* FMI 2.0 for co-simulation; the functions that FMI 3.0 has too are in fmi_shell.h. */
#include "fmi2Functions.h"

typedef fmi2Real fmi_real_t;
typedef fmi2FMUstate fmi_state;
typedef fmi2CallbackLogger fmi_logger;

#define FMI(name) fmi2##name
#define FMI_NUMBERS(verb) fmi2##verb##Real
#define FMI_STATE(verb, end) fmi2##verb##FMUstate##end
#define FMI_DESERIALIZE fmi2DeSerializeFMUstate
#define FMI_LOG(c, status, category, text) (c)->log((c)->environment, (c)->name, status, category, text)
#define FMI_COUNT
#define FMI_COUNT_UNUSED

#include "fmi_shell.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

fmi2Component fmi2Instantiate(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *functions,
    fmi2Boolean visible, fmi2Boolean logging)
{
    const fmi_logger log = (functions != NULL) ? functions->logger : NULL;
    void *environment = (functions != NULL) ? functions->componentEnvironment : NULL;
    const bool right = type == fmi2CoSimulation && guid != NULL && strcmp(guid, TOKEN) == 0;
    (void)resources;
    (void)visible;
    (void)logging;
    return instantiated(
        name, log, environment, right,
        "this FMU is for co-simulation, and its guid must be that of its modelDescription.xml");
}

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

fmi2Status fmi2DoStep(fmi2Component i, fmi2Real point, fmi2Real length, fmi2Boolean no_set_before)
{
    (void)point;
    (void)no_set_before;
    return stepped((component *)i, length);
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

/* Functions of FMI that this FMU does not support: they return an error. */

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
