/* Choice of the stage of the model ${fingerprint}; see hmcvt_stage.h. */
#include "hmcvt_stage.h"

#include <math.h>

/* An answer that is not known. */
static void clear_choice(hmcvt_stage_choice *out)
{
    const hmcvt_real unknown = (hmcvt_real)NAN;
    out->stage = HMCVT_NO_STAGE;
    out->best.displacement_ratio = unknown;
    out->best.efficiency = unknown;
    out->best.engine_speed = unknown;
}

int hmcvt_choose_stage_with(const hmcvt_parameters *parameters, int engaged,
                            hmcvt_real hysteresis, hmcvt_real output_speed,
                            hmcvt_real output_power, hmcvt_real lowest_engine_speed,
                            hmcvt_real highest_engine_speed, hmcvt_stage_choice *out)
{
    hmcvt_optimum kept;
    hmcvt_real kept_power = (hmcvt_real)0.0;
    hmcvt_real least_power = (hmcvt_real)0.0;
    int keeps = 0;
    int stage;

    clear_choice(out);
    if ((engaged < HMCVT_NO_STAGE) || (engaged >= HMCVT_STAGES)) {
        return HMCVT_UNKNOWN_STAGE;
    }
    if (!((hysteresis >= (hmcvt_real)0.0) && (hysteresis <= (hmcvt_real)1.0))) {
        return HMCVT_OUT_OF_RANGE;
    }
    for (stage = 0; stage < HMCVT_STAGES; stage++) {
        hmcvt_optimum best;
        const int status = hmcvt_optimal_engine_speed_with(
            parameters, stage, output_speed, output_power, lowest_engine_speed,
            highest_engine_speed, &best);
        if (status == HMCVT_OUT_OF_RANGE) {
            clear_choice(out);
            return status;
        }
        if (status == HMCVT_OK) {
            const hmcvt_real power = output_power / best.efficiency;
            if (stage == engaged) {
                kept = best;
                kept_power = power;
                keeps = 1;
            }
            if ((out->stage == HMCVT_NO_STAGE) || (power < least_power)) {
                out->stage = stage;
                out->best = best;
                least_power = power;
            }
        }
    }
    if (out->stage == HMCVT_NO_STAGE) {
        return HMCVT_NO_ANSWER;
    }
    if (keeps && (kept_power <= least_power * ((hmcvt_real)1.0 + hysteresis))) {
        out->stage = engaged;
        out->best = kept;
    }
    return HMCVT_OK;
}

int hmcvt_choose_stage(int engaged, hmcvt_real hysteresis, hmcvt_real output_speed,
                       hmcvt_real output_power, hmcvt_real lowest_engine_speed,
                       hmcvt_real highest_engine_speed, hmcvt_stage_choice *out)
{
    return hmcvt_choose_stage_with(&hmcvt_identified_parameters, engaged, hysteresis, output_speed,
                                   output_power, lowest_engine_speed, highest_engine_speed, out);
}
