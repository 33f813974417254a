/*
 * A flight of one state from leg to leg. The text before defines `fly_leg` and, where a law is
 * SAMPLED, `take_sample`, which may compute commands at the start of a leg; they are held. `given`
 * holds addresses as in `engine.c`. Entries that differ from sample to sample are written there:
 * errors of sensors [OBSERVED] and the learned state of the law (see `Sampling`).
 */
#ifdef SAMPLED
/* Samples of a law: for each its time, the errors, and the time step of learning. */
typedef struct {
    const double *times;  /* s, */
    const double *errors; /* [OBSERVED] */
    const double *learns; /* s */
    double *memory;       /* learned state of the law [LEARNT] */
    double *commands;     /* those before the first sample, then those of each [HELD] */
    int before;
} Sampling;

/* Take the samples that are due. Returns whether one is refused; then none is taken. */
static int take_samples(const void **given, Flow *flow, const int due, const double *x,
    const Sampling *law)
{
    double learnt[LEARNT + 1], before[LEARNT + 1], refused = 0.0;
    memcpy(before, law->memory, LEARNT * sizeof *before);
    given[MEMORY_AT] = law->memory;
    for (int k = 0; k < due; ++k, ++flow->sampled) {
        const int n = flow->sampled;
        given[ERRORS_AT] = law->errors + n * OBSERVED;
        given[LEARNS_AT] = law->learns + n;
        take_sample(given, law->times[n], x, law->commands + (law->before + n) * HELD_WIDTH,
            learnt, &refused);
        if (refused > 0.0) {
            memcpy(law->memory, before, LEARNT * sizeof *before);
            return 1;
        }
        memcpy(law->memory, learnt, LEARNT * sizeof *learnt);
    }
    return 0;
}
#else
typedef struct Sampling Sampling;
#endif

/* Fly from leg to leg from `x`, which becomes the last state, until `flow` holds a reason to stop.
 * */
void flow_legs(const void **given, Flow *flow, const Leg *legs, double *x, const Kept *kept,
    const Sampling *law);

void flow_legs(const void **given, Flow *flow, const Leg *legs, double *x, const Kept *kept,
    const Sampling *law)
{
    (void)law;
    flow->samples = 0;
    flow->reason = GOES_ON;
    while (flow->leg < flow->legs && flow->steps > 0) {
        const Leg *const leg = legs + flow->leg;
        if (!flow->begun) {
            if (kept->begins) {
                memcpy(kept->begins + flow->leg * STATE, x, STATE * sizeof *x);
            }
#ifdef SAMPLED
            if (take_samples(given, flow, leg->samples, x, law)) {
                flow->reason = REFUSED;
                return;
            }
            given[HELD_AT] = law->commands + leg->command * HELD_WIDTH;
#endif
            flow->begun = 1;
            flow->done = 0;
        }
        fly_leg(given, flow, leg, x, kept);
        if (flow->reason) {
            return;
        }
        if (flow->time >= leg->end) {
            flow->begun = 0;
            ++flow->leg;
        }
    }
}
