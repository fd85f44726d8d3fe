# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Exported C, built as a shared library and called at many points through ctypes."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

WARNINGS = ("-Wall", "-Wextra", "-Werror", "-pedantic")
COMPILER = shutil.which("gcc") or shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
BATCH = Path(__file__).with_name("batch.c")


def compile_c(folder, target, *arguments, compiler=COMPILER):
    """Compile with the warnings of the house; a warning fails."""
    command = [compiler, "-std=c99", *WARNINGS, *map(str, arguments), "-lm"]
    done = subprocess.run(
        [*command, "-o", str(target)], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return target


class Library:
    """The exported functions of a folder, over arrays."""

    def __init__(self, folder, model, precision="double"):
        target = compile_c(
            folder,
            folder / "batch.so",
            "-O2",
            "-fPIC",
            "-shared",
            "-I.",
            "hmcvt_model.c",
            BATCH,
        )
        self.library = ctypes.CDLL(str(target))
        self.real = np.float32 if precision == "single" else np.float64
        self.prediction = np.dtype(
            [
                ("efficiency", self.real),
                ("output_speed", self.real),
                ("engine_torque", self.real),
                ("power_loss", self.real),
                ("inside_domain", np.int32),
            ],
            align=True,
        )
        self.optimum = np.dtype(
            [
                ("displacement_ratio", self.real),
                ("efficiency", self.real),
                ("engine_speed", self.real),
            ]
        )
        self.parameters = model.parameters.to_array()

    def reals(self, values):
        return np.ascontiguousarray(values, dtype=self.real)

    def call(self, name, stage, columns, dtype, scalars=()):
        columns = [self.reals(column) for column in columns]
        n = columns[0].size
        stages = np.full(n, stage, dtype=np.int32)
        out = np.empty(n, dtype=dtype)
        status = np.empty(n, dtype=np.int32)
        parameters = self.reals(self.parameters)
        real = ctypes.c_float if self.real is np.float32 else ctypes.c_double
        pointers = [array.ctypes for array in (stages, *columns)]
        getattr(self.library, name)(
            parameters.ctypes,
            ctypes.c_int(n),
            *pointers,
            *(real(scalar) for scalar in scalars),
            out.ctypes,
            status.ctypes,
        )
        return out, status

    def predict(self, stage, *point):
        return self.call("batch_predict", stage, point, self.prediction)

    def std(self, stage, *point):
        return self.call("batch_std", stage, point, self.real)

    def stroke(self, stage, *demand):
        return self.call("batch_stroke", stage, demand, self.optimum)

    def speed(self, stage, *demand, limits):
        return self.call("batch_speed", stage, demand, self.optimum, limits)
