/* FMI 3.0 for co-simulation; the functions that FMI 2.0 has too are in fmi_shell.h. */
#include "fmi3Functions.h"

typedef fmi3Float64 fmi_real_t;
typedef fmi3FMUState fmi_state;
typedef fmi3LogMessageCallback fmi_logger;

#define FMI(name) fmi3##name
#define FMI_NUMBERS(verb) fmi3##verb##Float64
#define FMI_STATE(verb, end) fmi3##verb##FMUState##end
#define FMI_DESERIALIZE fmi3DeserializeFMUState
#define FMI_LOG(c, status, category, text) (c)->log((c)->environment, status, category, text)
#define FMI_COUNT , size_t values
#define FMI_COUNT_UNUSED (void)values;
#define FMI_TIME 0U

#include "fmi_shell.h"

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early_return, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)resources;
    (void)visible;
    (void)logging;
    (void)events;
    (void)early_return;
    (void)required;
    (void)n;
    (void)update;
    return instantiated(
        name, log, environment, token != NULL && strcmp(token, TOKEN) == 0,
        "the instantiation token must be that of the FMU's modelDescription.xml");
}

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

fmi3Status fmi3DoStep(
    fmi3Instance i, fmi3Float64 point, fmi3Float64 length, fmi3Boolean no_set_before, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    component *c = (component *)i;
    const fmi3Status status = stepped(c, length);
    (void)point;
    (void)no_set_before;
    *event = fmi3False;
    *terminate = fmi3False;
    *early = fmi3False;
    *last = c->data.time;
    return status;
}

#include "fmi3_missing.h"
