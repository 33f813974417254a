#include "gradient.c"
#include "curvature.c"

int MODULE(expl_ode_hess)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[5], &room, &status);
    const real *v = arg[0] + NQ, *weights = arg[3], *u = arg[4];
    Place at;
    real by_q[NV], by[NXU], matrix[NXU * NXU], columns[NX * NXU], sum[NXU * NXU] = {0.0};
    (void)iw;
    (void)w;
    (void)mem;
    locate(arg[0], &at);
    gradient(constants, &at, v, u, weights, by_q, by);
    curvature(constants, &at, v, u, weights, by_q, matrix);
    for (int i = 0; i < NX * NXU; ++i) {
        columns[i] = i < NX * NX ? arg[1][i] : arg[2][i - NX * NX];
    }
    add_congruent(matrix, columns, sum);
    store(NXU, 1, by, res[0]);
    for (int j = 0, place_of = 0; res[1] && j < NXU; ++j) {
        for (int i = j; i < NXU; ++i) {
            res[1][place_of++] = sum[i * NXU + j];
        }
    }
    return checked(status, MODULE(expl_ode_hess_sparsity_out), res);
}
