/* The source that stands in every C module, compiled by itself, and what tests call of it. */

#include <stddef.h>

#ifdef SINGLE
typedef float real;
#define LANES 16
#else
typedef double real;
#define LANES 8
#endif
#define MODULE(name) alone_##name

typedef struct {
    real one;
} alone_constants;

#include "runtime.c"

#include "gather.c"

void few(size_t count, size_t group, const real *angle, real *sine, real *cosine);
void many(size_t count, size_t group, const real *angle, real *sine, real *cosine);
void filled(size_t width, size_t lanes, const real *block, real *whole_block);
void packed(size_t count, size_t width, const real *rows, real *blocks);
void unpacked(size_t count, size_t width, const real *blocks, real *rows);
void gathered(int count, const int *rows, const int *columns, int width, const real *matrix,
              real *entries);
int finite_number(const real *value);
void arctangent_of(const real *x, real *angle);
void arctangents(size_t count, const real *RESTRICT x, real *RESTRICT angles);

/* Angles group by group, as the functions for one state do. */
void few(size_t count, size_t group, const real *angle, real *sine, real *cosine)
{
    for (size_t i = 0; i < count; i += group) {
        const size_t size = count - i < group ? count - i : group;
        sine_cosine_few((int)size, angle + i, sine + i, cosine + i);
    }
}

/* Angles group by group, as blocks of states do. */
void many(size_t count, size_t group, const real *angle, real *sine, real *cosine)
{
    for (size_t i = 0; i < count; i += group) {
        const size_t size = count - i < group ? count - i : group;
        sine_cosine_many((int)size, angle + i, sine + i, cosine + i);
    }
}

void filled(size_t width, size_t lanes, const real *block, real *whole_block)
{
    fill_lanes(width, lanes, block, whole_block);
}

void packed(size_t count, size_t width, const real *rows, real *blocks)
{
    pack_rows(count, width, rows, blocks);
}

void unpacked(size_t count, size_t width, const real *blocks, real *rows)
{
    unpack_rows(count, width, blocks, rows);
}

void gathered(int count, const int *rows, const int *columns, int width, const real *matrix,
              real *entries)
{
    gather(count, rows, columns, width, matrix, entries);
}

int finite_number(const real *value)
{
    return is_finite(*value);
}

void arctangent_of(const real *x, real *angle)
{
    *angle = arctangent(*x);
}

/* In a loop over lanes, as blocks of states are computed. */
void arctangents(size_t count, const real *RESTRICT x, real *RESTRICT angles)
{
    for (size_t i = 0; i < count; i += LANES) {
        VECTORISE
        for (int lane = 0; lane < LANES; ++lane) {
            angles[i + (size_t)lane] = arctangent(x[i + (size_t)lane]);
        }
    }
}
