# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the swash actuator: the stroke that the plate has is not the one commanded."""

from dataclasses import dataclass

import numpy as np

from .base import PRESSURE_REFERENCE, Array, Effect, ShaftState, Value, shape, size


class _Displacement(Effect):
    name = "displacement_error"
    component = "actuator"
    remedy = "read the swash angle, or the output speed at no load"


@dataclass(frozen=True)
class DisplacementOffset(_Displacement):
    """True ratio = commanded + offset."""

    form = "offset"
    summary = "the swash plate stands a constant angle off the one commanded"
    source = "feedback zero of swash actuators"
    shared_error = "zero of the stroke sensor"

    offset: float = size("-", 0.015, -0.1, 0.1, "true minus commanded ratio")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        return displacement_ratio + self.offset


@dataclass(frozen=True)
class DisplacementGain(_Displacement):
    """True ratio = commanded (1 + gain)."""

    form = "gain"
    summary = "the swash plate turns by another angle than commanded, in proportion"
    source = "feedback gain of swash actuators"
    shared_error = "gain of the stroke sensor"

    gain: float = size("-", 0.02, -0.1, 0.1, "true / commanded ratio - 1")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        return displacement_ratio * (1.0 + self.gain)


@dataclass(frozen=True)
class DisplacementDeadBand(_Displacement):
    """True ratio = commanded, less a dead band about zero."""

    form = "dead band"
    summary = "the swash plate does not answer small commands and lags larger ones"
    source = "overlap of servo valves"

    half_width: float = size("-", 0.02, 0.0, 0.15, "half width of the dead band")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        beyond = np.maximum(np.abs(displacement_ratio) - self.half_width, 0.0)
        return np.sign(displacement_ratio) * beyond


@dataclass(frozen=True)
class DisplacementLag(_Displacement):
    """True ratio = commanded - lag g(dp), g = dp / (|dp| + dp_half), 1 at 20 MPa.

    This is what steady tests keep of the hysteresis of an actuator whose friction or spring gives
    way to the load on the plate: constant once friction gives all it can (small dp_half), in
    proportion to the pressure for a spring (large). Where the band follows the way of approach
    instead, plates that come from neutral have a dead band, and tests in no order a noisy stroke.
    """

    form = "load"
    summary = (
        "the swash plate gives way to pressure: the stroke lags the command under load"
    )
    source = "hysteresis of a tractor's unit: Adv. Mech. Eng. 2016, doi 10.1177/1687814016676943"
    remedy = "read the swash angle; approach one point from either side"

    lag: float = size("-", 0.015, -0.1, 0.1, "stroke lost at 20 MPa")
    half_pressure: float = shape("MPa", (5.0, 50.0), "pressure at half the largest lag")

    def stroke_lag(self, state: ShaftState) -> Value:
        part, half = (
            pressure / PRESSURE_REFERENCE
            for pressure in (state.pressure, self.half_pressure * 1e6)
        )
        return self.lag * part * (1.0 + half) / (np.abs(part) + half)
