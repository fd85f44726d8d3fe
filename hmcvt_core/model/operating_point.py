# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The operating point from what meters show: stroke or output speed, and one of the loads."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from ..errors import InputError
from ..transmission.ranges import ANY_LOAD, DISPLACEMENT_RATIO, ENGINE_SPEED
from .model import NO_OPTIMUM, EfficiencyModel

STROKES = ("displacement_ratio", "output_speed")
LOADS = ("load_torque", "output_power", "output_torque", "engine_torque")

_BISECTIONS = 60
_TORQUE_TOLERANCE = 1e-6  # of the torque
_STROKE_TOLERANCE = 1e-9


def operating_point(
    model: EfficiencyModel, engine_speed: float, given: Mapping[str, float | None]
) -> tuple[float, float]:
    """Displacement ratio [-] and load torque [N m] at an engine speed.

    Args:
        model: of one stage, formulation `power_balance`.
        engine_speed: [rad/s].
        given: one of `STROKES` and one of `LOADS`, the others None or left out; SI units. Torques
            are negative in overrun, in either sense of the output.

    Raises:
        InputError: a value is out of range or cannot be reached.
    """
    speed = float(ENGINE_SPEED.check(engine_speed))
    known = {name: value for name, value in given.items() if value is not None}
    stroke_at = _stroke_function(model, speed, known)
    load = float(ANY_LOAD.check(_load_torque(model, speed, known, stroke_at)))
    stroke = stroke_at(load)
    if not abs(stroke) <= 1.0 + _STROKE_TOLERANCE:
        output = known.get("output_speed", math.nan)
        raise InputError(
            f"output_speed = {output:g} rad/s is out of reach of stage "
            f"{model.stage.name} at this engine speed and load: it would take a "
            f"displacement ratio of {stroke:.3g}"
        )
    return _within_stroke(stroke), load


def _stroke_function(
    model: EfficiencyModel, speed: float, known: Mapping[str, float]
) -> Callable[[float], float]:
    """Return the function that gives the displacement ratio at a load torque."""
    if "displacement_ratio" in known:
        given = known["displacement_ratio"]
        return lambda load: float(DISPLACEMENT_RATIO.check(given))
    output = known.get("output_speed", math.nan)
    balance = model.balance(NO_OPTIMUM)

    def holding_output(load: float) -> float:
        strokes, _ = balance.held(*np.array([[speed], [output], [load]]))
        return float(strokes[0])

    return holding_output


def _load_torque(
    model: EfficiencyModel,
    speed: float,
    known: Mapping[str, float],
    stroke_at: Callable[[float], float],
) -> float:
    """Load torque, referred to the engine, of whichever load is known [N m]."""
    if "output_torque" in known and "output_speed" in known:
        return known["output_torque"] * abs(known["output_speed"]) / speed
    if "output_power" in known:
        return known["output_power"] / speed
    if "load_torque" in known:
        return known["load_torque"]

    def engine_torque(load: float) -> float:
        stroke = _within_stroke(stroke_at(load))
        return load + model.power_loss(stroke, speed, load) / speed

    def output_torque(load: float) -> float:
        stroke = _within_stroke(stroke_at(load))
        return load * speed / abs(model.output_speed(stroke, speed, load))

    if "engine_torque" in known:
        name, torque = "engine_torque", engine_torque
    else:
        name, torque = "output_torque", output_torque
    load = _bisected(torque, known[name])
    if load is None:
        raise InputError(
            f"{name} = {known[name]:g} N m is more than stage {model.stage.name} "
            "can carry at this engine speed and displacement ratio"
        )
    return load


def _bisected(torque: Callable[[float], float], wanted: float) -> float | None:
    """Load at which the torque of a shaft, which rises with the load, is the one wanted."""

    def torque_at(load: float) -> float:
        value = float(torque(load))
        return math.inf if math.isnan(value) else value  # a stalled stage takes no more

    low = ANY_LOAD.low
    high = ANY_LOAD.high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if torque_at(middle) < wanted:
            low = middle
        else:
            high = middle
    miss = abs(torque_at(low) - wanted)
    return low if miss <= _TORQUE_TOLERANCE * max(abs(wanted), 1.0) else None


def _within_stroke(stroke: float) -> float:
    return min(max(stroke, -1.0), 1.0)
