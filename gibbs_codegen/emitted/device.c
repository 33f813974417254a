/* NVRTC has no headers of C. */
#ifdef __CUDACC_RTC__
typedef unsigned int uint32_t;
typedef unsigned long long uint64_t;
#define UINT32_C(literal) literal##u
#define UINT64_C(literal) literal##ull
#define DBL_MANT_DIG 53
#define NAN __int_as_float(0x7fffffff)
#define INFINITY __int_as_float(0x7f800000)
#else
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#endif
#define RESTRICT __restrict__
#define INLINE __device__ __forceinline__ __attribute__((unused))
#define VECTORISE
#define ENTRYWISE

#include "literals.c"

#include "exactness.c"

#include "arctangent.c"

/*
 * Sine and cosine as in C, but NaN for angles beyond ANGLE_LIMIT: a branch to the library would
 * slow every step.
 */
#include "sine_cosine_series.c"

#define KERNEL sine_cosine_one
#define NUMBER real
#define BITS bits
#include "sine_cosine_kernel.c"
#undef KERNEL
#undef NUMBER
#undef BITS

static INLINE void sine_cosine_few(const int count, const real *RESTRICT angle,
    real *RESTRICT sine, real *RESTRICT cosine)
{
    for (int i = 0; i < count; ++i) {
        bits beyond;
        sine_cosine_one(angle + i, sine + i, cosine + i, &beyond);
        if (beyond) {
            sine[i] = cosine[i] = (real)NAN;
        }
    }
}
#define sine_cosine_many sine_cosine_few
