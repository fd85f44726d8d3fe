/*
 * The variables of the FMU, for either version of FMI.
 */
#include "hmcvt_unit.h"

static int predict(const hmcvt_unit *unit, hmcvt_prediction *out)
{
    return hmcvt_predict_with(&unit->parameters, unit->stage, unit->displacement_ratio,
                              unit->engine_speed, unit->load_torque, out);
}

static double efficiency_std(const hmcvt_unit *unit)
{
    double error;
    (void)hmcvt_efficiency_std(&unit->parameters, unit->stage, unit->displacement_ratio,
                               unit->engine_speed, unit->load_torque, &error);
    return error;
}

static double optimal_displacement_ratio(const hmcvt_unit *unit)
{
    hmcvt_optimum best;
    (void)hmcvt_optimal_displacement_ratio_with(&unit->parameters, unit->stage,
                                                unit->engine_speed, unit->load_torque, &best);
    return best.displacement_ratio;
}

static hmcvt_stage_choice choose_stage(const hmcvt_unit *unit)
{
    hmcvt_stage_choice choice;
    const bool is_known = (unit->stage >= 0) && (unit->stage < HMCVT_STAGES);
    (void)hmcvt_choose_stage_with(&unit->parameters, is_known ? unit->stage : HMCVT_NO_STAGE,
                                  unit->hysteresis, unit->demanded_output_speed,
                                  unit->demanded_output_power, unit->lowest_engine_speed,
                                  unit->highest_engine_speed, &choice);
    return choice;
}

void hmcvt_unit_reset(hmcvt_unit *unit)
{
    unit->parameters = hmcvt_identified_parameters;
    unit->time = 0.0;
    unit->displacement_ratio = ${start_displacement_ratio};
    unit->engine_speed = ${start_engine_speed};
    unit->load_torque = ${start_load_torque};
    unit->stage = ${start_stage};
    unit->demanded_output_speed = ${start_demanded_output_speed};
    unit->demanded_output_power = ${start_demanded_output_power};
    unit->hysteresis = ${start_hysteresis};
    unit->lowest_engine_speed = ${start_lowest_engine_speed};
    unit->highest_engine_speed = ${start_highest_engine_speed};
}

bool hmcvt_unit_get_real(const hmcvt_unit *unit, unsigned int reference, double *value)
{
    hmcvt_prediction out;
    bool known = true;
    switch (reference) {
    case TIME:
        *value = unit->time;
        break;
    case DISPLACEMENT_RATIO:
        *value = unit->displacement_ratio;
        break;
    case ENGINE_SPEED:
        *value = unit->engine_speed;
        break;
    case LOAD_TORQUE:
        *value = unit->load_torque;
        break;
    case LEAKAGE:
        *value = unit->parameters.leakage;
        break;
    case MOTOR_DAMPING:
        *value = unit->parameters.motor_damping;
        break;
    case PUMP_DAMPING:
        *value = unit->parameters.pump_damping;
        break;
    case EFFICIENCY:
        (void)predict(unit, &out);
        *value = out.efficiency;
        break;
    case OUTPUT_SPEED:
        (void)predict(unit, &out);
        *value = out.output_speed;
        break;
    case ENGINE_TORQUE:
        (void)predict(unit, &out);
        *value = out.engine_torque;
        break;
    case POWER_LOSS:
        (void)predict(unit, &out);
        *value = out.power_loss;
        break;
    case OPTIMAL_DISPLACEMENT_RATIO:
        *value = optimal_displacement_ratio(unit);
        break;
    case EFFICIENCY_STD:
        *value = efficiency_std(unit);
        break;
    case DEMANDED_OUTPUT_SPEED:
        *value = unit->demanded_output_speed;
        break;
    case DEMANDED_OUTPUT_POWER:
        *value = unit->demanded_output_power;
        break;
    case HYSTERESIS:
        *value = unit->hysteresis;
        break;
    case LOWEST_ENGINE_SPEED:
        *value = unit->lowest_engine_speed;
        break;
    case HIGHEST_ENGINE_SPEED:
        *value = unit->highest_engine_speed;
        break;
    case OPTIMAL_ENGINE_SPEED:
        *value = choose_stage(unit).best.engine_speed;
        break;
    default:
        known = false;
        break;
    }
    return known;
}

bool hmcvt_unit_set_real(hmcvt_unit *unit, unsigned int reference, double value)
{
    bool known = true;
    switch (reference) {
    case DISPLACEMENT_RATIO:
        unit->displacement_ratio = value;
        break;
    case ENGINE_SPEED:
        unit->engine_speed = value;
        break;
    case LOAD_TORQUE:
        unit->load_torque = value;
        break;
    case LEAKAGE:
        unit->parameters.leakage = value;
        break;
    case MOTOR_DAMPING:
        unit->parameters.motor_damping = value;
        break;
    case PUMP_DAMPING:
        unit->parameters.pump_damping = value;
        break;
    case DEMANDED_OUTPUT_SPEED:
        unit->demanded_output_speed = value;
        break;
    case DEMANDED_OUTPUT_POWER:
        unit->demanded_output_power = value;
        break;
    case HYSTERESIS:
        unit->hysteresis = value;
        break;
    case LOWEST_ENGINE_SPEED:
        unit->lowest_engine_speed = value;
        break;
    case HIGHEST_ENGINE_SPEED:
        unit->highest_engine_speed = value;
        break;
    default:
        known = false;
        break;
    }
    return known;
}

bool hmcvt_unit_get_integer(const hmcvt_unit *unit, unsigned int reference, int *value)
{
    hmcvt_prediction out;
    bool known = true;
    switch (reference) {
    case STAGE:
        *value = unit->stage;
        break;
    case STATUS:
        *value = predict(unit, &out);
        break;
    case OPTIMAL_STAGE:
        *value = choose_stage(unit).stage;
        break;
    default:
        known = false;
        break;
    }
    return known;
}

bool hmcvt_unit_set_integer(hmcvt_unit *unit, unsigned int reference, int value)
{
    const bool known = reference == STAGE;
    if (known) {
        unit->stage = value;
    }
    return known;
}

bool hmcvt_unit_get_boolean(const hmcvt_unit *unit, unsigned int reference, bool *value)
{
    const bool known = reference == INSIDE_DOMAIN;
    if (known) {
        hmcvt_prediction out;
        (void)predict(unit, &out);
        *value = out.inside_domain != 0;
    }
    return known;
}
