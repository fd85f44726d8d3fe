# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that are in nobody's library, each confined to a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Conditions, Effect, FloatArray, between, either_sign


def _rise(value: FloatArray, edge: float, width: float) -> FloatArray:
    """Smooth step from 0 to 1 at `edge`."""
    return np.asarray(0.5 * (1.0 + np.tanh((value - edge) / width)))


@dataclass(frozen=True)
class TorsionalResonance(Effect):
    """A torsional mode of the driveline, damped in the input damper, in a band of engine speed.

    Power ~ the squared magnification of a single mode with damping ratio `damping`.
    """

    centre: float = between(105.0, 200.0)
    damping: float = between(0.03, 0.05)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        ratio = at.engine_speed / self.centre
        twice = 2.0 * self.damping
        magnified = twice**2 / ((1.0 - ratio**2) ** 2 + (twice * ratio) ** 2)
        excitation = 0.5 + 0.5 * at.load_torque / 300.0
        return np.asarray(self.size * 1500.0 * magnified * excitation)


@dataclass(frozen=True)
class CasingDeflection(Effect):
    """The casing yields at high load and large stroke of one sign and misaligns the gears."""

    stroke_edge: float = between(0.35, 0.6)
    load_edge: float = between(270.0, 340.0)
    sense: float = either_sign()

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        large = _rise(self.sense * at.command, self.stroke_edge, 0.05)
        heavy = _rise(at.load_torque, self.load_edge, 20.0)
        return np.asarray(self.size * 0.02 * at.load_torque * at.engine_speed * large * heavy)


@dataclass(frozen=True)
class SwashChatter(Effect):
    """The swash plate chatters in a band of displacement ratio.

    `torque`: chatter brakes the pump; `flow`: the valve plate cavitates and flow is lost.
    """

    variants: ClassVar[tuple[str, ...]] = ("torque", "flow")
    side: float = either_sign()
    distance: float = between(0.3, 0.75)
    half_width: float = between(0.12, 0.18)

    def _band(self, command: FloatArray) -> FloatArray:
        distance = np.abs(command - self.side * self.distance)
        return 1.0 - _rise(distance, self.half_width, 0.02)

    def pump_drag(self, at: Conditions) -> FloatArray:
        if self.variant != "torque":
            return np.zeros_like(at.pressure)
        torque = 2.0 + 0.05 * np.abs(at.pressure) * at.pump_displacement
        return np.asarray(self.size * torque * self._band(at.command))

    def lost_flow(self, at: Conditions) -> FloatArray:
        if self.variant != "flow":
            return np.zeros_like(at.pressure)
        flow = 0.02 * at.pump_displacement * at.pump_speed
        return np.asarray(self.size * flow * self._band(at.command) * np.tanh(at.pressure / 5e5))


@dataclass(frozen=True)
class ClutchMicroslip(Effect):
    """The closed clutch of the mechanical path creeps above its torque capacity."""

    limit: ClassVar[float] = 20.0
    capacity: float = between(330.0, 420.0)

    def carrier_slip(self, load_torque: FloatArray) -> FloatArray:
        excess = np.logaddexp(0.0, (load_torque - self.capacity) / 15.0) * 15.0
        return np.asarray(np.minimum(self.size * 1e-4 * excess, 0.5))
