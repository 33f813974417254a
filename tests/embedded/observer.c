/*
 * Steps of the observer of generalised momentum, and the wrench on the last frame: prints the bytes
 * of the residual and of the wrench, and how many ticks of SysTick a hundred steps and wrenches take.
 *
 * cases.h, written by whoever compiles it, includes the header of the laws and gives
 *
 *     real, Constants              types of the module
 *     Observer, FrameObserver      types of its memory
 *     MODEL(name)                  a function or constant of the module
 *     VELOCITIES, FRAMES           lengths
 *     q, v, u, share, weight, damping, time_step
 */

#include <stdint.h>
#include <stdio.h>

#include "cases.h"

#define SYSTICK ((volatile uint32_t *)0xe000e010u) /* control, reload, value */
#define LONGEST UINT32_C(0xffffff)
#define PROCESSOR_CLOCK UINT32_C(5)

enum { CALLS = 100 };

static uint32_t begin;

static void start(void)
{
    SYSTICK[1] = LONGEST;
    SYSTICK[2] = 0;
    SYSTICK[0] = PROCESSOR_CLOCK;
    begin = SYSTICK[2];
}

static void tell(const void *values, size_t size)
{
    const unsigned long ticks = (begin - SYSTICK[2]) & LONGEST;
    const unsigned char *bytes = values;
    for (size_t k = 0; k < size; ++k) {
        printf("%02x", (unsigned)bytes[k]);
    }
    printf(" %lu\n", ticks);
}

int main(void)
{
    const Constants *const constants = &MODEL(default_constants);
    static real jacobians[FRAMES][6 * VELOCITIES];
    const real *const jacobian = jacobians[FRAMES - 1];
    Observer observer;
    FrameObserver of_frame;
    real wrench[6];
    MODEL(init_momentum_observer)(constants, &observer, q, v);
    start();
    for (int call = 0; call < CALLS; ++call) {
        MODEL(momentum_observer_step)(constants, &observer, q, v, u, share, time_step);
    }
    tell(observer.residual, sizeof observer.residual);
    MODEL(frame_jacobians)(constants, q, jacobians[0]);
    for (int i = 0; i < 6 * VELOCITIES; ++i) {
        of_frame.late_jacobian[i] = jacobian[i];
    }
    start();
    for (int call = 0; call < CALLS; ++call) {
        MODEL(frame_jacobians)(constants, q, jacobians[0]);
        MODEL(wrench_of_residual)(&of_frame, jacobian, observer.residual, share, weight, damping,
                                  wrench);
    }
    tell(wrench, sizeof wrench);
    return 0;
}
