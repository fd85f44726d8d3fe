# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The drive line's best working point: which stage, which engine speed, which displacement ratio.

Held are output speed and output power, what the driver asks for. In each stage every engine speed
needs one displacement ratio, which the balance gives without a search. Along this line of states a
grid looks for the least fuel, in every stage first, and zooms in on those that may be best.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..physics.steady_state import ArraySolver
from ..transmission.ranges import ENGINE_SPEED, OUTPUT_SPEED, Range
from ..transmission.stage import Stage, speed_ratio
from .engine import Engine

Array = NDArray[np.float64]
OUTPUT_POWER = Range("output_power", 0.0, 1e6, "W", "is it in kW?")
_PART = Range("torque_reserve", 0.0, 0.9, "-", "a part of the full-load torque")
_SCAN, _FINE, _ZOOMS = 65, 129, 2
_SLIP = 0.3  # part of the kinematic ratio that a stage may lose, or gain in overrun
_EDGE = 1e-9  # of the stroke
_BESIDE = 1e-9  # of the speed at rest
_CLOSE = 0.01  # of the best: stages that the first grid cannot tell apart
_BINDS = 1e-4  # of a range


@dataclass(frozen=True)
class DriveOptimum:
    """The best working point of the drive line; NaN, and no stage, where there is none.

    Attributes:
        stage: engaged; None where nothing holds the demand.
        displacement_ratio: pump stroke [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        efficiency: of the transmission [-].
        engine_torque: [N m].
        fuel_rate: [kg/s]; NaN without an engine.
        limit: `full_load`, `engine_speed low` or `high`, `displacement_ratio low` or `high`: what
            binds, or None.
        fuel_per_loss: fuel that a further watt of loss costs [kg/J]; NaN without an engine.
    """

    stage: str | None
    displacement_ratio: float = math.nan
    engine_speed: float = math.nan
    load_torque: float = math.nan
    efficiency: float = math.nan
    engine_torque: float = math.nan
    fuel_rate: float = math.nan
    limit: str | None = None
    fuel_per_loss: float = math.nan


@dataclass(frozen=True)
class _Line:
    """What one stage costs along engine speeds at a held output speed and power."""

    solver: ArraySolver
    output_speed: float
    output_power: float
    engine: Engine | None
    reserve: float

    def state(self, speed: Array) -> tuple[Array, Array]:
        """Displacement ratio and engine torque; NaN where the stage cannot hold the demand."""
        stroke, torque = self.solver.held_in(
            (1 if self.output_speed > 0.0 else -1, 1), speed,
            np.full_like(speed, self.output_speed), self.output_power / speed)
        within = np.fmin(np.fmax(stroke, -1.0), 1.0)
        return within, np.where(np.abs(stroke - within) < _EDGE, torque, np.nan)

    def cost(self, speed: Array, torque: Array) -> Array:
        """Fuel [kg/s], or engine power [W] without an engine; infinite where it is not possible."""
        if self.engine is None:
            cost = torque * speed
        else:
            cost = self.engine.fuel_rate(speed, torque)
            if self.reserve > 0.0:
                highest = (1.0 - self.reserve) * self.engine.full_load_torque(speed)
                cost = np.where(torque <= highest, cost, np.nan)
        return np.where(np.isnan(cost), np.inf, cost)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def drive_optimum(
    stages: Mapping[str, tuple[Stage, ArraySolver]], output_speed: float, output_power: float,
    engine: Engine | None, engine_speed_limits: tuple[float, float], torque_reserve: float,
    stage: str | None, hysteresis: float,
) -> DriveOptimum:
    """Find stage, engine speed and displacement ratio of least fuel at a held output.

    Args:
        stages: gear train and solver of each by name.
        output_speed: to hold [rad/s]; negative backward.
        output_power: to hold [W].
        engine: whose fuel counts and whose full-load curve holds; without one the least engine
            power is looked for.
        engine_speed_limits: lowest and highest engine speed allowed [rad/s].
        torque_reserve: part of the full-load torque to keep [-].
        stage: engaged now, which is kept unless another saves more than the part `hysteresis`.

    Raises:
        InputError: input out of range, or there is no such stage.
    """
    held = float(OUTPUT_SPEED.check(abs(output_speed))) * math.copysign(1.0, output_speed)
    power, reserve = float(OUTPUT_POWER.check(output_power)), float(_PART.check(torque_reserve))
    low, high = ENGINE_SPEED.check(engine_speed_limits, "engine_speed_limits").tolist()
    if engine is not None:
        low, high = max(low, float(engine.speed[0])), min(high, float(engine.speed[-1]))
    if not low < high:
        raise InputError(f"engine_speed_limits = {low:g}, {high:g}: nothing lies between them and "
                         "the speeds of the engine")
    if stage is not None and stage not in stages:
        raise InputError(f"stage = {stage!r}; there is {', '.join(stages)}")
    coarse: dict[str, tuple[float, float, float, _Line]] = {}
    for name, (train, solver) in stages.items():
        window = _window(train, held, low, high)
        line = _Line(solver, held, power, engine, reserve)
        if window is not None:
            coarse[name] = (*_scan(line, *window, _SCAN), line)
    promising = min((cost for cost, *_ in coarse.values()), default=math.inf) * (1.0 + _CLOSE)
    found: dict[str, tuple[float, float, _Line]] = {}
    for name, (cost, at, step, line) in coarse.items():
        if math.isfinite(cost) and (cost <= promising or name == stage):
            for _ in range(_ZOOMS):
                nearer, there, step = _scan(line, max(at - step, low), min(at + step, high), _FINE)
                cost, at = min((cost, at), (nearer, there))
            found[name] = cost, at, line
    if not found:
        return DriveOptimum(None)
    best = min(found, key=lambda name: found[name][0])
    if stage in found and found[stage][0] <= found[best][0] * (1.0 + hysteresis):
        best = str(stage)
    return _told(best, found[best][1], found[best][2], low, high)


def _window(
    train: Stage, output_speed: float, low: float, high: float
) -> tuple[float, float] | None:
    """Engine speeds at which a stage may give an output speed."""
    ends = speed_ratio(train, np.array([-1.0, 1.0])) * math.copysign(1.0, output_speed)
    if ends.max() <= 0.0:
        return None
    low = max(low, abs(output_speed) / (ends.max() * (1.0 + _SLIP)))
    if ends.min() > 0.0:
        high = min(high, abs(output_speed) / (ends.min() * (1.0 - _SLIP)))
    return (low, high) if low < high else None


def _scan(line: _Line, low: float, high: float, count: int) -> tuple[float, float, float]:
    """Lowest cost on a grid, where, and the step of the grid."""
    speed = np.linspace(low, high, count)
    if (ratio := line.solver.mechanical_ratio) and count == _SCAN:
        # Where the motor rests, friction sets a step, and often a lowest point beside it.
        beside = line.output_speed / ratio * np.array([1.0 - _BESIDE, 1.0 + _BESIDE])
        speed = np.append(speed, beside[(beside >= low) & (beside <= high)])
    cost = line.cost(speed, line.state(speed)[1])
    best = int(cost.argmin())
    return float(cost[best]), float(speed[best]), (high - low) / (count - 1)


def _told(stage: str, speed: float, line: _Line, low: float, high: float) -> DriveOptimum:
    stroke, torque = (column.item() for column in line.state(np.array([speed])))
    load, fuel, per_loss, limit = line.output_power / speed, math.nan, math.nan, None
    for name, value, first, last in (("displacement_ratio", stroke, -1.0, 1.0),
                                     ("engine_speed", speed, low, high)):
        slack = _BINDS * (last - first)
        limit = (f"{name} low" if value < first + slack
                 else f"{name} high" if value > last - slack else limit)
    if line.engine is not None:
        fuel, full = line.engine.fuel_rate(speed, torque), line.engine.full_load_torque(speed)
        below = line.engine.fuel_rate(speed, 0.99 * torque)
        per_loss = (fuel - below) / (0.01 * torque * speed) if torque else math.nan
        if torque > (1.0 - line.reserve - 10.0 * _BINDS) * full:
            limit = "full_load"
    return DriveOptimum(stage, stroke, speed, load, load / torque, torque, fuel, limit, per_loss)
