/* STATE is the length of a state, RANGED how many inputs a step or a slope tells. */

/* The least and the greatest of inputs so far. */
static INLINE void widen(const number *inputs, real *range)
{
    for (int i = 0; range && i < RANGED; ++i) {
        const real value = ((const real *)inputs)[i * LANES];
        range[i] = real_minimum(range[i], value);
        range[RANGED + i] = real_maximum(range[RANGED + i], value);
    }
}
