/* The least and the greatest inputs of steps that follow each other. */

#ifndef GIBBS_CODEGEN_RANGES_H
#define GIBBS_CODEGEN_RANGES_H

#include <stddef.h>

/* Make `range`, the least values and then the greatest, hold `values` too; NULL holds nothing. */
static void widen(ptrdiff_t count, const double *values, double *range)
{
    for (ptrdiff_t i = 0; range && i < count; ++i) {
        range[i] = values[i] < range[i] ? values[i] : range[i];
        range[count + i] = values[i] > range[count + i] ? values[i] : range[count + i];
    }
}

#endif
