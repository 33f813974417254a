#include "base/by_entries.c"
#include "base/rates_along.c"

/* The residual, and its derivatives by x, its rates and u, each unless the pointer is null. */
static int residual(const real **arg, real *value, real *by_x, real *by_x_dot, real *by_u)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[5], &room, &status);
    const real *v = arg[0] + NQ, *x_dot = arg[1], *u = arg[2];
    Place at;
    real own[NX], force[NV], inputs[ROOM(NV * NU)], by_q[NV * NV], input_by_q[NV * NV];
    real by[NV * NX], by_v[NV * NV], mass[NV * NV];
    locate(arg[0], &at);
    rates(constants, &at, v, own);
    MODULE(inverse_dynamics_derivatives)(
        constants, at.q, v, x_dot + NQ, own + NQ, by_q, by_v, mass);
    MODULE(input_forces_derivatives)(constants, at.q, u, force, input_by_q);
    MODULE(input_matrix)(constants, at.q, inputs);
    for (int i = 0; i < NV * NV; ++i) {
        by_q[i] -= input_by_q[i];
    }
    for (int i = 0; i < NV; ++i) {
        by_entries(&at, by_q + i * NV, by + i * NX);
        for (int j = 0; j < NV; ++j) {
            by[i * NX + NQ + j] = by_v[i * NV + j];
        }
    }
    for (int i = 0; value && i < NX; ++i) {
        value[i] = i < NQ ? x_dot[i] - own[i] : own[i] - force[i - NQ];
    }
    for (int j = 0; by_x && j < NX; ++j) {
        real moved[NX] = {0.0}, *column = by_x + j * NX;
        moved[j] = 1.0;
        rates_along(&at, v, moved, column);
        for (int i = 0; i < NX; ++i) {
            column[i] = i < NQ ? -column[i] : by[(i - NQ) * NX + j];
        }
    }
    for (int j = 0; by_x_dot && j < NX; ++j) {
        for (int i = 0; i < NX; ++i) {
            const int both = i >= NQ && j >= NQ;
            by_x_dot[j * NX + i] = both ? mass[(i - NQ) * NV + j - NQ] : i == j ? 1.0 : 0.0;
        }
    }
    for (int j = 0; by_u && j < NU; ++j) {
        for (int i = 0; i < NX; ++i) {
            by_u[j * NX + i] = i < NQ ? 0.0 : -inputs[(i - NQ) * NU + j];
        }
    }
    return status;
}
