#include "base/place.c"

static void field(
    const Constants *constants, const Place *at, const real *v, const real *u, real *x_dot)
{
    rates(constants, at, v, x_dot);
    MODULE(forward_dynamics)(constants, at->q, v, u, x_dot + NQ);
}
