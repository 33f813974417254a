#include "place.c"

/* Derivatives by entries of q, from those by displacements. */
static void by_entries(const Place *at, const real *by_displacement, real *by_entry)
{
    for (int j = 0; j < 7; ++j) {
        by_entry[j] = 0.0;
        for (int i = 0; i < 6; ++i) {
            by_entry[j] += by_displacement[i] * at->map[i][j];
        }
    }
    for (int i = 6; i < NV; ++i) {
        by_entry[i + 1] = by_displacement[i];
    }
}
