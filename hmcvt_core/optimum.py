# SPDX-License-Identifier: Apache-2.0
"""The displacement ratio that wastes least.

At a held engine speed the best displacement ratio lies next to the full-mechanical point, eps = 0.
What a tractor wants is the best pair (engine speed, displacement ratio) on the line of constant
output speed and output power: every pair there gives the same ground speed and pull.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError
from .power_balance import OperatingPoints
from .published import speed_ratio
from .ranges import (
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
)

if TYPE_CHECKING:
    from .model import EfficiencyModel

Array = NDArray[np.float64]
HOLDS = ("engine_speed", "output_speed")
_GRID = 65
_ROUNDS = 4
_SECANT_STEPS = 12
_STROKE_TOLERANCE = 1e-11


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
    model: EfficiencyModel,
    engine_speed: ArrayLike,
    load_torque: ArrayLike,
    *,
    hold: str = "engine_speed",
    displacement_ratio: ArrayLike | None = None,
    output_speed: ArrayLike | None = None,
    engine_speed_limits: tuple[float, float] = ENGINE_SPEED_LIMITS,
) -> Optimum:
    """Find the displacement ratio that wastes least.

    Args:
        model: the efficiency model.
        engine_speed: now [rad/s].
        load_torque: now, output power / engine speed [N m]; broadcasts with the rest.
        hold: `engine_speed`, or `output_speed` to look for the best pair (engine speed,
            displacement ratio) that keeps output speed and output power.
        displacement_ratio: now [-]; tells the output speed to hold when that is not given.
        output_speed: to hold [rad/s].
        engine_speed_limits: lowest and highest engine speed allowed [rad/s].

    Returns:
        The best point, NaN where the model has no answer anywhere on the line.

    Raises:
        InputError: input out of range, `hold` unknown, or nothing tells the output speed.
    """
    if hold not in HOLDS:
        raise InputError(f"hold = {hold!r}; there is {', '.join(HOLDS)}")
    speed, torque = ENGINE_SPEED.check(engine_speed), LOAD_TORQUE.check(load_torque)
    if hold == "engine_speed":
        scalar = speed.ndim == 0 and torque.ndim == 0
        speed, torque = np.broadcast_arrays(np.atleast_1d(speed), np.atleast_1d(torque))
        return _best_stroke(model, speed, torque, scalar)
    low, high = ENGINE_SPEED.check(engine_speed_limits, "engine_speed_limits")
    if not low < high:
        raise InputError(f"engine_speed_limits = {low:g}, {high:g}: the first must be lower")
    if output_speed is not None:
        target = OUTPUT_SPEED.check(output_speed)
    elif displacement_ratio is not None:
        target = np.asarray(model.output_speed(displacement_ratio, speed, torque))
    else:
        raise InputError('hold="output_speed" needs displacement_ratio (now) or output_speed')
    scalar = speed.ndim == 0 and torque.ndim == 0 and target.ndim == 0
    arrays = np.broadcast_arrays(*map(np.atleast_1d, (target, speed * torque)))
    return _best_pair(model, arrays[0], arrays[1], (float(low), float(high)), scalar)


def _best_stroke(
    model: EfficiencyModel, speed: Array, torque: Array, scalar: bool
) -> Optimum:
    def value(stroke: Array) -> Array:
        return model.efficiency_at(OperatingPoints(
            stroke, *(np.broadcast_to(item[..., None], stroke.shape) for item in (speed, torque))))

    low, high = np.full(speed.shape, -1.0), np.full(speed.shape, 1.0)
    stroke, best = _maximise(value, low, high)
    points = OperatingPoints(stroke, speed, torque)
    output = np.where(np.isnan(best), np.nan, model.output_speed_at(points))
    limit = _limits(stroke, [("displacement_ratio", stroke, low, high)])
    return _packed(scalar, stroke, best, speed, torque, output, "engine_speed", limit)


def _best_pair(
    model: EfficiencyModel, target: Array, power: Array, limits: tuple[float, float], scalar: bool
) -> Optimum:
    # Without slip these engine speeds reach the target at full stroke; with slip, fewer do.
    full = speed_ratio(model.stage, np.array([-1.0, 1.0]))
    with np.errstate(divide="ignore"):
        ends = np.where(full > 0.0, target[..., None] / full, np.inf)
    low = np.maximum(ends.min(axis=-1) * 0.98, limits[0])
    high = np.minimum(ends.max(axis=-1) * 1.25, limits[1])
    feasible = low <= high
    low, high = np.where(feasible, low, limits[0]), np.where(feasible, high, limits[0])

    def stroke_at(speed: Array) -> Array:
        return _stroke_for(model, np.broadcast_to(target[..., None], speed.shape), speed,
                           power[..., None] / speed)

    def value(speed: Array) -> Array:
        stroke = stroke_at(speed)
        within = np.abs(stroke) <= 1.0
        points = OperatingPoints(np.where(within, stroke, 0.0), speed, power[..., None] / speed)
        return np.where(within, model.efficiency_at(points), np.nan)

    speed, best = _maximise(value, low, high)
    best = np.where(feasible, best, np.nan)
    speed = np.where(np.isnan(best), np.nan, speed)
    with np.errstate(invalid="ignore"):
        stroke = stroke_at(np.where(np.isnan(speed), limits[0], speed)[..., None])[..., 0]
    stroke = np.where(np.isnan(best), np.nan, stroke)
    limit = _limits(stroke, [
        ("engine_speed", speed, np.full(speed.shape, limits[0]), np.full(speed.shape, limits[1])),
        ("displacement_ratio", stroke, np.full(speed.shape, -1.0), np.full(speed.shape, 1.0)),
    ])
    return _packed(scalar, stroke, best, speed, power / speed, target, "output_speed", limit)


def _stroke_for(model: EfficiencyModel, target: Array, speed: Array, torque: Array) -> Array:
    """Displacement ratio that gives an output speed; beyond +-1 (or NaN) where none does."""
    ends = speed_ratio(model.stage, np.array([-1.0, 1.0]))
    slope = (ends[1] - ends[0]) / 2.0 * speed
    middle = (ends[1] + ends[0]) / 2.0 * speed
    inside = np.clip((target - middle) / slope, -1.0, 1.0)
    step = np.zeros_like(inside)
    before = None
    for _ in range(_SECANT_STEPS):
        reached = model.output_speed_at(OperatingPoints(inside, speed, torque))
        if before is not None:
            slope = _secant(inside - before[0], reached - before[1], slope)
        step = (target - reached) / slope
        moved = np.clip(inside + step, -1.0, 1.0)
        # Stroke that would have to go beyond full does not move any more.
        if not (np.abs(moved - inside) > _STROKE_TOLERANCE).any():
            break
        before = inside, reached
        inside = moved
    # At full stroke the step that is still missing tells that the target is out of reach.
    return np.where((np.abs(inside) == 1.0) & (np.abs(step) > 1e-9), inside + step, inside)


def _secant(moved: Array, answered: Array, slope: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        found = answered / moved
        # Slip changes the slope by a few per cent; anything else is noise of a vanishing move.
        sound = np.abs(found / slope - 1.0) < 0.5
    return np.where(sound, found, slope)


def _maximise(
    function: Callable[[Array], Array], low: Array, high: Array
) -> tuple[Array, Array]:
    """Maximise along the last axis by grids that zoom in; NaN counts as worst."""
    a, b = low, high
    for _ in range(_ROUNDS):
        grid = a[..., None] + (b - a)[..., None] * np.linspace(0.0, 1.0, _GRID)
        values = function(grid)
        ranked = np.where(np.isnan(values), -np.inf, values)
        index = ranked.argmax(axis=-1)[..., None]
        best = np.take_along_axis(grid, index, -1)[..., 0]
        value = np.take_along_axis(values, index, -1)[..., 0]
        step = (b - a) / (_GRID - 1)
        a, b = np.maximum(best - step, low), np.minimum(best + step, high)
    return np.where(np.isnan(value), np.nan, best), value


def _limits(
    best: Array, checks: list[tuple[str, Array, Array, Array]]
) -> NDArray[Any]:
    limit = np.full(best.shape, None, dtype=object)
    for name, value, low, high in checks:
        slack = 1e-5 * (high - low)
        limit[(limit == None) & (value <= low + slack)] = f"{name} low"  # noqa: E711
        limit[(limit == None) & (value >= high - slack)] = f"{name} high"  # noqa: E711
    return limit


def _packed(scalar: bool, *values: Any) -> Optimum:
    if not scalar:
        return Optimum(*values)
    return Optimum(*(value[0].item() if isinstance(value, np.ndarray) and value.dtype != object
                     else value[0] if isinstance(value, np.ndarray) else value
                     for value in values))
