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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..physics.balance import BalanceSolver
from ..transmission.ranges import ENGINE_SPEED, OUTPUT_SPEED, Range
from ..transmission.stage import speed_ratio
from .engine import Engine

Array = NDArray[np.float64]
OUTPUT_POWER = Range("output_power", 0.0, 1e6, "W", "is it in kW?")
_PART = Range("torque_reserve", 0.0, 0.9, "-", "a part of the full-load torque")
_SCAN, _FINE, _ZOOMS = 65, 129, 2
_SLIP = 0.5  # part of the kinematic ratio that a stage may lose, or gain in overrun
_EDGE = 1e-9  # of the stroke
_BESIDE = 1e-9  # of the speed at rest
_CLOSE = 0.01  # of the best: stages that the first grid cannot tell apart
_LIMIT_SLACK = 1e-5  # of the width between two limits
_BINDS = 1e-3  # of the full load


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


class Found(NamedTuple):
    """Lowest cost on a grid, at which engine speed, and the step of the grid."""

    cost: float
    speed: float
    step: float


@dataclass(frozen=True)
class Line:
    """What one stage costs along engine speeds at a held output speed and power."""

    solver: BalanceSolver
    output_speed: float
    output_power: float
    engine: Engine | None = None
    reserve: float = 0.0

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

    def coarse(self, low: float, high: float) -> Found:
        """Lowest cost on a grid over the engine speeds at which the stage may give the output."""
        ends = math.copysign(1.0, self.output_speed) * speed_ratio(
            self.solver.stage, np.array([-1.0, 1.0]))
        if ends.max() > 0.0:
            low = max(low, abs(self.output_speed) / (ends.max() * (1.0 + _SLIP)))
        if ends.min() > 0.0:
            high = min(high, abs(self.output_speed) / (ends.min() * (1.0 - _SLIP)))
        if ends.max() <= 0.0 or not low < high:
            return Found(math.inf, math.nan, math.nan)
        return self._lowest(np.linspace(low, high, _SCAN), (high - low) / (_SCAN - 1))

    def nearer(self, found: Found, low: float, high: float) -> Found:
        """Lowest cost when the grid zooms in on a point found, or beside the motor's rest."""
        lowest = found
        if ratio := self.solver.mechanical_ratio:
            # There friction sets a step, and often a lowest point beside it.
            beside = self.output_speed / ratio * np.array([1.0 - _BESIDE, 1.0 + _BESIDE])
            lowest = min(lowest, self._lowest(np.clip(beside, low, high), found.step))
        for _ in range(_ZOOMS):
            found = self._lowest(np.linspace(
                max(found.speed - found.step, low), min(found.speed + found.step, high), _FINE),
                2.0 * found.step / (_FINE - 1))
            lowest = min(lowest, found)
        return lowest

    def _lowest(self, speed: Array, step: float) -> Found:
        cost = self.cost(speed, self.state(speed)[1])
        best = int(cost.argmin())
        return Found(float(cost[best]), float(speed[best]), step)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def best_engine_speed(
    solver: BalanceSolver, output_speed: float, output_power: float, low: float, high: float
) -> float:
    """Engine speed of least engine power at a held output; NaN where none will do."""
    line = Line(solver, output_speed, output_power)
    found = line.nearer(line.coarse(low, high), low, high)
    return found.speed if math.isfinite(found.cost) else math.nan


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def drive_optimum(
    stages: Mapping[str, BalanceSolver], output_speed: float, output_power: float,
    engine: Engine | None, engine_speed_limits: tuple[float, float], torque_reserve: float,
    stage: str | None, hysteresis: float,
) -> DriveOptimum:
    """Find stage, engine speed and displacement ratio of least fuel at a held output.

    Args:
        stages: solver of each by name.
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
    lines = {name: Line(solver, held, power, engine, reserve) for name, solver in stages.items()}
    coarse = {name: line.coarse(low, high) for name, line in lines.items()}
    promising = min(found.cost for found in coarse.values()) * (1.0 + _CLOSE)
    found = {name: lines[name].nearer(first, low, high) for name, first in coarse.items()
             if math.isfinite(first.cost) and (first.cost <= promising or name == stage)}
    if not found:
        return DriveOptimum(None)
    best = min(found, key=lambda name: found[name].cost)
    if stage in found and found[stage].cost <= found[best].cost * (1.0 + hysteresis):
        best = str(stage)
    return _told(best, found[best].speed, lines[best], low, high)


def limit_of(stroke: float, speed: float, limits: tuple[float, float] | None) -> str | None:
    """Name the limit that binds, the engine's before the pump's."""
    for name, value, ends in (("engine_speed", speed, limits),
                              ("displacement_ratio", stroke, (-1.0, 1.0))):
        if ends is None:
            continue
        slack = _LIMIT_SLACK * (ends[1] - ends[0])
        if value <= ends[0] + slack:
            return f"{name} low"
        if value >= ends[1] - slack:
            return f"{name} high"
    return None


def _told(stage: str, speed: float, line: Line, low: float, high: float) -> DriveOptimum:
    stroke, torque = (column.item() for column in line.state(np.array([speed])))
    load, fuel, per_loss = line.output_power / speed, math.nan, math.nan
    limit = limit_of(stroke, speed, (low, high))
    if line.engine is not None:
        fuel, full = line.engine.fuel_rate(speed, torque), line.engine.full_load_torque(speed)
        below = line.engine.fuel_rate(speed, 0.99 * torque)
        per_loss = (fuel - below) / (0.01 * torque * speed) if torque else math.nan
        if torque > (1.0 - line.reserve - _BINDS) * full:
            limit = "full_load"
    return DriveOptimum(stage, stroke, speed, load, load / torque, torque, fuel, limit, per_loss)
