#ifdef __GNUC__
#define COLD __attribute__((noinline, cold))
#else
#define COLD
#endif

/* Distance of the second bit of a small whole number from the sign bit of a real. */
#ifdef SINGLE
#define SIGN_SHIFT 30
#else
#define SIGN_SHIFT 62
#endif

/*
 * Some sums keep their rounding errors, so their order matters. Where a compiler may reorder
 * arithmetic, STEPWISE makes it store every intermediate number.
 */
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST) || \
    FLT_EVAL_METHOD < 0 || FLT_EVAL_METHOD == 1 || FLT_EVAL_METHOD == 2
#define REORDERED
#define STEPWISE volatile
#else
#define STEPWISE
#endif

#ifdef __clang__
#define AS_WRITTEN _Pragma("clang fp reassociate(off)")
#else
#define AS_WRITTEN
#endif

/* It checks the bits, because with -ffast-math compilers assume that every number is finite. */
static INLINE int is_finite(const real value)
{
    bits value_bits;
    memcpy(&value_bits, &value, sizeof value_bits);
    return (value_bits & MAGNITUDE) < NOT_FINITE;
}
