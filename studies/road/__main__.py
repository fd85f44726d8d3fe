# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.road [--drives 40] [--minutes 15] [--seed 0]`."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_tools.estimation import EstimateSettings
from studies.page import table

from .bus import Faults, faults_of
from .drive import drive, machine_of
from .scoring import Score, scored, well_known

_CASES = (
    ("stage and displacement ratio known", True, None),
    ("neither known", False, None),
    ("neither known, bias +2 % in every log", False, 0.02),
    ("neither known, bias -2 % in every log", False, -0.02),
)


def scores_of(
    drives: int, minutes: float, seed: int, with_unit: bool, bias: float | None
) -> list[Score]:
    """Return the scores of several drives, each of another tractor.

    Args:
        drives: how many.
        minutes: how long each.
        seed: of the first.
        with_unit: whether the bus carries displacement ratio and stage.
        bias: of the torque in every log; None draws it, with 2 % standard deviation.
    """
    model = well_known()
    scores = []
    for number in range(seed, seed + drives):
        rng = np.random.default_rng([20261126, number])
        machine = machine_of(model, rng)
        driven = drive(machine, 60.0 * minutes, rng)
        faults = faults_of(rng)
        if bias is not None:
            faults = Faults(bias, faults.delays)
        with tempfile.TemporaryDirectory() as folder:
            scores.append(
                scored(
                    Path(folder),
                    model,
                    machine,
                    driven,
                    faults,
                    with_unit,
                    EstimateSettings(wear=0.0),
                )
            )
    return scores


def row_of(name: str, scores: list[Score]) -> tuple[str, ...]:
    """Return the row of the table."""
    errors = np.concatenate([score.slow for score in scores])
    slow = np.concatenate([score.slow_inside for score in scores])
    anywhere = np.concatenate([score.inside for score in scores])
    torque = np.concatenate([score.torque_inside for score in scores])
    stage = np.concatenate([score.stage_right for score in scores])
    energy = [score.energy for score in scores]
    held = [score.energy_inside for score in scores]
    return (
        name,
        f"{100.0 * np.median(errors):.2f} %",
        f"{100.0 * np.quantile(errors, 0.9):.2f} %",
        f"{100.0 * slow.mean():.1f} %",
        f"{100.0 * anywhere.mean():.1f} %",
        f"{100.0 * torque.mean():.1f} %",
        f"{100.0 * stage.mean():.1f} %",
        f"{100.0 * np.sqrt(np.mean(np.square(energy))):.2f} %",
        f"{sum(held)} of {len(held)}",
        f"{100.0 * np.mean([score.coverage for score in scores]):.1f} %",
    )


HEAD = (
    "case",
    "error of output power, median",
    "90 % quantile",
    "interval holds it",
    "also in transients",
    "interval of the torque",
    "stage right",
    "error of energy, rms",
    "its interval holds it",
    "time estimated",
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=40)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--seed", type=int, default=0)
    given: Any = parser.parse_args()
    print(table(HEAD, []), flush=True)
    for name, with_unit, bias in _CASES:
        scores = scores_of(given.drives, given.minutes, given.seed, with_unit, bias)
        print(f"| {' | '.join(row_of(name, scores))} |", flush=True)


if __name__ == "__main__":
    main()
