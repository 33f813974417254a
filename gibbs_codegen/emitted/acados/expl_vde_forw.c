#include "slopes.c"

int MODULE(expl_vde_forw)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[4], &room, &status);
    const real *v = arg[0] + NQ;
    Place at;
    real x_dot[NX], by[NV * NXU];
    (void)iw;
    (void)w;
    (void)mem;
    locate(arg[0], &at);
    slopes(constants, &at, v, arg[3], x_dot, by);
    store(NX, 1, x_dot, res[0]);
    for (int j = 0; res[1] && j < NX; ++j) {
        along(&at, v, by, NX, arg[1] + j * NX, res[1] + j * NX);
    }
    for (int j = 0; res[2] && j < NU; ++j) {
        real *column = res[2] + j * NX;
        along(&at, v, by, NX, arg[2] + j * NX, column);
        for (int i = 0; i < NV; ++i) {
            column[NQ + i] += by[i * NXU + NX + j];
        }
    }
    return checked(status, MODULE(expl_vde_forw_sparsity_out), res);
}
