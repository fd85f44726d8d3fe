# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.road.conditions [--drives 8] [--minutes 3] [--seed 0]`.

How often the intervals of `hmcvt estimate` hold the truth of tractors that are not as identified.
Each is drawn within the errors of the model, as in `studies.road`, and then changed by more than
these errors: cold oil, wear, working hydraulics. What is known of the condition is stated to the
estimate, except in the rows that say so.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

from hmcvt_core import HydraulicParameters
from hmcvt_core.physics.effects.hydraulic import walther_log_viscosity
from hmcvt_tools.estimation import EstimateSettings
from studies.page import table

from .bus import faults_of
from .drive import Drive, Machine, drive, machine_of
from .scoring import Score, scored, well_known

IDENTIFIED_AT = 60.0
"""Oil temperature of the identification [deg C]."""


def _temperature_of(viscosity_ratio: float) -> float:
    """Return the oil temperature of a multiple of the viscosity at `IDENTIFIED_AT`."""
    wanted = np.log(viscosity_ratio) + walther_log_viscosity(np.array(IDENTIFIED_AT))
    return float(
        brentq(lambda at: walther_log_viscosity(np.array(at)) - wanted, 0, 120)
    )


_NOTHING_STATED = EstimateSettings()


@dataclass(frozen=True)
class Condition:
    """What a tractor differs in, and what the estimate is told of it.

    Attributes:
        name: in the table.
        leakage: true by drawn leakage.
        dampings: true by drawn dampings.
        hydraulics: power that pumps take from the engine [W].
        oil_temperature: on the bus [deg C]; None where it is not.
        settings: of the estimate.
        with_unit: whether the bus carries displacement ratio and stage.
        wrong_stage: whether the bus names the stage after the one engaged.
    """

    name: str
    leakage: float = 1.0
    dampings: float = 1.0
    hydraulics: float = 0.0
    oil_temperature: float | None = None
    settings: EstimateSettings = _NOTHING_STATED
    with_unit: bool = True
    wrong_stage: bool = False


COLD = _temperature_of(2.0)
_WARM = EstimateSettings(oil_temperature=IDENTIFIED_AT)
_AS_IDENTIFIED = EstimateSettings(wear=0.0)
_PUMPS = EstimateSettings(hydraulics_high=6e3)

CONDITIONS = (
    Condition("as identified"),
    Condition("as identified, stage not on the bus", with_unit=False),
    Condition("as identified, the bus names the next stage", wrong_stage=True),
    Condition(
        f"cold: leakage x0.5, dampings x2; TRF1 says {COLD:.0f} deg C",
        0.5,
        2.0,
        oil_temperature=COLD,
        settings=_WARM,
    ),
    Condition("worn: leakage x1.5", 1.5),
    Condition("worn: leakage x2", 2.0),
    Condition("as identified; `--wear 0`", settings=_AS_IDENTIFIED),
    Condition(
        "hydraulics 6 kW; `--hydraulics 0..6kW`", hydraulics=6e3, settings=_PUMPS
    ),
    Condition("hydraulics 0 kW; `--hydraulics 0..6kW`", settings=_PUMPS),
    Condition("cold, nothing stated", 0.5, 2.0),
    Condition("hydraulics 6 kW, nothing stated", hydraulics=6e3),
)


def changed(machine: Machine, condition: Condition) -> Machine:
    """Return a tractor in a condition."""
    drawn = machine.model.parameters
    parameters = HydraulicParameters(
        condition.leakage * drawn.leakage,
        condition.dampings * drawn.motor_damping,
        condition.dampings * drawn.pump_damping,
    )
    return machine._replace(
        model=replace(machine.model, parameters=parameters),
        oil_temperature=condition.oil_temperature,
    )


def with_hydraulics(driven: Drive, power: float) -> Drive:
    """Return a drive whose engine gives power to pumps, too [W]."""
    return replace(
        driven, engine_torque=driven.engine_torque + power / driven.engine_speed
    )


def with_next_stage(driven: Drive, names: Sequence[str]) -> Drive:
    """Return a drive of which the bus names the stage after the one engaged."""
    following = dict(zip(names, (*names[1:], names[0]), strict=True))
    stage = [following.get(name, name) for name in driven.stage.tolist()]
    return replace(driven, stage=np.array(stage))


def scores_in(
    condition: Condition, seeds: Sequence[int], minutes: float
) -> list[Score]:
    """Return the scores of drives in a condition, one a seed."""
    model = well_known()
    scores = []
    for seed in seeds:
        rng = np.random.default_rng([20261128, seed])
        machine = changed(machine_of(model, rng), condition)
        driven = with_hydraulics(
            drive(machine, 60.0 * minutes, rng), condition.hydraulics
        )
        if condition.wrong_stage:
            driven = with_next_stage(driven, list(model.stages))
        with tempfile.TemporaryDirectory() as folder:
            scores.append(
                scored(
                    Path(folder),
                    model,
                    machine,
                    driven,
                    faults_of(rng),
                    condition.with_unit,
                    condition.settings,
                )
            )
    return scores


def row_of(condition: Condition, scores: Sequence[Score]) -> tuple[str, ...]:
    """Return the row of the table."""
    covered = float(np.mean([score.coverage for score in scores]))
    scores = [score for score in scores if len(score.slow)]
    errors = np.concatenate([score.slow for score in scores])
    moments = np.concatenate([score.slow_inside for score in scores])
    torque = np.concatenate([score.torque_inside for score in scores])
    held = sum(score.energy_inside for score in scores)
    return (
        condition.name,
        f"{100.0 * covered:.1f} %",
        f"{100.0 * np.median(errors):.1f} %",
        f"{100.0 * moments.mean():.0f} %",
        f"{100.0 * torque.mean():.0f} %",
        f"{held} of {len(scores)}",
    )


HEAD = (
    "tractor",
    "time with an estimate",
    "error of output power, median",
    "moments inside 90 %",
    "torque inside 90 %",
    "energy inside 90 %",
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=8)
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=0)
    given: Any = parser.parse_args()
    seeds = range(given.seed, given.seed + given.drives)
    print(table(HEAD, []), flush=True)
    for condition in CONDITIONS:
        row = row_of(condition, scores_in(condition, seeds, given.minutes))
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
