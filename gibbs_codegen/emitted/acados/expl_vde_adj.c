#include "gradient.c"

int MODULE(expl_vde_adj)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[3], &room, &status);
    Place at;
    real by_q[NV], by[NXU];
    (void)iw;
    (void)w;
    (void)mem;
    locate(arg[0], &at);
    gradient(constants, &at, arg[0] + NQ, arg[2], arg[1], by_q, by);
    store(NXU, 1, by, res[0]);
    return checked(status, MODULE(expl_vde_adj_sparsity_out), res);
}
