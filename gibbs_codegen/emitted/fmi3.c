/* The functions of FMI 3.0; most do nothing for a model without events and clocks. */
#ifdef FMI3_FUNCTION_PREFIX
#define FMI(name) PASTE(FMI3_FUNCTION_PREFIX, fmi3##name)
#else
#define FMI(name) fmi3##name
#endif
#define FLAG bool
#define BYTE uint8_t
#define SAVED(what) what##FMUState
#define SIZE_OF_SAVED SerializedFMUStateSize
#define DESERIALIZE DeserializeFMUState
#define RATES_OF_STATES GetContinuousStateDerivatives
#include "fmi_both.c"

typedef void (*Message3)(void *environment, Status status, const char *category, const char *text);

static void log_3(const Instance *instance, const char *message)
{
    if (instance->callback) {
        ((Message3)instance->callback)(instance->environment, ERROR, "logStatusError", message);
    }
}

static Instance *instantiate3(
    const char *name, const char *token, void *environment, const Message3 message)
{
    Instance *instance = instantiate(name, token, 1);
    if (instance) {
        instance->log = log_3;
        instance->environment = environment;
        instance->callback = (void (*)(void))message;
    } else if (message) {
        message(environment, ERROR, "logStatusError", "no memory, or another instantiation token");
    }
    return instance;
}

DEFINE(const char *, FMI(GetVersion), void)
{
    return "3.0";
}

DEFINE(
    Instance *, FMI(InstantiateModelExchange), const char *name, const char *token,
    const char *resources, bool visible, bool logging, void *environment, Message3 message)
{
    return instantiate3(name, token, environment, message);
}

DEFINE(
    Instance *, FMI(InstantiateCoSimulation), const char *name, const char *token,
    const char *resources, bool visible, bool logging, bool events, bool early_return,
    const unsigned *intermediate, size_t count, void *environment, Message3 message,
    void (*update)(void))
{
    return instantiate3(name, token, environment, message);
}

DEFINE(
    Instance *, FMI(InstantiateScheduledExecution), const char *name, const char *token,
    const char *resources, bool visible, bool logging, void *environment, Message3 message,
    void (*clock_update)(void), void (*lock)(void), void (*unlock)(void))
{
    return NULL;
}

FUNCTION(
    EnterInitializationMode, bool has_tolerance, double tolerance, double begin, bool has_end,
    double end)
{
    instance->values[TIME] = begin;
    return OK;
}

CHANGE_OF_MODE(EnterStepMode)
CHANGE_OF_MODE(EnterConfigurationMode)
CHANGE_OF_MODE(ExitConfigurationMode)
CHANGE_OF_MODE(EvaluateDiscreteStates)

FUNCTION(GetFloat64, const unsigned *references, size_t count, double *values, size_t size)
{
    return get_all(instance, references, count, values, size);
}

FUNCTION(SetFloat64, const unsigned *references, size_t count, const double *values, size_t size)
{
    return set_all(instance, references, count, values, size);
}

static Status none(const Instance *instance, const size_t count)
{
    return count == 0 ? OK : fail(instance, "all variables are of the type Float64");
}

#define NO_VARIABLES(type, kind) \
    FUNCTION(Get##type, const unsigned *references, size_t count, kind *values, size_t size) \
    { \
        return none(instance, count); \
    } \
    FUNCTION(Set##type, const unsigned *references, size_t count, const kind *values, size_t size) \
    { \
        return none(instance, count); \
    }
NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)
NO_VARIABLES(String, char *)

#define NONE_OF(name, ...) \
    FUNCTION(name, const unsigned *references, size_t count, __VA_ARGS__) \
    { \
        return none(instance, count); \
    }
NONE_OF(GetBinary, size_t *sizes, const uint8_t **values, size_t size)
NONE_OF(SetBinary, const size_t *sizes, const uint8_t *const *values, size_t size)
NONE_OF(GetClock, bool *values)
NONE_OF(SetClock, const bool *values)
NONE_OF(GetIntervalDecimal, double *intervals, int *qualifiers)
NONE_OF(GetIntervalFraction, uint64_t *counters, uint64_t *resolutions, int *qualifiers)
NONE_OF(GetShiftDecimal, double *shifts)
NONE_OF(GetShiftFraction, uint64_t *counters, uint64_t *resolutions)
NONE_OF(SetIntervalDecimal, const double *intervals)
NONE_OF(SetIntervalFraction, const uint64_t *counters, const uint64_t *resolutions)
NONE_OF(SetShiftDecimal, const double *shifts)
NONE_OF(SetShiftFraction, const uint64_t *counters, const uint64_t *resolutions)
NONE_OF(GetOutputDerivatives, const int32_t *orders, double *values, size_t size)

FUNCTION(GetNumberOfVariableDependencies, unsigned reference, size_t *count)
{
    return fail(instance, "dependencies are not told");
}

FUNCTION(
    GetVariableDependencies, unsigned dependent, size_t *of, unsigned *independents, size_t *by,
    int *kinds, size_t count)
{
    return fail(instance, "dependencies are not told");
}

FUNCTION(
    GetDirectionalDerivative, const unsigned *unknowns, size_t of, const unsigned *knowns,
    size_t by, const double *seed, size_t seeds, double *sensitivity, size_t size)
{
    return derive(
        instance, unknowns, of, knowns, by, seed, seeds, sensitivity, size);
}

FUNCTION(
    GetAdjointDerivative, const unsigned *unknowns, size_t of, const unsigned *knowns, size_t by,
    const double *seed, size_t seeds, double *sensitivity, size_t size)
{
    return fail(instance, "there are directional derivatives only");
}

FUNCTION(
    UpdateDiscreteStates, bool *again, bool *terminate, bool *nominals_changed, bool *values_changed,
    bool *has_next, double *next)
{
    *again = *terminate = *nominals_changed = *has_next = false;
    *values_changed = take_hold(instance);
    return OK;
}

FUNCTION(GetNumberOfEventIndicators, size_t *count)
{
    *count = 0;
    return OK;
}

FUNCTION(GetNumberOfContinuousStates, size_t *count)
{
    *count = STATES;
    return OK;
}

FUNCTION(
    DoStep, double time, double h, bool is_final, bool *has_event, bool *terminate, bool *is_early,
    double *reached)
{
    const Status status = advance(instance, time, h);
    *has_event = *terminate = *is_early = false;
    *reached = instance->values[TIME];
    return status;
}

FUNCTION(ActivateModelPartition, unsigned clock, double time)
{
    return fail(instance, "there are no clocks");
}
