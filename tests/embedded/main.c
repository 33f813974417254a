/*
 * Evaluates every function of a generated module and prints the bytes of all results, so that none
 * of their bits is lost. It runs alike on a microcontroller and on a desktop.
 *
 * cases.h, written by the test, includes the module's header and gives
 *
 *     real, Constants                 types of the module
 *     MODEL(name)                     a function or constant of the module
 *     LANES, PARAMETERS, WIDEST       lengths: of a block, of the parameters, of the largest output
 *     STATES, BLOCKS                  states, and blocks that hold them
 *     ARGUMENTS                       for each argument ARGUMENT(name, width)
 *     all_q and so on                 its values for the states, one after the other
 *     parameters                      what init_constants() is given
 *     FUNCTIONS                       for each function its outputs and its arguments:
 *                                     ONE(name, size, ...) or TWO(name, size, other_size, ...)
 */

#include "cases.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define ROOM (BLOCKS * LANES)

static real first[ROOM * WIDEST], second[ROOM * WIDEST], rows[ROOM * WIDEST];

static void print(const char *name, const char *suffix, size_t count, const real *values)
{
    const unsigned char *bytes = (const unsigned char *)values;
    printf("%s%s ", name, suffix);
    for (size_t i = 0; i < count * sizeof *values; ++i) {
        printf("%02x", (unsigned)bytes[i]);
    }
    printf("\n");
}

static void print_blocks(const char *name, const char *suffix, size_t width, const real *blocks)
{
    MODEL(unpack)(STATES, width, blocks, rows);
    print(name, suffix, STATES * width, rows);
}

static void one_state(const Constants *constants, size_t state)
{
#define ARGUMENT(name, width) const real *name = all_##name + state * (width);
    ARGUMENTS
#undef ARGUMENT
#define ONE(name, size, ...)                    \
    MODEL(name)(constants, __VA_ARGS__, first); \
    print(#name, ":1", size, first);
#define TWO(name, size, other_size, ...)                \
    MODEL(name)(constants, __VA_ARGS__, first, second); \
    print(#name, ":1", size, first);                    \
    print(#name, ":2", other_size, second);
    FUNCTIONS
#undef ONE
#undef TWO
}

static void batch(const Constants *constants)
{
#define ARGUMENT(name, width)          \
    static real name[ROOM * (width)]; \
    MODEL(pack)(STATES, width, all_##name, name);
    ARGUMENTS
#define ONE(name, size, ...)                                    \
    MODEL(name##_batch)(constants, STATES, __VA_ARGS__, first); \
    print_blocks(#name, "_batch:1", size, first);
#define TWO(name, size, other_size, ...)                                \
    MODEL(name##_batch)(constants, STATES, __VA_ARGS__, first, second); \
    print_blocks(#name, "_batch:1", size, first);                       \
    print_blocks(#name, "_batch:2", other_size, second);
    FUNCTIONS
}

int main(void)
{
    Constants constants;
    real no_numbers[PARAMETERS];
    memcpy(no_numbers, parameters, sizeof no_numbers);
    no_numbers[PARAMETERS - 1] = (real)NAN;
    if (MODEL(init_constants)(no_numbers, &constants) != 1) {
        printf("init_constants() takes a parameter that is not a number\n");
        return 1;
    }
    if (MODEL(init_constants)(parameters, &constants) != 0) {
        printf("init_constants() refuses good parameters\n");
        return 1;
    }
    print("constants", "", sizeof constants / sizeof(real), (const real *)&constants);
    for (size_t i = 0; i < STATES; ++i) {
        one_state(&constants, i);
    }
    batch(&constants);
    return 0;
}
