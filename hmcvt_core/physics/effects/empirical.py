# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A loss without a known cause, as a smooth function of the operating point.

One effect is one Gaussian bump; a remainder is the sum of some of them (radial basis functions,
Broomhead & Lowe 1988). Away from its centre a bump fades to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, ShaftState, Value, shape, size


@dataclass(frozen=True)
class EmpiricalLoss(Effect):
    """T = t exp(-r^2 / 2) on the engine shaft, r the distance from a centre in widths."""

    change_only = True
    name = "empirical_loss"
    component = "empirical"
    summary = "a smooth loss that bench samples show and no listed effect explains"
    source = "Broomhead & Lowe 1988, Complex Systems 2, 321"
    remedy = "measure where the loss is largest"

    torque: float = size("N m", 1.0, -1e4, 1e4, "torque at the centre; negative gains")
    stroke: float = shape("-", (-2.0, 0.0, 2.0), "displacement ratio of the centre")
    speed: float = shape("rad/s", (0.0, 150.0, 1e4), "engine speed of the centre")
    load: float = shape("N m", (-1e5, 200.0, 1e5), "load torque of the centre")
    stroke_width: float = shape("-", (1e-3, 0.5, 1e2), "width along the stroke")
    speed_width: float = shape("rad/s", (1e-3, 50.0, 1e5), "width along the speed")
    load_width: float = shape("N m", (1e-3, 100.0, 1e6), "width along the load")

    def engine_drag(self, state: ShaftState) -> Value:
        load = state.load_power / state.engine_speed
        stroke = state.displacement_ratio
        if state.commanded_ratio is not None:
            stroke = state.commanded_ratio
        height = self.closeness(stroke, state.engine_speed, load)
        return self.torque * height

    def closeness(self, stroke: Array, speed: Array, load: Array) -> Array:
        """Return exp(-r^2 / 2) at points, 1 at the centre."""
        squared = (
            ((stroke - self.stroke) / self.stroke_width) ** 2
            + ((speed - self.speed) / self.speed_width) ** 2
            + ((load - self.load) / self.load_width) ** 2
        )
        return np.asarray(np.exp(-0.5 * squared))
