#include "base/twice_by_entries.c"

int MODULE(impl_dae_hess)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    enum { REST = NV + NU, NARROW = 2 * NV + REST, WIDTH = NX + REST, ALL = 2 * NX + NU };
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[6], &room, &status);
    const real *v = arg[0] + NQ, *a = arg[1] + NQ, *u = arg[2], *of_force = arg[4] + NQ;
    Place at;
    real by_q[NV], by_v[NV], by_a[NV], force[NV], input_by_q[NV * NV], weights[NQ];
    real qq[NV * NV], qv[NV * NV], vv[NV * NV], qa[NV * NV], input_qq[NV * NV];
    real qu[ROOM(NV * NU)];
    real tangent[NARROW * NARROW] = {0.0}, matrix[WIDTH * WIDTH];
    (void)iw;
    (void)w;
    (void)mem;
    if (!res[0]) {
        return status;
    }
    locate(arg[0], &at);
    MODULE(inverse_dynamics_vjp)(constants, at.q, v, a, of_force, by_q, by_v, by_a);
    MODULE(inverse_dynamics_hessian)(constants, at.q, v, a, of_force, qq, qv, vv, qa);
    MODULE(input_forces_derivatives)(constants, at.q, u, force, input_by_q);
    MODULE(input_forces_hessian)(constants, at.q, u, of_force, input_qq, qu);
    for (int i = 0; i < NQ; ++i) {
        weights[i] = -arg[4][i];
    }
    for (int i = 0; i < NV; ++i) {
        for (int j = 0; j < NV; ++j) {
            by_q[j] -= of_force[i] * input_by_q[i * NV + j];
            tangent[i * NARROW + j] = qq[i * NV + j] - input_qq[i * NV + j];
            tangent[(NV + i) * NARROW + NV + j] = vv[i * NV + j];
            tangent[i * NARROW + NV + j] = tangent[(NV + j) * NARROW + i] = qv[i * NV + j];
            tangent[i * NARROW + 2 * NV + j] = qa[i * NV + j];
            tangent[(2 * NV + j) * NARROW + i] = qa[i * NV + j];
        }
        for (int j = 0; j < NU; ++j) {
            tangent[i * NARROW + 3 * NV + j] = -qu[i * NU + j];
            tangent[(3 * NV + j) * NARROW + i] = -qu[i * NU + j];
        }
    }
    twice_by_entries(&at, v, weights, REST, by_q, tangent, matrix);
    for (int j = 0; j < ALL; ++j) {
        /* The rates of q, which acados has between x and those of v, are linear. */
        const int from_j = j < NX ? j : j - NQ;
        for (int i = 0; i < ALL; ++i) {
            const int from_i = i < NX ? i : i - NQ;
            const int linear = (i >= NX && i < NX + NQ) || (j >= NX && j < NX + NQ);
            res[0][j * ALL + i] = linear ? 0.0 : matrix[from_i * WIDTH + from_j];
        }
    }
    return checked(status, MODULE(impl_dae_hess_sparsity_out), res);
}
