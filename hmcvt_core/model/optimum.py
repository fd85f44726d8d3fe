# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The displacement ratio that wastes least.

At a held engine speed the best displacement ratio lies next to the full-mechanical point, eps = 0.
What a tractor wants is the best pair (engine speed, displacement ratio) on the line of constant
output speed and output power: every pair there gives the same ground speed and pull.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..physics.balance import BalanceSolver
from ..physics.steady_state import PointSolver
from ..transmission.ranges import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    OperatingPoints,
)
from .drive_line import best_engine_speed, limit_of

Array = NDArray[np.float64]
Limits = tuple[float, float]
HOLDS = ("engine_speed", "output_speed")
_SCAN = 65
_ZOOMS = 4
_RESTING = 1e-12  # part of the speed beside a standing motor
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


def optimum(
    solver: BalanceSolver,
    lookup: PointSolver | None,
    engine_speed: ArrayLike,
    load_torque: ArrayLike,
    hold: str,
    displacement_ratio: ArrayLike | None,
    output_speed: ArrayLike | None,
    engine_speed_limits: Limits,
) -> Optimum:
    """See `EfficiencyModel.optimal_displacement_ratio`; `lookup` is a short cut at one point."""
    if hold not in HOLDS:
        raise InputError(f"hold = {hold!r}; there is {', '.join(HOLDS)}")
    given = [ENGINE_SPEED.check(engine_speed), LOAD_TORQUE.check(load_torque)]
    limits = None
    if hold == "output_speed":
        low, high = limits = ENGINE_SPEED.check(
            engine_speed_limits, "engine_speed_limits").tolist()
        if not low < high:
            raise InputError(f"engine_speed_limits = {low:g}, {high:g}: the first must be lower")
        if output_speed is not None:
            OUTPUT_SPEED.check(np.abs(output_speed))  # backward it is negative
            given.append(np.asarray(output_speed, dtype=float))
        elif displacement_ratio is not None:
            given.append(DISPLACEMENT_RATIO.check(displacement_ratio))
        else:
            raise InputError('hold="output_speed" needs displacement_ratio (now) or output_speed')
    if lookup is not None and limits is None and given[0].ndim == given[1].ndim == 0:
        return _at_point(lookup, given[0].item(), given[1].item())
    arrays = np.broadcast_arrays(*given)
    shape = arrays[0].shape
    speed, torque, *last = (array.ravel() for array in arrays)
    power = speed * torque
    if limits is not None:
        target = last[0] if output_speed is not None else solver.solve(
            OperatingPoints(last[0], speed, torque)).output_speed
        speed = np.array([best_engine_speed(solver, *held, *limits) for held in zip(
            target.tolist(), power.tolist(), strict=True)])
        stroke = np.clip(solver.held(speed, target, power / speed)[0], -1.0, 1.0)
        efficiency = solver.solve(OperatingPoints(stroke, speed, power / speed)).efficiency
    else:
        stroke = _best_stroke(solver, speed, torque)
        efficiency, target, _ = solver.solve(OperatingPoints(stroke, speed, torque))
    limit = np.array([limit_of(*pair, limits) for pair in zip(
        stroke.tolist(), speed.tolist(), strict=True)], dtype=object)
    columns: tuple[Any, ...] = stroke, efficiency, speed, power / speed, target, limit
    stroke, efficiency, speed, torque, target, limit = (
        column.reshape(shape) if shape else column.item() for column in columns)
    return Optimum(stroke, efficiency, speed, torque, target, hold, limit)


def _best_stroke(solver: BalanceSolver, speed: Array, torque: Array) -> Array:
    """Best displacement ratio at engine speeds and load torques of shape (n,)."""
    # Friction holds the motor over a range of strokes, with a corner at either end.
    beside = speed * solver.mechanical_ratio * np.array([[1.0 - _RESTING], [1.0 + _RESTING]])
    rest, _ = solver.held(speed, beside, torque)
    first, last = np.sort(np.clip(np.nan_to_num(rest), -1.0, 1.0), axis=0)
    ends = np.full_like(first, 1.0)
    # Next to the stall a motor need not rest between the two.
    low, high = (np.stack(pieces, axis=1).ravel() for pieces in (
        (-ends, first, last), (first, last, ends)))
    at = np.repeat(speed, 3 * _SCAN), np.repeat(torque, 3 * _SCAN)
    a, b, rows = low, high, np.arange(low.size)
    for _ in range(_ZOOMS):
        step = (b - a) / (_SCAN - 1)
        grid = a[:, None] + step[:, None] * np.arange(_SCAN)
        found = solver.solve(OperatingPoints(grid.ravel(), *at)).efficiency
        values = np.nan_to_num(found).reshape(grid.shape)
        index = values.argmax(axis=1)
        best, top = grid[rows, index], values[rows, index]
        a, b = np.maximum(best - step, low), np.minimum(best + step, high)
    chosen = rows[::3] + top.reshape(-1, 3).argmax(axis=1)
    return np.where(top[chosen] > 0.0, best[chosen], np.nan)


def _at_point(lookup: PointSolver, speed: float, torque: float) -> Optimum:
    """Best displacement ratio at one engine speed, in plain floats; as `_best_stroke`."""

    def value(way: float) -> float:
        found = lookup.solve(corner + reach * way * way, speed, torque)[0]
        return found if found > 0.0 else 0.0  # NaN counts as lowest

    tops = []
    low, high = (min(max(rest, -1.0), 1.0) for rest in lookup.resting_ratios(speed, torque))
    # Between the two the whole flow leaks: the one next to no stroke is best there.
    for corner, reach in ((low, -1.0 - low), (high, 1.0 - high)):
        top, way = max((value(i / _PARTS), i / _PARTS) for i in range(_PARTS + 1))
        tops.append((top, way, corner, reach))
        if way > 0.0 or value(_START) > top:
            ends = max(way - 1.0 / _PARTS, 0.0), min(way + 1.0 / _PARTS, 1.0)
            tops.append((*_golden(value, *ends), corner, reach))
    top, way, corner, reach = max(tops)
    stroke = corner + reach * way * way if top > 0.0 else math.nan
    efficiency, output_speed, _ = lookup.solve(stroke, speed, torque)
    return Optimum(stroke, efficiency, speed, torque, output_speed, "engine_speed",
                   limit_of(stroke, speed, None))


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
