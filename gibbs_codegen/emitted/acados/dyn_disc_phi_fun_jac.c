#include "stages.c"

int MODULE(dyn_disc_phi_fun_jac)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[2], &room, &status);
    Stages taken;
    real next[NX], moved[4][NXU];
    (void)iw;
    (void)w;
    (void)mem;
    take_step(constants, arg[0], arg[1], STEP(arg[2]), &taken, next);
    store(NX, 1, next, res[0]);
    for (int j = 0; res[1] && j < NXU; ++j) {
        step_column(&taken, j, moved, next);
        for (int i = 0; i < NX; ++i) {
            res[1][i * NXU + u_then_x(j)] = next[i];
        }
    }
    return checked(status, MODULE(dyn_disc_phi_fun_jac_sparsity_out), res);
}
