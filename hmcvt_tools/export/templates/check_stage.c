/*
 * Self-test of the choice of the stage: compares it with stage_vectors.csv, which Python wrote.
 *
 *   cc -std=c99 -O2 hmcvt_model.c hmcvt_stage.c check_stage.c -lm -o check_stage
 *   ./check_stage stage_vectors.csv
 *
 * It returns 0 and prints one line when all stages agree, else 1 and the first that does not.
 */
#include "hmcvt_stage.h"

#include <stdio.h>

#define LONGEST_LINE 512

int main(int count, char **arguments)
{
    char line[LONGEST_LINE];
    long compared = 0;
    FILE *file = count == 2 ? fopen(arguments[1], "r") : NULL;

    if (file == NULL) {
        printf("usage: check_stage stage_vectors.csv\n");
        return 1;
    }
    while (fgets(line, LONGEST_LINE, file) != NULL) {
        double input[5];
        int engaged;
        int expected;
        hmcvt_stage_choice choice;

        if (sscanf(line, "%d,%lf,%lf,%lf,%lf,%lf,%d", &engaged, &input[0], &input[1], &input[2],
                   &input[3], &input[4], &expected) != 7) {
            continue; /* the header */
        }
        (void)hmcvt_choose_stage(engaged, (hmcvt_real)input[0], (hmcvt_real)input[1],
                                 (hmcvt_real)input[2], (hmcvt_real)input[3], (hmcvt_real)input[4],
                                 &choice);
        if (choice.stage != expected) {
            printf("stage %d instead of %d: %s", choice.stage, expected, line);
            (void)fclose(file);
            return 1;
        }
        compared++;
    }
    (void)fclose(file);
    if (compared == 0) {
        printf("no vectors\n");
        return 1;
    }
    printf("model %s: %ld choices of a stage agree\n", hmcvt_fingerprint, compared);
    return 0;
}
