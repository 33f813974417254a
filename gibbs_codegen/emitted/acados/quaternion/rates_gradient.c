#include "place.c"
#include "cross.c"

/* Adds the gradient by x of the rates of q with some weights. */
static void add_rates_gradient(
    const Place *at, const real *v, const real *weights, real *gradient)
{
    const real *of_turn = weights + 3, *q = at->q + 3, *w = v + 3;
    real own[3] = {0.0, 0.0, 0.0}, turned[3], by_q[3], by_w[3];
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < 3; ++i) {
            own[k] += at->map[k][i] * weights[i];
        }
        gradient[NQ + k] += own[k];
    }
    cross(v, own, turned);
    cross(w, of_turn, by_q);
    cross(of_turn, q, by_w);
    for (int j = 3; j < 7; ++j) {
        for (int i = 0; i < 3; ++i) {
            gradient[j] += at->map[3 + i][j] * turned[i];
        }
    }
    for (int i = 0; i < 3; ++i) {
        const real along = q[3] * of_turn[i] + by_w[i] - of_turn[3] * q[i];
        gradient[3 + i] += 0.5 * (by_q[i] - of_turn[3] * w[i]);
        gradient[6] += 0.5 * of_turn[i] * w[i];
        gradient[NQ + 3 + i] += 0.5 * at->length * along;
    }
    for (int i = 7; i < NQ; ++i) {
        gradient[NQ - 1 + i] += weights[i];
    }
}
