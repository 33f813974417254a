#include "runge_kutta.c"
#include "field.c"

int MODULE(dyn_disc_phi_fun)(const real **arg, real **res, int *iw, real *w, void *mem)
{
    int status;
    Constants room;
    const Constants *constants = constants_of(arg[2], &room, &status);
    const real *x = arg[0], *u = arg[1], h = STEP(arg[2]);
    real state[NX], slope[NX] = {0.0}, next[NX];
    (void)iw;
    (void)w;
    (void)mem;
    store(NX, 1, x, next);
    for (int stage = 0; stage < 4; ++stage) {
        Place at;
        for (int i = 0; i < NX; ++i) {
            state[i] = x[i] + h * stage_ahead[stage] * slope[i];
        }
        locate(state, &at);
        field(constants, &at, state + NQ, u, slope);
        for (int i = 0; i < NX; ++i) {
            next[i] += h * stage_share[stage] * slope[i];
        }
    }
    store(NX, 1, next, res[0]);
    return checked(status, MODULE(dyn_disc_phi_fun_sparsity_out), res);
}
