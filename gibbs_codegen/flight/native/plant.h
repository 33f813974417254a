/* The robot that flies: what motors make of commands, and how it moves. */

#ifndef GIBBS_CODEGEN_PLANT_H
#define GIBBS_CODEGEN_PLANT_H

#include "environment.h"
#include "kinematics.h"
#include "loop.h"
#include "vectors.h"

/* Power of inputs. Where no joint moves the rotors, thrusts act on the base alone. */
static number power(const Loop *f, const Moment *now, const number *inputs, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t joints = at->velocities - BASE, width = inputs_of(f);
    number sum = {0.0}, twist[BASE];
    if (f->plant_rotors.move) {
        number *const matrix = take(&room, at->velocities * width);
        f->functions.input_matrix(OF(f->plant), now->q, matrix);
        for (ptrdiff_t i = 0; i < at->velocities; ++i) {
            sum += now->v[i] * dot(width, matrix + i * width, inputs);
        }
        return sum;
    }
    twist_of(at, &now->attitude, f->plant_rotors.centre, now->v, twist);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        sum += inputs[k] * dot(BASE, f->plant_rotors.wrenches + k * BASE, twist);
    }
    return sum + dot(joints, now->v + at->joints, inputs + at->rotors);
}

/* Power that the damping of the robot itself takes. */
static INLINE number losses(const Loop *f, const number *v)
{
    number sum = {0.0};
    for (ptrdiff_t i = 0; i < layout_of(f)->velocities; ++i) {
        sum += f->losses[i] * v[i] * v[i];
    }
    return sum;
}

/* Bring inputs within their limits. */
static void limit(const Loop *f, number *inputs)
{
    const number *const least = f->actuators.least, *const most = f->actuators.most;
    for (ptrdiff_t k = 0; f->actuators.limited && k < inputs_of(f); ++k) {
        const number within = choose((flags)(inputs[k] > most[k]), most[k], inputs[k]);
        inputs[k] = choose((flags)(inputs[k] < least[k]), least[k], within);
    }
}

/* Make inputs that act of those commanded, and of what motors aim for the rates of thrusts. */
static void actuate(const Loop *f, const number *thrusts, number *inputs, number *rate)
{
    for (ptrdiff_t k = 0; f->actuators.lags && k < layout_of(f)->rotors; ++k) {
        const flags lags = (flags)(f->actuators.lag[k] > 0.0);
        rate[k] = choose(lags, f->actuators.pace[k] * (inputs[k] - thrusts[k]), same(0.0));
        inputs[k] = choose(lags, thrusts[k], inputs[k]);
    }
}

/* Accelerations under inputs that act. Returns the power of all that acts. */
static number move(const Loop *f, const Moment *now, const number *inputs, number *acceleration,
                   Room room)
{
    const Functions *const of = &f->functions;
    const number *const q = now->q, *const v = now->v;
    const ptrdiff_t m = layout_of(f)->velocities;
    const number given = power(f, now, inputs, room) - losses(f, v);
    if (!f->environment.frames) {
        of->forward_dynamics(OF(f->plant), q, v, inputs, acceleration);
        return given;
    }
    number *const force = take(&room, m), *const wrenches = take(&room, 6 * f->environment.frames);
    surround(f, now, inputs, wrenches, room);
    of->forward_dynamics_with_wrenches(OF(f->plant), q, v, inputs, wrenches, acceleration);
    of->wrench_forces(OF(f->plant), q, wrenches, force);
    return given + dot(m, force, v);
}

/* Room that `move` takes. */
static ptrdiff_t room_of_plant(const Loop *f)
{
    const ptrdiff_t m = layout_of(f)->velocities;
    const ptrdiff_t power = f->plant_rotors.move ? m * inputs_of(f) : 0;
    const ptrdiff_t around = f->environment.frames ? m + room_of_environment(f) : 0;
    return power > around ? power : around;
}

#endif
