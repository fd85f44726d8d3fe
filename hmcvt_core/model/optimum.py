# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The working point that wastes least, of one stage or of the whole drive line.

At a held engine speed the best displacement ratio lies next to the full-mechanical point, eps = 0.
What a tractor wants is the best pair (engine speed, displacement ratio) at the output speed and
power that the driver asks for. In each stage every engine speed needs one displacement ratio, which
the balance gives without a search; along this line of states a grid looks for the least fuel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..physics.balance import BalanceSolver
from ..physics.regimes import Senses
from ..transmission import ranges
from ..transmission.ranges import Array, OperatingPoints, Range
from ..transmission.stage import speed_ratio
from .engine import Engine

Limits = tuple[float, float]
HOLDS = ("engine_speed", "output_speed")
OUTPUT_POWER = Range("output_power", 0.0, 1e6, "W", "is it in kW?")
_PART = Range("torque_reserve", 0.0, 0.9, "-", "a part of the full-load torque")
_SCAN, _ZOOMS = 65, 3
_SLIP = 0.5  # part of the kinematic ratio that a stage may lose, or gain in overrun
_BESIDE = 1e-9  # part of the speed at which the motor rests
_EDGE = 1e-9  # of the stroke
_CLOSE = 0.01  # of the best: stages that the first grid cannot tell apart
_LIMIT_SLACK = 1e-5  # of the width between two limits
_BINDS = 1e-3  # of the full load
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_PARTS = 8  # of the strokes on either side of rest
_START = 1e-3  # of a piece
_BRACKET = 1e-5  # of a piece


@dataclass(frozen=True)
class Optimum:
    """The best working point; floats, or arrays of one shape.

    Attributes:
        displacement_ratio: best pump stroke [-].
        efficiency: there [-].
        engine_speed: there [rad/s]; as given for hold="engine_speed".
        load_torque: there, output power / engine speed [N m].
        output_speed: there [rad/s].
        hold: what was held.
        limit: the limit that binds ("engine_speed low", "engine_speed high",
            "displacement_ratio low", "displacement_ratio high"), or None.
    """

    displacement_ratio: Any
    efficiency: Any
    engine_speed: Any
    load_torque: Any
    output_speed: Any
    hold: str
    limit: Any


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


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def optimum(
    solver: BalanceSolver,
    engine_speed: ArrayLike,
    load_torque: ArrayLike,
    hold: str,
    displacement_ratio: ArrayLike | None,
    output_speed: ArrayLike | None,
    engine_speed_limits: Limits,
) -> Optimum:
    """See `EfficiencyModel.optimal_displacement_ratio`."""
    if hold not in HOLDS:
        raise InputError(f"hold = {hold!r}; there is {', '.join(HOLDS)}")
    given = [
        ranges.ENGINE_SPEED.check(engine_speed),
        ranges.LOAD_TORQUE.check(load_torque),
    ]
    best: Callable[..., tuple[Any, ...]] = partial(_at_engine_speed, solver)
    if hold == "output_speed":
        low, high = ranges.ENGINE_SPEED.check(
            engine_speed_limits, "engine_speed_limits"
        ).tolist()
        if not low < high:
            raise InputError(
                f"engine_speed_limits = {low:g}, {high:g}: the first must be lower"
            )
        best = partial(_at_output_speed, solver, (low, high))
        if output_speed is not None:
            ranges.OUTPUT_SPEED.check(np.abs(output_speed))  # backward it is negative
            given.append(np.asarray(output_speed, dtype=float))
        elif displacement_ratio is not None:
            stroke = ranges.DISPLACEMENT_RATIO.check(displacement_ratio)
            points = np.broadcast_arrays(stroke, *given)
            given.append(
                OperatingPoints(*points).solved(lambda _, at: solver.solve(at))[1]
            )
        else:
            raise InputError(
                'hold="output_speed" needs displacement_ratio (now) or output_speed'
            )
    *values, limit = np.frompyfunc(best, len(given), 6)(*given)
    if np.ndim(limit):
        values = [column.astype(float) for column in values]
    stroke, efficiency, speed, torque, output = values
    return Optimum(stroke, efficiency, speed, torque, output, hold, limit)


def _at_output_speed(
    solver: BalanceSolver, limits: Limits, speed: float, torque: float, held: float
) -> tuple[Any, ...]:
    """Values of `Optimum`, but for what was held."""
    best = _best({"": Line(solver, held, speed * torque)}, *limits)
    return (
        best.displacement_ratio,
        best.efficiency,
        best.engine_speed,
        best.load_torque,
        held,
        best.limit,
    )


def _at_engine_speed(
    solver: BalanceSolver, speed: float, torque: float
) -> tuple[Any, ...]:
    """As `_at_output_speed`."""
    if solver.at_point is not None:
        stroke = _best_stroke(solver, solver.at_point, speed, torque)
        efficiency, output_speed, _ = solver.at_point(stroke, speed, torque)
    else:
        stroke = _best_on_grid(solver, speed, torque)
        efficiency, output_speed, _ = (
            column.item()
            for column in solver.solve(
                OperatingPoints(*np.array([[stroke], [speed], [torque]]))
            )
        )
    return (
        stroke,
        efficiency,
        speed,
        torque,
        output_speed,
        _limit("displacement_ratio", stroke, -1.0, 1.0),
    )


def _best_on_grid(solver: BalanceSolver, speed: float, torque: float) -> float:
    """Best displacement ratio at one engine speed and load torque; NaN where none will do."""
    # Friction holds the motor over a range of strokes, with a corner at either end.
    beside = speed * solver.mechanical_ratio * np.array([1.0 - _BESIDE, 1.0 + _BESIDE])
    rest, _ = solver.held(*np.broadcast_arrays(speed, beside, torque))
    # Next to the stall a motor need not rest between the two.
    first, last = np.sort(np.clip(np.nan_to_num(rest), -1.0, 1.0)).tolist()

    def cost(stroke: Array) -> Array:
        points = np.broadcast_arrays(stroke, speed, torque)
        return -np.nan_to_num(solver.solve(OperatingPoints(*points)).efficiency)

    search = Search(cost, ((-1.0, first), (first, last), (last, 1.0))).closer(_ZOOMS)
    return search.at if search.cost < 0.0 else math.nan


class Search:
    """Lowest cost on intervals: on a grid first, then ever closer to the lowest point of each.

    Attributes:
        at, cost: the lowest point of all, and its cost; infinite where nothing is possible.
    """

    def __init__(
        self, function: Callable[[Array], Array], intervals: Sequence[Limits]
    ) -> None:
        self._function = function
        self._low, self._high = np.array(intervals).T
        self._ends = self._low, self._high
        self.cost, self.at = math.inf, math.nan
        self.closer(1)

    def closer(self, times: int) -> Search:
        """Look closer so many times; return the search itself."""
        for _ in range(times):
            low, high = self._ends
            step = (high - low) / (_SCAN - 1)
            grid = low[:, None] + step[:, None] * np.arange(_SCAN)
            cost = self._function(grid.ravel()).reshape(grid.shape)
            lowest = np.arange(len(grid)), cost.argmin(axis=1)
            at, least = grid[lowest], cost[lowest]
            self._ends = (
                np.maximum(at - step, self._low),
                np.minimum(at + step, self._high),
            )
            self.cost, self.at = min(
                [(self.cost, self.at), *zip(least.tolist(), at.tolist(), strict=True)]
            )
        return self


def _best_stroke(
    solver: BalanceSolver,
    lookup: Callable[[float, float, float], Any],
    speed: float,
    torque: float,
) -> float:
    """As `_best_on_grid`, in plain floats."""

    def value(way: float) -> float:
        found = lookup(corner + reach * way * way, speed, torque)[0]
        return found if found > 0.0 else 0.0  # NaN counts as lowest

    tops = []
    usual = solver.quadrant(Senses(-1 if solver.stage.reverse else 1, 1))
    low, high = (
        min(max(rest, -1.0), 1.0) for rest in usual.resting_ratios(torque / speed)
    )
    # Between the two the whole flow leaks: the one next to no stroke is best there.
    for corner, reach in ((low, -1.0 - low), (high, 1.0 - high)):
        top, way = max((value(i / _PARTS), i / _PARTS) for i in range(_PARTS + 1))
        tops.append((top, way, corner, reach))
        if way > 0.0 or value(_START) > top:
            ends = max(way - 1.0 / _PARTS, 0.0), min(way + 1.0 / _PARTS, 1.0)
            tops.append((*_golden(value, *ends), corner, reach))
    top, way, corner, reach = max(tops)
    return corner + reach * way * way if top > 0.0 else math.nan


def _golden(value: Callable[[float], float], a: float, b: float) -> tuple[float, float]:
    """Highest value of a function with one maximum between two limits, and where."""
    c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_c, at_d = value(c), value(d)
    while b - a > _BRACKET:
        if at_c > at_d:
            b, d, at_d = d, c, at_c
            c = b - _GOLDEN * (b - a)
            at_c = value(c)
        else:
            a, c, at_c = c, d, at_d
            d = a + _GOLDEN * (b - a)
            at_d = value(d)
    return max((at_c, c), (at_d, d))


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
        stroke, torque = self.solver.held(
            speed,
            np.full_like(speed, self.output_speed),
            self.output_power / speed,
            senses=Senses(1 if self.output_speed > 0.0 else -1, 1),
        )
        within = np.fmin(np.fmax(stroke, -1.0), 1.0)
        return within, np.where(np.abs(stroke - within) < _EDGE, torque, np.nan)

    def cost(self, speed: Array) -> Array:
        """Fuel [kg/s], or engine power [W] without an engine; infinite where it is not possible."""
        _, torque = self.state(speed)
        if self.engine is None:
            cost = torque * speed
        else:
            cost = self.engine.fuel_rate(speed, torque)
            if self.reserve > 0.0:
                highest = (1.0 - self.reserve) * self.engine.full_load_torque(speed)
                cost = np.where(torque <= highest, cost, np.nan)
        return np.where(np.isnan(cost), np.inf, cost)

    def reaches(self, low: float, high: float) -> bool:
        """Whether engine speeds between two limits may give the output."""
        ends = math.copysign(1.0, self.output_speed) * speed_ratio(
            self.solver.stage, np.array([-1.0, 1.0])
        )
        slowest, fastest = (
            ends.min() * (1.0 - _SLIP) * low,
            ends.max() * (1.0 + _SLIP) * high,
        )
        return bool(slowest <= abs(self.output_speed) <= fastest)

    def search(self, low: float, high: float) -> Search:
        """Search along engine speeds, on either side of that at which the motor rests.

        There friction sets a step, and often a lowest point beside it.
        """
        ratio, ends = self.solver.mechanical_ratio, [low, high]
        if ratio:
            rest = self.output_speed / ratio * np.array([1.0 - _BESIDE, 1.0 + _BESIDE])
            ends = [low, *np.clip(rest, low, high).tolist(), high]
        return Search(
            self.cost,
            [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b],
        )

    def told(self, stage: str, speed: float, low: float, high: float) -> DriveOptimum:
        """Return the working point at an engine speed between two limits."""
        stroke, torque = (column.item() for column in self.state(np.array([speed])))
        load, fuel, per_loss = self.output_power / speed, math.nan, math.nan
        limit = _limit("engine_speed", speed, low, high) or _limit(
            "displacement_ratio", stroke, -1.0, 1.0
        )
        if self.engine is not None:
            fuel, full = (
                self.engine.fuel_rate(speed, torque),
                self.engine.full_load_torque(speed),
            )
            below = self.engine.fuel_rate(speed, 0.99 * torque)
            per_loss = (fuel - below) / (0.01 * torque * speed) if torque else math.nan
            if torque > (1.0 - self.reserve - _BINDS) * full:
                limit = "full_load"
        return DriveOptimum(
            stage, stroke, speed, load, load / torque, torque, fuel, limit, per_loss
        )


def drive_optimum(
    stages: Mapping[str, BalanceSolver],
    output_speed: float,
    output_power: float,
    engine: Engine | None,
    engine_speed_limits: Limits,
    torque_reserve: float,
    stage: str | None,
    hysteresis: float,
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
    held = float(ranges.OUTPUT_SPEED.check(abs(output_speed))) * math.copysign(
        1.0, output_speed
    )
    power, reserve = (
        float(OUTPUT_POWER.check(output_power)),
        float(_PART.check(torque_reserve)),
    )
    low, high = ranges.ENGINE_SPEED.check(
        engine_speed_limits, "engine_speed_limits"
    ).tolist()
    if engine is not None:
        low, high = max(low, float(engine.speed[0])), min(high, float(engine.speed[-1]))
    if not low < high:
        raise InputError(
            f"engine_speed_limits = {low:g}, {high:g}: nothing lies between them and "
            "the speeds of the engine"
        )
    if stage is not None and stage not in stages:
        raise InputError(f"stage = {stage!r}; there is {', '.join(stages)}")
    lines = {
        name: Line(solver, held, power, engine, reserve)
        for name, solver in stages.items()
    }
    return _best(lines, low, high, stage, hysteresis)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def _best(
    lines: Mapping[str, Line],
    low: float,
    high: float,
    engaged: str | None = None,
    hysteresis: float = 0.0,
) -> DriveOptimum:
    """Best working point on the lines of several stages; see `drive_optimum`."""
    found = {
        name: line.search(low, high)
        for name, line in lines.items()
        if line.reaches(low, high)
    }
    close = _CLOSE
    for _ in range(_ZOOMS):
        promising = min((each.cost for each in found.values()), default=math.inf) * (
            1.0 + close
        )
        found = {
            name: each.closer(1)
            for name, each in found.items()
            if math.isfinite(each.cost) and (each.cost <= promising or name == engaged)
        }
        close *= 2.0 / (_SCAN - 1)
    if not found:
        return DriveOptimum(None)
    best = min(found, key=lambda name: found[name].cost)
    if engaged in found and found[engaged].cost <= found[best].cost * (
        1.0 + hysteresis
    ):
        best = str(engaged)
    return lines[best].told(best, found[best].at, low, high)


def _limit(name: str, value: float, low: float, high: float) -> str | None:
    """Name the limit that binds, if one does."""
    slack = _LIMIT_SLACK * (high - low)
    return (
        f"{name} low"
        if value <= low + slack
        else f"{name} high"
        if value >= high - slack
        else None
    )
