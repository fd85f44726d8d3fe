# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Whether output speed and pressure of a bench have the signs of bench files, stage by stage.

Bench files state the output speed with its sense, negative backward, and the pressure as high less
low side of the motor with the sign of the output. Many benches record a speed without sense, and
the pressure as port A less port B, whose sign differs between stages. Both change only the sign of
a whole stage, so that gear train and load show them, and the file can be corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..transmission.ranges import Array
from ..transmission.stage import speed_ratio
from .model import EfficiencyModel
from .staged_samples import rows_by_stage

CLEAR_RATIO = 0.2
"""Speed ratio from which its sense is clear, relative to the largest of the stage [-].

Chosen: slip takes up to a tenth of the largest ratio, errors of the stroke as much.
"""
CLEAR_PRESSURE = 2e6
"""Predicted pressure from which its sign is clear [Pa].

Chosen: a boost pressure that was not taken off is about as large.
"""
FEWEST_CLEAR = 3
"""Samples of a stage from which its signs are judged."""
WHOLE_STAGE = 0.9
"""Fraction of the clear samples that must agree; the others may be mistyped."""
BALANCE = "power_balance"
"""Formulation that predicts a pressure."""
COMMAND = "hmcvt transmission signs"

RIGHT = "right"
WRONG = "wrong"
UNSIGNED = "unsigned"
MIXED = "mixed"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class StageSigns:
    """Signs of the readings of one stage.

    Attributes:
        stage: its name.
        samples: how many there are.
        output_speed: `right`, `wrong` (all against the gear train), `unsigned` (magnitudes where
            the output turns either way), `mixed`, or `unknown` without clear readings.
        pressure: the same; `wrong` where it is port B less port A.
    """

    stage: str
    samples: int
    output_speed: str
    pressure: str

    def to_dict(self) -> dict[str, Any]:
        """Return the signs as plain data."""
        return asdict(self)


def signs_by_stage(
    model: EfficiencyModel, samples: BenchSamples
) -> tuple[StageSigns, ...]:
    """Compare the signs of output speed and pressure with gear train and load.

    Args:
        model: its stages; its parameters matter little.
        samples: of a bench.

    Raises:
        InputError: as `stage_of_each`.
    """
    expected = None
    if samples.pressure is not None and model.formulation == BALANCE:
        expected = _expected(model, samples, "pressure")
    signs = []
    for name, rows in rows_by_stage(model, samples).items():
        signs.append(
            StageSigns(
                name,
                int(rows.sum()),
                _speed_signs(model, samples, name, rows),
                _pressure_signs(samples, expected, rows),
            )
        )
    return tuple(signs)


def sign_problems(signs: Sequence[StageSigns]) -> list[str]:
    """Return a sentence for each quantity whose sign a bench file states another way."""
    problems = []
    speeds = [item.stage for item in signs if item.output_speed in (WRONG, UNSIGNED)]
    if speeds:
        problems.append(
            f"output_speed in stage {', '.join(speeds)} turns against the gear train: bench "
            f"files state it negative backward; `{COMMAND}` corrects the file"
        )
    pressures = [item.stage for item in signs if item.pressure == WRONG]
    if pressures:
        problems.append(
            f"pressure in stage {', '.join(pressures)} has the other sign than under this load: "
            "it seems to be port A less port B; bench files state high less low side, with the "
            f"sign of the output; `{COMMAND}` corrects the file"
        )
    return problems


def require_signs(model: EfficiencyModel, samples: BenchSamples) -> None:
    """Refuse samples whose output speed or pressure has the wrong sign in a whole stage.

    Raises:
        InputError: the quantity, the stages and the remedy are named.
    """
    problems = sign_problems(signs_by_stage(model, samples))
    if problems:
        raise InputError(f"{samples.source}: {'; '.join(problems)}")


def with_corrected_signs(
    model: EfficiencyModel, samples: BenchSamples
) -> tuple[BenchSamples, tuple[StageSigns, ...]]:
    """Return samples with the signs of bench files, and what was found in each stage.

    Only stages that are wrong as a whole are corrected.

    Args:
        model: its stages; its parameters matter little.
        samples: of a bench.

    Raises:
        InputError: as `stage_of_each`.
    """
    signs = signs_by_stage(model, samples)
    rows_of = rows_by_stage(model, samples)
    columns = dict(samples.columns)
    for item in signs:
        rows = rows_of[item.stage]
        if item.output_speed in (WRONG, UNSIGNED):
            speed = columns["output_speed"]
            turned = -speed
            if (speed[rows] > 0.0).all():  # without a sense: that of the gear train
                expected = _expected(model, samples, "output_speed")
                turned = np.where(expected < 0.0, -speed, speed)
            columns["output_speed"] = np.where(rows, turned, speed)
        if item.pressure == WRONG:
            pressure = columns["pressure"]
            columns["pressure"] = np.where(rows, -pressure, pressure)
    return replace(samples, **columns), signs


def _expected(model: EfficiencyModel, samples: BenchSamples, channel: str) -> Array:
    """Return a reading as the model predicts it, shape (n,)."""
    return np.asarray(model.readings_at(samples.points)[channel])


def _speed_signs(
    model: EfficiencyModel,
    samples: BenchSamples,
    stage: str,
    rows: NDArray[np.bool_],
) -> str:
    """Judge the sense of the output speed of one stage."""
    if samples.output_speed is None:
        return UNKNOWN
    ratio = speed_ratio(model.in_stage(stage).stage, samples.displacement_ratio[rows])
    measured = samples.output_speed[rows]
    clear = np.abs(ratio) > CLEAR_RATIO * np.abs(ratio).max(initial=0.0)
    either_way = bool((ratio[clear] > 0.0).any() and (ratio[clear] < 0.0).any())
    if either_way and clear.sum() >= FEWEST_CLEAR and (measured > 0.0).all():
        return UNSIGNED
    return _judged(measured[clear] * ratio[clear])


def _pressure_signs(
    samples: BenchSamples, expected: Array | None, rows: NDArray[np.bool_]
) -> str:
    """Judge the sign of the pressure of one stage, as predicted, (n,), or None if it is not."""
    if samples.pressure is None or expected is None:
        return UNKNOWN
    of_stage = expected[rows]
    clear = np.abs(of_stage) > CLEAR_PRESSURE  # False for NaN
    return _judged(samples.pressure[rows][clear] * of_stage[clear])


def _judged(products: Array) -> str:
    """Judge products of measured and expected values, which are positive where signs agree."""
    if len(products) < FEWEST_CLEAR:
        return UNKNOWN
    agreeing = float(np.mean(products > 0.0))
    if agreeing >= WHOLE_STAGE:
        return RIGHT
    return WRONG if agreeing <= 1.0 - WHOLE_STAGE else MIXED
