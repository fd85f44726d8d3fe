# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.recordings --count 1000 --seed 1`: import random recordings."""

import argparse
import contextlib
import io
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hmcvt_core import read_bench
from hmcvt_tools.cli import main

from .truth import Recording, random_recording

TOLERANCE = 2e-3
"""Fraction by which an efficiency may differ: noise of the readings, and steps of the bus."""


class Outcome(NamedTuple):
    """What an import did.

    Attributes:
        code: exit code.
        message: on stderr.
        wrong: what is wrong without a word; `""` for nothing.
    """

    code: int
    message: str
    wrong: str


def judge(recording: Recording, folder: Path) -> Outcome:
    """Import a recording and compare it with its truth."""
    out = folder / "samples.csv"
    out.unlink(missing_ok=True)
    arguments = ["import", str(recording.path), "--out", str(out), "--yes"]
    shown = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(shown):
        try:
            main([*arguments, *recording.options])
            code = 0
        except SystemExit as stopped:
            code = int(stopped.code or 0)
    message = shown.getvalue()
    if "Traceback" in message or code not in (0, 2):
        return Outcome(code, message, "traceback")
    if code != 0:
        return Outcome(code, message, "")
    if recording.must_ask:
        return Outcome(code, message, "taken without the question that it needs")
    samples = read_bench(out)
    for value, stroke in zip(
        samples.efficiency, samples.displacement_ratio, strict=True
    ):
        test = int(np.argmin(np.abs(recording.efficiency / value - 1.0)))
        if abs(recording.efficiency[test] / value - 1.0) > TOLERANCE:
            return Outcome(code, message, f"efficiency {value:.4f} is of no test")
        if abs(recording.stroke[test] - stroke) > TOLERANCE:
            return Outcome(code, message, f"stroke {stroke:.4f} is of another test")
    return Outcome(code, message, "")


def run(count: int, seed: int, show: int) -> int:
    """Import recordings; return how many were wrong without a word.

    Args:
        count: of recordings.
        seed: of the first one; recording i is drawn by seed and i.
        show: wrong or asked recordings that are printed.
    """
    wrong = 0
    clear = 0
    taken = 0
    asked = 0
    for index in range(count):
        with tempfile.TemporaryDirectory() as name:
            rng = np.random.default_rng([seed, index])
            recording = random_recording(rng, Path(name))
            outcome = judge(recording, Path(name))
        clear += not recording.must_ask
        taken += outcome.code == 0 and not recording.must_ask
        if outcome.wrong:
            wrong += 1
            if wrong <= show:
                print(f"WRONG {index}: {outcome.wrong}: {recording.features}")
        elif outcome.code != 0 and not recording.must_ask:
            asked += 1
            if asked <= show:
                print(f"ASKED {index}: {outcome.message[-400:]} {recording.features}")
    print(f"{count} recordings, seed {seed}: {wrong} wrong without a word")
    print(
        f"{clear} leave nothing open, of which {taken} are imported without a question"
    )
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.recordings")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=5)
    given = parser.parse_args()
    raise SystemExit(1 if run(given.count, given.seed, given.show) else 0)
