/*
 * Functions that FMI 2.0 and 3.0 share. FMI(name) makes their names, FLAG and BYTE are types, and
 * SAVED makes the endings of names for saved states.
 */
#define FUNCTION(name, ...) DEFINE(Status, FMI(name), Instance *instance, __VA_ARGS__)
#define CHANGE_OF_MODE(name) \
    DEFINE(Status, FMI(name), Instance *instance) \
    { \
        return OK; \
    }
CHANGE_OF_MODE(EnterEventMode)
CHANGE_OF_MODE(EnterContinuousTimeMode)
CHANGE_OF_MODE(Terminate)

DEFINE(void, FMI(FreeInstance), Instance *instance)
{
    free(instance);
}

FUNCTION(SetDebugLogging, FLAG on, size_t count, const char *const *categories)
{
    return OK;
}

DEFINE(Status, FMI(ExitInitializationMode), Instance *instance)
{
    instance->values[INITIALISED] = 1.0;
    const Status status = refresh(instance, 0);
    take_hold(instance);
    return status;
}

DEFINE(Status, FMI(Reset), Instance *instance)
{
    start(instance);
    return OK;
}

FUNCTION(SAVED(Get), void **state)
{
    return save(instance, state);
}

FUNCTION(SAVED(Set), void *state)
{
    return restore(instance, state);
}

FUNCTION(SAVED(Free), void **state)
{
    free(*state);
    *state = NULL;
    return OK;
}

FUNCTION(SIZE_OF_SAVED, void *state, size_t *size)
{
    *size = SERIALISED;
    return OK;
}

FUNCTION(SAVED(Serialize), void *state, BYTE *bytes, size_t size)
{
    return serialise(instance, state, bytes, size);
}

FUNCTION(DESERIALIZE, const BYTE *bytes, size_t size, void **state)
{
    return deserialise(instance, bytes, size, state);
}

FUNCTION(CompletedIntegratorStep, FLAG is_final, FLAG *has_event, FLAG *terminate)
{
    *has_event = *terminate = 0;
    return OK;
}

FUNCTION(SetTime, double time)
{
    instance->values[TIME] = time;
    return OK;
}

FUNCTION(SetContinuousStates, const double *states, size_t count)
{
    return count == STATES ? set(instance, X, count, states) : ERROR;
}

FUNCTION(GetContinuousStates, double *states, size_t count)
{
    return count == STATES ? get(instance, X, count, states) : ERROR;
}

FUNCTION(RATES_OF_STATES, double *rates, size_t count)
{
    return count == STATES ? get(instance, RATES, count, rates) : ERROR;
}

FUNCTION(GetNominalsOfContinuousStates, double *nominals, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        nominals[i] = 1.0;
    }
    return count == STATES ? OK : ERROR;
}

FUNCTION(GetEventIndicators, double *indicators, size_t count)
{
    return count == 0 ? OK : ERROR;
}
