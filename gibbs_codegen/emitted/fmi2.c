/* The functions of FMI 2.0: every entry of an array is a variable. */
#undef FMI
#undef FUNCTION
#undef CHANGE_OF_MODE
#undef FLAG
#undef BYTE
#undef SAVED
#undef SIZE_OF_SAVED
#undef DESERIALIZE
#undef RATES_OF_STATES
#ifdef FMI2_FUNCTION_PREFIX
#define FMI(name) PASTE(FMI2_FUNCTION_PREFIX, fmi2##name)
#else
#define FMI(name) fmi2##name
#endif
#define FLAG int
#define BYTE char
#define SAVED(what) what##FMUstate
#define SIZE_OF_SAVED SerializedFMUstateSize
#define DESERIALIZE DeSerializeFMUstate
#define RATES_OF_STATES GetDerivatives
#include "fmi_both.c"

typedef void (*Message2)(
    void *environment, const char *name, Status status, const char *category, const char *text, ...);

typedef struct {
    Message2 message;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, Status status);
    void *environment;
} Callbacks2;

typedef struct {
    int again, terminate, nominals_changed, values_changed, has_next;
    double next;
} Events2;

static void log_2(const Instance *instance, const char *message)
{
    if (instance->callback) {
        ((Message2)instance->callback)(
            instance->environment, instance->name, ERROR, "logStatusError", "%s", message);
    }
}

DEFINE(const char *, FMI(GetTypesPlatform), void)
{
    return "default";
}

DEFINE(const char *, FMI(GetVersion), void)
{
    return "2.0";
}

DEFINE(
    Instance *, FMI(Instantiate), const char *name, int kind, const char *token,
    const char *resources, const Callbacks2 *callbacks, int visible, int logging)
{
    Instance *instance = instantiate(name, token, 0);
    if (instance) {
        instance->log = log_2;
        instance->environment = callbacks->environment;
        instance->callback = (void (*)(void))callbacks->message;
    } else if (callbacks->message) {
        callbacks->message(
            callbacks->environment, name, ERROR, "logStatusError", "no memory, or another GUID");
    }
    return instance;
}

FUNCTION(
    SetupExperiment, int has_tolerance, double tolerance, double begin, int has_end, double end)
{
    instance->values[TIME] = begin;
    return OK;
}

CHANGE_OF_MODE(EnterInitializationMode)
CHANGE_OF_MODE(CancelStep)

FUNCTION(GetReal, const unsigned *references, size_t count, double *values)
{
    return get_all(instance, references, count, values, count);
}

FUNCTION(SetReal, const unsigned *references, size_t count, const double *values)
{
    return set_all(instance, references, count, values, count);
}

#define NONE_OF2(name, ...) \
    FUNCTION(name, const unsigned *references, size_t count, __VA_ARGS__) \
    { \
        return count == 0 ? OK : fail(instance, #name ": there are no such variables"); \
    }
NONE_OF2(GetInteger, int *values)
NONE_OF2(SetInteger, const int *values)
NONE_OF2(GetBoolean, int *values)
NONE_OF2(SetBoolean, const int *values)
NONE_OF2(GetString, const char **values)
NONE_OF2(SetString, const char *const *values)
NONE_OF2(SetRealInputDerivatives, const int *orders, const double *values)
NONE_OF2(GetRealOutputDerivatives, const int *orders, double *values)

FUNCTION(
    GetDirectionalDerivative, const unsigned *unknowns, size_t of, const unsigned *knowns,
    size_t by, const double *seed, double *sensitivity)
{
    return derive(instance, unknowns, of, knowns, by, seed, by, sensitivity, of);
}

FUNCTION(NewDiscreteStates, Events2 *events)
{
    memset(events, 0, sizeof *events);
    events->values_changed = take_hold(instance);
    return OK;
}

FUNCTION(DoStep, double time, double h, int is_final)
{
    return advance(instance, time, h);
}

#define STATUS2(name, type) \
    FUNCTION(name, int kind, type *value) \
    { \
        return DISCARD; \
    }
STATUS2(GetStatus, int)
STATUS2(GetIntegerStatus, int)
STATUS2(GetBooleanStatus, int)
STATUS2(GetStringStatus, const char *)

FUNCTION(GetRealStatus, int kind, double *value)
{
    *value = instance->values[TIME];
    return kind == 2 ? OK : DISCARD; /* the last successful time */
}
