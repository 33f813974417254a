#include "stages.c"
#include "gradient.c"
#include "curvature.c"

int MODULE(dyn_disc_phi_fun_jac_hess)(
    const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[3], &room, &status);
    const real *u = arg[1], *pi = arg[2], h = STEP(arg[3]);
    Stages taken;
    real next[NX], moved[4][NXU], columns[4][NX * NXU];
    real passed[NXU] = {0.0}, by_q[NV], matrix[NXU * NXU], sum[NXU * NXU] = {0.0};
    (void)iw;
    (void)w;
    (void)mem;
    take_step(constants, arg[0], u, h, &taken, next);
    store(NX, 1, next, res[0]);
    for (int j = 0; j < NXU; ++j) {
        step_column(&taken, j, moved, next);
        for (int i = 0; i < NX; ++i) {
            for (int stage = 0; stage < 4; ++stage) {
                columns[stage][j * NX + i] = moved[stage][i];
            }
            if (res[1]) {
                res[1][i * NXU + u_then_x(j)] = next[i];
            }
        }
    }
    /* Each stage bends the result as much as its slope counts, directly and in later stages. */
    for (int stage = 3; stage >= 0; --stage) {
        const Place *at = &taken.at[stage];
        const real *v = taken.states[stage] + NQ;
        const real later = stage < 3 ? h * stage_ahead[stage + 1] : 0.0;
        real weights[NX];
        for (int i = 0; i < NX; ++i) {
            weights[i] = h * stage_share[stage] * pi[i] + later * passed[i];
        }
        gradient(constants, at, v, u, weights, by_q, passed);
        curvature(constants, at, v, u, weights, by_q, matrix);
        add_congruent(matrix, columns[stage], sum);
    }
    for (int j = 0; res[2] && j < NXU; ++j) {
        for (int i = 0; i < NXU; ++i) {
            res[2][u_then_x(j) * NXU + u_then_x(i)] = sum[i * NXU + j];
        }
    }
    return checked(status, MODULE(dyn_disc_phi_fun_jac_hess_sparsity_out), res);
}
