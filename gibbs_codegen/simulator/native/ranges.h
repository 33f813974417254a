/* The least and the greatest inputs of steps that follow each other. */

#ifndef GIBBS_CODEGEN_RANGES_H
#define GIBBS_CODEGEN_RANGES_H

#include <stddef.h>

/* Make `range`, the least values and then the greatest, hold `values` too; NULL holds nothing. */
static void widen(ptrdiff_t count, const double *restrict values, double *restrict range)
{
    if (!range) {
        return;
    }
    double *restrict const greatest = range + count;
    for (ptrdiff_t i = 0; i < count; ++i) {
        const double value = values[i], low = range[i], high = greatest[i];
        range[i] = value < low ? value : low;
        greatest[i] = value > high ? value : high;
    }
}

#endif
