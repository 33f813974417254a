/*
 * States that follow each other in memory, through a function that takes blocks of eight.
 *
 * The functions of an emitted C module that end in _batch take each entry of eight states side by
 * side. NumPy has one state after the other. This turns eight states at a time, in buffers small
 * enough to stay in the cache. Constants that differ from state to state are turned as inputs are.
 */

#define IN_BLOCKS
#include "arrays.h"

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
BatchCall gibbs_codegen_rows;
#ifdef __cplusplus
}
#endif

typedef double real;
typedef struct {
    const real *entries;
    size_t by_state, by_step;
} Rows;

#include "platform.c"

/* Nothing is computed with the entries of a block: any compiler will do. */
typedef real number;
typedef bits number_bits;

#include "rows.c"

int gibbs_codegen_lost(void)
{
    return lost_here();
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

/* Whole blocks by themselves: how many lanes they have is then known where this is compiled. */
static void pack(const double *rows, int filled, int width, double *block)
{
    const Rows all = rows_of(rows, (size_t)width);
    if (filled == LANES) {
        load_rows(all, 0.0, 0, LANES, 0, width, block);
    } else {
        load_rows(all, 0.0, 0, filled, 0, width, block);
    }
}

static void unpack(const double *block, int filled, int width, double *rows)
{
    if (filled == LANES) {
        store_rows(block, LANES, width, (size_t)width, rows);
    } else {
        store_rows(block, filled, width, (size_t)width, rows);
    }
}

int gibbs_codegen_rows(
    void (*batch)(void),
    const void *constants,
    size_t count,
    int inputs,
    int outputs,
    const size_t *widths,
    double *const *arrays,
    double *scratch)
{
    double *block[MAX_ARRAYS];
    const int taken = inputs + outputs, with_constants = constants ? taken : taken + 1;
    if (taken < 1 || taken >= MAX_ARRAYS) {
        return -1;
    }
    (void)lost_here();
    for (int i = 0; i < with_constants; ++i) {
        block[i] = scratch;
        scratch += LANES * widths[i];
    }
    for (size_t first = 0; first < count; first += LANES) {
        const int filled = count - first < LANES ? (int)(count - first) : LANES;
        for (int i = 0; i < with_constants; ++i) {
            if (i < inputs || i == taken) {
                pack(arrays[i] + first * widths[i], filled, (int)widths[i], block[i]);
            }
        }
        call(batch, constants ? constants : block[taken], taken, block);
        for (int i = inputs; i < taken; ++i) {
            unpack(block[i], filled, (int)widths[i], arrays[i] + first * widths[i]);
        }
    }
    return lost_here();
}
