# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Maps of every stage on a grid, for lookup tables.

Look up the loss and work out the efficiency from it: the loss is nearly straight over the load,
where the efficiency falls to zero.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.ranges import Array, OperatingPoints

AXIS_UNITS = {"displacement_ratio": "-", "engine_speed": "rad/s", "load_torque": "N m"}
TABLE_UNITS = {
    "efficiency": "-",
    "output_speed": "rad/s",
    "engine_torque": "N m",
    "power_loss": "W",
}
STROKES = np.linspace(-1.0, 1.0, 41)
SPEEDS = np.linspace(*ranges.ENGINE_SPEED_LIMITS, 15)
LOADS = np.linspace(-200.0, 600.0, 17)  # overrun to what the shipped engine gives [N m]

_TRIALS = 20_000
_SEED = 20240502
_MIN_LOAD = 20.0  # below it an efficiency says little [N m]
_QUANTILE = 0.99


@dataclass(frozen=True)
class StageMap:
    """Tables of one stage over displacement ratio, engine speed and load torque.

    Attributes:
        name: of the stage.
        tables: shape (strokes, speeds, loads) by the names of `TABLE_UNITS`; NaN without an answer.
        efficiency_error: error of the efficiency that follows from the interpolated loss; 99 % of
            random points that pull are within it [-].
    """

    name: str
    tables: Mapping[str, Array]
    efficiency_error: float


def stage_maps(model: EfficiencyModel) -> list[StageMap]:
    """Return the maps of every stage, without errors of meters."""
    maps = []
    for name, part in model.without_meters().stages.items():
        tables = _tables(part)
        error = _efficiency_error(part, tables["power_loss"])
        maps.append(StageMap(name, tables, error))
    return maps


def axes() -> Sequence[Array]:
    """Return strokes, engine speeds and loads of the maps."""
    return STROKES, SPEEDS, LOADS


def _tables(model: EfficiencyModel) -> dict[str, Array]:
    grid = np.meshgrid(*axes(), indexing="ij")
    solution = model.solution_at(OperatingPoints(*grid))
    return {
        "efficiency": solution.efficiency,
        "output_speed": solution.output_speed,
        "engine_torque": solution.engine_torque,
        "power_loss": grid[1] * (solution.engine_torque - grid[2]),
    }


def _efficiency_error(model: EfficiencyModel, loss_table: Array) -> float:
    """Return the error of the efficiency from the interpolated loss at random points."""
    # Imported where used: it takes half a second.
    from scipy.interpolate import RegularGridInterpolator

    rng = np.random.default_rng(_SEED)
    stroke = rng.uniform(STROKES[0], STROKES[-1], _TRIALS)
    speed = rng.uniform(SPEEDS[0], SPEEDS[-1], _TRIALS)
    load = rng.uniform(_MIN_LOAD, LOADS[-1], _TRIALS)
    interpolated = RegularGridInterpolator(axes(), loss_table)
    loss = interpolated(np.column_stack([stroke, speed, load]))
    looked_up = load / (load + loss / speed)
    efficiency = model.solution_at(OperatingPoints(stroke, speed, load)).efficiency
    errors = np.abs(looked_up - efficiency)
    known = errors[np.isfinite(errors)]
    return float(np.quantile(known, _QUANTILE)) if known.size else float("nan")
