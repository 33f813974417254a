#include "place.c"
#include "cross.c"

/* Adds half the product of a quaternion and an angular velocity. */
static void add_half_product(const real *q, const real *w, const real scale, real *result)
{
    result[0] += 0.5 * scale * (q[3] * w[0] + q[1] * w[2] - q[2] * w[1]);
    result[1] += 0.5 * scale * (q[3] * w[1] + q[2] * w[0] - q[0] * w[2]);
    result[2] += 0.5 * scale * (q[3] * w[2] + q[0] * w[1] - q[1] * w[0]);
    result[3] -= 0.5 * scale * (q[0] * w[0] + q[1] * w[1] + q[2] * w[2]);
}

/* Derivative of the rates of q in the direction `moved` of x. */
static void rates_along(const Place *at, const real *v, const real *moved, real *result)
{
    real turned[3] = {0.0, 0.0, 0.0}, velocity[3];
    for (int i = 0; i < 3; ++i) {
        for (int j = 3; j < 7; ++j) {
            turned[i] += at->map[3 + i][j] * moved[j];
        }
    }
    cross(turned, v, velocity);
    for (int i = 0; i < 3; ++i) {
        result[i] = 0.0;
        for (int k = 0; k < 3; ++k) {
            result[i] += at->map[k][i] * (velocity[k] + moved[NQ + k]);
        }
    }
    for (int i = 3; i < 7; ++i) {
        result[i] = 0.0;
    }
    add_half_product(moved + 3, v + 3, 1.0, result + 3);
    add_half_product(at->q + 3, moved + NQ + 3, at->length, result + 3);
    for (int i = 7; i < NQ; ++i) {
        result[i] = moved[NQ - 1 + i];
    }
}
