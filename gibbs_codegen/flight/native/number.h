/*
 * Numbers of one state, or of a block of LANES states side by side, for which the same text is
 * compiled: what differs from state to state is a `number`, what all states share is a `double`.
 * `flags` tell something of each state; a block's are all ones or all zeros, so that they choose.
 */

#ifndef GIBBS_CODEGEN_NUMBER_H
#define GIBBS_CODEGEN_NUMBER_H

#include <stddef.h>
#include <stdint.h>

typedef double real;
#include "../../emitted/platform.c"

#include "../../emitted/exactness.c"

#include "../../emitted/sine_cosine.c"

#ifndef LANES
#define LANES 1
#endif

/* ROBOT and OF are how functions of a module take constants: those of blocks are told how many
 * states there are. */
#if LANES == 1
typedef double number;
typedef int flags;
#define ROBOT const void *
#define OF(constants) constants
#else
/* No function that takes or returns vectors is called from elsewhere: no convention matters. */
#pragma GCC diagnostic ignored "-Wpsabi"
typedef double number __attribute__((vector_size(LANES * sizeof(double)), may_alias));
typedef int64_t flags __attribute__((vector_size(LANES * sizeof(int64_t)), may_alias));
#define ROBOT const void *, size_t
#define OF(constants) constants, (size_t)LANES
#endif

/* The flag of one state. */
static INLINE int flag(flags which, int lane)
{
#if LANES == 1
    return which && lane == 0;
#else
    return which[lane] != 0;
#endif
}

/* Flags that are set for one state alone. */
static INLINE flags only(int lane)
{
#if LANES == 1
    return lane == 0;
#else
    flags which = {0};
    which[lane] = -1;
    return which;
#endif
}

static INLINE flags opposite(flags which)
{
#if LANES == 1
    return !which;
#else
    return ~which;
#endif
}

/* Whether a flag of any state is set. */
static INLINE int any(flags which)
{
#if LANES == 1
    return which;
#else
    int64_t found = 0;
    for (int lane = 0; lane < LANES; ++lane) {
        found |= which[lane];
    }
    return found != 0;
#endif
}

/* The same for all states. */
static INLINE number same(double value)
{
#if LANES == 1
    return value;
#else
    return value - (number){0.0};
#endif
}

static INLINE number choose(flags which, number yes, number no)
{
#if LANES == 1
    return which ? yes : no;
#else
    return (number)(((flags)yes & which) | ((flags)no & ~which));
#endif
}

static INLINE number largest(number one, number other)
{
    return choose((flags)(one > other), one, other);
}

static INLINE number magnitude(number value)
{
#if LANES == 1
    return fabs(value);
#else
    return (number)((flags)value & INT64_MAX);
#endif
}

/* The magnitude of one number with the sign of another. */
static INLINE number signed_as(number value, number sign)
{
#if LANES == 1
    return copysign(value, sign);
#else
    return (number)(((flags)value & INT64_MAX) | ((flags)sign & INT64_MIN));
#endif
}

static INLINE flags are_finite(number value)
{
#if LANES == 1
    return is_finite(value);
#else
    double each[LANES];
    int64_t found[LANES];
    flags all;
    memcpy(each, &value, sizeof each);
    for (int lane = 0; lane < LANES; ++lane) {
        found[lane] = -(int64_t)is_finite(each[lane]);
    }
    memcpy(&all, found, sizeof all);
    return all;
#endif
}

static INLINE number root(number value)
{
    double each[LANES];
    memcpy(each, &value, sizeof each);
    for (int lane = 0; lane < LANES; ++lane) {
        each[lane] = sqrt(each[lane]);
    }
    memcpy(&value, each, sizeof each);
    return value;
}

/* The angle, from 0, of a point with coordinates x and y. */
static INLINE number arc_tangent(number y, number x)
{
    double up[LANES], along[LANES];
    memcpy(up, &y, sizeof up);
    memcpy(along, &x, sizeof along);
    for (int lane = 0; lane < LANES; ++lane) {
        up[lane] = atan2(up[lane], along[lane]);
    }
    memcpy(&y, up, sizeof up);
    return y;
}

/* Sines and cosines of three angles. */
static INLINE void sines_of(const number *angle, number *sine, number *cosine)
{
#if LANES == 1
    sine_cosine_few(3, angle, sine, cosine);
#else
    sine_cosine_many(3 * LANES, (const double *)angle, (double *)sine, (double *)cosine);
#endif
}

/* Numbers of one state out of those of all. */
static void gather(ptrdiff_t count, const number *from, int lane, double *one)
{
    const double *const each = (const double *)from;
    for (ptrdiff_t i = 0; i < count; ++i) {
        one[i] = each[i * LANES + lane];
    }
}

/* And back. */
static void scatter(ptrdiff_t count, const double *one, int lane, number *to)
{
    double *const each = (double *)to;
    for (ptrdiff_t i = 0; i < count; ++i) {
        each[i * LANES + lane] = one[i];
    }
}

#endif
