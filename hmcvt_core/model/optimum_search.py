# SPDX-License-Identifier: Apache-2.0
"""The optimum by a grid that zooms in: for models whose balance has no closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..physics.power_balance import OperatingPoints
from ..physics.published import speed_ratio

if TYPE_CHECKING:
    from .model import EfficiencyModel

Array = NDArray[np.float64]
_GRID = 65
_ROUNDS = 4
_SECANT_STEPS = 12
_STROKE_TOLERANCE = 1e-11
_SPEED_TOLERANCE = 1e-6  # of the output speed held


def search_stroke(model: EfficiencyModel, speed: Array, torque: Array) -> Array:
    """Return the best displacement ratio, shape (n,), at engine speeds and load torques (n,)."""
    def value(stroke: Array) -> Array:
        return model.efficiency_at(OperatingPoints(
            stroke, *(np.broadcast_to(item[..., None], stroke.shape) for item in (speed, torque))))

    low, high = np.full(speed.shape, -1.0), np.full(speed.shape, 1.0)
    return _maximise(value, low, high)


def search_pair(
    model: EfficiencyModel, target: Array, power: Array, limits: tuple[float, float]
) -> tuple[Array, Array]:
    """Return displacement ratio and engine speed, shape (n,), that keep output speed and power.

    Args:
        model: the efficiency model.
        target: output speeds [rad/s], shape (n,).
        power: output powers [W], shape (n,).
        limits: lowest and highest engine speed [rad/s].
    """
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
        # Next to a motor at rest the speed hardly answers the stroke; a pair beside the line would
        # seem better than those on it.
        reached = np.abs(model.output_speed_at(points) / target[..., None] - 1.0)
        within &= reached < _SPEED_TOLERANCE
        return np.where(within, model.efficiency_at(points), np.nan)

    speed = np.where(feasible, _maximise(value, low, high), np.nan)
    with np.errstate(invalid="ignore"):
        stroke = stroke_at(np.where(np.isnan(speed), limits[0], speed)[..., None])[..., 0]
    return np.where(np.isnan(speed), np.nan, stroke), speed


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


def _maximise(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Where a function is greatest between two limits; NaN counts as worst, and is all there is."""
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
    return np.where(np.isnan(value), np.nan, best)
