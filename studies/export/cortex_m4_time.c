/* Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0 */
/*
 * Counts the instructions of an answer on the emulated board mps2-an386.
 *
 * With `-icount shift=0` the emulator takes one nanosecond for an instruction, and SysTick counts
 * down with 25 MHz.
 */
#include "hmcvt_model.h"

#include <stdio.h>

#define SYSTICK_CONTROL (*(volatile unsigned int *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile unsigned int *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile unsigned int *)0xE000E018u)
#define LARGEST 0xFFFFFFu
#define INSTRUCTIONS_PER_TICK 40.0

#define POINTS 500
#define DEMANDS 10

static void start(void)
{
    SYSTICK_RELOAD = LARGEST;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 5u;
}

static double instructions(void)
{
    return INSTRUCTIONS_PER_TICK * (double)(LARGEST - SYSTICK_VALUE);
}

/* A number between 0 and 1 that looks random. */
static hmcvt_real part(int number, int factor)
{
    return (hmcvt_real)((number * factor) % 997) / (hmcvt_real)997;
}

int main(void)
{
    hmcvt_prediction out;
    hmcvt_optimum best;
    double predict = 0.0;
    double stroke = 0.0;
    double speed = 0.0;
    int i;
    start();
    for (i = 0; i < POINTS; i++) {
        (void)hmcvt_predict(i % HMCVT_STAGES, 2 * part(i, 389) - 1, 80 + 150 * part(i, 127),
                            20 + 380 * part(i, 613), &out);
    }
    predict = instructions() / POINTS;
    for (i = 0; i < DEMANDS; i++) {
        start();
        (void)hmcvt_optimal_displacement_ratio(i % HMCVT_STAGES, 80 + 150 * part(i, 127),
                                               20 + 380 * part(i, 613), &best);
        stroke += instructions() / DEMANDS;
        start();
        (void)hmcvt_optimal_engine_speed(i % HMCVT_STAGES, 10 + 200 * part(i, 127),
                                         (hmcvt_real)40e3, 80, 230, &best);
        speed += instructions() / DEMANDS;
    }
    printf("%.0f %.0f %.0f\n", predict, stroke, speed);
    return 0;
}
