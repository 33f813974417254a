/* The desired motion at a time. */

#ifndef GIBBS_CODEGEN_REFERENCE_H
#define GIBBS_CODEGEN_REFERENCE_H

#include "kinematics.h"
#include "loop.h"

/* Polynomials of `n` quantities at a time: values, first and second derivatives, one after the
 * other. */
static void evaluate(const Desired *path, const double *coefficients, ptrdiff_t n, double time,
                     double *restrict out)
{
    const double last = (double)path->pieces * path->piece;
    double since = time - path->begin;
    since = since < 0.0 ? 0.0 : since > last ? last : since;
    ptrdiff_t k = (ptrdiff_t)(since / path->piece);
    k = k < path->pieces ? k : path->pieces - 1;
    const double s = since - (double)k * path->piece;
    const double *restrict c = coefficients + k * POWERS * n;
    for (ptrdiff_t i = 0; i < n; ++i) {
        const double c1 = c[n + i], c2 = c[2 * n + i], c3 = c[3 * n + i];
        const double c4 = c[4 * n + i], c5 = c[5 * n + i];
        out[i] = c[i] + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        out[n + i] = c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))));
        out[2 * n + i] = 2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * (20.0 * c5)));
    }
}

/* Desired coordinates, velocities and accelerations, one after the other. */
static void reference(const Loop *f, double time, number *out)
{
    const ptrdiff_t n = layout_of(f)->coordinates;
    evaluate(&f->desired, f->desired.coefficients, n, time, (double *)out);
    for (ptrdiff_t i = 3 * n; i-- > 0;) { /* from the end, where nothing is overwritten */
        out[i] = same(((const double *)out)[i]);
    }
    if (has_quaternion(layout_of(f))) {
        quasi_velocities(layout_of(f), out);
    }
}

#endif
