/* The robot that flies: what motors make of commands, and how it moves. */

#ifndef GIBBS_CODEGEN_PLANT_H
#define GIBBS_CODEGEN_PLANT_H

#include <stddef.h>

#include "environment.h"
#include "kinematics.h"
#include "loop.h"
#include "vectors.h"

/* Power of inputs. Where no joint moves the rotors, thrusts act on the base alone. */
static double power(const Loop *f, const Moment *now, const double *inputs, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t joints = at->velocities - BASE, width = inputs_of(f);
    double sum = 0.0, twist[BASE];
    if (f->flown.move) {
        double *const matrix = take(&room, at->velocities * width);
        f->functions.input_matrix(f->plant, now->q, matrix);
        for (ptrdiff_t i = 0; i < at->velocities; ++i) {
            sum += now->v[i] * dot(width, matrix + i * width, inputs);
        }
        return sum;
    }
    twist_of(at, &now->attitude, f->flown.centre, now->v, twist);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        sum += inputs[k] * dot(BASE, f->flown.wrenches + k * BASE, twist);
    }
    return sum + dot(joints, now->v + at->joints, inputs + at->rotors);
}

/* Power that the damping of the robot itself takes. */
static double losses(const Loop *f, const double *v)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < f->layout.velocities; ++i) {
        sum += f->losses[i] * v[i] * v[i];
    }
    return sum;
}

/* Bring inputs within their limits. */
static void limit(const Loop *f, double *inputs)
{
    const double *const least = f->actuators.least, *const most = f->actuators.most;
    for (ptrdiff_t k = 0; f->actuators.limited && k < inputs_of(f); ++k) {
        inputs[k] = inputs[k] < least[k] ? least[k] : inputs[k] > most[k] ? most[k] : inputs[k];
    }
}

/* Make inputs that act of those commanded, and of what motors aim for the rates of their thrusts. */
static void actuate(const Loop *f, const double *thrusts, double *inputs, double *rate)
{
    for (ptrdiff_t k = 0; f->actuators.lags && k < f->layout.rotors; ++k) {
        rate[k] = 0.0;
        if (f->actuators.lag[k] > 0.0) {
            rate[k] = (inputs[k] - thrusts[k]) / f->actuators.lag[k];
            inputs[k] = thrusts[k];
        }
    }
}

/* Accelerations under inputs that act. Returns the power of all that acts. */
static double move(const Loop *f, const Moment *now, const double *inputs, double *acceleration,
                   Room room)
{
    const Functions *const of = &f->functions;
    const double *const q = now->q, *const v = now->v;
    const ptrdiff_t m = f->layout.velocities;
    const double given = power(f, now, inputs, room) - losses(f, v);
    if (!f->environment.frames) {
        of->forward_dynamics(f->plant, q, v, inputs, acceleration);
        return given;
    }
    double *const force = take(&room, m), *const wrenches = take(&room, 6 * f->environment.frames);
    surround(f, now, inputs, wrenches, room);
    of->forward_dynamics_with_wrenches(f->plant, q, v, inputs, wrenches, acceleration);
    of->wrench_forces(f->plant, q, wrenches, force);
    return given + dot(m, force, v);
}

/* Room that `move` takes. */
static ptrdiff_t room_of_plant(const Loop *f)
{
    const ptrdiff_t m = f->layout.velocities;
    const ptrdiff_t power = f->flown.move ? m * inputs_of(f) : 0;
    const ptrdiff_t around = f->environment.frames ? m + room_of_environment(f) : 0;
    return power > around ? power : around;
}

#endif
