/* Calls of functions whose last arguments are arrays, of which they have different numbers. */
#include <fenv.h>
#include <stddef.h>

/* States in a block. */
#define LANES 8
/* Inputs, outputs, and constants of each state. */
#define MAX_ARRAYS 13

/*
 * What calls a function for blocks of states. `arrays` are its inputs and then its outputs, each
 * with `count` rows of its width. Where `constants` is NULL, one more array has those of each
 * state, and `batch` takes them in blocks. `scratch` holds LANES states of all arrays. Returns 0
 * where finite inputs gave finite outputs, 1 where they may not have, and -1 where there are too
 * many arrays.
 */
typedef int BatchCall(
    void (*batch)(void),
    const void *constants,
    size_t count,
    int inputs,
    int outputs,
    const size_t *widths,
    double *const *arrays,
    double *scratch);

/* Calls a function that takes constants and, in blocks, how many states there are. */
#ifdef IN_BLOCKS
#define TYPES_0 const void *, size_t
#define VALUES_0 constants, LANES
#else
#define TYPES_0 const void *
#define VALUES_0 constants
#endif
#define TYPES_1 TYPES_0, double *
#define TYPES_2 TYPES_1, double *
#define TYPES_3 TYPES_2, double *
#define TYPES_4 TYPES_3, double *
#define TYPES_5 TYPES_4, double *
#define TYPES_6 TYPES_5, double *
#define TYPES_7 TYPES_6, double *
#define TYPES_8 TYPES_7, double *
#define TYPES_9 TYPES_8, double *
#define TYPES_10 TYPES_9, double *
#define TYPES_11 TYPES_10, double *
#define TYPES_12 TYPES_11, double *
#define VALUES_1 VALUES_0, arrays[0]
#define VALUES_2 VALUES_1, arrays[1]
#define VALUES_3 VALUES_2, arrays[2]
#define VALUES_4 VALUES_3, arrays[3]
#define VALUES_5 VALUES_4, arrays[4]
#define VALUES_6 VALUES_5, arrays[5]
#define VALUES_7 VALUES_6, arrays[6]
#define VALUES_8 VALUES_7, arrays[7]
#define VALUES_9 VALUES_8, arrays[8]
#define VALUES_10 VALUES_9, arrays[9]
#define VALUES_11 VALUES_10, arrays[10]
#define VALUES_12 VALUES_11, arrays[11]
#define CASE(n) \
    case n: \
        ((void (*)(TYPES_##n))function)(VALUES_##n); \
        break;

static inline void call(
    void (*function)(void), const void *constants, int number, double *const *arrays)
{
    switch (number) {
        CASE(1) CASE(2) CASE(3) CASE(4) CASE(5) CASE(6)
        CASE(7) CASE(8) CASE(9) CASE(10) CASE(11) CASE(12)
    }
}

/*
 * Whether finite numbers may have made one that is not, in this thread since it was last asked: the
 * processor raises a flag then, which costs nothing. One without flags may have at any time.
 */
static inline int lost_here(void)
{
#if defined(FE_OVERFLOW) && defined(FE_DIVBYZERO) && defined(FE_INVALID)
    if (!fetestexcept(FE_OVERFLOW | FE_DIVBYZERO | FE_INVALID)) {
        return 0;
    }
    feclearexcept(FE_OVERFLOW | FE_DIVBYZERO | FE_INVALID);
#endif
    return 1;
}
