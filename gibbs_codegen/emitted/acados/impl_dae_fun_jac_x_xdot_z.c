#include "residual.c"

int MODULE(impl_dae_fun_jac_x_xdot_z)(
    const real **arg, real **res, int *iw, real *w, void *mem)
{
    const int status = residual(arg, res[0], res[1], res[2], 0);
    (void)iw;
    (void)w;
    (void)mem;
    return checked(status, MODULE(impl_dae_fun_jac_x_xdot_z_sparsity_out), res);
}
