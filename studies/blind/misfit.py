# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A base that is a little off: no effect, but what every model's form misses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legvander

from studies.blind.effect import Conditions, Effect, FloatArray, between, drawn

_DEGREE = np.sum(np.indices((3, 3, 3)), axis=0)
_SPREAD = np.where(_DEGREE <= 3, 1.0 / np.maximum(_DEGREE, 1), 0.0)
_SPREAD[0, 0, 0] = 0.0
_EFFICIENCY = 0.8  # a drag of x P / eta^2 lowers the efficiency by about x


def draw_field(rng: np.random.Generator) -> tuple[float, ...]:
    """Draw the coefficients of a smooth field whose mean square over a cube is one on average."""
    coefficients = _SPREAD * rng.standard_normal(_SPREAD.shape) / np.sqrt(np.sum(_SPREAD**2))
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
        places = (at.command, (at.engine_speed - 154.0) / 76.0, (at.load_torque - 320.0) / 280.0)
        terms = [legvander(np.clip(place, -1.1, 1.1), 2) * np.sqrt([1.0, 3.0, 5.0])
                 for place in places]
        value = np.einsum("...i,...j,...k,ijk", *terms, np.reshape(field, _SPREAD.shape))
        return np.asarray(0.01 * self.size * value)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        power = at.load_torque * at.engine_speed / _EFFICIENCY**2
        return np.asarray(self._value(self.torque_field, at) * power)

    def lost_flow(self, at: Conditions) -> FloatArray:
        flow = self.flow_share * at.pump_displacement * at.pump_speed
        return np.asarray(self._value(self.flow_field, at) * flow)
