/* Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0 */
/* Starts a program on the Cortex-M4 that qemu calls mps2-an386, with files over semihosting. */
#include <stdint.h>

extern uint32_t stack_top;
extern void _start(void);

static void reset(void)
{
    /* Full access to the floating-point unit (coprocessors 10 and 11). */
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20;
    _start();
}

static void halt(void)
{
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (const void *)reset, (const void *)halt, (const void *)halt, (const void *)halt,
    (const void *)halt, (const void *)halt,
};
