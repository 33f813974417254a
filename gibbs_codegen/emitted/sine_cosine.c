/*
 * Sine and cosine. The nearest multiple m of pi/2 is subtracted from the angle, in parts of which
 * all but the last multiply exactly; the rounding error of the remainder is kept. Polynomials give
 * the sine and cosine of the remainder; m says which of them is which, and their signs. There is
 * one branch: the library computes angles beyond ANGLE_LIMIT and infinities, and every angle where
 * the compiler may reorder the arithmetic.
 */
#include "sine_cosine_series.c"

#ifdef REORDERED
#undef ANGLE_LIMIT
#define ANGLE_LIMIT 0
#elif defined(__GNUC__) && (defined(__SSE2__) || defined(__aarch64__))
#define QUAD
#endif

/* Sine and cosine of one angle. */
#define KERNEL sine_cosine_one
#define NUMBER real
#define BITS bits
#include "sine_cosine_kernel.c"
#undef KERNEL
#undef NUMBER
#undef BITS

/* Of four angles in a vector, where there are vectors. */
#ifdef QUAD
typedef real quad __attribute__((vector_size(4 * sizeof(real))));
typedef bits quad_bits __attribute__((vector_size(4 * sizeof(real))));
#define KERNEL sine_cosine_quad
#define NUMBER quad
#define BITS quad_bits
#include "sine_cosine_kernel.c"
#undef KERNEL
#undef NUMBER
#undef BITS
#endif

/* Angles beyond ANGLE_LIMIT only, so that they do not change the results of the others. */
static COLD void library_sine_cosine(const int count, const real *angle, real *sine, real *cosine)
{
    for (int i = 0; i < count; ++i) {
        bits angle_bits;
        memcpy(&angle_bits, angle + i, sizeof angle_bits);
        if ((angle_bits & MAGNITUDE) > ANGLE_LIMIT) {
            sine[i] = LIBRARY(sin)(angle[i]);
            cosine[i] = LIBRARY(cos)(angle[i]);
        }
    }
}

/* Up to four angles. */
static INLINE void sine_cosine_few(const int count, const real *RESTRICT angle,
    real *RESTRICT sine, real *RESTRICT cosine)
{
    bits beyond = 0;
#ifdef QUAD
    const real zero = R(0.0);
    const quad x = {
        angle[0],
        count > 1 ? angle[1] : zero,
        count > 2 ? angle[2] : zero,
        count > 3 ? angle[3] : zero,
    };
    quad sine_quad, cosine_quad;
    quad_bits beyond_quad;
    sine_cosine_quad(&x, &sine_quad, &cosine_quad, &beyond_quad);
    for (int i = 0; i < count; ++i) {
        sine[i] = sine_quad[i];
        cosine[i] = cosine_quad[i];
        beyond |= beyond_quad[i];
    }
#else
    for (int i = 0; i < count; ++i) {
        bits here;
        sine_cosine_one(angle + i, sine + i, cosine + i, &here);
        beyond |= here;
    }
#endif
    if (beyond) {
        library_sine_cosine(count, angle, sine, cosine);
    }
}

/* Any number of angles. */
static INLINE void sine_cosine_many(const int count, const real *RESTRICT angle,
    real *RESTRICT sine, real *RESTRICT cosine)
{
    bits beyond = 0;
    VECTORISE
    for (int i = 0; i < count; ++i) {
        bits here;
        sine_cosine_one(angle + i, sine + i, cosine + i, &here);
        beyond |= here;
    }
    if (beyond) {
        library_sine_cosine(count, angle, sine, cosine);
    }
}
