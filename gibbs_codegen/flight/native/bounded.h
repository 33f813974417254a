/*
 * Thrusts within limits whose wrench is nearest to a wanted one: bounded least squares.
 *
 * It is solved for one state at a time, with its own plain numbers. Torques are divided by a lever,
 * so that they compare with forces, and thrusts count a little, so that there is one solution.
 * Which thrusts are at a limit is guessed, at first as it was found the last time, and all wrong
 * guesses are changed at once; where that does not lead to fewer, the last of them alone, which
 * comes to an end (Judice and Pires 1994).
 */

#ifndef GIBBS_CODEGEN_BOUNDED_H
#define GIBBS_CODEGEN_BOUNDED_H

#include <math.h>
#include <string.h>

#include "loop.h"

/* Rounds in which wrong guesses may not have become fewer before only one is changed. */
enum { PATIENCE = 3 };

typedef struct {
    ptrdiff_t rotors;
    double *columns; /* [rotors][6]: what unit thrusts do */
    double *target;  /* [6] */
    double preference;     /* of small thrusts */
    const double *least;
    const double *most;
} Nearest;

static double product(ptrdiff_t n, const double *a, const double *b)
{
    double sum = 0.0;
    for (ptrdiff_t i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* A thrust is free (0), or it is at its least (-1) or its greatest (1). */
static int is_free(double side)
{
    return fabs(side) < 0.5;
}

/* Least squares for the free thrusts, the others as they are, by reflections of Householder. */
static void solve_free(const Nearest *p, const double *sides, double *x, Room room)
{
    const ptrdiff_t n = p->rotors;
    double *const columns = take_plain(&room, n * BASE), *const upper = take_plain(&room, n * n);
    double left[BASE];
    memcpy(columns, p->columns, (size_t)(n * BASE) * sizeof *columns);
    memcpy(left, p->target, sizeof left);
    for (ptrdiff_t k = 0; k < n; ++k) {
        for (int i = 0; i < BASE && !is_free(sides[k]); ++i) {
            left[i] -= columns[k * BASE + i] * x[k];
        }
    }
    for (ptrdiff_t k = 0; k < n; ++k) {
        if (!is_free(sides[k])) {
            continue;
        }
        const double *const own = columns + k * BASE;
        const double norm = sqrt(p->preference * p->preference + product(BASE, own, own));
        const double share = 1.0 / norm, scale = share / (norm + p->preference);
        upper[k * n + k] = norm;
        x[k] = share * product(BASE, own, left);
        const double kept = scale * product(BASE, own, left);
        for (int i = 0; i < BASE; ++i) {
            left[i] -= kept * own[i];
        }
        for (ptrdiff_t l = k + 1; l < n; ++l) {
            double *const other = columns + l * BASE;
            if (is_free(sides[l])) {
                const double along = product(BASE, own, other);
                upper[k * n + l] = share * along;
                for (int i = 0; i < BASE; ++i) {
                    other[i] -= scale * along * own[i];
                }
            }
        }
    }
    for (ptrdiff_t k = n - 1; k >= 0; --k) {
        if (is_free(sides[k])) {
            for (ptrdiff_t l = k + 1; l < n; ++l) {
                x[k] -= is_free(sides[l]) ? upper[k * n + l] * x[l] : 0.0;
            }
            x[k] /= upper[k * n + k];
        }
    }
}

/* Better guesses than `sides`, with which x was found. Returns how many are others; `last` is the
 * last of them. */
static ptrdiff_t guess_again(const Nearest *p, const double *sides, const double *x, double *better,
                             ptrdiff_t *last)
{
    double off[BASE];
    ptrdiff_t changed = 0;
    for (int i = 0; i < BASE; ++i) {
        off[i] = -p->target[i];
        for (ptrdiff_t k = 0; k < p->rotors; ++k) {
            off[i] += p->columns[k * BASE + i] * x[k];
        }
    }
    for (ptrdiff_t k = 0; k < p->rotors; ++k) {
        const double slope = product(BASE, p->columns + k * BASE, off) +
                             p->preference * p->preference * x[k];
        better[k] = is_free(sides[k]) ? (double)(x[k] > p->most[k]) - (double)(x[k] < p->least[k])
                                      : (slope * sides[k] > 0.0 ? 0.0 : sides[k]);
        if (fabs(better[k] - sides[k]) > 0.5) {
            *last = k;
            ++changed;
        }
    }
    return changed;
}

/* `sides` are the first guesses, and then what was found. Returns whether anything was. */
static int nearest(const Nearest *p, double *sides, double *x, Room room)
{
    const ptrdiff_t n = p->rotors;
    double *const better = take_plain(&room, n);
    ptrdiff_t fewest = n + 1, last = 0, patience = PATIENCE;
    for (ptrdiff_t round = 0; round < 10 * (n + 3); ++round) {
        for (ptrdiff_t k = 0; k < n; ++k) {
            x[k] = is_free(sides[k]) ? x[k] : sides[k] < 0.0 ? p->least[k] : p->most[k];
        }
        solve_free(p, sides, x, room);
        const ptrdiff_t changed = guess_again(p, sides, x, better, &last);
        if (changed == 0) {
            return 1;
        }
        patience = changed < fewest ? PATIENCE : patience - 1;
        fewest = changed < fewest ? changed : fewest;
        if (patience >= 0) {
            memcpy(sides, better, (size_t)n * sizeof *sides);
        } else {
            sides[last] = better[last];
        }
    }
    return 0;
}

#endif
