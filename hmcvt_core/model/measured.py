# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An operating point from what meters show: torque of either shaft, output power, output speed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ..errors import InputError
from ..transmission.ranges import ANY_LOAD, DISPLACEMENT_RATIO, ENGINE_SPEED
from .model import EfficiencyModel

STROKES = ("displacement_ratio", "output_speed")
LOADS = ("load_torque", "output_power", "output_torque", "engine_torque")
_HALVINGS = 60


def operating_point(
    model: EfficiencyModel, engine_speed: float, given: Mapping[str, float | None]
) -> tuple[float, float]:
    """Displacement ratio [-] and load torque [N m] at an engine speed [rad/s].

    Args:
        model: of one stage, formulation `power_balance`.
        engine_speed: [rad/s].
        given: one of `STROKES` and one of `LOADS`, the others None or left out; SI units. Torques
            are negative in overrun, in either sense of the output.

    Raises:
        InputError: a value is out of range or cannot be reached.
    """
    known = {name: value for name, value in given.items() if value is not None}
    speed = float(ENGINE_SPEED.check(engine_speed))
    output = known.get("output_speed")
    if "output_torque" in known and output is not None:
        known["output_power"] = known.pop("output_torque") * abs(output)
    if "output_power" in known:
        known["load_torque"] = known["output_power"] / speed
    if "load_torque" not in known:
        known["load_torque"] = _load(model, speed, known)
    load = float(ANY_LOAD.check(known["load_torque"]))
    stroke = _stroke(model, speed, known, load)
    if not abs(stroke) <= 1.0 + 1e-9:
        raise InputError(f"output_speed = {output:g} rad/s is out of reach of stage "
                         f"{model.stage.name} at this engine speed and load: it would take a "
                         f"displacement ratio of {stroke:.3g}")
    return min(max(stroke, -1.0), 1.0), load


def _stroke(
    model: EfficiencyModel, speed: float, known: Mapping[str, float], load: float
) -> float:
    if "displacement_ratio" in known:
        return float(DISPLACEMENT_RATIO.check(known["displacement_ratio"]))
    columns = np.array([[speed], [known["output_speed"]], [load]])
    return float(model.array_solver.held(*columns)[0][0])


def _load(model: EfficiencyModel, speed: float, known: Mapping[str, float]) -> float:
    """Load torque that goes with the torque of a shaft: by halving, for it rises with the load."""
    name = "engine_torque" if "engine_torque" in known else "output_torque"

    def torque(load: float) -> float:
        point = min(max(_stroke(model, speed, known, load), -1.0), 1.0), speed, load
        if name == "engine_torque":
            found = load + model.power_loss(*point) / speed
        else:
            found = load * speed / abs(model.output_speed(*point))
        return math.inf if math.isnan(found) else float(found)  # no load beyond a stall

    low, high = ANY_LOAD.low, ANY_LOAD.high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if torque(middle) < known[name] else (low, middle)
    if not abs(torque(low) - known[name]) <= 1e-6 * max(abs(known[name]), 1.0):
        raise InputError(f"{name} = {known[name]:g} N m is more than stage {model.stage.name} can "
                         "carry at this engine speed and displacement ratio")
    return low
