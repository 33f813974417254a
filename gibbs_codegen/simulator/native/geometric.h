/*
 * The geometric law for a base with a quaternion whose rotors push along one axis, as
 * `control/geometric.py` has it and explains it.
 */

#ifndef GIBBS_CODEGEN_GEOMETRIC_H
#define GIBBS_CODEGEN_GEOMETRIC_H

#include <math.h>
#include <string.h>

#include "allocation.h"
#include "loop.h"
#include "reference.h"
#include "vectors.h"

/* As in `control/geometric.py`. */
static const double AUTHORITY = 0.8, LEAST = 1e-9;

/* Force that the centre of mass needs, and the rate of its part that corrects errors; world axes.
 * `thrust` is what the force has along the thrust axis, never less than 0. */
typedef struct {
    double force[3];
    double correction[3];
    double rate[3];
    double thrust;
} Need;

/* The thrust axis in the base's frame, along what equal thrusts of all rotors make. */
static void axis_of(const Loop *f, const double *q, double *axis, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t width = inputs_of(f);
    double *const matrix = take(&room, f->known.move ? at->velocities * width : 0);
    double sum[3] = {0.0, 0.0, 0.0}, most = 0.0;
    memset(axis, 0, 3 * sizeof *axis);
    if (f->known.move) {
        f->functions.input_matrix(f->model, q, matrix);
    }
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        double force[3];
        for (int i = 0; i < 3; ++i) {
            force[i] = f->known.move ? matrix[(at->position + i) * width + k]
                                     : f->known.wrenches[k * BASE + i];
            sum[i] += force[i];
        }
        if (dot(3, force, force) > most) {
            most = dot(3, force, force);
            memcpy(axis, force, sizeof force);
        }
    }
    const double size = copysign(sqrt(most), dot(3, sum, axis));
    for (int i = 0; i < 3; ++i) {
        axis[i] /= size;
    }
}

/* What integral action adds to an error, by the place of its rate in the velocities. */
static double learned(const Loop *f, const Moment *now, ptrdiff_t place)
{
    return f->layout.memory ? f->gains.integral * now->memory[place] : 0.0;
}

/* The force that errors and the desired motion ask for. `jacobian` is that of the centre of mass,
 * and `along` the thrust axis in the world. */
static Need need_of(const Loop *f, const Moment *now, const double *jacobian, const double *along)
{
    const ptrdiff_t m = f->layout.velocities, position = f->layout.position;
    const double mass = f->centre.mass;
    double place[3], path[9], desired[3], off[3], drift[3], wish[3], growth[3];
    Need need;
    f->functions.centre_of_mass(f->model, now->q, place);
    evaluate(&f->desired, f->centre.coefficients, 3, now->time, path);
    for (int i = 0; i < 3; ++i) {
        const double k = f->gains.stiffness[position + i], d = f->gains.damping[position + i];
        desired[i] = mass * path[6 + i] + f->centre.weight[i];
        drift[i] = path[3 + i] - dot(m, jacobian + i * m, now->v);
        off[i] = path[i] - place[i];
        wish[i] = mass * (k * (off[i] + learned(f, now, position + i)) + d * drift[i]);
    }
    const double most = AUTHORITY * AUTHORITY * dot(3, desired, desired);
    const double share = 1.0 / sqrt(1.0 + dot(3, wish, wish) / most);
    for (int i = 0; i < 3; ++i) {
        need.correction[i] = share * wish[i];
        need.force[i] = desired[i] + need.correction[i];
    }
    need.thrust = fmax(dot(3, need.force, along), 0.0);
    for (int i = 0; i < 3; ++i) {
        const double k = f->gains.stiffness[position + i], d = f->gains.damping[position + i];
        growth[i] = k * mass * (drift[i] + f->gains.integral * off[i]) +
                    d * (desired[i] - need.thrust * along[i]);
    }
    const double bend = dot(3, wish, growth) * share * share * share / most;
    for (int i = 0; i < 3; ++i) {
        need.rate[i] = share * growth[i] - bend * wish[i];
    }
    return need;
}

/* A vector of the frame of a base with quaternion r in that of one with quaternion p. */
static void between_bases(const double *p, const double *r, const double *x, double *out)
{
    double world[3];
    turn(r, 1.0, x, world);
    turn(p, -1.0, world, out);
}

/* How a base with quaternion p must turn, in its frame: its thrust axis by the shortest way to
 * `unit`, which is in the frame of a base with quaternion r, then about that axis as r has it. */
static void attitude_error(const double *p, const double *r, const double *axis, const double *unit,
                           double *error)
{
    double there[3], swing[3], swept[3], lean[4], back[4], whole[4];
    between_bases(p, r, unit, there);
    cross(axis, there, swing);
    const double sine = sqrt(dot(3, swing, swing));
    const double share = sine > 0.0 ? atan2(sine, dot(3, axis, there)) / sine : 1.0;
    cross(axis, unit, lean);
    lean[3] = fmax(1.0 + dot(3, axis, unit), LEAST);
    const double size = sqrt(dot(4, lean, lean));
    between(p, r, back);
    cross(back, lean, swept);
    for (int i = 0; i < 3; ++i) {
        whole[i] = (back[3] * lean[i] + lean[3] * back[i] + swept[i]) / size;
    }
    whole[3] = (back[3] * lean[3] - dot(3, back, lean)) / size;
    const double about = dot(3, whole, axis), cosine = whole[3];
    const double heading = 2.0 * atan2(copysign(1.0, cosine) * about, fabs(cosine));
    for (int i = 0; i < 3; ++i) {
        error[i] = share * swing[i] + heading * (about * about + cosine * cosine) * axis[i];
    }
}

/* Add an error of the attitude times gains, which about the axis are those of the position. */
static void weigh(const Layout *at, const double *gains, const double *error, const double *axis,
                  double *out)
{
    const double heading = dot(3, axis, error);
    for (int i = 0; i < 3; ++i) {
        out[i] += gains[at->attitude + i] * (error[i] - heading * axis[i]) +
                  gains[at->position + i] * heading * axis[i];
    }
}

/* The angular acceleration by which the base leans as the force needs it. */
static void lean_to(const Loop *f, const Moment *now, const double *axis, const Need *need,
                    double *out)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const double *const p = now->q + at->quaternion, *const r = now->wanted + at->quaternion;
    const double *const spin = now->v + at->attitude;
    const double *const wanted = now->wanted + n + at->attitude; /* angular velocity */
    double unit[3], rate[3], correction[3], swept[3], about[3], turning[3], sum[3], ahead[3];
    turn(r, -1.0, need->force, unit);
    turn(r, -1.0, need->rate, rate);
    turn(r, -1.0, need->correction, correction);
    cross(wanted, correction, swept);
    const double size = sqrt(dot(3, unit, unit));
    for (int i = 0; i < 3; ++i) {
        unit[i] /= size;
        rate[i] = (rate[i] - swept[i]) / size;
    }
    cross(unit, rate, about);
    const double twist = dot(3, about, axis) / fmax(1.0 + dot(3, axis, unit), LEAST);
    for (int i = 0; i < 3; ++i) {
        turning[i] = about[i] - twist * unit[i];
        sum[i] = wanted[i] + turning[i];
    }
    between_bases(p, r, sum, ahead);
    cross(wanted, turning, swept);
    for (int i = 0; i < 3; ++i) {
        sum[i] = wanted[m + i] + swept[i];
    }
    between_bases(p, r, sum, out);
    cross(spin, ahead, swept);
    for (int i = 0; i < 3; ++i) {
        out[i] -= swept[i];
        sum[i] = ahead[i] - spin[i];
    }
    weigh(at, f->gains.damping, sum, axis, out);
    attitude_error(p, r, axis, unit, sum);
    weigh(at, f->gains.stiffness, sum, axis, out);
}

/* How what the law remembers grows: by the errors of the centre of mass and of the joints. */
static void remember_centre(const Loop *f, const Moment *now, double *growth)
{
    const Layout *const at = &f->layout;
    double place[3], path[9];
    f->functions.centre_of_mass(f->model, now->q, place);
    evaluate(&f->desired, f->centre.coefficients, 3, now->time, path);
    memset(growth, 0, (size_t)at->memory * sizeof *growth);
    for (int i = 0; i < 3; ++i) {
        growth[at->position + i] = path[i] - place[i];
    }
    for (ptrdiff_t i = at->joints; i < at->joints + at->velocities - BASE; ++i) {
        growth[i] = now->wanted[i + 1] - now->q[i + 1];
    }
}

/* Inputs by which the centre of mass, the attitude and the joints follow the desired motion. */
static int geometric(const Loop *f, const Moment *now, double *inputs, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    double *const jacobian = take(&room, 3 * m);
    double *const a = take(&room, m), *const generalised = take(&room, m);
    double axis[3], along[3], lacking[3];
    axis_of(f, now->q, axis, room);
    turn(now->q + at->quaternion, 1.0, axis, along);
    f->functions.centre_of_mass_jacobian(f->model, now->q, jacobian);
    const Need need = need_of(f, now, jacobian, along);
    memset(a + at->position, 0, 3 * sizeof *a);
    lean_to(f, now, axis, &need, a + at->attitude);
    for (ptrdiff_t i = at->joints; i < at->joints + m - BASE; ++i) {
        a[i] = now->wanted[n + m + i] +
               f->gains.stiffness[i] *
                   (now->wanted[i + 1] - now->q[i + 1] + learned(f, now, i)) +
               f->gains.damping[i] * (now->wanted[n + i] - now->v[i]);
    }
    f->functions.inverse_dynamics(f->model, now->q, now->v, a, generalised);
    turn(now->q + at->quaternion, 1.0, generalised + at->position, lacking);
    for (int i = 0; i < 3; ++i) {
        lacking[i] = need.thrust * along[i] - lacking[i];
    }
    for (ptrdiff_t i = 0; i < m; ++i) {
        generalised[i] += jacobian[i] * lacking[0] + jacobian[m + i] * lacking[1] +
                          jacobian[2 * m + i] * lacking[2];
    }
    return allocate(f, now->q, &now->attitude, generalised, inputs, room);
}

#endif
