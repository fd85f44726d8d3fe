# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Clutches and brakes at fault: closed ones that slip, and open ones that do not free.

The drag of open clutches that are free is `clutch_drag` in `mechanical`.
"""

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, ShaftState, Value, ramp, shape, size

_SLIP_REVERSAL = 2.0  # rad/s, over which the friction of a gripping clutch turns round

_TORQUE_REFERENCE = 400.0  # N m above the holding torque, at which a slip is stated


@dataclass(frozen=True)
class _ClosedClutch(Effect):
    """slip = s ((T - T_hold) / 400 N m)^n above T_hold.

    Friction of wet clutches rises with sliding speed, so a clutch with too little pressure settles
    at a slip instead of breaking away; n = 1 is a rise in proportion, more one that flattens.
    """

    component = "clutches"
    source = (
        "friction of wet clutches rises with sliding speed: Strobl et al. 2023, Forsch. "
        "Ingenieurwes. 87, 541"
    )
    remedy = "measure the clutch pressure, and the speed before and behind the clutch"

    slip: float = size(
        "rad/s", 5.0, 0.0, 200.0, "slip speed at 400 N m above the holding torque"
    )
    holding: float = shape(
        "N m",
        (60.0, 120.0, 240.0, 480.0, 960.0),
        "torque up to which the clutch holds",
    )
    exponent: float = shape("-", (1.0, 2.0, 3.0), "power of the torque above it")
    width: float = shape(
        "-",
        (0.1,),
        "half width of the onset / torque up to which the clutch holds",
        limits=(0.03, 0.9),
    )

    def _creep(self, torque: Array) -> Array:
        above = ramp(torque - self.holding, self.width * self.holding)
        return np.asarray(self.slip * (above / _TORQUE_REFERENCE) ** self.exponent)


@dataclass(frozen=True)
class ClutchSlip(_ClosedClutch):
    """slip = s ((T - T_hold) / 400 N m)^n above T_hold: a closed clutch creeps under load.

    It passes the torque of the output shaft; speed and power are lost by the same part. In overrun
    the output runs ahead.
    """

    name = "clutch_slip"
    summary = (
        "a closed clutch slips under load: above a certain torque the output runs slower "
        "than its gears"
    )

    def output_slip(self, torque: Array) -> Value:
        return self._creep(torque)


@dataclass(frozen=True)
class MechanicalClutchSlip(_ClosedClutch):
    """slip = s ((T - T_hold) / 400 N m)^n at the engine shaft: a clutch ahead of the planetary row.

    Torques at a row stand in a fixed ratio. Input-coupled, T follows the torque of the output,
    which runs slower as behind `ClutchSlip`; output-coupled, T follows the torque of the pump,
    which turns slower and delivers less.
    """

    name = "clutch_slip"
    form = "mechanical path"
    summary = (
        "a closed clutch between engine and planetary row slips under load: the row runs slower "
        "than its gears"
    )

    def mechanical_slip(self, torque: Array) -> Value:
        return self._creep(torque)


@dataclass(frozen=True)
class BrakeDrag(Effect):
    """T = T_grip against the output shaft at any speed: a brake that does not free."""

    name = "brake_drag"
    form = "brake at the output"
    component = "clutches"
    summary = (
        "a brake at the output does not free: it takes the same torque at every speed, so "
        "light loads lose most"
    )
    source = "residual torque of disk brakes: SAE 2015-01-2670"
    remedy = "turn the output by hand, and check the zero of the output torque meter"

    torque: float = size("N m", 10.0, 0.0, 200.0, "torque that the brake still grips")

    def output_drag(self, state: ShaftState) -> Value:
        return self._grip(state.output_speed)

    def _grip(self, slip: Array) -> Array:
        return np.asarray(self.torque * np.tanh(slip / _SLIP_REVERSAL))


@dataclass(frozen=True)
class GrippingClutch(BrakeDrag):
    """T = T_grip sign(w_out - r w_engine) between output and a shaft that the engine turns."""

    form = "clutch to the engine"
    summary = (
        "an open clutch does not free: it grips with the same torque at every slip between "
        "the output and a shaft of the engine"
    )
    source = "torque of plates in contact: Berger, Sadeghi & Krousgrill 1996, J. Tribol. 118, 137"
    remedy = "spin the output side alone with the clutches open"

    torque: float = size("N m", 10.0, 0.0, 200.0, "torque that the clutch still grips")
    speed_ratio: float = shape(
        "-",
        (-0.6, 0.3, 0.6, 0.8, 1.0, 1.2, 1.5),
        "output / engine speed at which the slip vanishes",
    )

    def output_drag(self, state: ShaftState) -> Value:
        return self._grip(state.output_speed - self.speed_ratio * state.engine_speed)

    def engine_drag(self, state: ShaftState) -> Value:
        return -self.speed_ratio * self.output_drag(state)
