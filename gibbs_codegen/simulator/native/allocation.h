/* The inputs of a generalised force. */

#ifndef GIBBS_CODEGEN_ALLOCATION_H
#define GIBBS_CODEGEN_ALLOCATION_H

#include <math.h>
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
static void moved_wrenches(const Loop *f, const Attitude *a, const double *matrix, double *columns,
                           Room room)
{
    const Layout *const at = &f->layout;
    double *const generalised = take(&room, at->velocities);
    for (ptrdiff_t k = 0; k < at->rotors; ++k) {
        for (ptrdiff_t i = 0; i < at->velocities; ++i) {
            generalised[i] = matrix[i * inputs_of(f) + k];
        }
        wrench_of(at, a, f->known.centre, generalised, columns + k * BASE);
    }
}

/*
 * The smallest thrusts of a wrench, by an orthogonal basis of what rows of the columns make: each
 * next direction of the basis is what the basis so far leaves of the row of which it leaves most.
 */
static void smallest(ptrdiff_t n, const double *columns, const double *wrench, double *x, Room room)
{
    double *const rows = take(&room, BASE * n);
    double left[BASE], largest = 0.0;
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
            const double square = dot(n, rows + i * n, rows + i * n);
            next = square > most ? i : next;
            most = square > most ? square : most;
        }
        largest = rank == 0 ? most : largest;
        if (!(most > RANK * RANK * largest)) {
            return;
        }
        double *const own = rows + next * n;
        const double share = left[next] / most;
        for (ptrdiff_t k = 0; k < n; ++k) {
            x[k] += share * own[k];
        }
        for (int i = 0; i < BASE; ++i) {
            const double along = dot(n, rows + i * n, own) / most;
            for (ptrdiff_t k = 0; k < n && i != next; ++k) {
                rows[i * n + k] -= along * own[k];
            }
            left[i] -= along * left[next] * (double)(i != next);
        }
        left[next] = 0.0;
        memset(own, 0, (size_t)n * sizeof *own);
    }
}

/* Whether thrusts produce a wrench, but for rounding. */
static int produced(ptrdiff_t n, const double *columns, const double *wrench, const double *thrusts)
{
    double missed[BASE];
    memcpy(missed, wrench, sizeof missed);
    for (ptrdiff_t k = 0; k < n; ++k) {
        for (int i = 0; i < BASE; ++i) {
            missed[i] -= columns[k * BASE + i] * thrusts[k];
        }
    }
    const double exact = EXACT * (1.0 + sqrt(dot(BASE, wrench, wrench)));
    return !(sqrt(dot(BASE, missed, missed)) > exact);
}

/* Where thrusts exceed their limits, put those in their place that come nearest to the wrench. */
static int keep_within(const Loop *f, const double *columns, const double *wrench, double *thrusts,
                       Room room)
{
    const ptrdiff_t n = f->layout.rotors;
    const double *const least = f->sharing.least, *const most = f->sharing.most;
    double *const weighted = take(&room, n * BASE), target[BASE], force = 0.0, torque = 0.0;
    int beyond = 0;
    for (ptrdiff_t k = 0; k < n; ++k) {
        beyond |= thrusts[k] < least[k] || thrusts[k] > most[k];
    }
    if (!beyond) {
        return DONE;
    }
    for (ptrdiff_t k = 0; k < n; ++k) {
        force += dot(3, columns + k * BASE, columns + k * BASE);
        torque += dot(3, columns + k * BASE + 3, columns + k * BASE + 3);
    }
    /* Torque is divided by the mean lever arm, so that it compares with force. */
    const int both = force > 0.0 && torque > 0.0;
    const double weight = both ? sqrt(force / torque) : 1.0;
    for (int i = 0; i < BASE; ++i) {
        const double own = i < 3 ? 1.0 : weight;
        target[i] = own * wrench[i];
        for (ptrdiff_t k = 0; k < n; ++k) {
            weighted[k * BASE + i] = own * columns[k * BASE + i];
        }
    }
    const double preference = PREFERENCE * sqrt(force + weight * weight * torque);
    const Nearest problem = {n, weighted, target, preference, least, most};
    return nearest(&problem, f->scratch, thrusts, room);
}

/*
 * Inputs of a generalised force at coordinates: thrusts for its part on the base; for the joints
 * their own entries, less what thrusts contribute to those. REFUSED where rotors cannot produce it.
 */
static int allocate(const Loop *f, const double *q, const Attitude *a, const double *generalised,
                    double *inputs, Room room)
{
    const Layout *const at = &f->layout;
    const ptrdiff_t n = at->rotors, width = inputs_of(f);
    const double *columns = f->known.wrenches;
    double *const matrix = take(&room, f->known.move ? at->velocities * width : 0);
    double wrench[BASE];
    wrench_of(at, a, f->known.centre, generalised, wrench);
    if (f->known.move) {
        double *const moved = take(&room, n * BASE);
        f->functions.input_matrix(f->model, q, matrix);
        moved_wrenches(f, a, matrix, moved, room);
        smallest(n, moved, wrench, inputs, room);
        columns = moved;
    } else {
        for (ptrdiff_t k = 0; k < n; ++k) {
            inputs[k] = dot(BASE, f->sharing.distribution + k * BASE, wrench);
        }
    }
    if (f->sharing.refuses && !produced(n, columns, wrench, inputs)) {
        return REFUSED;
    }
    if (f->sharing.limited && keep_within(f, columns, wrench, inputs, room) == REFUSED) {
        return REFUSED;
    }
    memcpy(inputs + n, generalised + at->joints, (size_t)(width - n) * sizeof *inputs);
    for (ptrdiff_t j = n; j < width && f->known.move; ++j) {
        inputs[j] -= dot(n, matrix + (at->joints + j - n) * width, inputs);
    }
    return DONE;
}

/* Room that `allocate` takes. */
static ptrdiff_t room_of_allocation(const Loop *f)
{
    const ptrdiff_t n = f->layout.rotors, m = f->layout.velocities;
    const ptrdiff_t moving = f->known.move ? m * inputs_of(f) + n * BASE : 0;
    const ptrdiff_t smallest_thrusts = f->known.move ? n * BASE : 0;
    const ptrdiff_t nearest_thrusts = f->sharing.limited ? n * (2 * BASE + 1 + n) : n * BASE;
    const ptrdiff_t columns = m > smallest_thrusts ? m : smallest_thrusts;
    return moving + (columns > nearest_thrusts ? columns : nearest_thrusts);
}

#endif
