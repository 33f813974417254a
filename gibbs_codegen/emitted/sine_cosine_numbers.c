/* Sines and cosines of `count` angles. */
static INLINE void real_sines_and_cosines(
    const int count, const real *angles, real *sines, real *cosines)
{
    if (count > 4) {
        sine_cosine_many(count, angles, sines, cosines);
    } else {
        sine_cosine_few(count, angles, sines, cosines);
    }
}

static INLINE void real_sine_and_cosine(const real angle, real *sine, real *cosine)
{
    sine_cosine_few(1, &angle, sine, cosine);
}

#if LANES == 1
#define sines_and_cosines real_sines_and_cosines
#define sine_and_cosine real_sine_and_cosine
#else
#define KERNEL sine_cosine_number
#define NUMBER number
#define BITS number_bits
#include "sine_cosine_kernel.c"
#undef KERNEL
#undef NUMBER
#undef BITS

static INLINE void sines_and_cosines(
    const int count, const number *angles, number *sines, number *cosines)
{
    number_bits beyond = {0};
    for (int i = 0; i < count; ++i) {
        number_bits here;
        sine_cosine_number(angles + i, sines + i, cosines + i, &here);
        beyond |= here;
    }
    if (any((flags)beyond)) {
        library_sine_cosine(
            count * LANES, (const real *)angles, (real *)sines, (real *)cosines);
    }
}

static INLINE void sine_and_cosine(const number angle, number *sine, number *cosine)
{
    sines_and_cosines(1, &angle, sine, cosine);
}
#endif
