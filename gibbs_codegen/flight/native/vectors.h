/* Vectors of three, and quaternions. */

#ifndef GIBBS_CODEGEN_VECTORS_H
#define GIBBS_CODEGEN_VECTORS_H

#include "number.h"

static void cross(const number *a, const number *b, number *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static INLINE number dot(ptrdiff_t n, const number *a, const number *b)
{
    number sum = {0.0};
    for (ptrdiff_t i = 0; i < n; ++i) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* The vector x in the world, of a base with the unit quaternion p; back into the base by -1. */
static void turn(const number *p, double sign, const number *x, number *out)
{
    number once[3], twice[3];
    cross(p, x, once);
    cross(p, once, twice);
    for (int i = 0; i < 3; ++i) {
        out[i] = x[i] + 2.0 * (sign * p[3] * once[i] + twice[i]);
    }
}

/* The product of the conjugate of p and of r. */
static void between(const number *p, const number *r, number *out)
{
    number carried[3];
    cross(p, r, carried);
    for (int i = 0; i < 3; ++i) {
        out[i] = p[3] * r[i] - r[3] * p[i] - carried[i];
    }
    out[3] = dot(4, p, r);
}

/* Solve A x = b in place of b, A positive definite, row by row, and changed. */
static void solve_positive(ptrdiff_t n, number *a, number *b)
{
    for (ptrdiff_t k = 0; k < n; ++k) {
        for (ptrdiff_t i = k + 1; i < n; ++i) {
            const number share = a[n * i + k] / a[n * k + k];
            for (ptrdiff_t j = k + 1; j < n; ++j) {
                a[n * i + j] -= share * a[n * k + j];
            }
            b[i] -= share * b[k];
        }
    }
    for (ptrdiff_t k = n; k-- > 0;) {
        b[k] = (b[k] - dot(n - k - 1, a + n * k + k + 1, b + k + 1)) / a[n * k + k];
    }
}

#endif
