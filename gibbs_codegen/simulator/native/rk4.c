/*
 * A controlled flight: its time derivative, and fixed steps of Runge and Kutta's classical method,
 * many steps a call.
 *
 * The functions of an emitted C module are given by their addresses, so one compiled loop serves
 * every robot. The state is q, v, the work of the inputs and of the wrenches on frames less what
 * damping takes, the thrusts where the motors lag, and what the law remembers. A quaternion may
 * have any length.
 */

#include <math.h>
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
 * of the inputs that are commanded, then of those that act. REFUSED, without a rate, where Python is
 * to say why there is none. */
static int derivative(const Loop *f, double time, const double *wanted, const double *state,
                      double *rate, double *range, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t n = at->coordinates, m = at->velocities, memory = memory_of(f);
    double *const q = take(&room, n), *const inputs = take(&room, inputs_of(f));
    Moment now = {time, wanted, q, state + n, state + n + m + 1, state + memory, {0}};
    memcpy(q, state, (size_t)n * sizeof *q);
    if (has_quaternion(at)) {
        normalise(at, q);
        rates_of(at, state, q, now.v, rate);
    } else {
        memcpy(rate, now.v, (size_t)n * sizeof *rate);
    }
    now.attitude = attitude_of(at, q);
    if (command(f, &now, inputs, room) == REFUSED) {
        return REFUSED;
    }
    if (f->actuators.compensates && compensate(f, &now, inputs, room) == REFUSED) {
        return REFUSED;
    }
    const int wound = at->memory && at_limits(f, inputs);
    widen(inputs_of(f), inputs, range);
    limit(f, inputs);
    actuate(f, now.thrusts, inputs, rate + n + m + 1);
    widen(inputs_of(f), inputs, range ? range + 2 * inputs_of(f) : NULL);
    rate[n + m] = move(f, &now, inputs, rate + n, room);
    remember(f, &now, rate + memory, room);
    if (wound) {
        keep_from_winding(f, now.memory, rate + memory);
    }
    return DONE;
}

/* Add a share of the slopes to `sum`, and go `ahead` along them from a state. */
static void advance(ptrdiff_t size, const double *restrict rate, double share, double *restrict sum,
                    const double *restrict state, double ahead, double *restrict stage)
{
    for (ptrdiff_t i = 0; i < size; ++i) {
        sum[i] += share * rate[i];
        stage[i] = state[i] + ahead * rate[i];
    }
}

/* Whether a flight can go on: finite, near what is wanted, and away from the singularity. */
static int goes_on(const Loop *f, const double *wanted, const double *state, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t n = at->coordinates, m = at->velocities, size = size_of(f);
    double *const q = take(&room, n), *const off = take(&room, 2 * m);
    for (ptrdiff_t i = 0; i < size; ++i) {
        if (!isfinite(state[i])) {
            return 0;
        }
    }
    memcpy(q, state, (size_t)n * sizeof *q);
    if (has_quaternion(at)) {
        normalise(at, q);
    }
    errors_of(at, wanted, q, state + n, off);
    for (ptrdiff_t i = 0; i < 2 * m; ++i) { /* errors, then their rates */
        if (fabs(off[i]) > f->envelope.bounds[i]) {
            return 0;
        }
    }
    return has_quaternion(at) || fabs(state[at->middle_angle]) <= f->envelope.largest_theta_0;
}

/* How many numbers `scratch` must hold; it is not looked at itself. */
ptrdiff_t gibbs_codegen_loop_room(const Loop *loop);

ptrdiff_t gibbs_codegen_loop_room(const Loop *loop)
{
    const ptrdiff_t n = loop->layout.coordinates;
    const ptrdiff_t law = room_of_command(loop, room_of_law(loop)), plant = room_of_plant(loop);
    const ptrdiff_t stage = n + inputs_of(loop) + (law > plant ? law : plant);
    return loop->layout.rotors + 3 * size_of(loop) + 3 * (3 * n) + stage;
}

/* The time derivative of a state at a time. 0, or REFUSED. */
int gibbs_codegen_rate(const Loop *loop, double time, const double *state, double *rate);

int gibbs_codegen_rate(const Loop *loop, double time, const double *state, double *rate)
{
    Room room = {loop->scratch + loop->layout.rotors};
    double *const wanted = take(&room, 3 * loop->layout.coordinates);
    reference(loop, time, wanted);
    return derivative(loop, time, wanted, state, rate, NULL, room);
}

/*
 * Take up to `count` steps of `step` from `state` at `time`; every `every`-th step, counted from
 * `number`, is a sample. Returns the steps taken; `state` is the last one, and `samples` has room
 * for count / every + 1 states. `ranges`, if it is not NULL, has room for one more ranges of inputs,
 * [2][2][inputs]: of those commanded and those that act, the least and the greatest at the begins of
 * the steps from one sample to the next. Ends before a step that is refused, and after one from
 * which the flight cannot go on.
 */
ptrdiff_t gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples,
                            double *ranges);

ptrdiff_t gibbs_codegen_rk4(const Loop *loop, double time, double step, ptrdiff_t count,
                            ptrdiff_t every, ptrdiff_t number, double *state, double *samples,
                            double *ranges)
{
    static const double weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    static const double ahead[4] = {0.5, 0.5, 1.0, 0.0}; /* to where the next slopes are taken */
    const Loop f = *loop;
    const ptrdiff_t n = f.layout.coordinates, size = size_of(&f);
    Room room = {f.scratch + f.layout.rotors}; /* before it, guesses at limits */
    double *const rate = take(&room, size), *const stage = take(&room, size);
    double *const sum = take(&room, size), *const middle = take(&room, 3 * n);
    double *now = take(&room, 3 * n), *then = take(&room, 3 * n);
    ptrdiff_t kept = 0; /* samples */
    reference(&f, time, now);
    for (ptrdiff_t done = 0; done < count; ++done) {
        const double *const wanted[4] = {now, middle, middle, then};
        double times[4];
        for (int k = 0; k < 4; ++k) {
            times[k] = time + step * ((double)done + 0.5 * (double)((k + 1) / 2));
        }
        reference(&f, times[1], middle);
        reference(&f, times[3], then);
        memcpy(sum, state, (size_t)size * sizeof *sum);
        for (int k = 0; k < 4; ++k) {
            const double *const from = k > 0 ? stage : state;
            double *const range = ranges && k == 0 ? ranges + 4 * inputs_of(&f) * kept : NULL;
            if (derivative(&f, times[k], wanted[k], from, rate, range, room) == REFUSED) {
                return done;
            }
            advance(size, rate, step * weight[k], sum, state, step * ahead[k], stage);
        }
        memcpy(state, sum, (size_t)size * sizeof *state);
        if ((number + done + 1) % every == 0) {
            memcpy(samples, state, (size_t)size * sizeof *samples);
            samples += size;
            ++kept;
        }
        double *const swap = now;
        now = then;
        then = swap;
        if (!goes_on(&f, now, state, room)) {
            return done + 1;
        }
    }
    return count;
}
