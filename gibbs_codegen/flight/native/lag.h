/* Motor lag, compensated, as `control/laws.py` has it. */

#ifndef GIBBS_CODEGEN_LAG_H
#define GIBBS_CODEGEN_LAG_H

#include <string.h>

#include "laws.h"
#include "loop.h"
#include "plant.h"
#include "reference.h"

/* Time, s, over which thrusts are differenced. */
#define AHEAD 1e-7

/* How fast coordinates, velocities and memory change as the law knows the robot, under its inputs
 * within limits and the thrusts of the motors. */
static void moving(const Loop *f, const Moment *now, const number *inputs, number *rate, Room room)
{
    const Layout *const at = layout_of(f);
    number *const acting = take(&room, inputs_of(f));
    memcpy(acting, inputs, (size_t)inputs_of(f) * sizeof *acting);
    limit(f, acting);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        const flags lags = (flags)(f->actuators.lag[k] > 0.0);
        acting[k] = choose(lags, now->thrusts[k], acting[k]);
    }
    if (has_quaternion(at)) {
        rates_of(at, now->q, now->q, now->v, rate);
    } else {
        memcpy(rate, now->v, (size_t)at->coordinates * sizeof *rate);
    }
    rate += at->coordinates;
    f->functions.forward_dynamics(OF(f->model), now->q, now->v, acting, rate);
    remember(f, now, rate + at->velocities, room);
}

/* Inputs that the law wants some time ahead, for which the motion goes on at a rate.
 * Returns what is refused. */
static flags want(const Loop *f, const Moment *now, const number *rate, double ahead,
                  number *inputs, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    number *const q = take(&room, n), *const v = take(&room, m);
    number *const memory = take(&room, at->memory), *const wanted = take(&room, 3 * n);
    for (ptrdiff_t i = 0; i < n; ++i) {
        q[i] = now->q[i] + ahead * rate[i];
    }
    for (ptrdiff_t i = 0; i < m; ++i) {
        v[i] = now->v[i] + ahead * rate[n + i];
    }
    for (ptrdiff_t i = 0; i < at->memory; ++i) {
        memory[i] = now->memory[i] + ahead * rate[n + m + i];
    }
    if (has_quaternion(at)) {
        normalise(at, q);
    }
    reference(f, now->time + ahead, wanted);
    const Moment then = {now->time + ahead, wanted, q, v, now->thrusts, memory,
                         now->going, attitude_of(at, q)};
    return command(f, &then, inputs, room);
}

/* Add what makes up for the lag of the motors to the inputs that the law wants, unless they are
 * held. Returns where the law refuses those that it wants next. */
static flags compensate(const Loop *f, const Moment *now, number *inputs, Room room)
{
    const Desired *const path = &f->desired;
    const Layout *const at = layout_of(f);
    const double last = path->begin + (double)path->pieces * path->piece - AHEAD;
    const double ahead = now->time > last ? -AHEAD : AHEAD;
    number *const rate = take(&room, at->coordinates + at->velocities + at->memory);
    number *const later = take(&room, inputs_of(f));
    flags refused = {0};
    if (f->law == HELD) {
        return refused;
    }
    moving(f, now, inputs, rate, room);
    refused = want(f, now, rate, ahead, later, room);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        inputs[k] += f->actuators.lag[k] * ((later[k] - inputs[k]) / ahead);
    }
    return refused;
}

/* Room that a command takes, of which the law itself takes `law`. */
static ptrdiff_t room_of_command(const Loop *f, ptrdiff_t law)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t motion = at->coordinates + at->velocities + at->memory;
    return f->actuators.compensates ? 2 * motion + inputs_of(f) + 3 * at->coordinates + law : law;
}

#endif
