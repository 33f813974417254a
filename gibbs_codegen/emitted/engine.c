/*
 * Steps of a program, many in one call, for one state or a block of states.
 *
 * The text before defines `take_step` and includes `ranges.c`. `runtime/program_steps.py`,
 * `fixed.c` and `rollout.c` call `program_run`. `given` holds addresses: of the constants, of the
 * context of functions written by hand, and of the program's other inputs, a `number` or `real` for
 * each entry. A state ends before a step that is refused, and after one from which it cannot
 * continue; it then stays as it is, and the others continue.
 */
typedef struct {
    int going[LANES];   /* whether the lane is used and has not ended */
    int refused[LANES]; /* whether it ended before a step */
    int taken[LANES];   /* steps */
} Progress;

/* Copy states. A running state also fills the lanes of ended ones, since these cost the same.
 * Returns whether any state runs. */
static INLINE int stand_in(const Progress *progress, const number *x, number *now)
{
    int one = 0;
    while (one < LANES && !progress->going[one]) {
        ++one;
    }
    for (int lane = 0; one < LANES && lane < LANES; ++lane) {
        const int from = progress->going[lane] ? lane : one;
        for (int i = 0; i < STATE; ++i) {
            ((real *)now)[i * LANES + lane] = ((const real *)x)[i * LANES + from];
        }
    }
    return one < LANES;
}

/* Whether a step is accepted and ends no state; NaN is false. */
static INLINE int all_go_on(const number *refused, const number *ended)
{
    bits ends = 0;
    VECTORISE
    for (int lane = 0; lane < LANES; ++lane) {
        ends |= (bits)!(((const real *)refused)[lane] <= R(0.0));
        ends |= (bits)!(((const real *)ended)[lane] <= R(0.0));
    }
    return ends == 0;
}

/* End states whose value is positive or NaN. */
static INLINE void end(Progress *progress, const number *value, const int refuses)
{
    for (int lane = 0; lane < LANES; ++lane) {
        const int ends = progress->going[lane] & !(((const real *)value)[lane] <= R(0.0));
        progress->going[lane] &= !ends;
        progress->refused[lane] |= refuses & ends;
    }
}

/* Take over the next states of running lanes. */
static INLINE void go_on(Progress *progress, const number *next, number *x)
{
    for (int lane = 0; lane < LANES; ++lane) {
        progress->taken[lane] += progress->going[lane];
        for (int i = 0; i < STATE && progress->going[lane]; ++i) {
            ((real *)x)[i * LANES + lane] = ((const real *)next)[i * LANES + lane];
        }
    }
}

/*
 * Take up to `count` steps of `h` from `x` at `time`; every `every`-th step, counted from `before`,
 * is a sample. `x` is then the last state, and `samples` has room for count / every + 1 states.
 * `ranges`, if it is not NULL, has room for one range more. A range [2][RANGED] holds the least and
 * the greatest inputs of the first lane, at the starts of steps between two samples.
 */
#ifdef LOCAL
static
#else
void program_run(
    const void *const *given,
    const double time,
    const double h,
    const int count,
    const int every,
    const int before,
    number *x,
    number *samples,
    real *ranges,
    Progress *progress);

#endif
WIDE void program_run(
    const void *const *given,
    const double time,
    const double h,
    const int count,
    const int every,
    const int before,
    number *x,
    number *samples,
    real *ranges,
    Progress *progress)
{
    number now[STATE], room[STATE], inputs[RANGED + 1], refused, ended;
    number *from = x, *to = room;
    int left = every - before % every, whole = 1, taken = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        whole &= progress->going[lane];
    }
    for (int done = 0; done < count && (whole || stand_in(progress, from, now)); ++done) {
        const real at = (real)(time + h * done);
        take_step(given, at, (real)h, whole ? from : now, to, &ended, inputs, &refused);
        whole = whole && all_go_on(&refused, &ended);
        if (!whole) {
            end(progress, &refused, 1);
        }
        if (progress->going[0]) {
            widen(inputs, ranges);
        }
        if (whole) {
            number *const next = to;
            to = from;
            from = next;
            ++taken;
        } else {
            go_on(progress, to, from);
            end(progress, &ended, 0);
        }
        if (--left == 0) {
            memcpy(samples, from, STATE * sizeof *samples);
            samples += STATE;
            ranges = ranges ? ranges + 2 * RANGED : ranges;
            left = every;
        }
    }
    for (int lane = 0; lane < LANES; ++lane) {
        progress->taken[lane] += taken;
    }
    if (from != x) {
        memcpy(x, from, STATE * sizeof *x);
    }
}
