#include "field.c"

int MODULE(expl_ode_fun)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[2], &room, &status);
    Place at;
    real x_dot[NX];
    (void)iw;
    (void)w;
    (void)mem;
    locate(arg[0], &at);
    field(constants, &at, arg[0] + NQ, arg[1], x_dot);
    store(NX, 1, x_dot, res[0]);
    return checked(status, MODULE(expl_ode_fun_sparsity_out), res);
}
