/*
 * Efficiency of a hydromechanical CVT: the model ${fingerprint} of hmcvt ${version}.
 * hmcvt_model.h documents the functions, the page "Theory" of hmcvt the equations.
 *
 * Speeds and torques are taken per engine speed, as in the Python modules `regimes` and
 * `single_point`, whose order of operations is kept: y, x, z are the speeds of output, motor and
 * pump, L the load, e the displacement ratio times the ratio of displacements, pi the pressure as a
 * torque of the motor.
 */
#include "hmcvt_model.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

/* A literal in the precision of the model. */
#define R(literal) ((hmcvt_real)(literal))
#define UNKNOWN R(NAN)
#define UNBOUNDED R(INFINITY)

/* Layouts that the stages of this model have. */
#define PUMP_AT_ENGINE ${pump_at_engine}
#define PUMP_ON_ROW ${pump_on_row}

/* Whether the identification states errors of the parameters, and the data that it covers. */
#define STATES_ERRORS ${states_errors}
#define STATES_DOMAIN ${states_domain}

/* Whether tables hold what effects change on top of the closed form. */
#define STATES_EFFECTS ${states_effects}

/* y of an output at rest without load: the smallest number, so that no torque is 0 / 0. */
#if HMCVT_SINGLE_PRECISION
#define STANDING R(1.17549435e-38)
#else
#define STANDING R(4.9406564584124654e-324)
#endif

/* --- constants of the stages ----------------------------------------------------------------- */

/* Factors of one regime, that is of the directions in which power flows. */
typedef struct {
    hmcvt_real gear;        /* output torque of the motor per motor torque */
    hmcvt_real transmitted; /* part of the pressure torque that friction leaves */
    hmcvt_real brace;       /* output torque that the pump braces per pump torque */
    hmcvt_real pump;        /* pump torque per pressure torque */
} regime_factors;

/* Factors of one quadrant, that is of the senses of the output and of the power. */
typedef struct {
    hmcvt_real flow_ratio;      /* e at displacement ratio 1 */
    hmcvt_real rest;            /* m: y at which the motor rests */
    hmcvt_real rest_squared;    /* m m */
    hmcvt_real sense;           /* sign of y */
    hmcvt_real reflection;      /* sign of what is reflected */
    hmcvt_real output_share;    /* c: z per y */
    hmcvt_real mechanical_load; /* engine torque per output torque, mechanical path */
    const regime_factors *regimes;
} quadrant_factors;

#if STATES_EFFECTS
/* What effects change, at nodes over displacement ratio, engine speed and load torque. */
typedef struct {
    const hmcvt_real *axes[3];
    int counts[3];
    const float *shift;  /* of the displacement ratio */
    const float *torque; /* of the engine, to add [N m] */
} effect_table;
#endif

/* Factors of one stage. */
typedef struct {
    bool pump_on_row;
    bool reverse;
    hmcvt_real engine_share;         /* a: pump speed per engine speed */
    hmcvt_real output_share;         /* pump speed per output speed, not reflected */
    hmcvt_real hydraulic_ratio;      /* h: output speed per motor speed */
    hmcvt_real displacement_squared; /* of the motor [m6/rad2] */
    hmcvt_real pump_friction;        /* friction torque per pressure torque */
    hmcvt_real gears[2];             /* engine torque per pump torque: mean, half the difference */
    hmcvt_real backward_gears[2];    /* the same for a pump that turns backward */
    hmcvt_real rest_ratio;           /* output speed ratio at which the unit on the row stands */
    hmcvt_real ratio_ends[2];        /* output speed ratio at full stroke, without slip */
    const quadrant_factors *quadrants;
#if STATES_EFFECTS
    const effect_table *effects;
#endif
} stage_factors;

/* Regimes; RESTING: friction holds the motor or the output. */
enum { RESTING = -1, DRIVING, DRIVEN, REVERSED, MOTORED, BACKWARD, BACKWARD_MOTORED };

${tables}
/* --- arithmetic ------------------------------------------------------------------------------ */

static hmcvt_real square_root(hmcvt_real value)
{
#if HMCVT_SINGLE_PRECISION
    return sqrtf(value);
#else
    return sqrt(value);
#endif
}

static hmcvt_real magnitude(hmcvt_real value)
{
#if HMCVT_SINGLE_PRECISION
    return fabsf(value);
#else
    return fabs(value);
#endif
}

static hmcvt_real lower_of(hmcvt_real first, hmcvt_real second)
{
    return (second < first) ? second : first;
}

static hmcvt_real higher_of(hmcvt_real first, hmcvt_real second)
{
    return (second > first) ? second : first;
}

/* False for NaN. */
static bool within(hmcvt_real value, hmcvt_real low, hmcvt_real high)
{
    return (value >= low) && (value <= high);
}

static bool is_unknown(hmcvt_real value)
{
    return isnan(value) != 0;
}

/* --- one regime ------------------------------------------------------------------------------ */

/* What is the same at all points of a quadrant. */
typedef struct {
    const stage_factors *stage;
    const quadrant_factors *quadrant;
    const hmcvt_parameters *parameters;
    hmcvt_real stiffness; /* K = V_m V_m / leakage */
} setting;

/* Constants of one regime with the parameters in force. */
typedef struct {
    hmcvt_real motor;      /* output torque of the motor per pi */
    hmcvt_real motor_drag; /* output torque that the damping of the motor takes per x */
    hmcvt_real brace_drag; /* output torque that the damping of the pump makes per z */
    hmcvt_real square;     /* A at e = 0 */
    hmcvt_real level;      /* B / 2 at e = 0 */
    hmcvt_real flow;       /* what e adds to B / 2, except for the brace */
} regime_constants;

static setting setting_of(const stage_factors *stage, int quadrant,
                          const hmcvt_parameters *parameters)
{
    setting at;
    at.stage = stage;
    at.quadrant = &stage->quadrants[quadrant];
    at.parameters = parameters;
    at.stiffness = stage->displacement_squared / parameters->leakage;
    return at;
}

static regime_constants constants_of(const setting *at, int regime)
{
    const regime_factors *factors = &at->quadrant->regimes[regime];
    const hmcvt_real a = at->stage->engine_share;
    const hmcvt_real c = at->quadrant->output_share;
    const hmcvt_real h = at->stage->hydraulic_ratio;
    const hmcvt_real m = at->quadrant->rest;
    const hmcvt_real stiff = at->stiffness * factors->gear * factors->transmitted;
    regime_constants constants;
    constants.motor = factors->gear * factors->transmitted;
    constants.motor_drag = factors->gear * at->parameters->motor_damping;
    constants.brace_drag = factors->brace * at->parameters->pump_damping;
    constants.square = ((stiff + constants.motor_drag) / h) - (constants.brace_drag * c);
    constants.level =
        R(0.5) * ((((stiff + constants.motor_drag) * m) / h) + (constants.brace_drag * a));
    constants.flow = R(0.5) * stiff * a;
    return constants;
}

/* z for y. */
static hmcvt_real pump_speed(const setting *at, hmcvt_real output)
{
    hmcvt_real speed = at->stage->engine_share;
    if (at->stage->pump_on_row) {
        speed += at->quadrant->output_share * output;
    }
    return speed;
}

/* pi for e and y. */
static hmcvt_real pressure_at(const setting *at, hmcvt_real ratio, hmcvt_real output)
{
    const hmcvt_real motor = (output - at->quadrant->rest) / at->stage->hydraulic_ratio;
    return at->stiffness * ((ratio * pump_speed(at, output)) - motor);
}

/* Torque of a pump that turns forward (1) or backward (-1). */
static hmcvt_real pump_torque_at(const setting *at, hmcvt_real ratio, hmcvt_real output,
                                 hmcvt_real pressure, hmcvt_real turning)
{
    const hmcvt_real ideal = ratio * pressure;
    const hmcvt_real friction = turning * (at->stage->pump_friction * magnitude(ideal));
    return ideal + friction + (at->parameters->pump_damping * pump_speed(at, output));
}

/* The same at the pressure that follows from the flow. */
static hmcvt_real pump_torque(const setting *at, hmcvt_real ratio, hmcvt_real output,
                              hmcvt_real turning)
{
    return pump_torque_at(at, ratio, output, pressure_at(at, ratio, output), turning);
}

/* y, NaN without a steady state, and the regime in which it holds. */
typedef struct {
    hmcvt_real output;
    int regime;
} steady_state;

/*
 * pi of a steady state. The flow gives it as the small difference of two speeds; single precision
 * takes it from the torques instead, which lose no digits.
 */
static hmcvt_real steady_pressure(const setting *at, steady_state steady, hmcvt_real ratio,
                                  hmcvt_real load)
{
    hmcvt_real pressure = pressure_at(at, ratio, steady.output);
#if HMCVT_SINGLE_PRECISION
    if (steady.regime != RESTING) {
        const regime_constants constants = constants_of(at, steady.regime);
        const regime_factors *factors = &at->quadrant->regimes[steady.regime];
        const hmcvt_real motor =
            (steady.output - at->quadrant->rest) / at->stage->hydraulic_ratio;
        const hmcvt_real rubbed = ratio + ((factors->pump - R(1.0)) * magnitude(ratio));
        const hmcvt_real asked = (load / steady.output) + (constants.motor_drag * motor) -
                                 (constants.brace_drag * pump_speed(at, steady.output));
        pressure = asked / (constants.motor + (factors->brace * rubbed));
    }
#else
    (void)load;
#endif
    return pressure;
}

/* Efficiency, output speed and engine torque; NaN where they are not known. */
typedef struct {
    hmcvt_real efficiency;
    hmcvt_real output_speed;
    hmcvt_real engine_torque;
} solution;

static hmcvt_real efficiency_of(hmcvt_real load_torque, hmcvt_real engine_torque)
{
    hmcvt_real efficiency = UNKNOWN;
    if (load_torque >= R(0.0)) {
        if (engine_torque > R(0.0)) {
            efficiency = load_torque / engine_torque;
        }
    } else if (engine_torque < R(0.0)) {
        efficiency = engine_torque / load_torque;
    } else {
        /* The engine gives power, too. */
    }
    return efficiency;
}

/* The solution at an output speed y; NaN for NaN. */
static solution solution_of(const setting *at, hmcvt_real output, hmcvt_real engine_torque,
                            hmcvt_real engine_speed, hmcvt_real load_torque)
{
    solution solved;
    solved.efficiency = efficiency_of(load_torque, engine_torque);
    /* A product with STANDING would round to a tiny speed, not to zero. */
    solved.output_speed = (output == STANDING)
                              ? R(0.0)
                              : (at->quadrant->reflection * engine_speed * output);
    solved.engine_torque = engine_torque;
    return solved;
}

static solution no_solution(void)
{
    const solution none = {UNKNOWN, UNKNOWN, UNKNOWN};
    return none;
}

/* --- pump at the engine: input-coupled and hydrostatic stages ---------------------------------- */

#if PUMP_AT_ENGINE

/* y in one regime; NaN without a root. */
static hmcvt_real engine_root(const setting *at, int regime, hmcvt_real ratio, hmcvt_real load)
{
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real middle =
        (constants.level + (constants.flow * ratio)) / constants.square;
    const hmcvt_real inside = (middle * middle) - (load / constants.square);
    hmcvt_real output = UNKNOWN;
    if (inside >= R(0.0)) {
        output = R(2.0) * middle;
        if (load != R(0.0)) {
            output = middle + (at->quadrant->sense * square_root(inside));
        }
    }
    return output;
}

/* Displacement ratio at which the output stands without load. */
static hmcvt_real standing_ratio(const setting *at)
{
    const regime_constants driving = constants_of(at, DRIVING);
    const hmcvt_real root = square_root(driving.flow * driving.flow);
    return ((R(-2.0) * driving.level) / (driving.flow + root)) / at->quadrant->flow_ratio;
}

/* The state of a motor that is driven, or held by friction. */
static steady_state slower_state(const setting *at, hmcvt_real ratio, hmcvt_real load)
{
    const hmcvt_real rest = at->quadrant->rest;
    steady_state steady;
    steady.output = engine_root(at, DRIVEN, ratio, load);
    steady.regime = DRIVEN;
    if (steady.output >= rest) {
        steady.output = rest;
        steady.regime = RESTING;
    } else {
        const hmcvt_real motor = (steady.output - rest) / at->stage->hydraulic_ratio;
        /* True for NaN, too. */
        const bool is_reversed =
            !(steady.output < rest) || ((ratio * at->stage->engine_share) < motor);
        if (is_reversed) {
            steady.output = engine_root(at, REVERSED, ratio, load);
            steady.regime = REVERSED;
        }
    }
    return steady;
}

/* L above which a motor that comes to rest goes on to stall. */
static bool stalls(const setting *at, hmcvt_real load)
{
    const quadrant_factors *quadrant = at->quadrant;
    const regime_constants driving = constants_of(at, DRIVING);
    return (quadrant->rest < R(0.0)) || (load > (quadrant->rest_squared * driving.square));
}

/* The state in whichever regime holds; NaN where the load is not carried. */
static steady_state engine_state(const setting *at, hmcvt_real ratio, hmcvt_real load)
{
    const hmcvt_real rest = at->quadrant->rest;
    steady_state steady;
    steady.output = engine_root(at, DRIVING, ratio, load);
    steady.regime = DRIVING;
    if (!(steady.output > rest)) {
        const bool has_root = steady.output <= rest;
        if (has_root || !stalls(at, load)) {
            steady = slower_state(at, ratio, load);
        }
    }
    if (!((steady.output * at->quadrant->sense) > R(0.0))) {
        if (load != R(0.0)) {
            steady.output = UNKNOWN;
        } else if (steady.output == R(0.0)) {
            steady.output = STANDING;
        } else {
            /* Without a load, the losses turn the output back: it keeps its speed. */
        }
    }
    return steady;
}

static int engine_quadrant(const stage_factors *stage, const hmcvt_parameters *parameters,
                           hmcvt_real displacement_ratio, hmcvt_real load_torque)
{
    const setting first = setting_of(stage, 0, parameters);
    const hmcvt_real turned =
        (displacement_ratio - standing_ratio(&first)) * first.quadrant->flow_ratio;
    int quadrant = 0;
    if (!(turned > R(0.0))) {
        quadrant += 2;
    }
    if (load_torque < R(0.0)) {
        quadrant += 1;
    }
    return quadrant;
}

static solution solve_at_engine(const stage_factors *stage, const hmcvt_parameters *parameters,
                                hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                                hmcvt_real load_torque)
{
    const int quadrant = engine_quadrant(stage, parameters, displacement_ratio, load_torque);
    const setting at = setting_of(stage, quadrant, parameters);
    const hmcvt_real ratio = at.quadrant->flow_ratio * displacement_ratio;
    const hmcvt_real load = load_torque / engine_speed;
    const steady_state steady = engine_state(&at, ratio, load);
    solution solved = no_solution();
    if (!is_unknown(steady.output)) {
        const hmcvt_real pressure = steady_pressure(&at, steady, ratio, load);
        const hmcvt_real pump = pump_torque_at(&at, ratio, steady.output, pressure, R(1.0));
        const hmcvt_real carried = (at.quadrant->mechanical_load * load) / steady.output;
        const hmcvt_real torque =
            carried + (stage->gears[0] * pump) + (stage->gears[1] * magnitude(pump));
        solved =
            solution_of(&at, steady.output, torque * engine_speed, engine_speed, load_torque);
    }
    return solved;
}

#endif

/* --- pump on the row: output-coupled stages ---------------------------------------------------- */

#if PUMP_ON_ROW

/* Torque of the wrong sign, against K y, that is rounding where two regimes meet. */
#define ROUNDING R(${rounding})

/* What the pump braces per z in one regime. */
static hmcvt_real brace_of(const setting *at, int regime, hmcvt_real ratio)
{
    const regime_factors *factors = &at->quadrant->regimes[regime];
    const hmcvt_real friction = factors->pump - R(1.0);
    const hmcvt_real rubbed = ratio + (friction * magnitude(ratio));
    return at->stiffness * factors->brace * rubbed;
}

/* B / 2 in one regime. */
static hmcvt_real level_of(const setting *at, int regime, hmcvt_real ratio)
{
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real level = constants.level + (constants.flow * ratio);
    const hmcvt_real brace = brace_of(at, regime, ratio);
    return level + (R(0.5) * brace * at->stage->engine_share * ratio);
}

/* A in one regime. */
static hmcvt_real square_of(const setting *at, int regime, hmcvt_real ratio)
{
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real brace = brace_of(at, regime, ratio);
    const hmcvt_real c = at->quadrant->output_share;
    const hmcvt_real fed_back = ((at->stiffness * constants.motor) + brace) * c * ratio;
    return (constants.square + (brace / at->stage->hydraulic_ratio)) - fed_back;
}

/* y in one regime; NaN without a root. */
static hmcvt_real row_root(const setting *at, int regime, hmcvt_real ratio, hmcvt_real load)
{
    const hmcvt_real square = square_of(at, regime, ratio);
    const hmcvt_real middle = level_of(at, regime, ratio) / square;
    const hmcvt_real inside = (middle * middle) - (load / square);
    hmcvt_real output = UNKNOWN;
    if ((inside >= R(0.0)) && (square > R(0.0))) {
        output = R(2.0) * middle;
        if (load != R(0.0)) {
            output = middle + square_root(inside);
        }
    }
    return output;
}

/*
 * Whether an output at rest without load starts in the sense of the quadrant, by the torque on it,
 * B / 2 as a polynomial of e. At rest the pressure has the sign of e, the pump turns forward and
 * takes torque.
 */
static bool starts(const setting *at, hmcvt_real ratio)
{
    const int regime = (ratio > R(0.0)) ? DRIVING : REVERSED;
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real rubbed = R(1.0) + at->stage->pump_friction;
    const hmcvt_real brace = at->stiffness * at->quadrant->regimes[regime].brace * rubbed;
    const hmcvt_real square = R(0.5) * brace * at->stage->engine_share;
    const hmcvt_real torque =
        constants.level + ((constants.flow + (square * ratio)) * ratio);
    return torque > R(0.0);
}

/* Whether no speed follows from the flow: the row feeds back what the motor takes. */
static bool beyond_pole(const setting *at, hmcvt_real ratio)
{
    const hmcvt_real h = at->stage->hydraulic_ratio;
    return (h * at->quadrant->output_share * ratio) >= R(1.0);
}

/* Whether a motor at the output drives it. */
static bool drives(const setting *at, hmcvt_real pressure, hmcvt_real output)
{
    const regime_constants driving = constants_of(at, DRIVING);
    const hmcvt_real drag = (driving.motor_drag * output) / at->stage->hydraulic_ratio;
    return (driving.motor * pressure) > drag;
}

/* The state at reversed pressure; NaN where the signs differ. */
static steady_state reversed_state(const setting *at, hmcvt_real ratio, hmcvt_real load)
{
    steady_state steady;
    hmcvt_real pump;
    hmcvt_real bound;
    bool is_motored;
    steady.output = row_root(at, REVERSED, ratio, load);
    steady.regime = REVERSED;
    pump = pump_torque(at, ratio, steady.output, R(1.0));
    is_motored = !(pump >= R(0.0));
    if (is_motored) {
        steady.output = row_root(at, MOTORED, ratio, load);
        steady.regime = MOTORED;
        pump = pump_torque(at, ratio, steady.output, R(1.0));
    }
    bound = ROUNDING * at->stiffness * steady.output;
    if ((pressure_at(at, ratio, steady.output) > bound) || (is_motored && (pump > bound))) {
        steady.output = UNKNOWN;
    }
    return steady;
}

/* The state while the pump turns forward; NaN without one. */
static steady_state forward_state(const setting *at, hmcvt_real ratio, hmcvt_real load)
{
    steady_state steady;
    bool is_other;
    steady.output = row_root(at, DRIVING, ratio, load);
    steady.regime = DRIVING;
    if (is_unknown(steady.output)) {
        /* At e <= 0 the pressure is never positive, so that only the other regimes count. */
        is_other = ratio <= R(0.0);
    } else {
        is_other = !drives(at, pressure_at(at, ratio, steady.output), steady.output);
    }
    if (is_other) {
        steady.output = row_root(at, DRIVEN, ratio, load);
        steady.regime = DRIVEN;
        if (!(pressure_at(at, ratio, steady.output) >= R(0.0))) {
            steady = reversed_state(at, ratio, load);
        }
    }
    return steady;
}

/* The state with the pump turned backward; NaN where it does not turn so. */
static steady_state backward_state(const setting *at, hmcvt_real ratio, hmcvt_real load)
{
    steady_state steady = {UNKNOWN, BACKWARD};
    int regime;
    for (regime = BACKWARD_MOTORED; regime >= BACKWARD; regime--) {
        const hmcvt_real candidate = row_root(at, regime, ratio, load);
        const hmcvt_real pump = pump_torque(at, ratio, candidate, R(-1.0));
        const hmcvt_real taken = (regime == BACKWARD) ? -pump : pump;
        const bool is_consistent =
            (taken >= R(0.0)) && (pressure_at(at, ratio, candidate) <= R(0.0));
        if (is_consistent && (pump_speed(at, candidate) < R(0.0))) {
            steady.output = candidate;
            steady.regime = regime;
        }
    }
    return steady;
}

/* Engine torque per engine speed. */
static hmcvt_real row_torque(const setting *at, hmcvt_real ratio, hmcvt_real output,
                             hmcvt_real pressure)
{
    const bool is_backward = pump_speed(at, output) < R(0.0);
    const hmcvt_real turning = is_backward ? R(-1.0) : R(1.0);
    const hmcvt_real pump = pump_torque_at(at, ratio, output, pressure, turning);
    const hmcvt_real *gears = is_backward ? at->stage->backward_gears : at->stage->gears;
    return (gears[0] * pump) + (gears[1] * magnitude(pump));
}

/* The quadrant in which the output starts, and e in it; false where friction holds the output. */
static bool row_quadrant(const stage_factors *stage, const hmcvt_parameters *parameters,
                         hmcvt_real displacement_ratio, setting *at, hmcvt_real *ratio)
{
    bool has_sense = false;
    int quadrant;
    for (quadrant = 0; (quadrant < 2) && !has_sense; quadrant++) {
        *at = setting_of(stage, quadrant, parameters);
        *ratio = at->quadrant->flow_ratio * displacement_ratio;
        has_sense = starts(at, *ratio);
    }
    return has_sense;
}

static solution solve_on_row(const stage_factors *stage, const hmcvt_parameters *parameters,
                             hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                             hmcvt_real load_torque)
{
    setting at;
    hmcvt_real ratio;
    const bool has_sense = row_quadrant(stage, parameters, displacement_ratio, &at, &ratio);
    const hmcvt_real load = load_torque / engine_speed;
    steady_state steady = {UNKNOWN, RESTING};
    solution solved = no_solution();
    if (!beyond_pole(&at, ratio)) {
        if (has_sense) {
            steady = forward_state(&at, ratio, load);
        } else if (load == R(0.0)) {
            steady.output = STANDING;
        } else {
            /* Friction holds the output: it carries no load. */
        }
    }
    if ((load == R(0.0)) && (steady.output == R(0.0))) {
        steady.output = STANDING;
    }
    if (steady.output > R(0.0)) {
        hmcvt_real pressure;
        hmcvt_real torque;
        if (pump_speed(&at, steady.output) < R(0.0)) {
            steady = backward_state(&at, ratio, load);
        }
        pressure = steady_pressure(&at, steady, ratio, load);
        torque = row_torque(&at, ratio, steady.output, pressure);
        solved =
            solution_of(&at, steady.output, torque * engine_speed, engine_speed, load_torque);
    }
    return solved;
}

#endif

/* --- one stage --------------------------------------------------------------------------------- */

/* The closed form, without effects. */
static solution solve_closed(const stage_factors *stage, const hmcvt_parameters *parameters,
                             hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                             hmcvt_real load_torque)
{
#if PUMP_AT_ENGINE && PUMP_ON_ROW
    solution solved;
    if (stage->pump_on_row) {
        solved = solve_on_row(stage, parameters, displacement_ratio, engine_speed, load_torque);
    } else {
        solved =
            solve_at_engine(stage, parameters, displacement_ratio, engine_speed, load_torque);
    }
    return solved;
#elif PUMP_AT_ENGINE
    return solve_at_engine(stage, parameters, displacement_ratio, engine_speed, load_torque);
#else
    return solve_on_row(stage, parameters, displacement_ratio, engine_speed, load_torque);
#endif
}

#if STATES_EFFECTS

/* Shift of the displacement ratio and torque to add; NaN where the tables have no answer. */
typedef struct {
    hmcvt_real shift;
    hmcvt_real torque;
} correction;

/* The interval of an axis that holds a value; how far the value is along it. */
static int interval_of(const effect_table *table, int axis, hmcvt_real value, hmcvt_real *part)
{
    const hmcvt_real *nodes = table->axes[axis];
    const int last = table->counts[axis] - 2;
    int interval = 0;
    while ((interval < last) && (value > nodes[interval + 1])) {
        interval++;
    }
    *part = (value - nodes[interval]) / (nodes[interval + 1] - nodes[interval]);
    return interval;
}

/* Linear interpolation. A displacement ratio beyond full stroke is extrapolated. */
static correction correction_at(const effect_table *table, hmcvt_real displacement_ratio,
                                hmcvt_real engine_speed, hmcvt_real load_torque)
{
    const hmcvt_real values[3] = {displacement_ratio, engine_speed, load_torque};
    correction sum = {R(0.0), R(0.0)};
    hmcvt_real parts[3];
    int first[3];
    int axis;
    int corner;
    for (axis = 0; axis < 3; axis++) {
        first[axis] = interval_of(table, axis, values[axis], &parts[axis]);
    }
    for (corner = 0; corner < 8; corner++) {
        hmcvt_real weight = R(1.0);
        int node = 0;
        int rest = corner;
        for (axis = 0; axis < 3; axis++) {
            const int upper = rest % 2;
            rest = rest / 2;
            weight *= (upper == 1) ? parts[axis] : (R(1.0) - parts[axis]);
            node = (node * table->counts[axis]) + first[axis] + upper;
        }
        sum.shift += weight * (hmcvt_real)table->shift[node];
        sum.torque += weight * (hmcvt_real)table->torque[node];
    }
    if (!within(load_torque, table->axes[2][0], table->axes[2][table->counts[2] - 1])) {
        sum.shift = UNKNOWN;
    }
    return sum;
}

static solution solve(const stage_factors *stage, const hmcvt_parameters *parameters,
                      hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                      hmcvt_real load_torque)
{
    const correction effects =
        correction_at(stage->effects, displacement_ratio, engine_speed, load_torque);
    solution solved = no_solution();
    if (!is_unknown(effects.shift)) {
        solved = solve_closed(stage, parameters, displacement_ratio + effects.shift,
                              engine_speed, load_torque);
        solved.engine_torque += effects.torque;
        solved.efficiency = efficiency_of(load_torque, solved.engine_torque);
    }
    return solved;
}

#else

static solution solve(const stage_factors *stage, const hmcvt_parameters *parameters,
                      hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                      hmcvt_real load_torque)
{
    return solve_closed(stage, parameters, displacement_ratio, engine_speed, load_torque);
}

#endif

static bool valid_parameters(const hmcvt_parameters *parameters)
{
    return within(parameters->leakage, R(${leakage_low}), R(${leakage_high})) &&
           within(parameters->motor_damping, R(${damping_low}), R(${damping_high})) &&
           within(parameters->pump_damping, R(${damping_low}), R(${damping_high}));
}

/* HMCVT_OK, or what is wrong with inputs that a pull and an overrun share. */
static int checked(const hmcvt_parameters *parameters, int stage, hmcvt_real engine_speed,
                   hmcvt_real load_torque)
{
    int status = HMCVT_OK;
    if ((stage < 0) || (stage >= HMCVT_STAGES)) {
        status = HMCVT_UNKNOWN_STAGE;
    } else if (!within(engine_speed, R(${engine_speed_low}), R(${engine_speed_high})) ||
               !within(load_torque, R(${load_low}), R(${load_high})) ||
               !valid_parameters(parameters)) {
        status = HMCVT_OUT_OF_RANGE;
    } else {
        /* All is well. */
    }
    return status;
}

static bool is_inside_domain(hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                             hmcvt_real load_torque)
{
#if STATES_DOMAIN
    return within(displacement_ratio, domain[0][0], domain[0][1]) &&
           within(engine_speed, domain[1][0], domain[1][1]) &&
           within(load_torque, domain[2][0], domain[2][1]);
#else
    (void)displacement_ratio;
    (void)engine_speed;
    (void)load_torque;
    return false;
#endif
}

int hmcvt_predict_with(const hmcvt_parameters *parameters, int stage,
                       hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                       hmcvt_real load_torque, hmcvt_prediction *out)
{
    solution solved = no_solution();
    int status = checked(parameters, stage, engine_speed, load_torque);
    out->inside_domain = 0;
    if ((status == HMCVT_OK) && !within(displacement_ratio, R(-1.0), R(1.0))) {
        status = HMCVT_OUT_OF_RANGE;
    }
    if (status == HMCVT_OK) {
        solved = solve(&stages[stage], parameters, displacement_ratio, engine_speed, load_torque);
        if (is_inside_domain(displacement_ratio, engine_speed, load_torque)) {
            out->inside_domain = 1;
        }
        if (is_unknown(solved.efficiency)) {
            status = HMCVT_NO_ANSWER;
        }
    }
    out->efficiency = solved.efficiency;
    out->output_speed = solved.output_speed;
    out->engine_torque = solved.engine_torque;
    out->power_loss = engine_speed * (solved.engine_torque - load_torque);
    return status;
}

int hmcvt_predict(int stage, hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                  hmcvt_real load_torque, hmcvt_prediction *out)
{
    return hmcvt_predict_with(&hmcvt_identified_parameters, stage, displacement_ratio,
                              engine_speed, load_torque, out);
}

/* --- signals of a control unit ----------------------------------------------------------------- */

hmcvt_signal hmcvt_signal_of(hmcvt_real output, hmcvt_real substitute)
{
    hmcvt_signal signal = {substitute, HMCVT_SUBSTITUTED};
    if (isfinite(output) != 0) {
        signal.value = output;
        signal.status = HMCVT_VALID;
    }
    return signal;
}

/* A signal, marked where no data cover its point. */
static hmcvt_signal covered_signal(hmcvt_real output, hmcvt_real substitute, int inside_domain)
{
    hmcvt_signal signal = hmcvt_signal_of(output, substitute);
    if ((signal.status == HMCVT_VALID) && (inside_domain == 0)) {
        signal.status = HMCVT_EXTRAPOLATED;
    }
    return signal;
}

int hmcvt_predict_signals(const hmcvt_parameters *parameters, int stage,
                          hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                          hmcvt_real load_torque, const hmcvt_substitutes *substitutes,
                          hmcvt_signals *out)
{
    hmcvt_prediction predicted;
    int status = hmcvt_predict_with(parameters, stage, displacement_ratio, engine_speed,
                                    load_torque, &predicted);
    const int inside = predicted.inside_domain;
    if (status == HMCVT_NO_ANSWER) {
        status = is_unknown(predicted.engine_torque) ? HMCVT_STALLED : HMCVT_DRAGGED;
    }
    out->efficiency = covered_signal(predicted.efficiency, substitutes->efficiency, inside);
    out->output_speed = covered_signal(predicted.output_speed, substitutes->output_speed, inside);
    out->engine_torque =
        covered_signal(predicted.engine_torque, substitutes->engine_torque, inside);
    out->power_loss = covered_signal(predicted.power_loss, substitutes->power_loss, inside);
    return status;
}

/* --- standard error ---------------------------------------------------------------------------- */

#if STATES_ERRORS
/* Change of the efficiency by one standard error of a parameter. */
static hmcvt_real slope_of(const hmcvt_parameters *stepped, int stage, int parameter,
                           hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                           hmcvt_real load_torque, hmcvt_real efficiency)
{
    const solution solved =
        solve(&stages[stage], stepped, displacement_ratio, engine_speed, load_torque);
    return (solved.efficiency - efficiency) * error_steps[parameter];
}

/* Standard error at a point with an efficiency; NaN where no parameter matters. */
static hmcvt_real error_of(const hmcvt_parameters *parameters, int stage,
                           hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                           hmcvt_real load_torque, hmcvt_real efficiency)
{
    hmcvt_parameters stepped[3];
    hmcvt_real slopes[3];
    hmcvt_real variance = R(0.0);
    bool depends = false;
    int i;
    int j;
    for (i = 0; i < 3; i++) {
        stepped[i] = *parameters;
    }
    stepped[0].leakage += parameter_steps[0];
    stepped[1].motor_damping += parameter_steps[1];
    stepped[2].pump_damping += parameter_steps[2];
    for (i = 0; i < 3; i++) {
        slopes[i] = slope_of(&stepped[i], stage, i, displacement_ratio, engine_speed,
                             load_torque, efficiency);
        depends = depends || (slopes[i] != R(0.0));
    }
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) {
            variance += slopes[i] * correlation[i][j] * slopes[j];
        }
    }
    return depends ? square_root(higher_of(variance, R(0.0)) + misfit_squared) : UNKNOWN;
}
#endif

int hmcvt_efficiency_std(const hmcvt_parameters *parameters, int stage,
                         hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                         hmcvt_real load_torque, hmcvt_real *out)
{
    hmcvt_prediction predicted;
    const int status = hmcvt_predict_with(parameters, stage, displacement_ratio, engine_speed,
                                          load_torque, &predicted);
    *out = UNKNOWN;
#if STATES_ERRORS
    if (status == HMCVT_OK) {
        *out = error_of(parameters, stage, displacement_ratio, engine_speed, load_torque,
                        predicted.efficiency);
    }
#endif
    return status;
}

/* --- best displacement ratio at a held engine speed ---------------------------------------------- */

/* Parts of the strokes on either side of rest. */
#define PARTS ${parts}

/* Steps of the golden section: its bracket shrinks from 2 / PARTS to less than ${bracket}. */
#define GOLDEN_STEPS ${golden_steps}

/* Where a search along the strokes looks: from a corner, as far as reach, and for what demand. */
typedef struct {
    const stage_factors *stage;
    const hmcvt_parameters *parameters;
    hmcvt_real engine_speed;
    hmcvt_real load_torque;
    hmcvt_real corner;
    hmcvt_real reach;
} stroke_line;

/* A point of such a line, and the efficiency at it. */
typedef struct {
    hmcvt_real efficiency;
    hmcvt_real way;
} stroke_candidate;

static hmcvt_real stroke_at(const stroke_line *line, hmcvt_real way)
{
    return line->corner + (line->reach * way * way);
}

/* Efficiency, 0 without an answer. */
static hmcvt_real value_at(const stroke_line *line, hmcvt_real way)
{
    const hmcvt_real efficiency = solve(line->stage, line->parameters, stroke_at(line, way),
                                        line->engine_speed, line->load_torque)
                                      .efficiency;
    return (efficiency > R(0.0)) ? efficiency : R(0.0);
}

/* Whether a candidate is at least as good as another; of equal ones the longer way counts. */
static bool is_as_good(stroke_candidate candidate, stroke_candidate other)
{
    const bool is_equal = !(candidate.efficiency > other.efficiency) &&
                          !(candidate.efficiency < other.efficiency);
    return (candidate.efficiency > other.efficiency) ||
           (is_equal && (candidate.way >= other.way));
}

/* The top between two ways with one maximum between them. */
static stroke_candidate golden_section(const stroke_line *line, hmcvt_real low, hmcvt_real high)
{
    const hmcvt_real golden = R(${golden});
    hmcvt_real a = low;
    hmcvt_real b = high;
    stroke_candidate c;
    stroke_candidate d;
    bool is_wide = true;
    int step;
    c.way = b - (golden * (b - a));
    d.way = a + (golden * (b - a));
    c.efficiency = value_at(line, c.way);
    d.efficiency = value_at(line, d.way);
    for (step = 0; (step < GOLDEN_STEPS) && is_wide; step++) {
        if (c.efficiency > d.efficiency) {
            b = d.way;
            d = c;
            c.way = b - (golden * (b - a));
            c.efficiency = value_at(line, c.way);
        } else {
            a = c.way;
            c = d;
            d.way = a + (golden * (b - a));
            d.efficiency = value_at(line, d.way);
        }
        is_wide = (b - a) > R(${bracket});
    }
    return is_as_good(d, c) ? d : c;
}

/* The top of a whole line: on a grid, then next to its best point. */
static stroke_candidate top_of(const stroke_line *line)
{
    stroke_candidate top = {R(-1.0), R(0.0)};
    int part;
    for (part = 0; part <= PARTS; part++) {
        stroke_candidate candidate;
        candidate.way = (hmcvt_real)part / R(PARTS);
        candidate.efficiency = value_at(line, candidate.way);
        if (is_as_good(candidate, top)) {
            top = candidate;
        }
    }
    if ((top.way > R(0.0)) || (value_at(line, R(${start})) > top.efficiency)) {
        const hmcvt_real low = higher_of(top.way - (R(1.0) / R(PARTS)), R(0.0));
        const hmcvt_real high = lower_of(top.way + (R(1.0) / R(PARTS)), R(1.0));
        const stroke_candidate closer = golden_section(line, low, high);
        if (is_as_good(closer, top)) {
            top = closer;
        }
    }
    return top;
}

#if PUMP_AT_ENGINE
/* Displacement ratio at which a motor comes to rest in one regime. */
static hmcvt_real resting_ratio(const setting *at, int regime, hmcvt_real load)
{
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real slowest =
        higher_of(at->quadrant->rest, square_root(load / constants.square));
    const hmcvt_real level = R(0.5) * ((constants.square * slowest) + (load / slowest));
    return ((level - constants.level) / constants.flow) / at->quadrant->flow_ratio;
}
#endif

/* Displacement ratios between which friction holds the motor or it stalls, within full stroke. */
static void resting_ratios(const stage_factors *stage, const hmcvt_parameters *parameters,
                           hmcvt_real load, hmcvt_real ends[2])
{
    ends[0] = R(0.0);
    ends[1] = R(0.0);
#if PUMP_AT_ENGINE
    if (!stage->pump_on_row) {
        const setting at = setting_of(stage, stage->reverse ? 2 : 0, parameters);
        const hmcvt_real driving = resting_ratio(&at, DRIVING, load);
        const hmcvt_real driven = resting_ratio(&at, DRIVEN, load);
        ends[0] = lower_of(higher_of(lower_of(driving, driven), R(-1.0)), R(1.0));
        ends[1] = lower_of(higher_of(higher_of(driving, driven), R(-1.0)), R(1.0));
    }
#else
    (void)stage;
    (void)parameters;
    (void)load;
#endif
}

/* The best displacement ratio; NaN where none carries the load. */
static hmcvt_real best_stroke(const stage_factors *stage, const hmcvt_parameters *parameters,
                              hmcvt_real engine_speed, hmcvt_real load_torque)
{
    hmcvt_real ends[2];
    hmcvt_real stroke = UNKNOWN;
    stroke_candidate best = {R(0.0), R(0.0)};
    int side;
    resting_ratios(stage, parameters, load_torque / engine_speed, ends);
    /* Between the two the whole flow leaks: of these strokes the one next to zero is best. */
    for (side = 0; side < 2; side++) {
        const hmcvt_real full = (side == 0) ? R(-1.0) : R(1.0);
        stroke_line line;
        stroke_candidate top;
        line.stage = stage;
        line.parameters = parameters;
        line.engine_speed = engine_speed;
        line.load_torque = load_torque;
        line.corner = ends[side];
        line.reach = full - ends[side];
        top = top_of(&line);
        if ((top.efficiency > R(0.0)) && is_as_good(top, best)) {
            best = top;
            stroke = stroke_at(&line, top.way);
        }
    }
    return stroke;
}

/* An optimum that is not known. */
static void clear_optimum(hmcvt_optimum *out)
{
    out->displacement_ratio = UNKNOWN;
    out->efficiency = UNKNOWN;
    out->engine_speed = UNKNOWN;
}

int hmcvt_optimal_displacement_ratio_with(const hmcvt_parameters *parameters, int stage,
                                          hmcvt_real engine_speed, hmcvt_real load_torque,
                                          hmcvt_optimum *out)
{
    int status = checked(parameters, stage, engine_speed, load_torque);
    clear_optimum(out);
    if ((status == HMCVT_OK) && !within(load_torque, R(${pull_low}), R(${pull_high}))) {
        status = HMCVT_OUT_OF_RANGE;
    }
    if (status == HMCVT_OK) {
        const stage_factors *engaged = &stages[stage];
        const hmcvt_real stroke = best_stroke(engaged, parameters, engine_speed, load_torque);
        if (is_unknown(stroke)) {
            status = HMCVT_NO_ANSWER;
        } else {
            out->displacement_ratio = stroke;
            out->efficiency =
                solve(engaged, parameters, stroke, engine_speed, load_torque).efficiency;
            out->engine_speed = engine_speed;
        }
    }
    return status;
}

int hmcvt_optimal_displacement_ratio(int stage, hmcvt_real engine_speed, hmcvt_real load_torque,
                                     hmcvt_optimum *out)
{
    return hmcvt_optimal_displacement_ratio_with(&hmcvt_identified_parameters, stage,
                                                 engine_speed, load_torque, out);
}

/* --- best engine speed at a held output ---------------------------------------------------------- */

/* Steps of a grid on one interval, and grids, each next to the best point of the one before. */
#define SCAN_STEPS ${scan_steps}
#define GRIDS ${grids}

/* The steady state that makes an output speed: pi, e and A of one regime. */
typedef struct {
    hmcvt_real pressure;
    hmcvt_real ratio;
    hmcvt_real square;
} held_state;

static held_state held_in(const setting *at, int regime, hmcvt_real output, hmcvt_real load)
{
    const regime_constants constants = constants_of(at, regime);
    const hmcvt_real motor = (output - at->quadrant->rest) / at->stage->hydraulic_ratio;
    const hmcvt_real pump = pump_speed(at, output);
    const hmcvt_real asked = (load / output) + (constants.motor_drag * motor);
    held_state held;
#if PUMP_ON_ROW
    if (at->stage->pump_on_row) {
        const regime_factors *factors = &at->quadrant->regimes[regime];
        const hmcvt_real brace = factors->brace * factors->pump;
        const hmcvt_real rest = asked - (constants.brace_drag * pump);
        const hmcvt_real linear = constants.motor + ((brace * motor) / pump);
        const hmcvt_real bend = (R(4.0) * brace * rest) / (at->stiffness * pump);
        held.pressure = (R(2.0) * rest) / (linear + square_root((linear * linear) + bend));
        held.ratio = (motor + (held.pressure / at->stiffness)) / pump;
        held.square = square_of(at, regime, held.ratio);
    } else
#endif
    {
        held.pressure = asked / constants.motor;
        held.ratio = (motor + (held.pressure / at->stiffness)) / pump;
        held.square = constants.square;
    }
    return held;
}

#if PUMP_AT_ENGINE
/* x below which a motor rests but for rounding. */
#define MOTOR_AT_REST R(${motor_at_rest})

/* Engine torque per engine speed, NaN where no steady motor keeps the state; sets e. */
static hmcvt_real held_at_engine(const setting *at, hmcvt_real output, hmcvt_real load,
                                 hmcvt_real *ratio)
{
    const hmcvt_real motor = (output - at->quadrant->rest) / at->stage->hydraulic_ratio;
    const bool is_driven = !(motor > MOTOR_AT_REST);
    held_state held = held_in(at, DRIVING, output, load);
    hmcvt_real torque = UNKNOWN;
    if (is_driven) {
        held = held_in(at, DRIVEN, output, load);
        if (!(held.pressure >= R(0.0))) {
            held = held_in(at, REVERSED, output, load);
        }
    }
    if (((held.square * output * output) >= load) && (!is_driven || !stalls(at, load))) {
        const hmcvt_real pump = pump_torque(at, held.ratio, output, R(1.0));
        torque = ((at->quadrant->mechanical_load * load) / output) +
                 (at->stage->gears[0] * pump) + (at->stage->gears[1] * magnitude(pump));
    }
    *ratio = held.ratio;
    return torque;
}
#endif

#if PUMP_ON_ROW
/* As held_at_engine. A pull never turns the pump backward. */
static hmcvt_real held_on_row(const setting *at, hmcvt_real output, hmcvt_real load,
                              hmcvt_real *ratio)
{
    held_state held = held_in(at, DRIVING, output, load);
    hmcvt_real torque = UNKNOWN;
    if (!drives(at, held.pressure, output)) {
        held = held_in(at, DRIVEN, output, load);
        if (!(held.pressure >= R(0.0))) {
            held = held_in(at, REVERSED, output, load);
            if (!(pump_torque(at, held.ratio, output, R(1.0)) >= R(0.0))) {
                held = held_in(at, MOTORED, output, load);
            }
        }
    }
    if (((held.square * output * output) >= load) && !beyond_pole(at, held.ratio) &&
        (pump_speed(at, output) >= R(0.0))) {
        torque = row_torque(at, held.ratio, output, pressure_at(at, held.ratio, output));
    }
    *ratio = held.ratio;
    return torque;
}
#endif

#if STATES_EFFECTS
/* Steps that undo a shift: each leaves a small part of the error before it. */
#define SHIFT_STEPS ${shift_steps}

/* The displacement ratio that the effects shift to another; adds their torque. */
static hmcvt_real unshifted(const effect_table *table, hmcvt_real shifted, hmcvt_real engine_speed,
                            hmcvt_real load_torque, hmcvt_real *torque)
{
    hmcvt_real stroke = lower_of(higher_of(shifted, R(-1.0)), R(1.0));
    correction effects = correction_at(table, stroke, engine_speed, load_torque);
    int step;
    for (step = 0; step < SHIFT_STEPS; step++) {
        stroke = shifted - effects.shift;
        effects = correction_at(table, stroke, engine_speed, load_torque);
    }
    *torque += effects.torque;
    if (!(magnitude((stroke + effects.shift) - shifted) < R(${shift_tolerance}))) {
        *torque = UNKNOWN;
    }
    return stroke;
}
#endif

/* The demand of a search along engine speeds. */
typedef struct {
    setting at;
    hmcvt_real output_speed;
    hmcvt_real output_power;
} demand;

/* Engine torque that meets a demand at an engine speed, NaN where the stage cannot; the stroke. */
static hmcvt_real held_torque(const demand *asked, hmcvt_real engine_speed, hmcvt_real *stroke)
{
    const setting *at = &asked->at;
    const hmcvt_real output = (at->quadrant->reflection * asked->output_speed) / engine_speed;
    const hmcvt_real load = (asked->output_power / engine_speed) / engine_speed;
    hmcvt_real ratio = UNKNOWN;
    hmcvt_real torque;
    hmcvt_real exact;
#if PUMP_AT_ENGINE && PUMP_ON_ROW
    if (at->stage->pump_on_row) {
        torque = held_on_row(at, output, load, &ratio);
    } else {
        torque = held_at_engine(at, output, load, &ratio);
    }
#elif PUMP_AT_ENGINE
    torque = held_at_engine(at, output, load, &ratio);
#else
    torque = held_on_row(at, output, load, &ratio);
#endif
    exact = ratio / at->quadrant->flow_ratio;
    torque *= engine_speed;
#if STATES_EFFECTS
    exact = unshifted(at->stage->effects, exact, engine_speed, load * engine_speed, &torque);
#endif
    *stroke = lower_of(higher_of(exact, R(-1.0)), R(1.0));
    if (!(magnitude(exact - *stroke) < R(${edge}))) {
        torque = UNKNOWN;
    }
    return torque;
}

/* Whether engine speeds between two limits may give the output. */
static bool reaches(const demand *asked, hmcvt_real low, hmcvt_real high)
{
    const hmcvt_real sense = (asked->output_speed > R(0.0)) ? R(1.0) : R(-1.0);
    const hmcvt_real first = sense * asked->at.stage->ratio_ends[0];
    const hmcvt_real last = sense * asked->at.stage->ratio_ends[1];
    const hmcvt_real slowest = lower_of(first, last) * (R(1.0) - R(${slip})) * low;
    const hmcvt_real fastest = higher_of(first, last) * (R(1.0) + R(${slip})) * high;
    return within(magnitude(asked->output_speed), slowest, fastest);
}

/* The engine speed of least engine power, and that power; NaN and infinity without one. */
typedef struct {
    hmcvt_real engine_speed;
    hmcvt_real power;
} speed_candidate;

/* An interval of engine speeds, and the part of it that the next grid looks at. */
typedef struct {
    hmcvt_real low;
    hmcvt_real high;
    hmcvt_real first;
    hmcvt_real last;
} speed_interval;

/* The best of a grid on an interval, which is narrowed to its neighbours. */
static speed_candidate best_of_grid(const demand *asked, speed_interval *interval)
{
    const hmcvt_real step = (interval->last - interval->first) / R(SCAN_STEPS);
    speed_candidate lowest;
    int i;
    lowest.engine_speed = interval->first;
    lowest.power = UNBOUNDED;
    for (i = 0; i <= SCAN_STEPS; i++) {
        const hmcvt_real engine_speed = interval->first + (step * (hmcvt_real)i);
        hmcvt_real stroke;
        const hmcvt_real power = held_torque(asked, engine_speed, &stroke) * engine_speed;
        if (power < lowest.power) {
            lowest.engine_speed = engine_speed;
            lowest.power = power;
        }
    }
    interval->first = higher_of(lowest.engine_speed - step, interval->low);
    interval->last = lower_of(lowest.engine_speed + step, interval->high);
    return lowest;
}

/*
 * The intervals to search: on either side of the engine speed at which the unit on the row rests.
 * Friction sets a step there, and often a lowest point next to it. Returns their count.
 */
static int intervals_of(const demand *asked, hmcvt_real low, hmcvt_real high,
                        speed_interval intervals[2])
{
    const hmcvt_real ratio = asked->at.stage->rest_ratio;
    hmcvt_real below = high;
    hmcvt_real above = high;
    int count = 0;
    if (ratio != R(0.0)) {
        const hmcvt_real rest = asked->output_speed / ratio;
        const hmcvt_real next = R(${next_to_rest});
        below = lower_of(higher_of(rest * (R(1.0) - next), low), high);
        above = lower_of(higher_of(rest * (R(1.0) + next), low), high);
    }
    if (low < below) {
        const speed_interval slower = {low, below, low, below};
        intervals[count] = slower;
        count++;
    }
    if (above < high) {
        const speed_interval faster = {above, high, above, high};
        intervals[count] = faster;
        count++;
    }
    return count;
}

/* The engine speed of least power between two limits. */
static speed_candidate least_power(const demand *asked, hmcvt_real low, hmcvt_real high)
{
    speed_interval intervals[2];
    const int count = intervals_of(asked, low, high, intervals);
    speed_candidate best = {UNKNOWN, UNBOUNDED};
    bool is_possible = true;
    int grid;
    for (grid = 0; (grid < GRIDS) && is_possible; grid++) {
        int i;
        for (i = 0; i < count; i++) {
            const speed_candidate lowest = best_of_grid(asked, &intervals[i]);
            if (lowest.power < best.power) {
                best = lowest;
            }
        }
        is_possible = best.power < UNBOUNDED;
    }
    return best;
}

static int checked_demand(const hmcvt_parameters *parameters, int stage, hmcvt_real output_speed,
                          hmcvt_real output_power, hmcvt_real low, hmcvt_real high)
{
    int status = checked(parameters, stage, low, R(0.0));
    if ((status == HMCVT_OK) &&
        (!within(magnitude(output_speed), R(${output_speed_low}), R(${output_speed_high})) ||
         !within(output_power, R(0.0), R(${output_power_high})) || !(output_power > R(0.0)) ||
         !within(high, R(${engine_speed_low}), R(${engine_speed_high})) || !(low < high))) {
        status = HMCVT_OUT_OF_RANGE;
    }
    return status;
}

int hmcvt_optimal_engine_speed_with(const hmcvt_parameters *parameters, int stage,
                                    hmcvt_real output_speed, hmcvt_real output_power,
                                    hmcvt_real lowest_engine_speed,
                                    hmcvt_real highest_engine_speed, hmcvt_optimum *out)
{
    int status = checked_demand(parameters, stage, output_speed, output_power,
                                lowest_engine_speed, highest_engine_speed);
    clear_optimum(out);
    if (status == HMCVT_OK) {
        const stage_factors *engaged = &stages[stage];
        const int backward = engaged->pump_on_row ? 1 : 2;
        speed_candidate best = {UNKNOWN, UNBOUNDED};
        demand asked;
        asked.at = setting_of(engaged, (output_speed > R(0.0)) ? 0 : backward, parameters);
        asked.output_speed = output_speed;
        asked.output_power = output_power;
        status = HMCVT_NO_ANSWER;
        if (reaches(&asked, lowest_engine_speed, highest_engine_speed)) {
            best = least_power(&asked, lowest_engine_speed, highest_engine_speed);
        }
        if (best.power < UNBOUNDED) {
            hmcvt_real stroke;
            const hmcvt_real torque = held_torque(&asked, best.engine_speed, &stroke);
            status = HMCVT_OK;
            out->displacement_ratio = stroke;
            out->efficiency = (output_power / best.engine_speed) / torque;
            out->engine_speed = best.engine_speed;
        }
    }
    return status;
}

int hmcvt_optimal_engine_speed(int stage, hmcvt_real output_speed, hmcvt_real output_power,
                               hmcvt_real lowest_engine_speed, hmcvt_real highest_engine_speed,
                               hmcvt_optimum *out)
{
    return hmcvt_optimal_engine_speed_with(&hmcvt_identified_parameters, stage, output_speed,
                                           output_power, lowest_engine_speed,
                                           highest_engine_speed, out);
}
