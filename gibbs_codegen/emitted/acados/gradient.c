#include "base/by_entries.c"
#include "base/rates_gradient.c"

/* Gradient by x and u of the rates of x with some weights; `by_q` is its part by displacements. */
static void gradient(
    const Constants *constants,
    const Place *at,
    const real *v,
    const real *u,
    const real *weights,
    real *by_q,
    real *by)
{
    MODULE(forward_dynamics_vjp)(
        constants, at->q, v, u, weights + NQ, by_q, by + NQ, by + NX);
    by_entries(at, by_q, by);
    add_rates_gradient(at, v, weights, by);
}
