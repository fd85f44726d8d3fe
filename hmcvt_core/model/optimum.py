# SPDX-License-Identifier: Apache-2.0
"""The displacement ratio that wastes least.

At a held engine speed the best displacement ratio lies next to the full-mechanical point, eps = 0.
What a tractor wants is the best pair (engine speed, displacement ratio) on the line of constant
output speed and output power: every pair there gives the same ground speed and pull.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..transmission.ranges import (
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    Range,
)
from .closed_form_optimum import best_engine_speed, best_flow
from .optimum_search import search_pair, search_stroke

if TYPE_CHECKING:
    from .model import EfficiencyModel

Array = NDArray[np.float64]
Value = Any
"""A float, or an array."""
Pairs = tuple[Any, Any]
"""Displacement ratio and engine speed: floats, or arrays of one shape."""
Limits = tuple[float, float]
"""Lowest and highest engine speed [rad/s]."""
HOLDS = ("engine_speed", "output_speed")
_LIMIT_SLACK = 1e-5  # of the width between two limits


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
        InputError: input out of range, `hold` unknown, nothing tells the output speed, or the
            formulation is `published`, whose best point is one of its own making.
    """
    if model.formulation == "published":
        raise InputError("formulation 'published' has no optimum: it has a pole, eq. (11), and "
                         "peaks where eq. (8) alone sees no hydraulic power; take power_balance")
    if hold not in HOLDS:
        raise InputError(f"hold = {hold!r}; there is {', '.join(HOLDS)}")
    speed, torque = _checked(ENGINE_SPEED, engine_speed), _checked(LOAD_TORQUE, load_torque)
    if hold == "engine_speed":
        pairs = _held_engine_speed(model, speed, torque)
        return _packed(model, pairs, speed * torque, hold)
    low, high = ENGINE_SPEED.check(engine_speed_limits, "engine_speed_limits").tolist()
    if not low < high:
        raise InputError(f"engine_speed_limits = {low:g}, {high:g}: the first must be lower")
    if output_speed is not None:
        target = _checked(OUTPUT_SPEED, output_speed)
    elif displacement_ratio is not None:
        target = model.output_speed(displacement_ratio, engine_speed, load_torque)
    else:
        raise InputError('hold="output_speed" needs displacement_ratio (now) or output_speed')
    power = speed * torque
    pairs = _held_output_speed(model, target, power, (low, high))
    return _packed(model, pairs, power, hold, target, (low, high))


def _checked(limits: Range, value: Any) -> Value:
    # A single float, which a control loop gives, is to cost no array.
    if isinstance(value, float) and limits.low <= value <= limits.high:
        return float(value)
    array = limits.check(value)
    return array.item() if array.ndim == 0 else array


def _held_engine_speed(model: EfficiencyModel, speed: Value, torque: Value) -> Pairs:
    """Displacement ratio and engine speed at engine speeds and load torques."""
    form = model.closed_form

    def exact(speed: float, torque: float) -> tuple[float, float] | None:
        flow = None if form is None else best_flow(form, speed, torque)
        return None if form is None or flow is None else (flow / form.full_flow, speed)

    return _exact_or_searched(
        exact, lambda speed, torque: (search_stroke(model, speed, torque), speed), speed, torque)


def _held_output_speed(
    model: EfficiencyModel, target: Value, power: Value, limits: Limits
) -> Pairs:
    """Displacement ratio and engine speed at output speeds and powers."""
    form = model.closed_form

    def exact(target: float, power: float) -> tuple[float, float] | None:
        found = None if form is None else best_engine_speed(form, target, power, limits)
        return None if form is None or found is None else (found[1] / form.full_flow, found[0])

    return _exact_or_searched(
        exact, lambda target, power: search_pair(model, target, power, limits), target, power)


def _exact_or_searched(
    exact: Callable[[float, float], tuple[float, float] | None],
    search: Callable[[Array, Array], tuple[Array, Array]],
    first: Value,
    second: Value,
) -> Pairs:
    """Solve point by point where the model can, and search, all at once, where it cannot."""
    if isinstance(first, float) and isinstance(second, float):
        pair = exact(first, second)
        if pair is None:
            stroke, speed = search(np.array([first]), np.array([second]))
            pair = stroke.item(), speed.item()
        return pair
    first, second = np.broadcast_arrays(first, second)
    found = [exact(*point) for point in zip(first.ravel().tolist(), second.ravel().tolist(),
                                            strict=True)]
    pairs = np.array([(math.nan, math.nan) if pair is None else pair for pair in found])
    rest = [i for i, pair in enumerate(found) if pair is None]
    if rest:
        pairs[rest] = np.transpose(search(first.ravel()[rest], second.ravel()[rest]))
    strokes, speeds = pairs.reshape(-1, 2).T.reshape(2, *first.shape)
    return strokes, speeds


def _packed(
    model: EfficiencyModel,
    pairs: Pairs,
    power: Value,
    hold: str,
    target: Value | None = None,
    limits: Limits | None = None,
) -> Optimum:
    stroke, speed = pairs
    if isinstance(stroke, float) and isinstance(speed, float):
        # Rounding may lead a little beyond full stroke.
        stroke = 1.0 if stroke > 1.0 else -1.0 if stroke < -1.0 else stroke
        return _packed_point(model, stroke, speed, power, hold, target, limits)
    stroke, torque = np.clip(stroke, -1.0, 1.0), power / speed
    known = ~np.isnan(stroke)
    # The model takes no NaN; what it says there is not used.
    point = (np.where(known, stroke, 0.0), np.where(known, speed, ENGINE_SPEED.high),
             np.where(known, torque, LOAD_TORQUE.low))
    efficiency = np.where(known, model.efficiency(*point), np.nan)
    reached = (np.where(known, model.output_speed(*point), np.nan) if target is None
               else np.broadcast_to(target, stroke.shape))
    limit = np.full(stroke.shape, None, dtype=object)
    for i in np.ndindex(stroke.shape):
        limit[i] = _limit(stroke[i], speed[i], limits)
    return Optimum(stroke, efficiency, speed, torque, reached, hold, limit)


def _packed_point(
    model: EfficiencyModel,
    stroke: float,
    speed: float,
    power: Any,
    hold: str,
    target: Any,
    limits: Limits | None,
) -> Optimum:
    torque, form = power / speed, model.closed_form
    efficiency, reached = math.nan, math.nan if target is None else target
    known = not math.isnan(stroke)
    if known and target is None and form is not None:
        efficiency, reached = form.point(stroke, speed, torque)
    elif known:
        efficiency = model.efficiency(stroke, speed, torque)
        if target is None:
            reached = model.output_speed(stroke, speed, torque)
    return Optimum(stroke, efficiency, speed, torque, reached, hold,
                   _limit(stroke, speed, limits))


def _limit(stroke: float, speed: float, limits: Limits | None) -> str | None:
    """Name the limit that binds, the engine's before the pump's."""
    at_engine = None if limits is None else _end("engine_speed", speed, *limits)
    return at_engine or _end("displacement_ratio", stroke, -1.0, 1.0)


def _end(name: str, value: float, low: float, high: float) -> str | None:
    slack = _LIMIT_SLACK * (high - low)
    if value <= low + slack:
        return f"{name} low"
    return f"{name} high" if value >= high - slack else None
