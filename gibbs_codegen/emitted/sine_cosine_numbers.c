static INLINE real sine_real(const real a)
{
    real sine, cosine;
    sine_cosine_many(1, &a, &sine, &cosine);
    return sine;
}

static INLINE real cosine_real(const real a)
{
    real sine, cosine;
    sine_cosine_many(1, &a, &sine, &cosine);
    return cosine;
}

#if LANES == 1
#define sine sine_real
#define cosine cosine_real
#else
typedef bits number_bits __attribute__((vector_size(LANES * sizeof(real)), may_alias));
#define KERNEL sine_cosine_number
#define NUMBER number
#define BITS number_bits
#include "sine_cosine_kernel.c"
#undef KERNEL
#undef NUMBER
#undef BITS

/* Sine and cosine of a number, of which one that is not asked for costs nothing. */
static INLINE void sine_and_cosine(const number a, number *sine_of, number *cosine_of)
{
    number_bits beyond;
    bits any = 0;
    sine_cosine_number(&a, sine_of, cosine_of, &beyond);
    for (int lane = 0; lane < LANES; ++lane) {
        any |= beyond[lane];
    }
    if (any) {
        library_sine_cosine(LANES, (const real *)&a, (real *)sine_of, (real *)cosine_of);
    }
}

static INLINE number sine(const number a)
{
    number sine_of, cosine_of;
    sine_and_cosine(a, &sine_of, &cosine_of);
    return sine_of;
}

static INLINE number cosine(const number a)
{
    number sine_of, cosine_of;
    sine_and_cosine(a, &sine_of, &cosine_of);
    return cosine_of;
}
#endif
