#include "place.c"

/* Derivatives by entries of q, from those by displacements. */
static void by_entries(const Place *at, const real *by_displacement, real *by_entry)
{
    (void)at;
    for (int i = 0; i < NQ; ++i) {
        by_entry[i] = by_displacement[i];
    }
}
