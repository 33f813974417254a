#include "base/twice_by_entries.c"

/*
 * Second derivatives by x and u of the rates of x with some weights, whose gradient by displacements
 * is `by_q`, which changes.
 */
static void curvature(
    const Constants *constants,
    const Place *at,
    const real *v,
    const real *u,
    const real *weights,
    real *by_q,
    real *matrix)
{
    real tangent[(2 * NV + NU) * (2 * NV + NU)];
    MODULE(forward_dynamics_hessian)(constants, at->q, v, u, weights + NQ, tangent);
    twice_by_entries(at, v, weights, NU, by_q, tangent, matrix);
}

/* Adds S^T H S, where the first rows of S are NXU columns of x, and the others select u. */
static void add_congruent(const real *matrix, const real *columns, real *sum)
{
    for (int j = 0; j < NXU; ++j) {
        real product[NXU];
        for (int i = 0; i < NXU; ++i) {
            product[i] = j < NX ? 0.0 : matrix[i * NXU + j];
            for (int k = 0; k < NX; ++k) {
                product[i] += matrix[i * NXU + k] * columns[j * NX + k];
            }
        }
        for (int i = 0; i < NXU; ++i) {
            real entry = i < NX ? 0.0 : product[i];
            for (int k = 0; k < NX; ++k) {
                entry += columns[i * NX + k] * product[k];
            }
            sum[i * NXU + j] += entry;
        }
    }
}
