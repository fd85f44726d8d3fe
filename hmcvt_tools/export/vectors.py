# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The vectors of the self-test: inputs of the exported functions, and what Python answers."""

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.ranges import Array, OperatingPoints, Range
from hmcvt_core.transmission.stage import speed_ratio

from .effect_tables import TABLE_LOAD, TABLE_SPEED, EffectTable

COLUMNS = (
    "function",
    "stage",
    *(f"input_{number}" for number in range(1, 5)),
    "status",
    *(f"output_{number}" for number in range(1, 6)),
)
"""Columns of vectors.csv; the README of an export says what they hold for each function."""

_SEED = 20240501
_POINTS = 240  # of each stage
_DEMANDS = 12  # of each stage and search
_USUAL_LOAD = 400.0  # half of the points have loads up to this [N m]
_NUDGE = 1e-4
_STEEP = 1e-2
_NAN = float("nan")


class _Box(NamedTuple):
    """Ranges of random inputs."""

    speed: Range
    load: Range
    highest_demand: float
    highest_power: float


_WHOLE_BOX = _Box(ranges.ENGINE_SPEED, ranges.ANY_LOAD, ranges.LOAD_TORQUE.high, 3e5)
# Demands stay off the stalls, next to which tables are less exact.
_TABLE_BOX = _Box(TABLE_SPEED, TABLE_LOAD, 0.3 * TABLE_LOAD.high, 2e4)


class Status(IntEnum):
    """What the exported functions return."""

    OK = 0
    NO_ANSWER = 1
    OUT_OF_RANGE = 2
    UNKNOWN_STAGE = 3


class Vector(NamedTuple):
    """One row of the self-test."""

    function: str
    stage: int
    inputs: tuple[float, ...]
    status: Status
    outputs: tuple[float, ...]


TABLE_TOLERANCE = 0.02
"""Tolerance of the self-test where tables hold effects, as a part of each quantity."""


def vectors_csv(
    model: EfficiencyModel, precision: str, effects: Sequence[EffectTable] = ()
) -> str:
    """Return the self-test of a model as CSV.

    Args:
        model: all its stages are tested.
        precision: `double` or `single`; inputs are numbers of this precision.
        effects: a table for each stage, or none.
    """
    lines = [f"fingerprint,{model.fingerprint}", ",".join(COLUMNS)]
    for vector in _vectors(model, precision, effects):
        cells = [vector.function, str(vector.stage)]
        cells += _padded(vector.inputs, 4)
        cells.append(str(int(vector.status)))
        cells += _padded(vector.outputs, 5)
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _padded(values: Sequence[float], count: int) -> list[str]:
    cells = [repr(float(value)) for value in values]
    return cells + ["0.0"] * (count - len(cells))


def _vectors(
    model: EfficiencyModel, precision: str, effects: Sequence[EffectTable]
) -> Iterator[Vector]:
    """Yield points and demands of every stage, then inputs that are refused."""
    rng = np.random.default_rng(_SEED)
    box = _TABLE_BOX if effects else _WHOLE_BOX
    for number, part in enumerate(model.without_meters().stages.values()):
        points = _random_points(rng, box, precision)
        smooth = _is_smooth(part, points)
        if effects:
            smooth &= _is_close(part, effects[number], points)
        kept = points.map(lambda values, smooth=smooth: values[smooth])
        yield from _predictions(part, number, kept)
        yield from _best_strokes(part, number, _random_demands(rng, box, precision))
        outputs = _random_outputs(rng, part, box, precision)
        yield from _best_speeds(part, number, outputs)
    yield from _refused(len(model.stages))


def _rounded(values: Array, precision: str) -> Array:
    """Return values that the precision holds exactly."""
    if precision == "single":
        return values.astype(np.float32).astype(float)
    return values


def _random_points(
    rng: np.random.Generator, box: _Box, precision: str
) -> OperatingPoints:
    """Return points in the whole range of the inputs."""
    stroke = rng.uniform(-1.0, 1.0, _POINTS)
    stroke[:3] = (-1.0, 0.0, 1.0)
    speed = rng.uniform(box.speed.low, box.speed.high, _POINTS)
    load = rng.uniform(box.load.low, box.load.high, _POINTS)
    usual = rng.random(_POINTS) < 0.5
    load[usual] = rng.uniform(-_USUAL_LOAD, _USUAL_LOAD, int(usual.sum()))
    load[:12] = 0.0
    return OperatingPoints(
        _rounded(stroke, precision),
        _rounded(speed, precision),
        _rounded(load, precision),
    )


def _is_close(
    model: EfficiencyModel, table: EffectTable, points: OperatingPoints
) -> Any:
    """Return where a table gives the answer of the model well within the tolerance."""
    closed = EfficiencyModel(model.stage, model.parameters).balance("closed form")
    exact = model.solution_at(points)
    corrected = table.corrected(closed, points)
    close = np.isfinite(exact.efficiency) & np.isfinite(corrected.efficiency)
    for values, others in zip(exact, corrected, strict=True):
        scale = np.maximum(np.abs(values), 1.0)
        close &= np.abs(others - values) < 0.5 * TABLE_TOLERANCE * scale
    return close


def _is_smooth(model: EfficiencyModel, points: OperatingPoints) -> Any:
    """Return where the answer barely changes with the point."""
    efficiency = model.solution_at(points).efficiency
    smooth = np.ones(efficiency.shape, dtype=bool)
    for factor in (1.0 - _NUDGE, 1.0 + _NUDGE):
        nudged = points._replace(
            displacement_ratio=points.displacement_ratio / factor,
            load_torque=points.load_torque * factor,
        )
        other = model.solution_at(nudged).efficiency
        both_unknown = np.isnan(efficiency) & np.isnan(other)
        smooth &= both_unknown | (np.abs(other - efficiency) < _STEEP)
    return smooth


def _predictions(
    model: EfficiencyModel, number: int, points: OperatingPoints
) -> Iterator[Vector]:
    solution = model.solution_at(points)
    loss = points.engine_speed * (solution.engine_torque - points.load_torque)
    inside = np.zeros(loss.shape, dtype=bool)
    if model.domain is not None:
        inside = model.domain.contains(*points[:3])
    columns = np.column_stack([*points[:3], *solution, loss, inside.astype(float)])
    for row in columns.tolist():
        outputs = tuple(row[3:])
        status = Status.NO_ANSWER if np.isnan(outputs[0]) else Status.OK
        yield Vector("predict", number, tuple(row[:3]), status, outputs)


def _random_demands(rng: np.random.Generator, box: _Box, precision: str) -> Array:
    """Return engine speeds and load torques, shape (n, 2)."""
    speed = rng.uniform(box.speed.low, box.speed.high, _DEMANDS)
    low = ranges.LOAD_TORQUE.low
    load = np.exp(rng.uniform(np.log(low), np.log(box.highest_demand), _DEMANDS))
    load = np.clip(load, low, box.highest_demand)
    return _rounded(np.column_stack([speed, load]), precision)


def _best_strokes(
    model: EfficiencyModel, number: int, demands: Array
) -> Iterator[Vector]:
    for speed, load in demands.tolist():
        best = model.optimal_displacement_ratio(speed, load)
        outputs = (best.displacement_ratio, best.efficiency, speed)
        yield _optimum("optimal_displacement_ratio", number, (speed, load), outputs)


def _random_outputs(
    rng: np.random.Generator, model: EfficiencyModel, box: _Box, precision: str
) -> Array:
    """Return output speeds and powers, shape (n, 2)."""
    low, high = ranges.ENGINE_SPEED_LIMITS
    stroke = rng.uniform(-1.0, 1.0, _DEMANDS)
    speed = speed_ratio(model.stage, stroke) * rng.uniform(low, high, _DEMANDS)
    power = np.exp(rng.uniform(np.log(500.0), np.log(box.highest_power), _DEMANDS))
    demands = _rounded(np.column_stack([speed, power]), precision)
    return demands[ranges.OUTPUT_SPEED.contains(np.abs(demands[:, 0]))]


def _best_speeds(
    model: EfficiencyModel, number: int, outputs: Array
) -> Iterator[Vector]:
    limits = _rounded(np.array(ranges.ENGINE_SPEED_LIMITS), "single").tolist()
    for speed, power in outputs.tolist():
        best = model.optimal_drive(
            speed, power, engine_speed_limits=(limits[0], limits[1])
        )
        values = (best.displacement_ratio, best.efficiency, best.engine_speed)
        yield _optimum("optimal_engine_speed", number, (speed, power, *limits), values)


def _optimum(
    function: str, number: int, inputs: tuple[float, ...], outputs: tuple[float, ...]
) -> Vector:
    if np.isnan(outputs[1]):
        return Vector(function, number, inputs, Status.NO_ANSWER, (_NAN, _NAN, _NAN))
    return Vector(function, number, inputs, Status.OK, outputs)


def _refused(stages: int) -> Iterator[Vector]:
    """Yield inputs out of range and stages that do not exist."""
    unknown = (_NAN, _NAN, _NAN, _NAN, 0.0)
    for point in (
        (1.5, 150.0, 100.0),
        (_NAN, 150.0, 100.0),
        (0.5, 1.0, 100.0),
        (0.5, float("inf"), 100.0),
        (0.5, 150.0, -6000.0),
        (0.5, 150.0, _NAN),
    ):
        yield Vector("predict", 0, point, Status.OUT_OF_RANGE, unknown)
    for stage in (-1, stages):
        point = (0.5, 150.0, 100.0)
        yield Vector("predict", stage, point, Status.UNKNOWN_STAGE, unknown)
    no_optimum = (_NAN, _NAN, _NAN)
    for demand in ((150.0, 0.0), (150.0, -100.0), (_NAN, 100.0)):
        yield Vector(
            "optimal_displacement_ratio", 0, demand, Status.OUT_OF_RANGE, no_optimum
        )
    for output in (
        (0.0, 4e4, 80.0, 230.0),
        (150.0, 0.0, 80.0, 230.0),
        (150.0, 4e4, 230.0, 80.0),
    ):
        yield Vector("optimal_engine_speed", 0, output, Status.OUT_OF_RANGE, no_optimum)
