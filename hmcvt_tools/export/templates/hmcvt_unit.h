/*
 * The variables of the FMU and what they hold, for either version of FMI.
 */
#ifndef HMCVT_UNIT_H
#define HMCVT_UNIT_H

#include "hmcvt_stage.h"

#include <stdbool.h>

/* Identifies the FMU: that of modelDescription.xml. */
#define HMCVT_TOKEN "${token}"

/* Value references. */
enum {
${references}
};

/* What an instance remembers: the values set from outside. Outputs follow from them at any time. */
typedef struct {
    hmcvt_parameters parameters;
    double time;
    double displacement_ratio;
    double engine_speed;
    double load_torque;
    double demanded_output_speed;
    double demanded_output_power;
    double hysteresis;
    double lowest_engine_speed;
    double highest_engine_speed;
    int stage;
} hmcvt_unit;

/* Give every variable its start value. */
void hmcvt_unit_reset(hmcvt_unit *unit);

/* Get or set a variable; false for a reference that is unknown, of another type or not to be set. */
bool hmcvt_unit_get_real(const hmcvt_unit *unit, unsigned int reference, double *value);
bool hmcvt_unit_set_real(hmcvt_unit *unit, unsigned int reference, double value);
bool hmcvt_unit_get_integer(const hmcvt_unit *unit, unsigned int reference, int *value);
bool hmcvt_unit_set_integer(hmcvt_unit *unit, unsigned int reference, int value);
bool hmcvt_unit_get_boolean(const hmcvt_unit *unit, unsigned int reference, bool *value);

#endif
