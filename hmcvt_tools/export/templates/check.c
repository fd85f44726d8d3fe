/*
 * Self-test of the exported model: compares every answer of vectors.csv, which Python wrote.
 *
 *   cc -std=c99 -O2 hmcvt_model.c check.c -lm -o check
 *   ./check vectors.csv
 *
 * It returns 0 and prints one line when all answers agree, else 1 and the first that does not.
 */
#include "hmcvt_model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INPUTS 4
#define OUTPUTS 5
#define LONGEST_LINE 1024

/*
 * Largest difference, as a part of the larger of 1 and the quantity: predictions agree bit by bit in
 * double precision, except for tables of effects. Of a search the efficiency counts: two points may
 * be as good.
 */
#if HMCVT_SINGLE_PRECISION
static const double prediction_tolerance = ${single_tolerance};
static const double search_tolerance = ${single_tolerance};
#else
static const double prediction_tolerance = ${prediction_tolerance};
static const double search_tolerance = ${search_tolerance};
#endif

/* One row of vectors.csv. */
typedef struct {
    char function[32];
    int stage;
    double inputs[INPUTS];
    int status;
    double outputs[OUTPUTS];
} vector;

/* What the functions answer, as in the columns of the file. */
typedef struct {
    int status;
    double outputs[OUTPUTS];
} answer;

/* Read numbers that commas end; returns 0 where one is missing. */
static int read_numbers(char **text, double *numbers, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        char *end;
        if (**text != ',') {
            return 0;
        }
        numbers[i] = strtod(*text + 1, &end);
        if (end == *text + 1) {
            return 0;
        }
        *text = end;
    }
    return 1;
}

static int read_vector(char *line, vector *row)
{
    const size_t length = strcspn(line, ",");
    char *text = line + length;
    double number;
    if (length >= sizeof row->function) {
        return 0;
    }
    memcpy(row->function, line, length);
    row->function[length] = '\0';
    if (!read_numbers(&text, &number, 1)) {
        return 0;
    }
    row->stage = (int)number;
    if (!read_numbers(&text, row->inputs, INPUTS) || !read_numbers(&text, &number, 1)) {
        return 0;
    }
    row->status = (int)number;
    return read_numbers(&text, row->outputs, OUTPUTS);
}

/* Whether a signal is the output, or the substitute for one that is not known. */
static int is_signal_of(hmcvt_signal signal, hmcvt_real output, hmcvt_real substitute)
{
    int agrees = (signal.status != HMCVT_SUBSTITUTED) && (signal.value == output);
    if (isnan(output)) {
        agrees = (signal.status == HMCVT_SUBSTITUTED) && (signal.value == substitute);
    }
    return agrees;
}

/* Whether the signals of a control unit are the outputs of a prediction. */
static int signals_agree(const vector *row, const hmcvt_prediction *out, int status)
{
    const hmcvt_substitutes instead = {-1, -2, -3, -4};
    hmcvt_signals got;
    const int returned = hmcvt_predict_signals(
        &hmcvt_identified_parameters, row->stage, (hmcvt_real)row->inputs[0],
        (hmcvt_real)row->inputs[1], (hmcvt_real)row->inputs[2], &instead, &got);
    const int no_answer = (returned == HMCVT_STALLED) || (returned == HMCVT_DRAGGED);
    return ((no_answer ? HMCVT_NO_ANSWER : returned) == status) &&
           is_signal_of(got.efficiency, out->efficiency, instead.efficiency) &&
           is_signal_of(got.output_speed, out->output_speed, instead.output_speed) &&
           is_signal_of(got.engine_torque, out->engine_torque, instead.engine_torque) &&
           is_signal_of(got.power_loss, out->power_loss, instead.power_loss);
}

static answer predicted(const vector *row)
{
    hmcvt_prediction out;
    answer got;
    got.status = hmcvt_predict(row->stage, (hmcvt_real)row->inputs[0],
                               (hmcvt_real)row->inputs[1], (hmcvt_real)row->inputs[2], &out);
    if (!signals_agree(row, &out, got.status)) {
        got.status = -1;
    }
    got.outputs[0] = (double)out.efficiency;
    got.outputs[1] = (double)out.output_speed;
    got.outputs[2] = (double)out.engine_torque;
    got.outputs[3] = (double)out.power_loss;
    got.outputs[4] = (double)out.inside_domain;
    return got;
}

static answer searched(const vector *row)
{
    hmcvt_optimum out;
    answer got;
    if (strcmp(row->function, "optimal_displacement_ratio") == 0) {
        got.status = hmcvt_optimal_displacement_ratio(row->stage, (hmcvt_real)row->inputs[0],
                                                      (hmcvt_real)row->inputs[1], &out);
    } else {
        got.status = hmcvt_optimal_engine_speed(
            row->stage, (hmcvt_real)row->inputs[0], (hmcvt_real)row->inputs[1],
            (hmcvt_real)row->inputs[2], (hmcvt_real)row->inputs[3], &out);
    }
    got.outputs[0] = (double)out.displacement_ratio;
    got.outputs[1] = (double)out.efficiency;
    got.outputs[2] = (double)out.engine_speed;
    got.outputs[3] = 0.0;
    got.outputs[4] = 0.0;
    return got;
}

/* Difference of two numbers as a part of the larger of 1, the number and a scale. */
static double difference(double expected, double got, double scale)
{
    double largest = fmax(1.0, fmax(fabs(expected), scale));
    if (isnan(expected) || isnan(got)) {
        return (isnan(expected) && isnan(got)) ? 0.0 : INFINITY;
    }
    return fabs(expected - got) / largest;
}

/* Largest difference of an answer, in tolerances. */
static double deviation(const vector *row, const answer *got)
{
    const int is_prediction = strcmp(row->function, "predict") == 0;
    const double tolerance = is_prediction ? prediction_tolerance : search_tolerance;
    double largest = 0.0;
    int i;
    if (got->status != row->status) {
        return INFINITY;
    }
    for (i = 0; i < OUTPUTS; i++) {
        /* A loss is the difference of two powers. */
        const double scale =
            (is_prediction && (i == 3)) ? fabs(row->inputs[1] * row->inputs[2]) : 0.0;
        const double parts = difference(row->outputs[i], got->outputs[i], scale);
        const int counts = is_prediction || (i == 1);
        if (counts && (parts > 0.0)) {
            largest = fmax(largest, (tolerance > 0.0) ? (parts / tolerance) : INFINITY);
        }
    }
    return largest;
}

static int has_fingerprint(const char *line)
{
    const char *const prefix = "fingerprint,";
    const size_t length = strlen(hmcvt_fingerprint);
    return (strncmp(line, prefix, strlen(prefix)) == 0) &&
           (strncmp(line + strlen(prefix), hmcvt_fingerprint, length) == 0);
}

/* Compare every row; returns their count, or -1 after a message. */
static long compare(FILE *file, double *largest)
{
    char line[LONGEST_LINE];
    long rows = 0;
    if ((fgets(line, LONGEST_LINE, file) == NULL) || !has_fingerprint(line)) {
        printf("the vectors are not those of model %s\n", hmcvt_fingerprint);
        return -1;
    }
    if (fgets(line, LONGEST_LINE, file) == NULL) {
        printf("the vectors end after their first line\n");
        return -1;
    }
    while (fgets(line, LONGEST_LINE, file) != NULL) {
        vector row;
        answer got;
        double tolerances;
        if (!read_vector(line, &row)) {
            printf("row %ld of the vectors cannot be read\n", rows + 1);
            return -1;
        }
        got = (strcmp(row.function, "predict") == 0) ? predicted(&row) : searched(&row);
        tolerances = deviation(&row, &got);
        if (!(tolerances <= 1.0)) {
            printf("row %ld differs: %s of stage %d: status %d, expected %d; %.17g, expected %.17g\n",
                   rows + 1, row.function, row.stage, got.status, row.status, got.outputs[0],
                   row.outputs[0]);
            return -1;
        }
        *largest = fmax(*largest, tolerances);
        rows++;
    }
    return rows;
}

int main(int argc, char **argv)
{
    const char *const path = (argc > 1) ? argv[1] : "vectors.csv";
    FILE *const file = fopen(path, "r");
    double largest = 0.0;
    long rows;
    if (file == NULL) {
        printf("%s cannot be read\n", path);
        return 1;
    }
    rows = compare(file, &largest);
    fclose(file);
    if (rows < 1) {
        return 1;
    }
    printf("model %s: %ld answers agree with Python, largest difference %.2g of the tolerance\n",
           hmcvt_fingerprint, rows, largest);
    return 0;
}
