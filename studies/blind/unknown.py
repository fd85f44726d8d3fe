# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is in nobody's library: effects confined to a region, and a base that is a little off."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.polynomial.legendre import legvander

from studies.blind.effect import (
    Conditions,
    Effect,
    FloatArray,
    between,
    drawn,
    either_sign,
)

_DEGREE = np.sum(np.indices((3, 3, 3)), axis=0)
_SPREAD = np.where(_DEGREE <= 3, 1.0 / np.maximum(_DEGREE, 1), 0.0)
_SPREAD[0, 0, 0] = 0.0
_EFFICIENCY = 0.8  # a drag of x P / eta^2 lowers the efficiency by about x


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
        return np.asarray(
            self.size * 0.02 * at.load_torque * at.engine_speed * large * heavy
        )


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
        return np.asarray(
            self.size * flow * self._band(at.command) * np.tanh(at.pressure / 5e5)
        )


@dataclass(frozen=True)
class ClutchMicroslip(Effect):
    """The closed clutch of the mechanical path creeps above its torque capacity."""

    limit: ClassVar[float] = 20.0
    capacity: float = between(330.0, 420.0)

    def clutch_slip(self, torque: FloatArray) -> FloatArray:
        excess = np.logaddexp(0.0, (torque - self.capacity) / 15.0) * 15.0
        return np.asarray(np.minimum(self.size * 0.015 * excess, 75.0))


def draw_field(rng: np.random.Generator) -> tuple[float, ...]:
    """Draw the coefficients of a smooth field whose mean square over a cube is one on average."""
    coefficients = (
        _SPREAD * rng.standard_normal(_SPREAD.shape) / np.sqrt(np.sum(_SPREAD**2))
    )
    return tuple(coefficients.ravel().tolist())


@dataclass(frozen=True)
class BaseMisfit(Effect):
    """A smooth field over stroke, speed and load by which efficiency differs from the base's form.

    Products of Legendre polynomials up to degree three. `size` 1 is a point of efficiency;
    `flow_share` lets the pumped flow differ too, by a field of its own.
    """

    torque_field: tuple[float, ...] = drawn((), draw_field)
    flow_field: tuple[float, ...] = drawn((), draw_field)
    flow_share: float = between(0.0, 1.0)

    def _value(self, field: tuple[float, ...], at: Conditions) -> FloatArray:
        places = (
            at.command,
            (at.engine_speed - 154.0) / 76.0,
            (at.load_torque - 320.0) / 280.0,
        )
        terms = [
            legvander(np.clip(place, -1.1, 1.1), 2) * np.sqrt([1.0, 3.0, 5.0])
            for place in places
        ]
        value = np.einsum(
            "...i,...j,...k,ijk", *terms, np.reshape(field, _SPREAD.shape)
        )
        return np.asarray(0.01 * self.size * value)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        power = at.load_torque * at.engine_speed / _EFFICIENCY**2
        return np.asarray(self._value(self.torque_field, at) * power)

    def lost_flow(self, at: Conditions) -> FloatArray:
        flow = self.flow_share * at.pump_displacement * at.pump_speed
        return np.asarray(self._value(self.flow_field, at) * flow)
