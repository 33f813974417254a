#ifndef LANES
#define LANES 1
#endif

/* What differs from state to state is a number, what all states share is a real. */
#if LANES == 1
typedef real number;
typedef real part;
enum { REGISTER = sizeof(number) };
typedef int flags;
typedef bits number_bits;
#define same(value) (value)
#define EACH(function) function
#else
/* No function that takes or returns vectors is called from elsewhere: no convention matters. */
#pragma GCC diagnostic ignored "-Wpsabi"
typedef real number __attribute__((vector_size(LANES * sizeof(real)), may_alias));
#ifdef SINGLE
typedef int32_t flags __attribute__((vector_size(LANES * sizeof(int32_t)), may_alias));
#else
typedef int64_t flags __attribute__((vector_size(LANES * sizeof(int64_t)), may_alias));
#endif
typedef bits number_bits __attribute__((vector_size(LANES * sizeof(real)), may_alias));
#define EACH(function) function##_block

static INLINE number same(const real value)
{
    const number zero = {R(0.0)};
    return value - zero;
}
#endif

/* Numbers that are wider than registers gcc compares entry by entry, and keeps sums of them in
 * memory, but not of their parts. */
#if LANES > 1
#ifdef __clang__
enum { REGISTER = sizeof(number) };
#else
enum { LARGEST = __BIGGEST_ALIGNMENT__, WHOLE = sizeof(number) };
enum { REGISTER = LARGEST < WHOLE ? LARGEST : WHOLE };
#endif
typedef real part __attribute__((vector_size(REGISTER), may_alias));
#endif
enum { PARTS = sizeof(number) / REGISTER };
typedef struct {
    part each[PARTS];
} Parts;
#define PART(x) (((const part *)&(x))[k_part])
#define ADD_IN_PARTS(sum, term) \
    for (int k_part = 0; k_part < PARTS; ++k_part) { \
        sum.each[k_part] += term; \
    }

static INLINE Parts parts_of(const number x)
{
    Parts parts;
    memcpy(&parts, &x, sizeof parts);
    return parts;
}

static INLINE number whole_of(const Parts parts)
{
    number x;
    memcpy(&x, &parts, sizeof x);
    return x;
}

/* Whether a flag of any state is set. */
static INLINE int any(const flags which)
{
#if LANES == 1
    return which;
#else
    int found = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        found |= which[lane] != 0;
    }
    return found;
#endif
}

static INLINE real real_minimum(const real a, const real b)
{
    return b < a ? b : a;
}

static INLINE real real_maximum(const real a, const real b)
{
    return b > a ? b : a;
}

static INLINE real real_choose(const real a, const real b, const real above, const real otherwise)
{
    return a > b ? above : otherwise;
}

static INLINE real real_absolute(const real a)
{
    return LIBRARY(fabs)(a);
}

static INLINE real real_signed_as(const real a, const real sign)
{
    return LIBRARY(copysign)(a, sign);
}

static INLINE real real_square_root(const real a)
{
    return LIBRARY(sqrt)(a);
}

static INLINE real real_exponential(const real a)
{
    return LIBRARY(exp)(a);
}

static INLINE real real_arctan2(const real a, const real b)
{
    return LIBRARY(atan2)(a, b);
}

#if LANES == 1
static INLINE flags greater(const number a, const number b)
{
    return a > b;
}

#define minimum real_minimum
#define maximum real_maximum
#define choose real_choose
#define absolute real_absolute
#define signed_as real_signed_as
#define square_root real_square_root
#define exponential real_exponential
#define arctan2 real_arctan2
#else
/* Whether a is greater than b. */
static INLINE flags greater(const number a, const number b)
{
    number found;
    for (int k = 0; k < PARTS; ++k) {
        ((part *)&found)[k] = (part)(((const part *)&a)[k] > ((const part *)&b)[k]);
    }
    return (flags)found;
}

static INLINE number choose(
    const number a, const number b, const number above, const number otherwise)
{
    const flags which = greater(a, b);
    return (number)(((flags)above & which) | ((flags)otherwise & ~which));
}

static INLINE number minimum(const number a, const number b)
{
    return choose(a, b, b, a);
}

static INLINE number maximum(const number a, const number b)
{
    return choose(b, a, b, a);
}

static INLINE number absolute(const number a)
{
    return (number)((flags)a & ~(flags)same(R(-0.0)));
}

static INLINE number signed_as(const number a, const number sign)
{
    const flags minus = (flags)same(R(-0.0));
    return (number)(((flags)a & ~minus) | ((flags)sign & minus));
}

/* A function of the library in each lane. */
#define IN_LANES(name, each) \
    static INLINE number name(const number a) \
    { \
        number found; \
        for (int lane = 0; lane < LANES; ++lane) { \
            found[lane] = each(a[lane]); \
        } \
        return found; \
    }

IN_LANES(square_root, real_square_root)
IN_LANES(exponential, real_exponential)

static INLINE number arctan2(const number a, const number b)
{
    number found;
    for (int lane = 0; lane < LANES; ++lane) {
        found[lane] = real_arctan2(a[lane], b[lane]);
    }
    return found;
}
#endif

/* The inverse of a matrix (n, n) times another (n, width), by elimination without exchanges. */
static INLINE void solve(
    const int n, const int width, const number *matrix, const number *right, number *solution)
{
    number left[SOLVE_ROOM];
    memcpy(left, matrix, sizeof(number) * (size_t)(n * n));
    memcpy(solution, right, sizeof(number) * (size_t)(n * width));
    for (int k = 0; k < n; ++k) {
        for (int i = k + 1; i < n; ++i) {
            const number share = left[n * i + k] / left[n * k + k];
            for (int j = k + 1; j < n; ++j) {
                left[n * i + j] -= share * left[n * k + j];
            }
            for (int j = 0; j < width; ++j) {
                solution[width * i + j] -= share * solution[width * k + j];
            }
        }
    }
    for (int k = n; k-- > 0;) {
        for (int j = 0; j < width; ++j) {
            number rest = solution[width * k + j];
            for (int i = k + 1; i < n; ++i) {
                rest -= left[n * k + i] * solution[width * i + j];
            }
            solution[width * k + j] = rest / left[n * k + k];
        }
    }
}
