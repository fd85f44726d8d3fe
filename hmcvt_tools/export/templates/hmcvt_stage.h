/*
 * Choice of the stage of the model ${fingerprint}: least engine power, with hysteresis.
 *
 * It gives the answer of `hmcvt optimum --output-speed --output-power --stage --hysteresis`, without an
 * engine map. Like the model it keeps no state: the caller remembers the stage engaged.
 */
#ifndef HMCVT_STAGE_H
#define HMCVT_STAGE_H

#include "hmcvt_model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Stands for no stage. */
#define HMCVT_NO_STAGE (-1)

typedef struct {
    int stage;          /* to engage; HMCVT_NO_STAGE where none holds the demand */
    hmcvt_optimum best; /* its displacement ratio, efficiency and engine speed */
} hmcvt_stage_choice;

/*
 * Choose the stage, engine speed and displacement ratio of the least engine power at a held output.
 *
 * engaged: stage engaged now, or HMCVT_NO_STAGE. It is kept unless another one saves more than the
 *     part hysteresis of the engine power.
 * hysteresis: 0 to 1 [-].
 * The other inputs: as of hmcvt_optimal_engine_speed.
 *
 * HMCVT_NO_ANSWER: no stage holds the demand.
 */
int hmcvt_choose_stage(int engaged, hmcvt_real hysteresis, hmcvt_real output_speed,
                       hmcvt_real output_power, hmcvt_real lowest_engine_speed,
                       hmcvt_real highest_engine_speed, hmcvt_stage_choice *out);

/* The same with other parameters. */
int hmcvt_choose_stage_with(const hmcvt_parameters *parameters, int engaged,
                            hmcvt_real hysteresis, hmcvt_real output_speed,
                            hmcvt_real output_power, hmcvt_real lowest_engine_speed,
                            hmcvt_real highest_engine_speed, hmcvt_stage_choice *out);

#ifdef __cplusplus
}
#endif

#endif
