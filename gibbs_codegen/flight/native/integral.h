/* Integral action, as `control/laws.py` has it. */

#ifndef GIBBS_CODEGEN_INTEGRAL_H
#define GIBBS_CODEGEN_INTEGRAL_H

#include "loop.h"

/* Whether a commanded input is at a limit, or beyond. */
static INLINE flags at_limits(const Loop *f, const number *inputs)
{
    flags reached = {0};
    for (ptrdiff_t k = 0; f->actuators.limited && k < inputs_of(f); ++k) {
        const number least = f->actuators.least[k], width = f->actuators.most[k] - least;
        const number margin = choose(are_finite(width), 1e-9 * width, same(0.0));
        reached |= (flags)(inputs[k] <= least + margin);
        reached |= (flags)(inputs[k] >= f->actuators.most[k] - margin);
    }
    return reached;
}

/* Let nothing that is remembered grow away from 0 where an input is at a limit. */
static void keep_from_winding(const Loop *f, flags wound, const number *memory, number *growth)
{
    for (ptrdiff_t i = 0; i < layout_of(f)->memory; ++i) {
        const flags away = wound & (flags)(growth[i] * memory[i] >= 0.0);
        growth[i] = choose(away, same(0.0), growth[i]);
    }
}

#endif
