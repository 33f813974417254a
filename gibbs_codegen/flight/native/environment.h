/* What acts on the robot besides its inputs, as wrenches on its frames, as `plant/environment.py`
 * has them: [frames][6], force and torque in world axes. */

#ifndef GIBBS_CODEGEN_ENVIRONMENT_H
#define GIBBS_CODEGEN_ENVIRONMENT_H

#include <math.h>

#include "loop.h"
#include "vectors.h"

/* Drag of frames that have velocities, in the wind of a time. */
static void drag(const Environment *e, double time, const number *velocities, number *wrenches)
{
    const double turn_of_circle = 6.283185307179586;
    double wind[6] = {e->wind[0], e->wind[1], e->wind[2]};
    for (const double *gust = e->gust; gust < e->gust + 5 * e->gusts; gust += 5) {
        const double share = fmin(fmax((time - gust[0]) / gust[1], 0.0), 1.0);
        for (int i = 0; i < 3; ++i) {
            wind[i] += (1.0 - cos(turn_of_circle * share)) * gust[2 + i];
        }
    }
    for (ptrdiff_t i = 0; i < 6 * e->frames; ++i) {
        wrenches[i] -= e->coefficients[i] * (velocities[i] - wind[i % 6]);
    }
}

/* Forces of walls on frames that lean on them. */
static void lean(const Environment *e, const number *poses, const number *velocities,
                 number *wrenches)
{
    for (const double *wall = e->wall; wall < e->wall + 9 * e->walls; wall += 9) {
        const ptrdiff_t frame = (ptrdiff_t)wall[0];
        const double *const point = wall + 1, *const normal = wall + 4;
        number depth = {0.0}, speed = {0.0};
        for (int i = 0; i < 3; ++i) {
            depth += normal[i] * (point[i] - poses[16 * frame + 4 * i + 3]);
            speed -= normal[i] * velocities[6 * frame + i];
        }
        const number pressed = largest(wall[7] * depth + wall[8] * speed, same(0.0));
        const number force = choose((flags)(depth > 0.0), pressed, same(0.0));
        for (int i = 0; i < 3; ++i) {
            wrenches[6 * frame + i] += force * normal[i];
        }
    }
}

/* Gyroscopic torques of spinning rotors. */
static void resist(const Environment *e, const number *poses, const number *velocities,
                   const number *inputs, number *wrenches)
{
    for (const double *spin = e->spin; spin < e->spin + 6 * e->spins; spin += 6) {
        const ptrdiff_t frame = (ptrdiff_t)spin[1];
        const number thrust = inputs[(ptrdiff_t)spin[0]];
        const number momentum = spin[5] * signed_as(root(magnitude(thrust)), thrust);
        number held[3], torque[3];
        for (int i = 0; i < 3; ++i) {
            const number *const row = poses + 16 * frame + 4 * i;
            held[i] = momentum * (row[0] * spin[2] + row[1] * spin[3] + row[2] * spin[4]);
        }
        cross(held, velocities + 6 * frame + 3, torque);
        for (int i = 0; i < 3; ++i) {
            wrenches[6 * frame + 3 + i] += torque[i];
        }
    }
}

/*
 * Forces of payloads, which depend on the acceleration under all the others: (1/m + J M^-1 J^T) f =
 * g - c - J a. The columns of M^-1 J^T are differences of accelerations by unit forces.
 */
static void carry(const Loop *f, const Moment *now, const number *inputs, number *wrenches,
                  Room room)
{
    const Environment *const e = &f->environment;
    const Functions *const of = &f->functions;
    const ptrdiff_t m = layout_of(f)->velocities, count = 3 * e->payloads;
    number *const free = take(&room, m), *const moved = take(&room, m);
    number *const jacobians = take(&room, 6 * m * e->frames);
    number *const drift = take(&room, 6 * e->frames);
    number *const matrix = take(&room, count * count), *const force = take(&room, count);
    of->forward_dynamics_with_wrenches(OF(f->plant), now->q, now->v, inputs, wrenches, free);
    of->frame_jacobians(OF(f->plant), now->q, jacobians);
    of->frame_bias_accelerations(OF(f->plant), now->q, now->v, drift);
    for (ptrdiff_t k = 0; k < count; ++k) {
        const ptrdiff_t entry = 6 * (ptrdiff_t)e->payload[2 * (k / 3)] + k % 3;
        const number before = wrenches[entry];
        wrenches[entry] += 1.0;
        of->forward_dynamics_with_wrenches(OF(f->plant), now->q, now->v, inputs, wrenches, moved);
        wrenches[entry] = before;
        for (ptrdiff_t i = 0; i < m; ++i) {
            moved[i] -= free[i];
        }
        for (ptrdiff_t i = 0; i < count; ++i) {
            const ptrdiff_t row = 6 * (ptrdiff_t)e->payload[2 * (i / 3)] + i % 3;
            matrix[count * i + k] = dot(m, jacobians + m * row, moved);
        }
        matrix[count * k + k] += 1.0 / e->payload[2 * (k / 3) + 1];
        force[k] = -drift[entry];
        if (k % 3 == 2) {
            force[k] += *e->gravity;
        }
        force[k] -= dot(m, jacobians + m * entry, free);
    }
    solve_positive(count, matrix, force);
    for (ptrdiff_t k = 0; k < count; ++k) {
        wrenches[6 * (ptrdiff_t)e->payload[2 * (k / 3)] + k % 3] += force[k];
    }
}

/* All wrenches on the frames, under inputs that act. */
static void surround(const Loop *f, const Moment *now, const number *inputs, number *wrenches,
                     Room room)
{
    const Environment *const e = &f->environment;
    number *const poses = take(&room, 16 * e->frames);
    number *const velocities = take(&room, 6 * e->frames);
    for (ptrdiff_t i = 0; i < 6 * e->frames; ++i) {
        wrenches[i] = same(e->push[i]);
    }
    if (e->coefficients || e->walls || e->spins) {
        f->functions.frame_velocities(OF(f->plant), now->q, now->v, velocities);
    }
    if (e->coefficients) {
        drag(e, now->time, velocities, wrenches);
    }
    if (e->walls || e->spins) {
        f->functions.frame_poses(OF(f->plant), now->q, poses);
        lean(e, poses, velocities, wrenches);
        resist(e, poses, velocities, inputs, wrenches);
    }
    if (e->payloads) {
        carry(f, now, inputs, wrenches, room);
    }
}

/* How many numbers `surround` takes, with room for the wrenches. */
static ptrdiff_t room_of_environment(const Loop *f)
{
    const Environment *const e = &f->environment;
    const ptrdiff_t m = layout_of(f)->velocities, count = 3 * e->payloads;
    const ptrdiff_t carried = 2 * m + (6 * m + 6) * e->frames + count * count + count;
    return (6 + 16 + 6) * e->frames + (count ? carried : 0);
}

#endif
