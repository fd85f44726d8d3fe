# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Losses of real machines that a list of the usual ones lacks.

`listed_as` is the name under which a library may have one all the same; a campaign counts as
unlisted only where the library that is judged has no such name.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.bench.plant import BenchConditions
from studies.blind.effect import (
    Conditions,
    Effect,
    FloatArray,
    between,
    either_sign,
    pumping,
)


def _softplus(excess: FloatArray, width: float) -> FloatArray:
    """Return the excess above zero, rounded over a width."""
    return np.asarray(width * np.logaddexp(0.0, excess / width))


@dataclass(frozen=True)
class UnlistedLoss(Effect):
    """A loss that the bench may hide and that no usual list has."""

    listed_as: ClassVar[tuple[str, ...]] = ()


@dataclass(frozen=True)
class ReliefValve(UnlistedLoss):
    """A relief valve of the loop that opens too early: flow rises linearly above its pressure.

    Attributes:
        quantile: share of the tests below whose pressure it stays shut, used by the drawing.
        cracking: pressure at which it opens [Pa].
    """

    listed_as: ClassVar[tuple[str, ...]] = ("relief_valve", "relief_valve_opening")
    quantile: float = between(0.55, 0.85)
    cracking: float = 9e6

    def lost_flow(self, at: Conditions) -> FloatArray:
        over = _softplus(np.abs(at.pressure) - self.cracking, 1.5e5)
        return np.asarray(self.size * 6e-11 * over * np.sign(at.pressure))


@dataclass(frozen=True)
class OilFan(UnlistedLoss):
    """A fan on the engine side whose coupling engages as the oil warms; torque ~ speed^2.

    Attributes:
        engage: temperature at which half of it is engaged, against the mean of the tests [K].
        width: temperature over which it engages [K].
    """

    listed_as: ClassVar[tuple[str, ...]] = (
        "fan",
        "fan_drive",
        "oil_fan",
        "auxiliary_drive",
    )
    engage: float = between(-2.0, 4.0)
    width: float = between(1.5, 4.0)
    mean_temperature: float = 60.0

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        if not isinstance(at, BenchConditions):
            return np.zeros_like(at.pressure)
        over = at.oil_temperature - self.mean_temperature - self.engage
        engaged = 0.5 * (1.0 + np.tanh(over / self.width))
        return np.asarray(self.size * 900.0 * engaged * (at.engine_speed / 150.0) ** 3)


@dataclass(frozen=True)
class CreepingClutch(UnlistedLoss):
    """A closed clutch that creeps: slip grows with torque, steeply above what it holds.

    Attributes:
        capacity: torque at the engine shaft from which slip grows steeply [N m].
        creep: slip below it, against that above.
    """

    listed_as: ClassVar[tuple[str, ...]] = (
        "clutch_slip",
        "clutch_creep",
        "closed_clutch_slip",
    )
    limit: ClassVar[float] = 20.0
    capacity: float = between(180.0, 320.0)
    creep: float = between(0.02, 0.2)

    def clutch_slip(self, torque: FloatArray) -> FloatArray:
        below = self.creep * torque
        above = _softplus(torque - self.capacity, 12.0)
        return np.asarray(np.minimum(self.size * 0.009 * (below + above), 45.0))


@dataclass(frozen=True)
class StarvedInlet(UnlistedLoss):
    """A pump that its inlet does not fill at high speed.

    Attributes:
        onset: pump speed from which it is not filled [rad/s].
        exponent: of the speed above it.
    """

    listed_as: ClassVar[tuple[str, ...]] = (
        "starved_inlet",
        "inlet_starvation",
        "inlet_cavitation",
    )
    onset: float = between(200.0, 270.0)
    exponent: float = between(1.2, 2.2)

    def lost_flow(self, at: Conditions) -> FloatArray:
        over = _softplus(at.pump_speed - self.onset, 6.0) / 100.0
        swept = at.pump_displacement * at.pump_speed * np.abs(at.stroke)
        lacking = swept * over**self.exponent * pumping(at)
        return np.asarray(self.size * 0.03 * lacking * np.sign(at.pressure))


@dataclass(frozen=True)
class DraggingBrake(UnlistedLoss):
    """A brake at the output side that does not free: dry friction, a little less at speed.

    Attributes:
        fading: speed over which half of the friction that fades has faded [rad/s].
        faded: part that fades.
    """

    listed_as: ClassVar[tuple[str, ...]] = ("dragging_brake", "brake_drag")
    fading: float = between(30.0, 120.0)
    faded: float = between(0.2, 0.6)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        left = 1.0 - self.faded * at.output_speed / (at.output_speed + self.fading)
        return np.asarray(self.size * 6.0 * left * at.output_speed)


@dataclass(frozen=True)
class LateWindage(UnlistedLoss):
    """Windage that sets in where the gears reach the oil mist: none below an engine speed.

    Attributes:
        onset: engine speed [rad/s].
        exponent: of the speed above it.
    """

    onset: float = between(120.0, 165.0)
    exponent: float = between(1.0, 1.8)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        over = _softplus(at.engine_speed - self.onset, 4.0) / 50.0
        return np.asarray(self.size * 800.0 * over**self.exponent)


@dataclass(frozen=True)
class HystereticLoss(UnlistedLoss):
    """A loss that depends on whether the load rose or fell to the test.

    Attributes:
        share: of the load power [-].
        sense: 1 where it costs after the load rose, -1 where it costs after it fell.
    """

    share: float = between(0.01, 0.015)
    sense: float = either_sign()

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        if not isinstance(at, BenchConditions):
            return np.zeros_like(at.pressure)
        costs = 0.5 * (1.0 + self.sense * at.approach)
        return np.asarray(self.size * self.share * at.load_power * costs)


UNLISTED_LOSSES = {kind.name: kind for kind in UnlistedLoss.__subclasses__()}
