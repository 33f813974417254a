#include "by_entries.c"
#include "cross.c"

/* Adds a number to two entries of a symmetric matrix. */
static void add_pair(real *matrix, const int width, const int i, const int j, const real value)
{
    matrix[i * width + j] += value;
    matrix[j * width + i] += value;
}

/* Adds what the weighed rates of the position give, by displacements and v. */
static void add_moving(
    const Place *at,
    const real *v,
    const real *weights,
    const int width,
    real *gradient,
    real *tangent)
{
    real own[3] = {0.0, 0.0, 0.0}, turned[3], along = 0.0;
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < 3; ++i) {
            own[k] += at->map[k][i] * weights[i];
        }
        along += own[k] * v[k];
    }
    cross(v, own, turned);
    for (int i = 0; i < 3; ++i) {
        gradient[3 + i] += turned[i];
        for (int j = 0; j < 3; ++j) {
            tangent[(3 + i) * width + 3 + j] +=
                0.5 * (v[i] * own[j] + own[i] * v[j]) - (i == j ? along : 0.0);
        }
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        add_pair(tangent, width, 3 + i, NV + j, own[k]);
        add_pair(tangent, width, 3 + i, NV + k, -own[j]);
    }
}

/* Adds what is left of second derivatives by entries: displacements are not linear in them. */
static void add_bending(
    const Place *at, const real *gradient, const int width, real *entries)
{
    real turned[4] = {0.0, 0.0, 0.0, 0.0};
    for (int j = 0; j < 4; ++j) {
        real spin[3], moved[3];
        for (int i = 0; i < 3; ++i) {
            spin[i] = at->map[3 + i][3 + j];
            turned[j] += gradient[3 + i] * spin[i];
        }
        cross(gradient, spin, moved);
        for (int k = 0; k < 3; ++k) {
            real along = 0.0;
            for (int i = 0; i < 3; ++i) {
                along += at->map[i][k] * moved[i];
            }
            add_pair(entries, width, 3 + j, k, -0.5 * along);
        }
    }
    for (int i = 0; i < 4; ++i) {
        for (int j = 0; j < 4; ++j) {
            const real both = at->q[3 + i] * turned[j] + at->q[3 + j] * turned[i];
            entries[(3 + i) * width + 3 + j] -= both / at->length;
        }
    }
}

/*
 * Second derivatives by x and `rest` further variables, from those by displacements, v and these,
 * for which there is room; those of the rates of q with some weights are added to both.
 */
static void twice_by_entries(
    const Place *at,
    const real *v,
    const real *weights,
    const int rest,
    real *gradient,
    real *tangent,
    real *entries)
{
    const int width = NX + rest, narrow = 2 * NV + rest;
    const real *w = weights + 3;
    add_moving(at, v, weights, narrow, gradient, tangent);
    for (int j = 0; j < narrow; ++j) {
        real column[NV], moved[NQ];
        const int to = j < NV ? j : j + 1;
        for (int i = 0; i < NV; ++i) {
            column[i] = tangent[i * narrow + j];
        }
        by_entries(at, column, moved);
        for (int i = 0; i < NQ; ++i) {
            entries[i * width + to] = moved[i];
        }
        for (int i = NV; i < narrow; ++i) {
            entries[(i + 1) * width + to] = tangent[i * narrow + j];
        }
    }
    for (int i = 0; i < width; ++i) {
        real row[NV], moved[NQ];
        for (int j = 0; j < NV; ++j) {
            row[j] = entries[i * width + j];
        }
        by_entries(at, row, moved);
        for (int j = 0; j < NQ; ++j) {
            entries[i * width + j] = moved[j];
        }
    }
    add_bending(at, gradient, width, entries);
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        add_pair(entries, width, 6, NQ + 3 + i, 0.5 * w[i]);
        add_pair(entries, width, 3 + i, NQ + 3 + i, -0.5 * w[3]);
        add_pair(entries, width, 3 + i, NQ + 3 + j, 0.5 * w[k]);
        add_pair(entries, width, 3 + i, NQ + 3 + k, -0.5 * w[j]);
    }
}
