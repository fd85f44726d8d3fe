# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.recordings --count 1000 --seed 1`: import random recordings."""

import argparse
import contextlib
import io
import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core import BenchSamples, read_bench
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.cli import main

from .files import random_recording
from .truth import History, Recording

TOLERANCE = 2e-3
"""Fraction by which a value may differ: noise of the readings, and steps of the bus."""


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
    said = io.StringIO()
    shown = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(shown):
        try:
            main([*arguments, *recording.options])
            code = 0
        except SystemExit as stopped:
            code = int(stopped.code or 0)
        except Exception as error:  # what a user would see as a traceback
            return Outcome(1, str(error), f"traceback: {error!r}")
    message = shown.getvalue()
    if code not in (0, 2):
        return Outcome(code, message, f"exit code {code}")
    if code != 0:
        return Outcome(code, message, "")
    if recording.must_ask:
        return Outcome(code, message, "taken without the question that it needs")
    if "e+09" in said.getvalue() or "00000000.0 s" in said.getvalue():
        return Outcome(code, message, "a stamp that is wrong by far is used")
    tests, wrong = _tests_of(read_bench(out), recording.history)
    lost = set(np.flatnonzero(recording.history.covered).tolist()) - tests
    if not wrong and lost and not _LOSS.search(said.getvalue()):
        wrong = f"tests {sorted(lost)} are missing, and nothing states it"
    return Outcome(code, message, wrong)


_LOSS = re.compile(
    r"gaps|out of order|cut off|[1-9]\d* (windows out of range|rows without a number)"
)
"""Remarks that state that something of the file was not used."""


def _tests_of(samples: BenchSamples, history: History) -> tuple[set[int], str]:
    """Return which tests the samples are of, and what is wrong; `""` for nothing."""
    tests = set()
    for row in range(len(samples)):
        efficiency = samples.efficiency[row]
        stroke = samples.displacement_ratio[row]
        test = int(np.argmin(np.abs(history.tests["PumpStroke"] - 100.0 * stroke)))
        if abs(history.tests["PumpStroke"][test] - 100.0 * stroke) > 100.0 * TOLERANCE:
            return tests, f"stroke {stroke:.4f} is of no test"
        speed = history.tests["EngineSpeed"][test] * RPM
        expected = {
            "efficiency": (efficiency, history.efficiency[test]),
            "load torque": (samples.load_torque[row], history.load[test]),
            "engine speed": (samples.engine_speed[row], speed),
        }
        for name, (value, truth) in expected.items():
            if abs(value / truth - 1.0) > TOLERANCE:
                return tests, f"{name} {value:.4f} of test {test} is {truth:.4f}"
        tests.add(test)
    return tests, ""


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
                print(f"WRONG {index}: {outcome.wrong}: {_drawn(recording)}")
        elif outcome.code != 0 and not recording.must_ask:
            asked += 1
            if asked <= show:
                print(f"ASKED {index}: {outcome.message[-400:]} {_drawn(recording)}")
    print(f"{count} recordings, seed {seed}: {wrong} wrong without a word")
    print(
        f"{clear} leave nothing open, of which {taken} are imported without a question"
    )
    return wrong


def _drawn(recording: Recording) -> dict[str, Any]:
    return {**recording.features, **recording.history.features}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.recordings")
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=5)
    given = parser.parse_args()
    raise SystemExit(1 if run(given.count, given.seed, given.show) else 0)
