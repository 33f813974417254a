/*
 * The geometric law for a base with a quaternion whose rotors push along one axis, as
 * `control/geometric.py` has it and explains it.
 */

#ifndef GIBBS_CODEGEN_GEOMETRIC_H
#define GIBBS_CODEGEN_GEOMETRIC_H

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
    number force[3];
    number correction[3];
    number rate[3];
    number thrust;
} Need;

/* The thrust axis in the base's frame, along what equal thrusts of all rotors make. */
static void axis_of(const Loop *f, const number *q, number *axis, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t width = inputs_of(f);
    number *const matrix = take(&room, f->model_rotors.move ? at->velocities * width : 0);
    number sum[3] = {0}, most = {0.0};
    memset(axis, 0, 3 * sizeof *axis);
    if (f->model_rotors.move) {
        f->functions.input_matrix(OF(f->model), q, matrix);
    }
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        number force[3];
        for (int i = 0; i < 3; ++i) {
            force[i] = f->model_rotors.move ? matrix[(at->position + i) * width + k]
                                     : f->model_rotors.wrenches[k * BASE + i];
            sum[i] += force[i];
        }
        const number square = dot(3, force, force);
        for (int i = 0; i < 3; ++i) {
            axis[i] = choose((flags)(square > most), force[i], axis[i]);
        }
        most = largest(square, most);
    }
    const number size = signed_as(root(most), dot(3, sum, axis));
    for (int i = 0; i < 3; ++i) {
        axis[i] /= size;
    }
}

/* What integral action adds to an error, by the place of its rate in the velocities. */
static INLINE number error_correction(const Loop *f, const Moment *now, ptrdiff_t place)
{
    if (!layout_of(f)->memory) {
        return same(0.0);
    }
    return *f->gains.integral * now->memory[place];
}

/* The force that errors and the desired motion ask for. `jacobian` is that of the centre of mass,
 * and `along` the thrust axis in the world. */
static Need need_of(const Loop *f, const Moment *now, const number *jacobian, const number *along)
{
    const ptrdiff_t m = layout_of(f)->velocities, position = layout_of(f)->position;
    const number mass = *f->centre.mass;
    number place[3], path[9], desired[3], off[3], drift[3], wish[3], growth[3];
    Need need;
    f->functions.centre_of_mass(OF(f->model), now->q, place);
    evaluate(&f->desired, (const double *)f->centre.coefficients, 3 * LANES, now->time,
             (double *)path);
    for (int i = 0; i < 3; ++i) {
        const number k = f->gains.stiffness[position + i], d = f->gains.damping[position + i];
        desired[i] = mass * path[6 + i] + f->centre.weight[i];
        drift[i] = path[3 + i] - dot(m, jacobian + i * m, now->v);
        off[i] = path[i] - place[i];
        wish[i] = mass * (k * (off[i] + error_correction(f, now, position + i)) + d * drift[i]);
    }
    const number most = AUTHORITY * AUTHORITY * dot(3, desired, desired);
    const number share = 1.0 / root(1.0 + dot(3, wish, wish) / most);
    for (int i = 0; i < 3; ++i) {
        need.correction[i] = share * wish[i];
        need.force[i] = desired[i] + need.correction[i];
    }
    need.thrust = largest(dot(3, need.force, along), same(0.0));
    for (int i = 0; i < 3; ++i) {
        const number k = f->gains.stiffness[position + i], d = f->gains.damping[position + i];
        growth[i] = k * mass * (drift[i] + *f->gains.integral * off[i]) +
                    d * (desired[i] - need.thrust * along[i]);
    }
    const number bend = dot(3, wish, growth) * share * share * share / most;
    for (int i = 0; i < 3; ++i) {
        need.rate[i] = share * growth[i] - bend * wish[i];
    }
    return need;
}

/* A vector of the frame of a base with quaternion r in that of one with quaternion p. */
static void between_bases(const number *p, const number *r, const number *x, number *out)
{
    number world[3];
    turn(r, 1.0, x, world);
    turn(p, -1.0, world, out);
}

/* How a base with quaternion p must turn, in its frame: its thrust axis by the shortest way to
 * `unit`, which is in the frame of a base with quaternion r, then about that axis as r has it. */
static void attitude_error(const number *p, const number *r, const number *axis, const number *unit,
                           number *error)
{
    number there[3], swing[3], swept[3], lean[4], back[4], whole[4];
    between_bases(p, r, unit, there);
    cross(axis, there, swing);
    const number sine = root(dot(3, swing, swing));
    const number angle = arc_tangent(sine, dot(3, axis, there));
    const number share = choose((flags)(sine > 0.0), angle / sine, same(1.0));
    cross(axis, unit, lean);
    lean[3] = largest(1.0 + dot(3, axis, unit), same(LEAST));
    const number size = root(dot(4, lean, lean));
    between(p, r, back);
    cross(back, lean, swept);
    for (int i = 0; i < 3; ++i) {
        whole[i] = (back[3] * lean[i] + lean[3] * back[i] + swept[i]) / size;
    }
    whole[3] = (back[3] * lean[3] - dot(3, back, lean)) / size;
    const number about = dot(3, whole, axis), cosine = whole[3];
    const number side = signed_as(same(1.0), cosine);
    const number heading = 2.0 * arc_tangent(side * about, magnitude(cosine));
    for (int i = 0; i < 3; ++i) {
        error[i] = share * swing[i] + heading * (about * about + cosine * cosine) * axis[i];
    }
}

/* Add an error of the attitude times gains, which about the axis are those of the position. */
static void weigh(const Layout *at, const number *gains, const number *error, const number *axis,
                  number *out)
{
    const number heading = dot(3, axis, error);
    for (int i = 0; i < 3; ++i) {
        out[i] += gains[at->attitude + i] * (error[i] - heading * axis[i]) +
                  gains[at->position + i] * heading * axis[i];
    }
}

/* The angular acceleration by which the base leans as the force needs it. */
static void lean_to(const Loop *f, const Moment *now, const number *axis, const Need *need,
                    number *out)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const number *const p = now->q + at->quaternion, *const r = now->wanted + at->quaternion;
    const number *const spin = now->v + at->attitude;
    const number *const wanted = now->wanted + n + at->attitude; /* angular velocity */
    number unit[3], rate[3], correction[3], swept[3], about[3], turning[3], sum[3], ahead[3];
    turn(r, -1.0, need->force, unit);
    turn(r, -1.0, need->rate, rate);
    turn(r, -1.0, need->correction, correction);
    cross(wanted, correction, swept);
    const number size = root(dot(3, unit, unit));
    for (int i = 0; i < 3; ++i) {
        unit[i] /= size;
        rate[i] = (rate[i] - swept[i]) / size;
    }
    cross(unit, rate, about);
    const number twist = dot(3, about, axis) / largest(1.0 + dot(3, axis, unit), same(LEAST));
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
static void remember_centre(const Loop *f, const Moment *now, number *growth)
{
    const Layout *const at = layout_of(f);
    number place[3], path[9];
    f->functions.centre_of_mass(OF(f->model), now->q, place);
    evaluate(&f->desired, (const double *)f->centre.coefficients, 3 * LANES, now->time,
             (double *)path);
    memset(growth, 0, (size_t)at->memory * sizeof *growth);
    for (int i = 0; i < 3; ++i) {
        growth[at->position + i] = path[i] - place[i];
    }
    for (ptrdiff_t i = at->joints; i < at->joints + at->velocities - BASE; ++i) {
        growth[i] = now->wanted[i + 1] - now->q[i + 1];
    }
}

/* Inputs by which the centre of mass, the attitude and the joints follow the desired motion. */
static flags geometric(const Loop *f, const Moment *now, number *inputs, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    number *const jacobian = take(&room, 3 * m);
    number *const a = take(&room, m), *const generalised = take(&room, m);
    number axis[3], along[3], lacking[3];
    axis_of(f, now->q, axis, room);
    turn(now->q + at->quaternion, 1.0, axis, along);
    f->functions.centre_of_mass_jacobian(OF(f->model), now->q, jacobian);
    const Need need = need_of(f, now, jacobian, along);
    memset(a + at->position, 0, 3 * sizeof *a);
    lean_to(f, now, axis, &need, a + at->attitude);
    for (ptrdiff_t i = at->joints; i < at->joints + m - BASE; ++i) {
        a[i] = now->wanted[n + m + i] +
               f->gains.stiffness[i] *
                   (now->wanted[i + 1] - now->q[i + 1] + error_correction(f, now, i)) +
               f->gains.damping[i] * (now->wanted[n + i] - now->v[i]);
    }
    f->functions.inverse_dynamics(OF(f->model), now->q, now->v, a, generalised);
    turn(now->q + at->quaternion, 1.0, generalised + at->position, lacking);
    for (int i = 0; i < 3; ++i) {
        lacking[i] = need.thrust * along[i] - lacking[i];
    }
    for (ptrdiff_t i = 0; i < m; ++i) {
        generalised[i] += jacobian[i] * lacking[0] + jacobian[m + i] * lacking[1] +
                          jacobian[2 * m + i] * lacking[2];
    }
    return allocate(f, now, now->q, &now->attitude, generalised, inputs, room);
}

#endif
