/*
 * A controlled flight, or a block of flights side by side: its time derivative, and fixed steps of
 * Runge and Kutta's classical method, many steps a call.
 *
 * The functions of an emitted C module are given by their addresses, so one compiled loop serves
 * every robot. The state is q, v, the work of the inputs and of the wrenches on frames less what
 * damping takes, the thrusts where the motors lag, and what the law remembers. A quaternion may
 * have any length.
 */

#include <stddef.h>
#include <string.h>

#include "environment.h"
#include "integral.h"
#include "kinematics.h"
#include "lag.h"
#include "laws.h"
#include "loop.h"
#include "plant.h"
#include "ranges.h"
#include "reference.h"

/* Time derivative of a state. `wanted` is the reference at its time; `range`, if it is not NULL, is
 * of the inputs that are commanded, then of those that act. Returns the flights, of those that are
 * `going`, for which Python is to say why there is none. */
static flags derivative(const Loop *f, double time, flags going, const number *wanted,
                        const number *state, number *rate, number *range, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities, memory = memory_of(f);
    number *const q = take(&room, n), *const inputs = take(&room, inputs_of(f));
    Moment now = {time, wanted, q, state + n, state + n + m + 1, state + memory, going, {0}};
    memcpy(q, state, (size_t)n * sizeof *q);
    if (has_quaternion(at)) {
        normalise(at, q);
        rates_of(at, state, q, now.v, rate);
    } else {
        memcpy(rate, now.v, (size_t)n * sizeof *rate);
    }
    now.attitude = attitude_of(at, q);
    flags refused = going & command(f, &now, inputs, room);
    now.going = going & opposite(refused);
    if (any(now.going) && f->actuators.compensates) {
        refused |= now.going & compensate(f, &now, inputs, room);
        now.going = going & opposite(refused);
    }
    if (!any(now.going)) {
        return refused;
    }
    const flags wound = at->memory ? at_limits(f, inputs) : opposite(going | opposite(going));
    widen(inputs_of(f), inputs, range);
    limit(f, inputs);
    actuate(f, now.thrusts, inputs, rate + n + m + 1);
    widen(inputs_of(f), inputs, range ? range + 2 * inputs_of(f) : NULL);
    rate[n + m] = move(f, &now, inputs, rate + n, room);
    remember(f, &now, rate + memory, room);
    keep_from_winding(f, wound, now.memory, rate + memory);
    return refused;
}

/* Add a share of the slopes to `sum`, and go `ahead` along them from a state. */
static void advance(ptrdiff_t size, const number *restrict rate, double share,
                    number *restrict sum, const number *restrict state, double ahead,
                    number *restrict stage)
{
    for (ptrdiff_t i = 0; i < size; ++i) {
        sum[i] += share * rate[i];
        stage[i] = state[i] + ahead * rate[i];
    }
}

/* Which flights can go on: finite, near what is wanted, and away from the singularity. */
static flags go_on(const Loop *f, const number *wanted, const number *state, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities, size = size_of(f);
    number *const q = take(&room, n), *const off = take(&room, 2 * m);
    flags within = are_finite(state[0]);
    for (ptrdiff_t i = 1; i < size; ++i) {
        within &= are_finite(state[i]);
    }
    memcpy(q, state, (size_t)n * sizeof *q);
    if (has_quaternion(at)) {
        normalise(at, q);
    }
    errors_of(at, wanted, q, state + n, off);
    for (ptrdiff_t i = 0; i < 2 * m; ++i) { /* errors, then their rates */
        within &= opposite((flags)(magnitude(off[i]) > f->envelope.bounds[i]));
    }
    if (!has_quaternion(at)) {
        const number lean = magnitude(state[at->middle_angle]);
        within &= (flags)(lean <= f->envelope.largest_theta_0);
    }
    return within;
}

/* One step from the reference `wanted` at its four stages. Flights that are not `going` keep their
 * state. Returns those that are refused, which do too. */
static flags take_step(const Loop *f, double time, double step, flags going,
                       const number *const *wanted, number *state, number *range, Room room)
{
    static const double weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    static const double ahead[4] = {0.5, 0.5, 1.0, 0.0}; /* to where the next slopes are taken */
    const ptrdiff_t size = size_of(f);
    number *const rate = take(&room, size), *const stage = take(&room, size);
    number *const sum = take(&room, size), *const begin = take(&room, size);
    const ptrdiff_t moving = layout_of(f)->coordinates + layout_of(f)->velocities;
    flags refused = {0};
    for (ptrdiff_t i = 0; i < size; ++i) {
        /* Where a flight was lost numbers may be so large that they take long: it rests instead. */
        begin[i] = choose(going, state[i], i < moving ? wanted[0][i] : (number){0});
    }
    memcpy(sum, begin, (size_t)size * sizeof *sum);
    for (int k = 0; k < 4; ++k) {
        const double at = time + step * 0.5 * (double)((k + 1) / 2);
        const number *const from = k > 0 ? stage : begin;
        const flags left = going & opposite(refused);
        refused |= derivative(f, at, left, wanted[k], from, rate, k > 0 ? NULL : range, room);
        if (!any(going & opposite(refused))) {
            return refused;
        }
        advance(size, rate, step * weight[k], sum, begin, step * ahead[k], stage);
    }
    for (ptrdiff_t i = 0; i < size; ++i) {
        state[i] = choose(going & opposite(refused), sum[i], state[i]);
    }
    return refused;
}

/* How many numbers `scratch` must hold; it is not looked at itself. */
ptrdiff_t gibbs_codegen_loop_room(const Loop *loop);

ptrdiff_t gibbs_codegen_loop_room(const Loop *loop)
{
    const ptrdiff_t n = layout_of(loop)->coordinates;
    const ptrdiff_t law = room_of_command(loop, room_of_law(loop)), plant = room_of_plant(loop);
    const ptrdiff_t stage = n + inputs_of(loop) + (law > plant ? law : plant);
    return 4 * size_of(loop) + 3 * (3 * n) + stage;
}

/* The time derivative of states at a time. `going` tells for which it is wanted, and becomes those
 * for which there is one. */
void gibbs_codegen_rate(const Loop *loop, double time, flags *going, const number *state,
                        number *rate);

void gibbs_codegen_rate(const Loop *loop, double time, flags *going, const number *state,
                        number *rate)
{
    Room room = {loop->scratch};
    number *const wanted = take(&room, 3 * layout_of(loop)->coordinates);
    reference(loop, time, wanted);
    *going &= opposite(derivative(loop, time, *going, wanted, state, rate, NULL, room));
}

/* Which flights there are, and how they end. */
typedef struct {
    flags going;               /* those that are flown, and then those that have not ended */
    flags refused;             /* those that Python is to say more about */
    ptrdiff_t taken[LANES];    /* steps */
} Progress;

/* End flights after a number of steps. */
static INLINE void end(Progress *progress, flags which, ptrdiff_t steps)
{
    which &= progress->going;
    for (int lane = 0; any(which) && lane < LANES; ++lane) {
        progress->taken[lane] = flag(which, lane) ? steps : progress->taken[lane];
    }
    progress->going &= opposite(which);
}

/*
 * Take up to `count` steps of `step` from `state` at `time`; every `every`-th step, counted from
 * `before`, is a sample. `state` is then the last one, and `samples` has room for count / every + 1
 * states. `ranges`, if it is not NULL, has room for one more ranges of inputs, [2][2][inputs]:
 * of those commanded and those that act, the least and the greatest at the starts of the steps from
 * one sample to the next. A flight ends before a step that is refused, and after one from which it
 * cannot go on; samples of those that have ended repeat their last state, while others go on.
 */
void gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                       ptrdiff_t every, ptrdiff_t before, number *state, number *samples,
                       number *ranges, Progress *progress);

void gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                       ptrdiff_t every, ptrdiff_t before, number *state, number *samples,
                       number *ranges, Progress *progress)
{
    const Loop f = *loop;
    const ptrdiff_t n = layout_of(&f)->coordinates, size = size_of(&f);
    Room room = {f.scratch};
    number *const middle = take(&room, 3 * n);
    number *now = take(&room, 3 * n), *then = take(&room, 3 * n);
    ptrdiff_t kept = 0; /* samples */
    for (int lane = 0; lane < LANES; ++lane) {
        progress->taken[lane] = flag(progress->going, lane) ? count : 0;
    }
    reference(&f, time, now);
    for (ptrdiff_t done = 0; done < count; ++done) {
        const number *const wanted[4] = {now, middle, middle, then};
        const double begin = time + step * (double)done;
        number *const range = ranges ? ranges + 4 * inputs_of(&f) * kept : NULL;
        reference(&f, begin + 0.5 * step, middle);
        reference(&f, begin + step, then);
        const flags going = progress->going;
        const flags refused = take_step(&f, begin, step, going, wanted, state, range, room);
        progress->refused |= refused;
        end(progress, refused, done);
        if (!any(progress->going)) {
            return;
        }
        if ((before + done + 1) % every == 0) {
            memcpy(samples, state, (size_t)size * sizeof *samples);
            samples += size;
            ++kept;
        }
        number *const swap = now;
        now = then;
        then = swap;
        end(progress, opposite(go_on(&f, now, state, room)), done + 1);
        if (!any(progress->going)) {
            return;
        }
    }
}
