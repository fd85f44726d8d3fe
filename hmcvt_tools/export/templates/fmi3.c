/*
 * Functions of FMI 3.0 for co-simulation and model exchange.
 *
 * The model has no states and no events: outputs follow from the inputs at any time. What both
 * versions of FMI share is in hmcvt_unit.c; the rest are functions whose names, arguments and
 * statuses FMI prescribes, and differently in each version.
 */
#if !defined(FMI3_FUNCTION_PREFIX) && !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#define FMI3_FUNCTION_PREFIX ${identifier}_
#endif
#include "fmi3Functions.h"

#include "hmcvt_unit.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    hmcvt_unit unit;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log_message;
    bool logs;
} component;

static hmcvt_unit *unit_of(fmi3Instance instance)
{
    return &((component *)instance)->unit;
}

/* Report an error to the importer. */
static fmi3Status refuse(fmi3Instance instance, const char *message)
{
    const component *const at = (const component *)instance;
    if (at->logs && (at->log_message != NULL)) {
        at->log_message(at->environment, fmi3Error, "error", message);
    }
    return fmi3Error;
}

static fmi3Status unsupported(fmi3Instance instance)
{
    return refuse(instance, "the function is not supported");
}

static fmi3Status unknown_reference(fmi3Instance instance)
{
    return refuse(instance, "a value reference is unknown or of another kind");
}

/* For types that no variable has. */
static fmi3Status no_values(fmi3Instance instance, size_t count)
{
    return (count == 0) ? fmi3OK : unknown_reference(instance);
}

static fmi3Instance made(fmi3String token, fmi3Boolean logs, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log_message)
{
    component *at = NULL;
    if ((token != NULL) && (strcmp(token, HMCVT_TOKEN) == 0)) {
        at = (component *)calloc(1, sizeof(component));
    }
    if (at != NULL) {
        hmcvt_unit_reset(&at->unit);
        at->environment = environment;
        at->log_message = log_message;
        at->logs = logs;
    }
    return at;
}

/* --- creation ---------------------------------------------------------------------------------- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)nCategories;
    (void)categories;
    ((component *)instance)->logs = loggingOn;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible,
                                          fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    return made(instantiationToken, loggingOn, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible,
                                         fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)instanceName;
    (void)resourcePath;
    (void)visible;
    (void)eventModeUsed;
    (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables;
    (void)nRequiredIntermediateVariables;
    (void)intermediateUpdate;
    return made(instantiationToken, loggingOn, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName,
                                               fmi3String instantiationToken,
                                               fmi3String resourcePath, fmi3Boolean visible,
                                               fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName;
    (void)instantiationToken;
    (void)resourcePath;
    (void)visible;
    (void)loggingOn;
    (void)instanceEnvironment;
    (void)logMessage;
    (void)clockUpdate;
    (void)lockPreemption;
    (void)unlockPreemption;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

/* --- modes ------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                       fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    unit_of(instance)->time = startTime;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    hmcvt_unit_reset(unit_of(instance));
    return fmi3OK;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    return unsupported(instance);
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return unsupported(instance);
}

/* --- variables --------------------------------------------------------------------------------- */

/* Functions for a type that variables have; `access` reads or writes one of them. */
#define VALUES_OF(kind, type, access)                                                            \
    fmi3Status kind(fmi3Instance instance, const fmi3ValueReference valueReferences[],           \
                    size_t nValueReferences, type values[], size_t nValues)                      \
    {                                                                                            \
        size_t i;                                                                                \
        if (nValues != nValueReferences) {                                                       \
            return unknown_reference(instance);                                                  \
        }                                                                                        \
        for (i = 0; i < nValueReferences; i++) {                                                 \
            if (!(access)) {                                                                     \
                return unknown_reference(instance);                                              \
            }                                                                                    \
        }                                                                                        \
        return fmi3OK;                                                                           \
    }

VALUES_OF(fmi3GetFloat64, fmi3Float64,
          hmcvt_unit_get_real(unit_of(instance), valueReferences[i], &values[i]))
VALUES_OF(fmi3SetFloat64, const fmi3Float64,
          hmcvt_unit_set_real(unit_of(instance), valueReferences[i], values[i]))
VALUES_OF(fmi3GetInt32, fmi3Int32,
          hmcvt_unit_get_integer(unit_of(instance), valueReferences[i], &values[i]))
VALUES_OF(fmi3SetInt32, const fmi3Int32,
          hmcvt_unit_set_integer(unit_of(instance), valueReferences[i], values[i]))
VALUES_OF(fmi3GetBoolean, fmi3Boolean,
          hmcvt_unit_get_boolean(unit_of(instance), valueReferences[i], &values[i]))

/* Functions for a type that no variable has. */
#define NO_VALUES_OF(kind, type)                                                                 \
    fmi3Status kind(fmi3Instance instance, const fmi3ValueReference valueReferences[],          \
                    size_t nValueReferences, type values[], size_t nValues)                     \
    {                                                                                           \
        (void)valueReferences;                                                                  \
        (void)values;                                                                           \
        (void)nValues;                                                                          \
        return no_values(instance, nValueReferences);                                           \
    }

NO_VALUES_OF(fmi3GetFloat32, fmi3Float32)
NO_VALUES_OF(fmi3GetInt8, fmi3Int8)
NO_VALUES_OF(fmi3GetUInt8, fmi3UInt8)
NO_VALUES_OF(fmi3GetInt16, fmi3Int16)
NO_VALUES_OF(fmi3GetUInt16, fmi3UInt16)
NO_VALUES_OF(fmi3GetUInt32, fmi3UInt32)
NO_VALUES_OF(fmi3GetInt64, fmi3Int64)
NO_VALUES_OF(fmi3GetUInt64, fmi3UInt64)
NO_VALUES_OF(fmi3GetString, fmi3String)
NO_VALUES_OF(fmi3SetFloat32, const fmi3Float32)
NO_VALUES_OF(fmi3SetInt8, const fmi3Int8)
NO_VALUES_OF(fmi3SetUInt8, const fmi3UInt8)
NO_VALUES_OF(fmi3SetInt16, const fmi3Int16)
NO_VALUES_OF(fmi3SetUInt16, const fmi3UInt16)
NO_VALUES_OF(fmi3SetUInt32, const fmi3UInt32)
NO_VALUES_OF(fmi3SetInt64, const fmi3Int64)
NO_VALUES_OF(fmi3SetUInt64, const fmi3UInt64)
NO_VALUES_OF(fmi3SetBoolean, const fmi3Boolean)
NO_VALUES_OF(fmi3SetString, const fmi3String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, size_t valueSizes[], fmi3Binary values[],
                         size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, fmi3Clock values[])
{
    (void)valueReferences;
    (void)values;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                         size_t nValueReferences, const size_t valueSizes[],
                         const fmi3Binary values[], size_t nValues)
{
    (void)valueReferences;
    (void)valueSizes;
    (void)values;
    (void)nValues;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                        size_t nValueReferences, const fmi3Clock values[])
{
    (void)valueReferences;
    (void)values;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance,
                                               fmi3ValueReference valueReference,
                                               size_t *nDependencies)
{
    (void)valueReference;
    (void)nDependencies;
    return unsupported(instance);
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    (void)dependent;
    (void)elementIndicesOfDependent;
    (void)independents;
    (void)elementIndicesOfIndependents;
    (void)dependencyKinds;
    (void)nDependencies;
    return unsupported(instance);
}

/* --- state of the FMU -------------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    if (*FMUState == NULL) {
        *FMUState = calloc(1, sizeof(hmcvt_unit));
    }
    if (*FMUState == NULL) {
        return refuse(instance, "no memory");
    }
    *(hmcvt_unit *)*FMUState = *unit_of(instance);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    *unit_of(instance) = *(const hmcvt_unit *)FMUState;
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    (void)instance;
    free(*FMUState);
    *FMUState = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    (void)instance;
    (void)FMUState;
    *size = sizeof(hmcvt_unit);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState,
                                 fmi3Byte serializedState[], size_t size)
{
    if (size < sizeof(hmcvt_unit)) {
        return refuse(instance, "the serialized state does not fit");
    }
    memcpy(serializedState, FMUState, sizeof(hmcvt_unit));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[],
                                   size_t size, fmi3FMUState *FMUState)
{
    if (size != sizeof(hmcvt_unit)) {
        return refuse(instance, "the serialized state is of another FMU");
    }
    if (fmi3GetFMUState(instance, FMUState) != fmi3OK) {
        return fmi3Error;
    }
    memcpy(*FMUState, serializedState, sizeof(hmcvt_unit));
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance,
                                        const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns,
                                        const fmi3Float64 seed[], size_t nSeed,
                                        fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)unknowns;
    (void)nUnknowns;
    (void)knowns;
    (void)nKnowns;
    (void)seed;
    (void)nSeed;
    (void)sensitivity;
    (void)nSensitivity;
    return unsupported(instance);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t nUnknowns, const fmi3ValueReference knowns[],
                                    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity)
{
    (void)unknowns;
    (void)nUnknowns;
    (void)knowns;
    (void)nKnowns;
    (void)seed;
    (void)nSeed;
    (void)sensitivity;
    (void)nSensitivity;
    return unsupported(instance);
}

/* --- clocks: the model has none ---------------------------------------------------------------- */

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance,
                                  const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences;
    (void)intervals;
    (void)qualifiers;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[])
{
    (void)valueReferences;
    (void)shifts;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance,
                                  const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, const fmi3Float64 intervals[])
{
    (void)valueReferences;
    (void)intervals;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance,
                                   const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, const fmi3Float64 shifts[])
{
    (void)valueReferences;
    (void)shifts;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
    (void)valueReferences;
    (void)counters;
    (void)resolutions;
    return no_values(instance, nValueReferences);
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    (void)instance;
    *discreteStatesNeedUpdate = fmi3False;
    *terminateSimulation = fmi3False;
    *nominalsOfContinuousStatesChanged = fmi3False;
    *valuesOfContinuousStatesChanged = fmi3False;
    *nextEventTimeDefined = fmi3False;
    *nextEventTime = 0.0;
    return fmi3OK;
}

/* --- model exchange ---------------------------------------------------------------------------- */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                       fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation)
{
    (void)instance;
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = fmi3False;
    *terminateSimulation = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    unit_of(instance)->time = time;
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
    (void)continuousStates;
    return (nContinuousStates == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates)
{
    (void)derivatives;
    return (nContinuousStates == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[],
                                  size_t nEventIndicators)
{
    (void)eventIndicators;
    return (nEventIndicators == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[],
                                   size_t nContinuousStates)
{
    (void)continuousStates;
    return (nContinuousStates == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t nContinuousStates)
{
    (void)nominals;
    return (nContinuousStates == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    (void)instance;
    *nEventIndicators = 0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    (void)instance;
    *nContinuousStates = 0;
    return fmi3OK;
}

/* --- co-simulation ----------------------------------------------------------------------------- */

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance,
                                    const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t nValues)
{
    (void)valueReferences;
    (void)orders;
    (void)values;
    (void)nValues;
    return (nValueReferences == 0) ? fmi3OK : unsupported(instance);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    unit_of(instance)->time = currentCommunicationPoint + communicationStepSize;
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = unit_of(instance)->time;
    return fmi3OK;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime)
{
    (void)clockReference;
    (void)activationTime;
    return unsupported(instance);
}
