/*
 * Sine and cosine. The nearest multiple m of pi/2 is subtracted from the angle, in parts of which
 * all but the last multiply exactly; the rounding error of the remainder is kept. Polynomials give
 * the sine and cosine of the remainder; m says which of them is which, and their signs. There is
 * one branch: the library computes angles beyond ANGLE_LIMIT and infinities, and every angle where
 * the compiler may reorder the arithmetic.
 */
#ifdef SINGLE
#define ANGLE_LIMIT UINT32_C(0x43c80000) /* 400 as float */
#define ROUND R(12582912.0)              /* 1.5 * 2^23 */
#define HALF_PI_1 R(1.570770263671875)
#define HALF_PI_2 R(2.606306225061416626e-05)
#define HALF_PI_REST(m) ((m) * R(6.077094383272196865e-11) + (m) * R(6.123233995736765886e-17))
#define SINE_SERIES(z, zz)                                                                     \
    ((R(-0.16666654908636106869) + (z) * R(0.008332175846584764919)) +                         \
     (zz) * R(-0.00019516977498448928726))
#define COSINE_SERIES(z, zz)                                                                   \
    ((R(0.041666646807190746216) + (z) * R(-0.0013887364485517624984)) +                       \
     (zz) * R(0.000024438090961243314256))
#else
#define ANGLE_LIMIT UINT64_C(0x40f86a0000000000) /* 100000 as double */
#define ROUND R(6755399441055744.0)              /* 1.5 * 2^52 */
#define HALF_PI_1 R(1.570796326792333275079727)
#define HALF_PI_2 R(2.563344151583955789121955e-12)
#define HALF_PI_REST(m) ((m) * R(1.056299906698742711241868e-23))
#define SINE_SERIES(z, zz)                                                                     \
    ((R(-0.1666666666666663186) + (z) * R(0.008333333333322369958)) +                          \
     (zz) * ((R(-0.00019841269829771154519) + (z) * R(2.755731367866183082e-06)) +             \
             (zz) * (R(-2.5050755960800009268e-08) + (z) * R(1.5896666472027738053e-10))))
#define COSINE_SERIES(z, zz)                                                                   \
    ((R(0.041666666666666599153) + (z) * R(-0.0013888888888874064882)) +                       \
     (zz) * ((R(0.000024801587289443480916) + (z) * R(-2.7557314340660010951e-07)) +           \
             (zz) * (R(2.0875721623861680061e-09) + (z) * R(-1.1359559340405310137e-11))))
#endif

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
