/* The inputs of a generalised force. */

#ifndef GIBBS_CODEGEN_ALLOCATION_H
#define GIBBS_CODEGEN_ALLOCATION_H

#include <string.h>

#include "bounded.h"
#include "kinematics.h"
#include "loop.h"
#include "vectors.h"

/* Singular directions, and parts of a wrench, that count as none: shares of the largest. */
static const double RANK = 1e-9, EXACT = 1e-9;
/* Weight of small thrusts against the wrench, as a share of the norm of all wrenches. */
static const double PREFERENCE = 1e-5;

/* Wrenches of unit thrusts at a configuration, of rotors that joints move. `matrix` is the input
 * matrix there. */
static void moved_wrenches(const Loop *f, const Attitude *a, const number *matrix, number *columns,
                           Room room)
{
    const Layout *const at = layout_of(f);
    number *const generalised = take(&room, at->velocities);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        for (ptrdiff_t i = 0; i < at->velocities; ++i) {
            generalised[i] = matrix[i * inputs_of(f) + k];
        }
        wrench_of(at, a, f->model_rotors.centre, generalised, columns + k * BASE);
    }
}

/*
 * The smallest thrusts of a wrench, by an orthogonal basis of what rows of the columns make: each
 * next direction of the basis is what the basis so far leaves of the row of which it leaves most.
 */
static void smallest(ptrdiff_t n, const double *columns, const double *wrench, double *x, Room room)
{
    double *const rows = take_plain(&room, BASE * n);
    double left[BASE], greatest = 0.0;
    memcpy(left, wrench, sizeof left);
    memset(x, 0, (size_t)n * sizeof *x);
    for (ptrdiff_t k = 0; k < n; ++k) {
        for (int i = 0; i < BASE; ++i) {
            rows[i * n + k] = columns[k * BASE + i];
        }
    }
    for (int rank = 0; rank < BASE; ++rank) {
        double most = 0.0;
        int next = 0;
        for (int i = 0; i < BASE; ++i) {
            const double square = product(n, rows + i * n, rows + i * n);
            next = square > most ? i : next;
            most = square > most ? square : most;
        }
        greatest = rank == 0 ? most : greatest;
        if (!(most > RANK * RANK * greatest)) {
            return;
        }
        double *const own = rows + next * n;
        const double share = left[next] / most;
        for (ptrdiff_t k = 0; k < n; ++k) {
            x[k] += share * own[k];
        }
        for (int i = 0; i < BASE; ++i) {
            const double along = product(n, rows + i * n, own) / most;
            for (ptrdiff_t k = 0; k < n && i != next; ++k) {
                rows[i * n + k] -= along * own[k];
            }
            left[i] -= along * left[next] * (double)(i != next);
        }
        left[next] = 0.0;
        memset(own, 0, (size_t)n * sizeof *own);
    }
}

/* Where thrusts do not produce a wrench, but for rounding. */
static flags missed(ptrdiff_t n, const number *columns, const number *wrench, const number *thrusts)
{
    number left[BASE];
    memcpy(left, wrench, sizeof left);
    for (ptrdiff_t k = 0; k < n; ++k) {
        for (int i = 0; i < BASE; ++i) {
            left[i] -= columns[k * BASE + i] * thrusts[k];
        }
    }
    const number exact = EXACT * (1.0 + root(dot(BASE, wrench, wrench)));
    return (flags)(root(dot(BASE, left, left)) > exact);
}

/* Weigh a problem whose force and torque do not yet compare, and how much small thrusts count. */
static void weigh_torques(Nearest *p)
{
    double force = 0.0, torque = 0.0;
    for (ptrdiff_t k = 0; k < p->rotors; ++k) {
        force += product(3, p->columns + k * BASE, p->columns + k * BASE);
        torque += product(3, p->columns + k * BASE + 3, p->columns + k * BASE + 3);
    }
    /* Torque is divided by the mean lever arm, so that it compares with force. */
    const int both = force > 0.0 && torque > 0.0;
    const double weight = both ? sqrt(force / torque) : 1.0;
    for (int i = 3; i < BASE; ++i) {
        p->target[i] *= weight;
        for (ptrdiff_t k = 0; k < p->rotors; ++k) {
            p->columns[k * BASE + i] *= weight;
        }
    }
    p->preference = PREFERENCE * sqrt(force + weight * weight * torque);
}

/* Thrusts of one state within limits that come nearest to its wrench. Returns whether they are
 * found. */
static int bring_within(const Loop *f, const number *columns, const number *wrench, int lane,
                        number *thrusts, Room room)
{
    const ptrdiff_t n = layout_of(f)->rotors;
    double *const own = take_plain(&room, n * BASE), *const target = take_plain(&room, BASE);
    double *const least = take_plain(&room, n), *const most = take_plain(&room, n);
    double *const sides = take_plain(&room, n), *const found = take_plain(&room, n);
    gather(n * BASE, columns, lane, own);
    gather(BASE, wrench, lane, target);
    gather(n, f->sharing.least, lane, least);
    gather(n, f->sharing.most, lane, most);
    gather(n, f->guesses, lane, sides);
    gather(n, thrusts, lane, found);
    Nearest problem = {n, own, target, 0.0, least, most};
    weigh_torques(&problem);
    const int done = nearest(&problem, sides, found, room);
    scatter(n, sides, lane, f->guesses);
    scatter(n, found, lane, thrusts);
    return done;
}

/* Where thrusts of flights that go on exceed their limits, put those in their place that come
 * nearest to the wrench. Returns where none are found. */
static flags keep_within(const Loop *f, flags going, const number *columns, const number *wrench,
                         number *thrusts, Room room)
{
    const number *const least = f->sharing.least, *const most = f->sharing.most;
    flags beyond = {0}, refused = {0};
    for (ptrdiff_t k = 0; k < layout_of(f)->rotors; ++k) {
        beyond |= (flags)(thrusts[k] < least[k]) | (flags)(thrusts[k] > most[k]);
    }
    beyond &= going;
    for (int lane = 0; any(beyond) && lane < LANES; ++lane) {
        if (flag(beyond, lane) && !bring_within(f, columns, wrench, lane, thrusts, room)) {
            refused |= only(lane);
        }
    }
    return refused;
}

/* The smallest thrusts of a wrench, state by state, of rotors that joints move. */
static void smallest_of_each(ptrdiff_t n, const number *columns, const number *wrench,
                             number *thrusts, Room room)
{
    double *const own = take_plain(&room, n * BASE), *const found = take_plain(&room, n);
    double target[BASE];
    for (int lane = 0; lane < LANES; ++lane) {
        gather(n * BASE, columns, lane, own);
        gather(BASE, wrench, lane, target);
        smallest(n, own, target, found, room);
        scatter(n, found, lane, thrusts);
    }
}

/*
 * Inputs of a generalised force at coordinates: thrusts for its part on the base; for the joints
 * their own entries, less what thrusts contribute to those. Returns where rotors cannot produce it.
 */
static flags allocate(const Loop *f, const Moment *now, const number *q, const Attitude *a,
                      const number *generalised, number *inputs, Room room)
{
    const Layout *const at = layout_of(f);
    const ptrdiff_t n = at->rotors, width = inputs_of(f);
    const number *columns = f->model_rotors.wrenches;
    number *const matrix = take(&room, f->model_rotors.move ? at->velocities * width : 0);
    number wrench[BASE];
    flags refused = {0};
    wrench_of(at, a, f->model_rotors.centre, generalised, wrench);
    if (f->model_rotors.move) {
        number *const moved = take(&room, n * BASE);
        f->functions.input_matrix(OF(f->model), q, matrix);
        moved_wrenches(f, a, matrix, moved, room);
        smallest_of_each(n, moved, wrench, inputs, room);
        columns = moved;
    } else {
        for (ptrdiff_t k = 0; k < n; ++k) {
            inputs[k] = dot(BASE, f->sharing.distribution + k * BASE, wrench);
        }
    }
    if (f->sharing.refuses) {
        refused = missed(n, columns, wrench, inputs);
    }
    if (f->sharing.limited) {
        refused |= keep_within(f, now->going & opposite(refused), columns, wrench, inputs, room);
    }
    memcpy(inputs + n, generalised + at->joints, (size_t)(width - n) * sizeof *inputs);
    for (ptrdiff_t j = n; j < width && f->model_rotors.move; ++j) {
        inputs[j] -= dot(n, matrix + (at->joints + j - n) * width, inputs);
    }
    return refused;
}

/* Room that `allocate` takes. */
static ptrdiff_t room_of_allocation(const Loop *f)
{
    const ptrdiff_t n = layout_of(f)->rotors, m = layout_of(f)->velocities;
    const ptrdiff_t moving = f->model_rotors.move ? m * inputs_of(f) + n * BASE : 0;
    const ptrdiff_t smallest_thrusts = f->model_rotors.move ? n * (2 * BASE + 1) : 0;
    const ptrdiff_t nearest_thrusts = f->sharing.limited ? n * (2 * BASE + 5 + n) + BASE : 0;
    const ptrdiff_t columns = m > smallest_thrusts ? m : smallest_thrusts;
    return moving + (columns > nearest_thrusts ? columns : nearest_thrusts);
}

#endif
