/*
 * Calls a law of control for some cases, prints the bytes of its inputs, and how many ticks of
 * SysTick a hundred calls take.
 *
 * cases.h, written by whoever compiles it, includes the header of the laws and gives
 *
 *     real, Constants, Rotors      types of the module
 *     MODEL(name), LAW             a function or constant of the module; the law
 *     INPUTS, CASES                lengths: of u, and of the arrays that follow
 *     all_gains, all_states, all_references
 */

#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "cases.h"

#define SYSTICK ((volatile uint32_t *)0xe000e010u) /* control, reload, value */
#define LONGEST UINT32_C(0xffffff)
#define PROCESSOR_CLOCK UINT32_C(5)

enum { CALLS = 100 };

int main(void)
{
    const Constants *const constants = &MODEL(default_constants);
    Rotors rotors;
    real u[INPUTS];
    MODEL(init_rotors)(constants, &rotors);
    for (int i = 0; i < CASES; ++i) {
        LAW(constants, &rotors, &all_gains[i], &all_states[i], &all_references[i], u);
        const unsigned char *bytes = (const unsigned char *)u;
        printf("u%d ", i);
        for (size_t k = 0; k < sizeof u; ++k) {
            printf("%02x", (unsigned)bytes[k]);
        }
        SYSTICK[1] = LONGEST;
        SYSTICK[2] = 0;
        SYSTICK[0] = PROCESSOR_CLOCK;
        const uint32_t begin = SYSTICK[2];
        for (int call = 0; call < CALLS; ++call) {
            LAW(constants, &rotors, &all_gains[i], &all_states[i], &all_references[i], u);
        }
        printf(" %lu\n", (unsigned long)((begin - SYSTICK[2]) & LONGEST));
    }
    return 0;
}
