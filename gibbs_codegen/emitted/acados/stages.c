#include "runge_kutta.c"
#include "slopes.c"

/* The stages of a step, with the derivatives of the accelerations there. */
typedef struct {
    real h;
    real states[4][NX];
    Place at[4];
    real by[4][NV * NXU];
} Stages;

static void take_step(
    const Constants *constants,
    const real *x,
    const real *u,
    const real h,
    Stages *taken,
    real *next)
{
    real slope[NX] = {0.0};
    taken->h = h;
    store(NX, 1, x, next);
    for (int stage = 0; stage < 4; ++stage) {
        real *state = taken->states[stage];
        for (int i = 0; i < NX; ++i) {
            state[i] = x[i] + h * stage_ahead[stage] * slope[i];
        }
        locate(state, &taken->at[stage]);
        slopes(constants, &taken->at[stage], state + NQ, u, slope, taken->by[stage]);
        for (int i = 0; i < NX; ++i) {
            next[i] += h * stage_share[stage] * slope[i];
        }
    }
}

/* A column of derivatives by x and u: of the state of each stage, and of the result. */
static void step_column(
    const Stages *taken, const int column, real moved[4][NXU], real *next)
{
    real slope[NX] = {0.0};
    for (int i = 0; i < NX; ++i) {
        next[i] = i == column ? 1.0 : 0.0;
    }
    for (int stage = 0; stage < 4; ++stage) {
        real *own = moved[stage];
        for (int i = 0; i < NXU; ++i) {
            own[i] = i == column ? 1.0 : 0.0;
        }
        for (int i = 0; i < NX; ++i) {
            own[i] += taken->h * stage_ahead[stage] * slope[i];
        }
        along(
            &taken->at[stage], taken->states[stage] + NQ, taken->by[stage], NXU, own, slope);
        for (int i = 0; i < NX; ++i) {
            next[i] += taken->h * stage_share[stage] * slope[i];
        }
    }
}

/* acados has u before x, and the matrix transposed. */
static int u_then_x(const int i)
{
    return i < NX ? NU + i : i - NX;
}
