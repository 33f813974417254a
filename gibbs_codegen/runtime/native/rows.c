/*
 * States that follow each other in memory, through a function that takes blocks of eight.
 *
 * The functions of an emitted C module that end in _batch take each entry of eight states side by
 * side. NumPy has one state after the other. This turns eight states at a time, in buffers small
 * enough to stay in the cache. Constants that differ from state to state are turned as inputs are.
 */

#include <fenv.h>
#include <stddef.h>
#include <string.h>

#ifndef GIBBS_CODEGEN_ROWS
#define GIBBS_CODEGEN_ROWS gibbs_codegen_rows
#endif

#define LANES 8
/* Inputs and outputs; constants of each state come on top. */
#define MAX_ARRAYS 9

#ifdef __cplusplus
extern "C" {
#endif
int gibbs_codegen_lost(void);
size_t gibbs_codegen_constants_of_each(
    int (*init)(const double *, void *),
    size_t count,
    size_t parameters_width,
    size_t constants_width,
    const double *parameters,
    double *constants);
int GIBBS_CODEGEN_ROWS(
    void (*batch)(void),
    const void *constants,
    size_t count,
    int inputs,
    int outputs,
    const size_t *widths,
    double *const *arrays,
    double *scratch);
#ifdef __cplusplus
}
#endif

/* A batch function of a number of arrays. */
#define R double *
typedef void One(const void *, size_t, R);
typedef void Two(const void *, size_t, R, R);
typedef void Three(const void *, size_t, R, R, R);
typedef void Four(const void *, size_t, R, R, R, R);
typedef void Five(const void *, size_t, R, R, R, R, R);
typedef void Six(const void *, size_t, R, R, R, R, R, R);
typedef void Seven(const void *, size_t, R, R, R, R, R, R, R);
typedef void Eight(const void *, size_t, R, R, R, R, R, R, R, R);
typedef void Nine(const void *, size_t, R, R, R, R, R, R, R, R, R);
#undef R

/*
 * Whether finite numbers may have made one that is not, in this thread since it was last asked: the
 * processor raises a flag then, which costs nothing. One without flags may have at any time.
 */
int gibbs_codegen_lost(void)
{
#if defined(FE_OVERFLOW) && defined(FE_DIVBYZERO) && defined(FE_INVALID)
    if (!fetestexcept(FE_OVERFLOW | FE_DIVBYZERO | FE_INVALID)) {
        return 0;
    }
    feclearexcept(FE_OVERFLOW | FE_DIVBYZERO | FE_INVALID);
#endif
    return 1;
}

static void call_block(void (*batch)(void), const void *constants, int number, double *const *b)
{
    switch (number) {
    case 1:
        ((One *)batch)(constants, LANES, b[0]);
        break;
    case 2:
        ((Two *)batch)(constants, LANES, b[0], b[1]);
        break;
    case 3:
        ((Three *)batch)(constants, LANES, b[0], b[1], b[2]);
        break;
    case 4:
        ((Four *)batch)(constants, LANES, b[0], b[1], b[2], b[3]);
        break;
    case 5:
        ((Five *)batch)(constants, LANES, b[0], b[1], b[2], b[3], b[4]);
        break;
    case 6:
        ((Six *)batch)(constants, LANES, b[0], b[1], b[2], b[3], b[4], b[5]);
        break;
    case 7:
        ((Seven *)batch)(constants, LANES, b[0], b[1], b[2], b[3], b[4], b[5], b[6]);
        break;
    case 8:
        ((Eight *)batch)(constants, LANES, b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]);
        break;
    default:
        ((Nine *)batch)(constants, LANES, b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]);
        break;
    }
}

#ifdef __GNUC__
typedef double Vector __attribute__((vector_size(LANES * sizeof(double)), aligned(8), may_alias));
typedef long long Order __attribute__((vector_size(LANES * sizeof(double))));

#ifdef __clang__
#define MIX(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define MIX(a, b, ...) __builtin_shuffle(a, b, (Order){__VA_ARGS__})
#endif

/* Eight rows of eight become eight columns; rows may lie any distance apart on either side. */
static void transpose(const double *from, size_t from_step, double *to, size_t to_step)
{
    Vector row[LANES], pair[LANES], four[LANES];
    for (int i = 0; i < LANES; ++i) {
        row[i] = *(const Vector *)(from + (size_t)i * from_step);
    }
    for (int i = 0; i < LANES; i += 2) {
        pair[i] = MIX(row[i], row[i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
        pair[i + 1] = MIX(row[i], row[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    }
    for (int i = 0; i < LANES; i += 4) {
        for (int j = i; j < i + 2; ++j) {
            four[j] = MIX(pair[j], pair[j + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            four[j + 2] = MIX(pair[j], pair[j + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    }
    for (int i = 0; i < 4; ++i) {
        const Vector low = MIX(four[i], four[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        const Vector high = MIX(four[i], four[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
        *(Vector *)(to + (size_t)i * to_step) = low;
        *(Vector *)(to + (size_t)(i + 4) * to_step) = high;
    }
}
#else
static void transpose(const double *from, size_t from_step, double *to, size_t to_step)
{
    for (size_t i = 0; i < LANES; ++i) {
        for (size_t j = 0; j < LANES; ++j) {
            to[j * to_step + i] = from[i * from_step + j];
        }
    }
}
#endif

/* The states that are there, and the last of them again in lanes that would be empty. */
static void pack(const double *rows, size_t filled, size_t width, double *block)
{
    size_t i = 0;
    if (filled == LANES) {
        for (; i + LANES <= width; i += LANES) {
            transpose(rows + i, width, block + i * LANES, LANES);
        }
    }
    for (; i < width; ++i) {
        for (size_t lane = 0; lane < LANES; ++lane) {
            block[i * LANES + lane] = rows[(lane < filled ? lane : filled - 1) * width + i];
        }
    }
}

static void unpack(const double *block, size_t filled, size_t width, double *rows)
{
    size_t i = 0;
    if (filled == LANES) {
        for (; i + LANES <= width; i += LANES) {
            transpose(block + i * LANES, LANES, rows + i, width);
        }
    }
    for (; i < width; ++i) {
        for (size_t lane = 0; lane < filled; ++lane) {
            rows[lane * width + i] = block[i * LANES + lane];
        }
    }
}

/*
 * Constants of each state for its parameters, by the function for one state. Returns 0, or 1 and
 * the number of the first state whose constants are of no use.
 */
size_t gibbs_codegen_constants_of_each(
    int (*init)(const double *, void *),
    size_t count,
    size_t parameters_width,
    size_t constants_width,
    const double *parameters,
    double *constants)
{
    for (size_t i = 0; i < count; ++i) {
        if (init(parameters + i * parameters_width, constants + i * constants_width)) {
            return i + 1;
        }
    }
    return 0;
}

/*
 * `arrays` are the inputs and then the outputs of `batch`, each with `count` rows of its width.
 * Where `constants` is NULL, one more array has those of each state, and `batch` takes them in
 * blocks. `scratch` holds LANES states of all arrays. Returns 0 where finite inputs gave finite
 * outputs, 1 where they may not have, and -1 where there are too many arrays.
 */
int GIBBS_CODEGEN_ROWS(
    void (*batch)(void),
    const void *constants,
    size_t count,
    int inputs,
    int outputs,
    const size_t *widths,
    double *const *arrays,
    double *scratch)
{
    double *block[MAX_ARRAYS + 1];
    const int number = inputs + outputs, arrays_given = constants ? number : number + 1;
    if (number < 1 || number > MAX_ARRAYS) {
        return -1;
    }
    (void)gibbs_codegen_lost();
    for (int i = 0; i < arrays_given; ++i) {
        block[i] = scratch;
        scratch += LANES * widths[i];
    }
    for (size_t first = 0; first < count; first += LANES) {
        const size_t filled = count - first < LANES ? count - first : LANES;
        for (int i = 0; i < inputs; ++i) {
            pack(arrays[i] + first * widths[i], filled, widths[i], block[i]);
        }
        if (!constants) {
            const size_t width = widths[number];
            pack(arrays[number] + first * width, filled, width, block[number]);
        }
        call_block(batch, constants ? constants : block[number], number, block);
        for (int i = inputs; i < number; ++i) {
            unpack(block[i], filled, widths[i], arrays[i] + first * widths[i]);
        }
    }
    return gibbs_codegen_lost();
}
