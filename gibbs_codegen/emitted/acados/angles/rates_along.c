#include "by_entries.c"

/* Derivative of the rates of q in the direction `moved` of x. */
static void rates_along(const Place *at, const real *v, const real *moved, real *result)
{
    (void)v;
    by_entries(at, moved + NQ, result);
}
