/*
 * Efficiency of a hydromechanical CVT: the model ${fingerprint} of hmcvt ${version}.
 *
 * SI units: rad/s, N m, W; displacement ratio and efficiency are plain fractions. The load torque is
 * referred to the engine shaft: output power / engine speed. It is negative in overrun.
 *
 * C99. No function allocates memory, calls itself or keeps a state: all may run in parallel and in
 * interrupts. Every loop is bounded.
 *
 * ${guarantee}
 *
 * Compile with -std=c99 or -ffp-contract=off, and without -ffast-math.
 */
#ifndef HMCVT_MODEL_H
#define HMCVT_MODEL_H

#ifdef __cplusplus
extern "C" {
#endif

/* 1 computes in single precision, 0 in double precision. */
#ifndef HMCVT_SINGLE_PRECISION
#define HMCVT_SINGLE_PRECISION ${single}
#endif

#if HMCVT_SINGLE_PRECISION
typedef float hmcvt_real;
#else
typedef double hmcvt_real;
#endif

/* Answers of the functions. */
enum {
    HMCVT_OK = 0,            /* all outputs are set */
    HMCVT_NO_ANSWER = 1,     /* the load is not carried, or the engine drags in overrun: see below */
    HMCVT_OUT_OF_RANGE = 2,  /* an input is not finite or outside its range */
    HMCVT_UNKNOWN_STAGE = 3, /* the stage is not one of 0 to HMCVT_STAGES - 1 */
    /* Of hmcvt_predict_signals alone, in place of HMCVT_NO_ANSWER: */
    HMCVT_STALLED = 4, /* the load is not carried; every signal holds its substitute */
    HMCVT_DRAGGED = 5  /* the engine drags in overrun; the efficiency holds its substitute */
};

/* Status of one signal. */
enum {
    HMCVT_VALID = 0,        /* the answer of the model */
    HMCVT_EXTRAPOLATED = 1, /* the same, not covered by data of the identification */
    HMCVT_SUBSTITUTED = 2   /* the model has no answer: the value is the substitute */
};

/* Stages, numbered from 0:${stage_list} */
#define HMCVT_STAGES ${stages}
extern const char *const hmcvt_stage_names[HMCVT_STAGES];

/* Changes when the physics of the model changes. */
extern const char hmcvt_fingerprint[];

/* Hydraulic parameters, which may be calibrated at run time. */
typedef struct {
    hmcvt_real leakage;       /* leakage flow per pressure [m3/(s Pa)], ${leakage_range} */
    hmcvt_real motor_damping; /* viscous torque per motor speed [N m s/rad], ${damping_range} */
    hmcvt_real pump_damping;  /* viscous torque per pump speed [N m s/rad], ${damping_range} */
} hmcvt_parameters;

/* The parameters as identified. */
extern const hmcvt_parameters hmcvt_identified_parameters;

/* Outputs that are not known are NaN. */
typedef struct {
    hmcvt_real efficiency;    /* output power / engine power; in overrun the reciprocal [-] */
    hmcvt_real output_speed;  /* [rad/s], negative backward */
    hmcvt_real engine_torque; /* [N m] */
    hmcvt_real power_loss;    /* engine power less output power [W] */
    int inside_domain;        /* 1 where data of the identification cover the point, else 0 */
} hmcvt_prediction;

typedef struct {
    hmcvt_real displacement_ratio; /* [-] */
    hmcvt_real efficiency;         /* [-] */
    hmcvt_real engine_speed;       /* [rad/s] */
} hmcvt_optimum;

/*
 * Predict efficiency, output speed, engine torque and loss at an operating point.
 *
 * displacement_ratio: pump stroke, ${displacement_ratio_range}.
 * engine_speed: ${engine_speed_range}.
 * load_torque: ${load_torque_range}.
 *
 * HMCVT_NO_ANSWER: the efficiency is not defined. Where the wheels in overrun give less than the
 * losses take, the other outputs are set; where the load is not carried, all are NaN.
 */
int hmcvt_predict(int stage, hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                  hmcvt_real load_torque, hmcvt_prediction *out);

/* The same with other parameters. */
int hmcvt_predict_with(const hmcvt_parameters *parameters, int stage,
                       hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                       hmcvt_real load_torque, hmcvt_prediction *out);

/*
 * One signal for a control unit. Its value is never NaN and never infinite.
 */
typedef struct {
    hmcvt_real value;
    int status; /* HMCVT_VALID, HMCVT_EXTRAPOLATED or HMCVT_SUBSTITUTED */
} hmcvt_signal;

typedef struct {
    hmcvt_signal efficiency;    /* [-] */
    hmcvt_signal output_speed;  /* [rad/s] */
    hmcvt_signal engine_torque; /* [N m] */
    hmcvt_signal power_loss;    /* [W] */
} hmcvt_signals;

/* Values that stand for answers which the model does not have. */
typedef struct {
    hmcvt_real efficiency;
    hmcvt_real output_speed;
    hmcvt_real engine_torque;
    hmcvt_real power_loss;
} hmcvt_substitutes;

/*
 * hmcvt_predict_with for a control unit: each signal has a status, and holds a substitute where the
 * model has no answer. Returns HMCVT_STALLED and HMCVT_DRAGGED in place of HMCVT_NO_ANSWER.
 */
int hmcvt_predict_signals(const hmcvt_parameters *parameters, int stage,
                          hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                          hmcvt_real load_torque, const hmcvt_substitutes *substitutes,
                          hmcvt_signals *out);

/* Any other output as a signal: HMCVT_VALID, or the substitute where the output is not finite. */
hmcvt_signal hmcvt_signal_of(hmcvt_real output, hmcvt_real substitute);

/*
 * Standard error of the efficiency [-], from the errors of the parameters and from what the model
 * misses at samples left out of its fit; NaN where ${error_remark}.
 */
int hmcvt_efficiency_std(const hmcvt_parameters *parameters, int stage,
                         hmcvt_real displacement_ratio, hmcvt_real engine_speed,
                         hmcvt_real load_torque, hmcvt_real *out);

/*
 * Half the width of an interval of 90 % in such standard errors: Student's t with the degrees of
 * freedom of the identification, 1.645 where its noise is known.
 */
extern const hmcvt_real hmcvt_interval_90;

/*
 * Find the displacement ratio of the highest efficiency at a held engine speed.
 *
 * load_torque: ${pull_range}. HMCVT_NO_ANSWER: no displacement ratio carries it.
 */
int hmcvt_optimal_displacement_ratio(int stage, hmcvt_real engine_speed, hmcvt_real load_torque,
                                     hmcvt_optimum *out);

/* The same with other parameters. */
int hmcvt_optimal_displacement_ratio_with(const hmcvt_parameters *parameters, int stage,
                                          hmcvt_real engine_speed, hmcvt_real load_torque,
                                          hmcvt_optimum *out);

/*
 * Find the engine speed and displacement ratio of the least engine power at a held output.
 *
 * output_speed: ${output_speed_range}.
 * output_power: above 0 [W].
 * lowest_engine_speed, highest_engine_speed: limits, rising, ${engine_speed_range}.
 */
int hmcvt_optimal_engine_speed(int stage, hmcvt_real output_speed, hmcvt_real output_power,
                               hmcvt_real lowest_engine_speed, hmcvt_real highest_engine_speed,
                               hmcvt_optimum *out);

/* The same with other parameters. */
int hmcvt_optimal_engine_speed_with(const hmcvt_parameters *parameters, int stage,
                                    hmcvt_real output_speed, hmcvt_real output_power,
                                    hmcvt_real lowest_engine_speed,
                                    hmcvt_real highest_engine_speed, hmcvt_optimum *out);

#ifdef __cplusplus
}
#endif

#endif
