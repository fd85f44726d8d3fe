# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Import a random table by the command, and compare what it wrote with the truth."""

import contextlib
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hmcvt_core import read_bench
from hmcvt_tools.cli import main

from .truth import RandomTable

COMPARED = (
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "efficiency",
    "output_speed",
    "oil_temperature",
)


class Judged(NamedTuple):
    """Outcome of one import.

    Attributes:
        code: exit code of the command.
        message: last line on stderr.
        wrong: what is off by more than the rounding; `""` for nothing.
    """

    code: int
    message: str
    wrong: str


def judge(table: RandomTable, folder: Path) -> Judged:
    """Import a table with `--yes --skip-bad` and compare the samples.

    Args:
        table: with its truth.
        folder: to work in.
    """
    path = folder / "table.csv"
    out = folder / "bench.csv"
    out.unlink(missing_ok=True)
    table.write(path)
    words = ["import", str(path), "--out", str(out), "--yes", "--skip-bad"]
    code = 0
    errors = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        try:
            main(words)
        except SystemExit as stopped:
            code = int(stopped.code or 0)
    lines = errors.getvalue().splitlines()
    message = lines[-1] if lines else ""
    if code != 0:
        return Judged(code, message, "")
    samples = read_bench(out)
    truth = table.truth
    distance = np.abs(samples.displacement_ratio[:, None] - truth["displacement_ratio"])
    rows = np.argmin(distance, axis=1)
    if len(set(rows.tolist())) < len(rows):
        return Judged(code, message, "displacement_ratio")
    for name in COMPARED:
        values = getattr(samples, name)
        if values is None:
            continue
        true = truth[name][rows]
        limit = 3.0 * table.rounding * np.abs(true)
        if name == "displacement_ratio":
            limit = np.full(len(true), 6e-3)
        if name == "oil_temperature":
            limit = limit + 0.2
        if np.any(np.abs(values - true) > limit):
            return Judged(code, message, name)
    return Judged(code, message, "")
