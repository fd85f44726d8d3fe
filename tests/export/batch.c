/* Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0 */
/* Calls the exported functions at many points, for the tests. */
#include "hmcvt_model.h"

void batch_predict(const hmcvt_parameters *parameters, int n, const int *stage,
                   const hmcvt_real *displacement_ratio, const hmcvt_real *engine_speed,
                   const hmcvt_real *load_torque, hmcvt_prediction *out, int *status)
{
    int i;
    for (i = 0; i < n; i++) {
        status[i] = hmcvt_predict_with(parameters, stage[i], displacement_ratio[i],
                                       engine_speed[i], load_torque[i], &out[i]);
    }
}

void batch_std(const hmcvt_parameters *parameters, int n, const int *stage,
               const hmcvt_real *displacement_ratio, const hmcvt_real *engine_speed,
               const hmcvt_real *load_torque, hmcvt_real *out, int *status)
{
    int i;
    for (i = 0; i < n; i++) {
        status[i] = hmcvt_efficiency_std(parameters, stage[i], displacement_ratio[i],
                                         engine_speed[i], load_torque[i], &out[i]);
    }
}

void batch_stroke(const hmcvt_parameters *parameters, int n, const int *stage,
                  const hmcvt_real *engine_speed, const hmcvt_real *load_torque,
                  hmcvt_optimum *out, int *status)
{
    int i;
    for (i = 0; i < n; i++) {
        status[i] = hmcvt_optimal_displacement_ratio_with(parameters, stage[i], engine_speed[i],
                                                          load_torque[i], &out[i]);
    }
}

void batch_speed(const hmcvt_parameters *parameters, int n, const int *stage,
                 const hmcvt_real *output_speed, const hmcvt_real *output_power,
                 hmcvt_real lowest, hmcvt_real highest, hmcvt_optimum *out, int *status)
{
    int i;
    for (i = 0; i < n; i++) {
        status[i] = hmcvt_optimal_engine_speed_with(parameters, stage[i], output_speed[i],
                                                    output_power[i], lowest, highest, &out[i]);
    }
}
