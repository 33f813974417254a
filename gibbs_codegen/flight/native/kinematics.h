/* Coordinates, velocities and tracking errors, with attitude angles or a quaternion. */

#ifndef GIBBS_CODEGEN_KINEMATICS_H
#define GIBBS_CODEGEN_KINEMATICS_H

#include <string.h>

#include "loop.h"
#include "vectors.h"

static Attitude attitude_of(const Layout *at, const number *q)
{
    Attitude found = {0};
    found.quaternion = q + at->quaternion;
    if (!has_quaternion(at)) {
        sines_of(q + at->attitude, found.sine, found.cosine);
    }
    return found;
}

/* Turn a vector back about the axis of the angle `i`. */
static void turn_back(const Layout *at, const Attitude *a, int i, number *x)
{
    const ptrdiff_t one = (at->axes[i] + 1) % 3, two = (at->axes[i] + 2) % 3;
    const number first = a->cosine[i] * x[one] + a->sine[i] * x[two];
    x[two] = a->cosine[i] * x[two] - a->sine[i] * x[one];
    x[one] = first;
}

/* A vector of the world in the axes of the base. */
static void into_base(const Layout *at, const Attitude *a, const number *x, number *out)
{
    if (has_quaternion(at)) {
        turn(a->quaternion, -1.0, x, out);
        return;
    }
    memcpy(out, x, 3 * sizeof *out);
    for (int i = 0; i < 3; ++i) {
        turn_back(at, a, i, out);
    }
}

/* Velocity of the base centre and angular velocity, in the axes of the base. */
static void twist_of(const Layout *at, const Attitude *a, const number *centre, const number *v,
                     number *twist)
{
    number *const spin = twist + 3, swept[3];
    if (has_quaternion(at)) {
        memcpy(twist, v + at->position, 3 * sizeof *twist);
        memcpy(spin, v + at->attitude, 3 * sizeof *spin);
    } else {
        into_base(at, a, v + at->position, twist);
        memset(spin, 0, 3 * sizeof *spin);
        for (int i = 0; i < 3; ++i) { /* by each angle, carried round by those after it */
            turn_back(at, a, i, spin);
            spin[at->axes[i]] += v[at->attitude + i];
        }
    }
    cross(spin, centre, swept);
    for (int i = 0; i < 3; ++i) {
        twist[i] += swept[i];
    }
}

/* The wrench on the base that a generalised force amounts to: force, torque about its centre. */
static void wrench_of(const Layout *at, const Attitude *a, const number *centre,
                      const number *generalised, number *wrench)
{
    const number *const g = generalised + at->attitude;
    number *const torque = wrench + 3, lever[3];
    if (has_quaternion(at)) {
        memcpy(wrench, generalised + at->position, 3 * sizeof *wrench);
        memcpy(torque, g, 3 * sizeof *torque);
    } else {
        /* The axes of the three angles are not at right angles: the first leans by the second. */
        const int cyclic = (at->axes[0] + 1) % 3 == at->axes[1];
        const number lean = cyclic ? a->sine[1] : -a->sine[1];
        into_base(at, a, generalised + at->position, wrench);
        torque[at->axes[0]] = (g[0] - lean * g[2]) / a->cosine[1];
        torque[at->axes[1]] = g[1];
        torque[at->axes[2]] = g[2];
        turn_back(at, a, 2, torque);
    }
    cross(centre, wrench, lever);
    for (int i = 0; i < 3; ++i) {
        torque[i] -= lever[i];
    }
}

/* Make the quaternion of coordinates one of unit length. */
static void normalise(const Layout *at, number *q)
{
    number *p = q + at->quaternion;
    const number length = root(dot(4, p, p));
    for (int i = 0; i < 4; ++i) {
        p[i] /= length;
    }
}

/* Rates of coordinates, of which `unit` has the quaternion of length 1; it keeps its length. */
static void rates_of(const Layout *at, const number *q, const number *unit, const number *v,
                     number *rate)
{
    const number *p = q + at->quaternion, *spin = v + at->attitude;
    number *growth = rate + at->quaternion;
    turn(unit + at->quaternion, 1.0, v + at->position, rate + at->placed);
    cross(p, spin, growth);
    for (int i = 0; i < 3; ++i) {
        growth[i] = 0.5 * (growth[i] + p[3] * spin[i]);
    }
    growth[3] = -0.5 * dot(3, p, spin);
    memcpy(rate + at->joints + 1, v + at->joints,
           (size_t)(at->velocities - BASE) * sizeof *rate);
}

/*
 * In place of coordinates and their first two derivatives, the coordinates with a quaternion of
 * unit length, velocities and accelerations. With c = r p, where p is of unit length,
 * conj(c) c' = r r' + r^2 spin / 2.
 */
static void quasi_velocities(const Layout *at, number *out)
{
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const size_t joints = (size_t)(m - BASE) * sizeof *out;
    const number *c = out + at->quaternion;
    const number square = dot(4, c, c), stretching = dot(4, c, c + n) / square;
    number spin[4], growth[4], linear[3], rate[3], carried[3];
    between(c, c + n, spin);
    between(c, c + 2 * n, growth);
    for (int i = 0; i < 3; ++i) {
        spin[i] *= 2.0 / square;
        growth[i] = growth[i] * (2.0 / square) - 2.0 * stretching * spin[i];
    }
    normalise(at, out);
    turn(c, -1.0, out + n + at->placed, linear);
    turn(c, -1.0, out + 2 * n + at->placed, rate);
    cross(spin, linear, carried);
    memmove(out + n + at->joints, out + n + at->joints + 1, joints);
    memmove(out + n + m + at->joints, out + 2 * n + at->joints + 1, joints);
    for (int i = 0; i < 3; ++i) {
        out[n + at->attitude + i] = spin[i];
        out[n + at->position + i] = linear[i];
        out[n + m + at->attitude + i] = growth[i];
        out[n + m + at->position + i] = rate[i] - carried[i];
    }
}

/*
 * Errors of a state, then their rates: with angles, differences. With a quaternion those of the
 * position are in world axes; that of the attitude is the rotation vector in the base's frame.
 */
static void errors_of(const Layout *at, const number *wanted, const number *q, const number *v,
                      number *off)
{
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const ptrdiff_t shift = n - m; /* of the joints, past a quaternion */
    number *rate = off + m;
    for (ptrdiff_t i = 0; i < m; ++i) {
        off[i] = wanted[i + shift] - q[i + shift];
        rate[i] = wanted[n + i] - v[i];
    }
    if (!has_quaternion(at)) {
        return;
    }
    const number *p = q + at->quaternion, *r = wanted + at->quaternion;
    number turned[4], spin[3], here[3], there[3];
    between(p, r, turned);
    const number sine = root(dot(3, turned, turned)), cosine = magnitude(turned[3]);
    const number half = choose((flags)(sine > 0.0), arc_tangent(sine, cosine) / sine, 1.0 / cosine);
    turn(r, 1.0, wanted + n + at->attitude, there);
    turn(p, -1.0, there, spin);
    turn(p, 1.0, v + at->position, here);
    turn(r, 1.0, wanted + n + at->position, there);
    for (int i = 0; i < 3; ++i) {
        off[at->attitude + i] = signed_as(2.0 * half, turned[3]) * turned[i];
        off[at->position + i] = wanted[at->placed + i] - q[at->placed + i];
        rate[at->attitude + i] = spin[i] - v[at->attitude + i];
        rate[at->position + i] = there[i] - here[i];
    }
}

/* Of a base with a quaternion, accelerations in which the base would move in the world as wanted
 * but for `pull`, which is what control makes of the errors. */
static void carried_over(const Layout *at, const number *wanted, const number *q, const number *v,
                         const number *pull, number *out)
{
    const ptrdiff_t n = at->coordinates, m = at->velocities;
    const number *p = q + at->quaternion, *r = wanted + at->quaternion;
    const number *turning = wanted + n + at->attitude, *spin = v + at->attitude;
    number swept[3], world[3], rate[3], there[3], here[3];
    cross(turning, wanted + n + at->position, swept);
    for (int i = 0; i < 3; ++i) {
        swept[i] += wanted[n + m + at->position + i];
    }
    turn(r, 1.0, swept, world);
    for (int i = 0; i < 3; ++i) {
        world[i] += pull[at->position + i];
    }
    turn(p, -1.0, world, out + at->position);
    cross(spin, v + at->position, swept);
    turn(r, 1.0, wanted + n + m + at->attitude, world);
    turn(p, -1.0, world, rate);
    turn(r, 1.0, turning, there);
    turn(p, -1.0, there, here);
    cross(spin, here, there);
    for (int i = 0; i < 3; ++i) {
        out[at->position + i] -= swept[i];
        out[at->attitude + i] = rate[i] - there[i] + pull[at->attitude + i];
    }
}

#endif
