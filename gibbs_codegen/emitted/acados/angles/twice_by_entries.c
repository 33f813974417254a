#include "place.c"

/*
 * Second derivatives by x and `rest` further variables, from those by displacements, v and these;
 * the rates of q have none.
 */
static void twice_by_entries(
    const Place *at,
    const real *v,
    const real *weights,
    const int rest,
    real *gradient,
    real *tangent,
    real *entries)
{
    (void)at;
    (void)v;
    (void)weights;
    (void)gradient;
    for (int i = 0; i < (NX + rest) * (NX + rest); ++i) {
        entries[i] = tangent[i];
    }
}
