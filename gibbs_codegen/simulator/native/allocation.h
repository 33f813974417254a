/* The inputs of a generalised force. */

#ifndef GIBBS_CODEGEN_ALLOCATION_H
#define GIBBS_CODEGEN_ALLOCATION_H

#include <string.h>

#include "loop.h"
#include "vectors.h"

/*
 * Inputs of a generalised force: the joints' own entries, and thrusts for the rest. `distribution`
 * tells the thrusts of a force and a torque on the base; which force and torque it takes is told by
 * what such thrusts do to position and attitude. Position is moved by the force alone, so that is
 * found first, and the torque then makes what the force leaves of the attitude's entries.
 */
static void allocate(const Loop *f, const double *matrix, const double *wanted, double *inputs)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t joints = at->velocities - BASE, width = inputs_of(f);
    const double *attitude = matrix + at->attitude * width;
    const double *position = matrix + at->position * width;
    double pushed[9] = {0.0}, turned[9] = {0.0}, force[3], torque[3];
    double left[3];
    memcpy(left, wanted + at->attitude, sizeof left);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        const double *share = f->sharing.distribution + k * BASE;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) {
                pushed[3 * i + j] += position[i * width + k] * share[j];
                turned[3 * i + j] += attitude[i * width + k] * share[3 + j];
            }
        }
    }
    solve(pushed, wanted + at->position, force);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        const double *share = f->sharing.distribution + k * BASE;
        inputs[k] = share[0] * force[0] + share[1] * force[1] + share[2] * force[2];
        for (int i = 0; i < 3; ++i) {
            left[i] -= attitude[i * width + k] * inputs[k];
        }
    }
    solve(turned, left, torque);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        const double *share = f->sharing.distribution + k * BASE + 3;
        inputs[k] += share[0] * torque[0] + share[1] * torque[1] + share[2] * torque[2];
    }
    memcpy(inputs + at->rotors, wanted + at->joints, (size_t)joints * sizeof *inputs);
}

#endif
