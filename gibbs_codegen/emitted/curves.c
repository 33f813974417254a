/*
 * Functions written by hand that programs call: curves in time, and thrusts within limits. The
 * context is an array of addresses: the tables of two curves, and the guesses of thrusts at limits.
 */
enum { DESIRED, CENTRE, GUESSES };
enum { POWERS = 6 };

/*
 * Polynomials of `n` quantities at a time: values, first and second derivatives, one after the
 * other. A table has start and length of a piece, s, the number of pieces, and their coefficients
 * [pieces][POWERS][n]. Before the first piece and after the last one they are constant.
 */
static void curves_at(
    const real *RESTRICT table, const int n, const real time, real *RESTRICT found)
{
    const real piece = table[1], pieces = table[2];
    const real since = real_minimum(real_maximum(time - table[0], R(0.0)), piece * pieces);
    const real whole = real_minimum(LIBRARY(floor)(since / piece), pieces - R(1.0));
    const real s = since - whole * piece;
    const real *RESTRICT c = table + 3 + (size_t)whole * (size_t)(POWERS * n);
    for (int i = 0; i < n; ++i) {
        const real c1 = c[n + i], c2 = c[2 * n + i], c3 = c[3 * n + i];
        const real c4 = c[4 * n + i], c5 = c[5 * n + i];
        found[i] = c[i] + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))));
        found[n + i] = c1 + s * (R(2.0) * c2 + s * (R(3.0) * c3 +
            s * (R(4.0) * c4 + s * (R(5.0) * c5))));
        found[2 * n + i] = R(2.0) * c2 + s * (R(6.0) * c3 + s * (R(12.0) * c4 + s * (R(20.0) * c5)));
    }
}

static INLINE void desired(const void *const *context, const real time, real *found)
{
    curves_at((const real *)context[DESIRED], COORDINATES, time, found);
}

static INLINE void centre(const void *const *context, const real time, real *found)
{
    curves_at((const real *)context[CENTRE], 3, time, found);
}
