/* Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0 */
/* Loads the Windows library of an FMU 2.0, and prints its efficiency at points of the command line. */
#include <windows.h>

#include "fmi2FunctionTypes.h"

#include <stdio.h>
#include <stdlib.h>

#define LOAD(type, name) type *name = (type *)(void *)GetProcAddress(library, #name)

int main(int argc, char **argv)
{
    const fmi2CallbackFunctions callbacks = {NULL, calloc, free, NULL, NULL};
    const fmi2ValueReference inputs[3] = {1, 2, 3};
    const fmi2ValueReference efficiency = 5;
    HMODULE library = LoadLibraryA(argv[1]);
    int i;
    if (library == NULL) {
        return 1;
    }
    LOAD(fmi2InstantiateTYPE, fmi2Instantiate);
    LOAD(fmi2SetRealTYPE, fmi2SetReal);
    LOAD(fmi2GetRealTYPE, fmi2GetReal);
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance);
    fmi2Component c =
        fmi2Instantiate("unit", fmi2CoSimulation, argv[2], "", &callbacks, fmi2False, fmi2False);
    if (c == NULL) {
        return 1;
    }
    for (i = 3; i + 2 < argc; i += 3) {
        fmi2Real point[3];
        fmi2Real value;
        point[0] = strtod(argv[i], NULL);
        point[1] = strtod(argv[i + 1], NULL);
        point[2] = strtod(argv[i + 2], NULL);
        fmi2SetReal(c, inputs, 3, point);
        fmi2GetReal(c, &efficiency, 1, &value);
        printf("%.17g\n", value);
    }
    fmi2FreeInstance(c);
    return 0;
}
