/*
 * A robot as a functional mock-up unit (FMU), for both versions of the interface (FMI).
 *
 * One array holds all values of an instance, and a value reference is an index in it: time, states,
 * their rates, inputs, the greatest step of co-simulation, parameters, outputs. A variable of FMI
 * 2.0 is an entry; one of FMI 3.0 may be an array of LENGTH[index] entries. The text before defines
 * the numbers of these, START, LENGTH, GRAVITY, TOKEN, and MODULE, which makes names of the robot's
 * functions. Memory is allocated for instances and saved states only.
 */
enum {
    TIME,
    X,
    RATES = X + STATES,
    GIVEN = RATES + STATES,
    STEP = GIVEN + INPUTS,
    PARAMETER,
    RESULTS = PARAMETER + PARAMETERS,
    COUNT = RESULTS + OUTPUTS,
    /* Without a value reference: whether initialisation has ended, whether holds have changed. */
    INITIALISED = COUNT,
    HOLDS_CHANGED,
    SIZE
};

/* Both versions of FMI have these numbers for them. */
typedef enum { OK, WARNING, DISCARD, ERROR } Status;

/* Values that must be computed before they are read. */
enum { CONSTANTS_STALE = 1, RATES_STALE = 2, OUTPUTS_STALE = 4, ALL_STALE = 7 };

typedef struct Instance Instance;
struct Instance {
    double values[SIZE];
    MODULE(constants) constants;
    int stale;
    int has_arrays;
    void (*log)(const Instance *instance, const char *message);
    /* The importer's callback for messages. */
    void *environment;
    void (*callback)(void);
    char name[64];
};

static Status fail(const Instance *instance, const char *message)
{
    instance->log(instance, message);
    return ERROR;
}

static void start(Instance *instance)
{
    const volatile double *const first = START; /* gcc 12 copies constants wrongly, see platform.c */
    for (int i = 0; i < SIZE; ++i) {
        instance->values[i] = first[i];
    }
    instance->values[INITIALISED] = 0.0;
    instance->values[HOLDS_CHANGED] = 1.0;
    instance->stale = ALL_STALE;
}

static Instance *instantiate(const char *name, const char *token, const int has_arrays)
{
    Instance *instance = strcmp(token, TOKEN) == 0 ? malloc(sizeof *instance) : NULL;
    if (instance) {
        memset(instance, 0, sizeof *instance);
        instance->has_arrays = has_arrays;
        strncpy(instance->name, name, sizeof instance->name - 1);
        start(instance);
    }
    return instance;
}

/* Compute some of RATES_STALE and OUTPUTS_STALE, if they are. */
static Status refresh(Instance *instance, const int wanted)
{
    double *values = instance->values;
    const int stale = instance->stale & (wanted | CONSTANTS_STALE);
    if (stale & CONSTANTS_STALE && MODULE(init_constants)(values + PARAMETER, &instance->constants)) {
        return fail(instance, "parameters: the robot has no mass, or a value is not finite");
    }
    if (stale & RATES_STALE) {
        MODULE(rates)(
            &instance->constants, values + X, values + GIVEN, GRAVITY, values + RATES);
    }
    if (stale & OUTPUTS_STALE) {
        MODULE(outputs)(
            &instance->constants, values + X, values + GIVEN, GRAVITY, values + RESULTS);
    }
    instance->stale &= ~stale;
    return OK;
}

/* Let constraints take hold, if the set of active ones has changed; returns whether it has. */
static int take_hold(Instance *instance)
{
#ifdef HOLDS
    double *values = instance->values, next[STATES];
    if (values[HOLDS_CHANGED] > 0.0 && refresh(instance, 0) == OK) {
        MODULE(take_hold)(&instance->constants, values + X, values + GIVEN, next);
        memcpy(values + X, next, sizeof next);
        instance->stale |= RATES_STALE | OUTPUTS_STALE;
        values[HOLDS_CHANGED] = 0.0;
        return 1;
    }
#endif
    (void)instance;
    return 0;
}

/* Read some entries, computed first if they are stale. */
static Status get(Instance *instance, const size_t place, const size_t count, double *to)
{
    int wanted = place >= RATES && place < GIVEN ? RATES_STALE : 0;
    wanted |= place >= RESULTS ? OUTPUTS_STALE : 0;
    if (wanted && refresh(instance, wanted) != OK) {
        return ERROR;
    }
    memcpy(to, instance->values + place, count * sizeof *to);
    return OK;
}

/* Write some entries: states, inputs or parameters. */
static Status set(Instance *instance, const size_t place, const size_t count, const double *from)
{
    const int is_state = place >= X && place + count <= RATES;
    if (!is_state && !(place >= GIVEN && place + count <= RESULTS)) {
        return fail(instance, "only states, inputs and parameters can be set");
    }
#ifdef EASES
    for (size_t i = EASES; i < EASES + LENGTH[EASES]; ++i) {
        if (i >= place && i < place + count && !(from[i - place] > 0.0)) {
            return fail(instance, "wall.bristle_damping: must be above 0, N s/m");
        }
    }
#endif
    memcpy(instance->values + place, from, count * sizeof *from);
    instance->stale |= place >= PARAMETER ? ALL_STALE : RATES_STALE | OUTPUTS_STALE;
#ifdef HOLDS
    if (place < STEP && place + count > HOLDS) {
        instance->values[HOLDS_CHANGED] = 1.0;
    }
#endif
    return OK;
}

/* Advance by steps of one size, no greater than the instance's; they end where `h` does. */
static Status advance(Instance *instance, const double time, const double h)
{
    double *values = instance->values, next[STATES];
    const double least = h / values[STEP];
    if (!(h > 0.0) || !(values[STEP] > 0.0) || !(least < 1e9)) {
        return fail(instance, "steps and step_size must be positive, at most 1e9 of these in one");
    }
    /* Importers count steps or add them up, so times differ by rounding. */
    if (!(fabs(time - values[TIME]) <= 1e-6 * h + 1e-12 * fabs(time))) {
        return fail(instance, "a step must begin at the time where the last one ended");
    }
    if (refresh(instance, 0) != OK) {
        return ERROR;
    }
    take_hold(instance);
    /* Rounding of a multiple must not add a step. */
    const long steps = least > 1.0 ? (long)ceil(least * (1.0 - 1e-9)) : 1;
    for (long k = 0; k < steps; ++k) {
        MODULE(step)(
            &instance->constants, values + X, values + GIVEN, GRAVITY, h / (double)steps, next);
        for (int i = 0; i < STATES; ++i) {
            if (!isfinite(next[i])) {
                return fail(instance, "a state is no finite number after a step");
            }
        }
        memcpy(values + X, next, sizeof next);
        values[TIME] = time + h * (double)(k + 1) / (double)steps;
        instance->stale |= RATES_STALE | OUTPUTS_STALE;
    }
    values[TIME] = time + h;
    return OK;
}

/* Entries of a variable; 0 if the reference is unknown or there is no room for its values. */
static size_t entries(const Instance *instance, const unsigned reference, const size_t room)
{
    const size_t any = reference < COUNT ? (instance->has_arrays ? LENGTH[reference] : 1) : 0;
    if (any == 0 || any > room) {
        fail(instance, "no such value reference, or a wrong number of values");
    }
    return any > room ? 0 : any;
}

/* Read or write variables one after the other. */
static Status get_all(
    Instance *instance, const unsigned *references, const size_t count, double *to, size_t room)
{
    for (size_t k = 0, found; k < count; ++k, to += found, room -= found) {
        found = entries(instance, references[k], room);
        if (found == 0 || get(instance, references[k], found, to) != OK) {
            return ERROR;
        }
    }
    return OK;
}

static Status set_all(
    Instance *instance, const unsigned *references, const size_t count, const double *from,
    size_t room)
{
    for (size_t k = 0, found; k < count; ++k, from += found, room -= found) {
        found = entries(instance, references[k], room);
        if (found > 0 && references[k] < RATES && instance->values[INITIALISED] > 0.0) {
            return fail(instance, "states can be set until initialisation ends");
        }
        if (found == 0 || set(instance, references[k], found, from) != OK) {
            return ERROR;
        }
    }
    return OK;
}

/* Derivatives of rates and outputs along a direction of states and inputs. */
static Status derive(
    Instance *instance, const unsigned *unknowns, const size_t of, const unsigned *knowns,
    const size_t by, const double *seed, size_t seeds, double *sensitivity, size_t room)
{
    const double *values = instance->values;
    double dot[COUNT] = {0.0};
    for (size_t k = 0, found; k < by; ++k, seed += found, seeds -= found) {
        const unsigned place = knowns[k];
        found = entries(instance, place, seeds);
        if (found == 0 || place >= PARAMETER || (place >= RATES && place < GIVEN)) {
            return fail(instance, "derivatives are by states and inputs, and by no parameters");
        }
        memcpy(dot + place, seed, found * sizeof *seed);
    }
    if (refresh(instance, 0) != OK) {
        return ERROR;
    }
    MODULE(derivatives)(
        &instance->constants, values + X, values + GIVEN, GRAVITY, dot + X, dot + GIVEN,
        dot + RATES, dot + RESULTS);
    for (size_t k = 0, found; k < of; ++k, sensitivity += found, room -= found) {
        const unsigned place = unknowns[k];
        found = entries(instance, place, room);
        if (found == 0 || place < RATES || (place >= GIVEN && place < RESULTS)) {
            return fail(instance, "derivatives are of rates of states and outputs");
        }
        memcpy(sensitivity, dot + place, found * sizeof *sensitivity);
    }
    return OK;
}

/* A saved state is a copy of the values; everything else can be computed from them. */
static Status save(const Instance *instance, void **state)
{
    *state = *state ? *state : malloc(sizeof instance->values);
    if (!*state) {
        return fail(instance, "no memory for a state");
    }
    memcpy(*state, instance->values, sizeof instance->values);
    return OK;
}

/* A serialised state begins with the token, because indices of values differ between models. */
enum { SERIALISED = sizeof TOKEN + SIZE * sizeof(double) };

static Status serialise(const Instance *instance, const void *state, void *to, const size_t size)
{
    if (size != SERIALISED) {
        return fail(instance, "a serialised state takes another number of bytes");
    }
    memcpy(to, TOKEN, sizeof TOKEN);
    memcpy((char *)to + sizeof TOKEN, state, sizeof instance->values);
    return OK;
}

static Status deserialise(
    const Instance *instance, const void *from, const size_t size, void **state)
{
    if (size != SERIALISED || memcmp(from, TOKEN, sizeof TOKEN) != 0) {
        return fail(instance, "a serialised state is of another model");
    }
    const Status status = save(instance, state);
    if (status == OK) {
        memcpy(*state, (const char *)from + sizeof TOKEN, sizeof instance->values);
    }
    return status;
}

static Status restore(Instance *instance, const void *state)
{
    memcpy(instance->values, state, sizeof instance->values);
    instance->stale = ALL_STALE;
    return OK;
}

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#define PASTED(prefix, name) prefix##name
#define PASTE(prefix, name) PASTED(prefix, name)
/* FMI's functions are declared here too, so no headers of an importer are needed. */
#define DEFINE(type, name, ...) \
    EXPORT type name(__VA_ARGS__); \
    type name(__VA_ARGS__)
