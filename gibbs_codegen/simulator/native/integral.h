/* Integral action, as `control/integral.py` has it. */

#ifndef GIBBS_CODEGEN_INTEGRAL_H
#define GIBBS_CODEGEN_INTEGRAL_H

#include <math.h>

#include "loop.h"

/* Whether a commanded input is at a limit, or beyond. */
static int at_limits(const Loop *f, const double *inputs)
{
    for (ptrdiff_t k = 0; f->actuators.limited && k < inputs_of(f); ++k) {
        const double least = f->actuators.least[k], most = f->actuators.most[k];
        const double margin = isfinite(most - least) ? 1e-9 * (most - least) : 0.0;
        if (inputs[k] <= least + margin || inputs[k] >= most - margin) {
            return 1;
        }
    }
    return 0;
}

/* Let nothing that is remembered grow away from 0. */
static void keep_from_winding(const Loop *f, const double *memory, double *growth)
{
    for (ptrdiff_t i = 0; i < f->layout.memory; ++i) {
        growth[i] = growth[i] * memory[i] >= 0.0 ? 0.0 : growth[i];
    }
}

#endif
