/*
 * A function of a filter: prints after a few of its calls the bytes of coordinates and velocities,
 * and how many ticks of SysTick these calls take.
 *
 * cases.h, written by whoever compiles it, includes the header of the laws and gives
 *
 *     real, Constants, Filter      types of the module
 *     MODEL(name)                  a function or constant of the module
 *     begin                        a filter's structure
 *     CALL                         a call with `constants`, `&filter` and `&nis`
 */

#include <stdint.h>
#include <stdio.h>

#include "cases.h"

#define SYSTICK ((volatile uint32_t *)0xe000e010u) /* control, reload, value */
#define LONGEST UINT32_C(0xffffff)
#define PROCESSOR_CLOCK UINT32_C(5)

enum { CALLS = 10 };

static Filter filter;

int main(void)
{
    const Constants *const constants = &MODEL(default_constants);
    const unsigned char *const bytes = (const unsigned char *)&filter;
    real nis;
    uint32_t first;
    filter = begin;
    SYSTICK[1] = LONGEST;
    SYSTICK[2] = 0;
    SYSTICK[0] = PROCESSOR_CLOCK;
    first = SYSTICK[2];
    for (int call = 0; call < CALLS; ++call) {
        CALL;
    }
    first = (first - SYSTICK[2]) & LONGEST;
    for (size_t k = 0; k < sizeof filter.q + sizeof filter.v; ++k) {
        printf("%02x", (unsigned)bytes[k]);
    }
    printf(" %lu\n", (unsigned long)first);
    (void)constants;
    (void)nis;
    return 0;
}
