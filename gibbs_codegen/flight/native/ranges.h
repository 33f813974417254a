/* The least and the greatest inputs of steps that follow each other. */

#ifndef GIBBS_CODEGEN_RANGES_H
#define GIBBS_CODEGEN_RANGES_H

#include "number.h"

/* Make `range`, the least values and then the greatest, hold `values` too; NULL holds nothing. */
static void widen(ptrdiff_t count, const number *restrict values, number *restrict range)
{
    if (!range) {
        return;
    }
    number *restrict const greatest = range + count;
    for (ptrdiff_t i = 0; i < count; ++i) {
        const number value = values[i], low = range[i], high = greatest[i];
        range[i] = choose((flags)(value < low), value, low);
        greatest[i] = choose((flags)(value > high), value, high);
    }
}

#endif
