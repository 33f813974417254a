/*
 * Start of a bare-metal program on a Cortex-M4 or M7 with a floating-point unit, run by QEMU with
 * semihosting. QEMU loads .data in place and clears .bss, so nothing is left to copy.
 */

#include <stdint.h>
#include <stdio.h>
#include <unistd.h>

#define CPACR (*(volatile uint32_t *)0xe000ed88u) /* coprocessor access control */
#define FPU_ACCESS (UINT32_C(0xf) << 20)

#define SYS_WRITE0 UINT32_C(0x04)
#define SYS_EXIT UINT32_C(0x18)
#define RUN_TIME_ERROR UINT32_C(0x20023)

typedef void (*Handler)(void);

extern uint32_t stack_top; /* of link.ld */

int main(void);
void initialise_monitor_handles(void); /* of newlib: opens stdout */
void reset(void);
void fault(void);

static void semihosting(uint32_t operation, uintptr_t argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void reset(void)
{
    CPACR |= FPU_ACCESS;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    initialise_monitor_handles();
    const int status = main();
    fflush(stdout);
    _exit(status);
}

/* Whatever goes wrong ends the emulator, rather than leaving it running. */
void fault(void)
{
    semihosting(SYS_WRITE0, (uintptr_t) "the processor took a fault\n");
    semihosting(SYS_EXIT, RUN_TIME_ERROR);
    for (;;) {
    }
}

/* The initial stack pointer, then reset, NMI and the faults, all of which arrive as HardFault. */
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    Handler handlers[3];
} vectors = {&stack_top, {reset, fault, fault}};
