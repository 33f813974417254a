/* The robot that flies: what motors make of commands, and how it moves. */

#ifndef GIBBS_CODEGEN_PLANT_H
#define GIBBS_CODEGEN_PLANT_H

#include <stddef.h>

#include "loop.h"
#include "vectors.h"

/* Power of inputs: thrusts act on attitude and position (the thrusts of rotors that joints move are
 * 0 here), joint torques on their own joints. */
static double power(const Loop *f, const double *matrix, const double *inputs, const double *v)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t joints = at->velocities - BASE, width = inputs_of(f);
    const double *attitude = matrix + at->attitude * width;
    const double *position = matrix + at->position * width;
    double sum = 0.0;
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        double speed = 0.0;
        for (int i = 0; i < 3; ++i) {
            speed += attitude[i * width + k] * v[at->attitude + i] +
                     position[i * width + k] * v[at->position + i];
        }
        sum += speed * inputs[k];
    }
    for (ptrdiff_t k = 0; k < joints; ++k) {
        sum += v[at->joints + k] * inputs[at->rotors + k];
    }
    return sum;
}

/* Power that the damping of the robot itself takes. */
static double losses(const Loop *f, const double *v)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < f->layout.velocities; ++i) {
        sum += f->surroundings.losses[i] * v[i] * v[i];
    }
    return sum;
}

static int within_limits(const Loop *f, ptrdiff_t count, const double *inputs)
{
    for (ptrdiff_t k = 0; k < count; ++k) {
        if (!(inputs[k] >= f->actuators.least[k] && inputs[k] <= f->actuators.most[k])) {
            return 0;
        }
    }
    return 1;
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
static double move(const Loop *f, const Moment *now, const double *matrix, const double *inputs,
                   double *acceleration, Room room)
{
    const Functions *const of = &f->functions;
    const double *const q = now->q, *const v = now->v, *const pushed = f->surroundings.wrenches;
    const ptrdiff_t m = f->layout.velocities;
    const double given = power(f, matrix, inputs, v) - losses(f, v);
    if (!pushed) {
        of->forward_dynamics(f->plant, q, v, inputs, acceleration);
        return given;
    }
    double *const force = take(&room, m);
    of->forward_dynamics_with_wrenches(f->plant, q, v, inputs, pushed, acceleration);
    of->wrench_forces(f->plant, q, pushed, force);
    return given + dot(m, force, v);
}

#endif
