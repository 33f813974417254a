#include "base/place.c"

int MODULE(impl_dae_fun)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[5], &room, &status);
    const real *v = arg[0] + NQ, *x_dot = arg[1];
    Place at;
    real rest[NX], inputs[ROOM(NV * NU)];
    (void)iw;
    (void)w;
    (void)mem;
    locate(arg[0], &at);
    rates(constants, &at, v, rest);
    for (int i = 0; i < NQ; ++i) {
        rest[i] = x_dot[i] - rest[i];
    }
    MODULE(inverse_dynamics)(constants, at.q, v, x_dot + NQ, rest + NQ);
    MODULE(input_matrix)(constants, at.q, inputs);
    for (int i = 0; i < NV; ++i) {
        for (int j = 0; j < NU; ++j) {
            rest[NQ + i] -= inputs[i * NU + j] * arg[2][j];
        }
    }
    store(NX, 1, rest, res[0]);
    return checked(status, MODULE(impl_dae_fun_sparsity_out), res);
}
