/*
 * Steps of a program, many a call, for one state or a block of states side by side.
 *
 * `take_step` is the program's. A state ends before a step that is refused, and after one from
 * which it cannot go on; it then stays as it is, while others go on.
 */
typedef struct {
    int going[LANES];   /* whether it is flown, and then whether it has not ended */
    int refused[LANES]; /* whether it ended before a step */
    int taken[LANES];   /* steps */
} Progress;

/* Whether a value of a lane is 0 or less: no number is not. */
static INLINE int is_within(const number *value, const int lane)
{
    return ((const real *)value)[lane] <= R(0.0);
}

/* Where states have ended, those of one that goes on stand in for them, whose cost is the same. */
static INLINE void stand_in(const Progress *progress, number *x)
{
    int one = 0;
    while (one < LANES && !progress->going[one]) {
        ++one;
    }
    for (int lane = 0; lane < LANES; ++lane) {
        for (int i = 0; i < STATE && !progress->going[lane]; ++i) {
            ((real *)x)[i * LANES + lane] = ((const real *)x)[i * LANES + one];
        }
    }
}

/* The least and the greatest of inputs so far. */
static INLINE void widen(const number *inputs, real *range)
{
    for (int i = 0; range && i < RANGED; ++i) {
        const real value = ((const real *)inputs)[i * LANES];
        range[i] = minimum_real(range[i], value);
        range[RANGED + i] = maximum_real(range[RANGED + i], value);
    }
}

/* End states of which some are told. Returns whether any goes on. */
static INLINE int end(Progress *progress, const number *within, const int refuses)
{
    int any = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        if (progress->going[lane] && !is_within(within, lane)) {
            progress->going[lane] = 0;
            progress->refused[lane] |= refuses;
        }
        any |= progress->going[lane];
    }
    return any;
}

/*
 * Take up to `count` steps of `h` from `x` at `time`; every `every`-th step, counted from `before`,
 * is a sample. `x` is then the last state, and `samples` has room for count / every + 1 states.
 * `ranges`, if it is not NULL, has room for as many ranges of the inputs of the first lane,
 * [2][RANGED]: the least, then the greatest at the starts of steps from one sample to the next.
 */
void program_run(
    const void *const *given,
    const real time,
    const real h,
    const int count,
    const int every,
    const int before,
    number *x,
    number *samples,
    real *ranges,
    Progress *progress);

WIDE void program_run(
    const void *const *given,
    const real time,
    const real h,
    const int count,
    const int every,
    const int before,
    number *x,
    number *samples,
    real *ranges,
    Progress *progress)
{
    number now[STATE], next[STATE], inputs[RANGED];
    memcpy(now, x, sizeof now);
    for (int done = 0; done < count; ++done) {
        number refused, ended;
        stand_in(progress, now);
        take_step(given, time + h * (real)done, h, now, next, &ended, inputs, &refused);
        widen(inputs, ranges);
        if (!end(progress, &refused, 1)) {
            return;
        }
        for (int lane = 0; lane < LANES; ++lane) {
            for (int i = 0; i < STATE && progress->going[lane]; ++i) {
                ((real *)x)[i * LANES + lane] = ((const real *)next)[i * LANES + lane];
            }
            progress->taken[lane] += progress->going[lane];
        }
        memcpy(now, next, sizeof now);
        if ((before + done + 1) % every == 0) {
            memcpy(samples, x, sizeof now);
            samples += STATE;
            ranges = ranges ? ranges + 2 * RANGED : ranges;
        }
        if (!end(progress, &ended, 0)) {
            return;
        }
    }
}
