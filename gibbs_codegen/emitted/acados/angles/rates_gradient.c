#include "place.c"

/* Adds the gradient by x of the rates of q with some weights. */
static void add_rates_gradient(
    const Place *at, const real *v, const real *weights, real *gradient)
{
    (void)at;
    (void)v;
    for (int i = 0; i < NQ; ++i) {
        gradient[NQ + i] += weights[i];
    }
}
