#include "base/by_entries.c"
#include "base/rates_along.c"

/* Rates of x, and the derivatives of the accelerations by x and u. */
static void slopes(
    const Constants *constants,
    const Place *at,
    const real *v,
    const real *u,
    real *x_dot,
    real *by)
{
    real by_q[NV * NV], by_v[NV * NV], by_u[ROOM(NV * NU)];
    rates(constants, at, v, x_dot);
    MODULE(forward_dynamics_derivatives)(
        constants, at->q, v, u, x_dot + NQ, by_q, by_v, by_u);
    for (int i = 0; i < NV; ++i) {
        real *row = by + i * NXU;
        by_entries(at, by_q + i * NV, row);
        for (int j = 0; j < NV; ++j) {
            row[NQ + j] = by_v[i * NV + j];
        }
        for (int j = 0; j < NU; ++j) {
            row[NX + j] = by_u[i * NU + j];
        }
    }
}

/* Derivative of the rates of x in a direction of x, or of x and u, of so many entries. */
static void along(
    const Place *at,
    const real *v,
    const real *by,
    const int entries,
    const real *moved,
    real *result)
{
    rates_along(at, v, moved, result);
    for (int i = 0; i < NV; ++i) {
        real sum = 0.0;
        for (int j = 0; j < entries; ++j) {
            sum += by[i * NXU + j] * moved[j];
        }
        result[NQ + i] = sum;
    }
}
