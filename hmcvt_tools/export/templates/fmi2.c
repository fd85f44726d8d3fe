/*
 * Functions of FMI 2.0 for co-simulation and model exchange.
 *
 * The model has no states and no events: outputs follow from the inputs at any time.
 */
#if !defined(FMI2_FUNCTION_PREFIX) && !defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#define FMI2_FUNCTION_PREFIX ${identifier}_
#endif
#include "fmi2Functions.h"

#include "hmcvt_unit.h"

#include <string.h>

typedef struct {
    hmcvt_unit unit;
    fmi2CallbackFunctions callbacks;
    bool logs;
} instance;

/* Report an error to the importer. */
static fmi2Status refuse(const instance *at, const char *message)
{
    if (at->logs && (at->callbacks.logger != NULL)) {
        at->callbacks.logger(at->callbacks.componentEnvironment, "hmcvt", fmi2Error, "error",
                             message);
    }
    return fmi2Error;
}

static fmi2Status unsupported(fmi2Component c)
{
    return refuse((const instance *)c, "the function is not supported");
}

static fmi2Status unknown_reference(fmi2Component c)
{
    return refuse((const instance *)c, "a value reference is unknown or of another kind");
}

/* --- creation ---------------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    (void)nCategories;
    (void)categories;
    ((instance *)c)->logs = loggingOn != fmi2False;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean loggingOn)
{
    instance *made = NULL;
    (void)instanceName;
    (void)fmuType;
    (void)fmuResourceLocation;
    (void)visible;
    if ((fmuGUID != NULL) && (strcmp(fmuGUID, HMCVT_TOKEN) == 0)) {
        made = (instance *)functions->allocateMemory(1, sizeof(instance));
    }
    if (made != NULL) {
        hmcvt_unit_reset(&made->unit);
        made->callbacks = *functions;
        made->logs = loggingOn != fmi2False;
    }
    return made;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c != NULL) {
        ((instance *)c)->callbacks.freeMemory(c);
    }
}

/* --- modes ------------------------------------------------------------------------------------- */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined,
                               fmi2Real stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    ((instance *)c)->unit.time = startTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    hmcvt_unit_reset(&((instance *)c)->unit);
    return fmi2OK;
}

/* --- variables --------------------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       fmi2Real value[])
{
    size_t i;
    for (i = 0; i < nvr; i++) {
        if (!hmcvt_unit_get_real(&((instance *)c)->unit, vr[i], &value[i])) {
            return unknown_reference(c);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Integer value[])
{
    size_t i;
    for (i = 0; i < nvr; i++) {
        if (!hmcvt_unit_get_integer(&((instance *)c)->unit, vr[i], &value[i])) {
            return unknown_reference(c);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Boolean value[])
{
    size_t i;
    for (i = 0; i < nvr; i++) {
        bool flag;
        if (!hmcvt_unit_get_boolean(&((instance *)c)->unit, vr[i], &flag)) {
            return unknown_reference(c);
        }
        value[i] = flag ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         fmi2String value[])
{
    (void)vr;
    (void)value;
    return (nvr == 0) ? fmi2OK : unknown_reference(c);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       const fmi2Real value[])
{
    size_t i;
    for (i = 0; i < nvr; i++) {
        if (!hmcvt_unit_set_real(&((instance *)c)->unit, vr[i], value[i])) {
            return unknown_reference(c);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[])
{
    size_t i;
    for (i = 0; i < nvr; i++) {
        if (!hmcvt_unit_set_integer(&((instance *)c)->unit, vr[i], value[i])) {
            return unknown_reference(c);
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[])
{
    (void)vr;
    (void)value;
    return (nvr == 0) ? fmi2OK : unknown_reference(c);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[])
{
    (void)vr;
    (void)value;
    return (nvr == 0) ? fmi2OK : unknown_reference(c);
}

/* --- state of the FMU -------------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    instance *const at = (instance *)c;
    if (*FMUstate == NULL) {
        *FMUstate = at->callbacks.allocateMemory(1, sizeof(hmcvt_unit));
    }
    if (*FMUstate == NULL) {
        return refuse(at, "no memory");
    }
    *(hmcvt_unit *)*FMUstate = at->unit;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    ((instance *)c)->unit = *(const hmcvt_unit *)FMUstate;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    if (*FMUstate != NULL) {
        ((instance *)c)->callbacks.freeMemory(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    (void)c;
    (void)FMUstate;
    *size = sizeof(hmcvt_unit);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate,
                                 fmi2Byte serializedState[], size_t size)
{
    if (size < sizeof(hmcvt_unit)) {
        return refuse((const instance *)c, "the serialized state does not fit");
    }
    memcpy(serializedState, FMUstate, sizeof(hmcvt_unit));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate)
{
    if (size != sizeof(hmcvt_unit)) {
        return refuse((const instance *)c, "the serialized state is of another FMU");
    }
    if (fmi2GetFMUstate(c, FMUstate) != fmi2OK) {
        return fmi2Error;
    }
    memcpy(*FMUstate, serializedState, sizeof(hmcvt_unit));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    (void)vUnknown_ref;
    (void)nUnknown;
    (void)vKnown_ref;
    (void)nKnown;
    (void)dvKnown;
    (void)dvUnknown;
    return unsupported(c);
}

/* --- model exchange ---------------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    (void)c;
    fmi2eventInfo->newDiscreteStatesNeeded = fmi2False;
    fmi2eventInfo->terminateSimulation = fmi2False;
    fmi2eventInfo->nominalsOfContinuousStatesChanged = fmi2False;
    fmi2eventInfo->valuesOfContinuousStatesChanged = fmi2False;
    fmi2eventInfo->nextEventTimeDefined = fmi2False;
    fmi2eventInfo->nextEventTime = 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c,
                                       fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode,
                                       fmi2Boolean *terminateSimulation)
{
    (void)c;
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = fmi2False;
    *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ((instance *)c)->unit.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    (void)x;
    return (nx == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    (void)derivatives;
    return (nx == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni)
{
    (void)eventIndicators;
    return (ni == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    (void)x;
    return (nx == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx)
{
    (void)x_nominal;
    return (nx == 0) ? fmi2OK : unsupported(c);
}

/* --- co-simulation ----------------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (nvr == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                        size_t nvr, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr;
    (void)order;
    (void)value;
    return (nvr == 0) ? fmi2OK : unsupported(c);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint,
                      fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    ((instance *)c)->unit.time = currentCommunicationPoint + communicationStepSize;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return unsupported(c);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    (void)s;
    (void)value;
    (void)unsupported(c);
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    if (s != fmi2LastSuccessfulTime) {
        (void)unsupported(c);
        return fmi2Discard;
    }
    *value = ((instance *)c)->unit.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    (void)s;
    (void)value;
    (void)unsupported(c);
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    if (s != fmi2Terminated) {
        (void)unsupported(c);
        return fmi2Discard;
    }
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    (void)s;
    (void)value;
    (void)unsupported(c);
    return fmi2Discard;
}
