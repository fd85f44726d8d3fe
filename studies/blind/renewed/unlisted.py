# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Losses that no library names, an accessory, and the small losses by which the base errs."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.bench.plant import BenchConditions
from studies.blind.effect import Conditions, Effect, FloatArray, between
from studies.blind.renewed.listed import softplus, thickness

# --- unlisted ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Unlisted(Effect):
    """A loss that no library names."""


@dataclass(frozen=True)
class TippingBlock(Unlisted):
    """A cylinder block that tips at high speed and low pressure and lets oil pass.

    Manring 2000, Tipping the cylinder block of an axial-piston machine, JDSMC 122, 216.
    """

    onset: float = between(150.0, 260.0)
    closing: float = between(3e6, 9e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        over = softplus(np.abs(at.pump_speed) - self.onset, 12.0) / 100.0
        shut = np.exp(-np.abs(at.pressure) / self.closing)
        flow = np.asarray(4e-4 * self.size * over * shut)
        return np.asarray(flow * np.tanh(at.pressure / 3e5))


@dataclass(frozen=True)
class FloodedCase(Unlisted):
    """A case that the drain flow floods above a pressure: churning of the barrel sets in."""

    pressure: float = between(6e6, 16e6)
    width: float = between(1e6, 3e6)

    def pump_drag(self, at: Conditions) -> FloatArray:
        flooded = 1.0 / (
            1.0 + np.exp((self.pressure - np.abs(at.pressure)) / self.width)
        )
        return np.asarray(9.0 * self.size * flooded * (at.pump_speed / 230.0) ** 2)


@dataclass(frozen=True)
class HuntingPlate(Unlisted):
    """A plate that hunts about zero stroke: its servo takes power there."""

    reach: float = between(0.08, 0.25)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        near = np.exp(-((at.command / self.reach) ** 2))
        return np.asarray(1200.0 * self.size * near * at.engine_speed / 150.0)


@dataclass(frozen=True)
class ShaftWhirl(Unlisted):
    """A shaft that whirls near its critical speed: a Lorentz peak in the output speed.

    Dimentberg 1961, Flexural Vibrations of Rotating Shafts.
    """

    critical: float = between(60.0, 180.0)
    damping: float = between(0.05, 0.15)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        pace = at.output_speed / self.critical
        width = 2.0 * self.damping
        peak = width**2 / ((1.0 - pace**2) ** 2 + (width * pace) ** 2)
        return np.asarray(1500.0 * self.size * peak * pace**2)


UNLISTED = {kind.name: kind for kind in Unlisted.__subclasses__()}


# --- accessory --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Accessory(Effect):
    """An alternator, compressor or stand-by hydraulics at constant power: T ~ 1 / speed.

    Attributes:
        listed_as: names under which a library may have it.
    """

    listed_as: ClassVar[tuple[str, ...]] = (
        "accessory",
        "accessory_power",
        "accessory_drive",
        "auxiliary_drive",
        "auxiliary_power",
        "constant_power",
    )

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        return np.full_like(at.pressure, 700.0 * self.size)


# --- errors of the base -----------------------------------------------------------------------


@dataclass(frozen=True)
class SmallLoss(Effect):
    """A small loss that the base lacks, in a form of its own."""


@dataclass(frozen=True)
class SealLips(SmallLoss):
    """Seals of the pump shaft: a torque that falls with the speed."""

    fading: float = between(20.0, 90.0)

    def pump_drag(self, at: Conditions) -> FloatArray:
        torque = 1.0 + 0.8 * np.exp(-np.abs(at.pump_speed) / self.fading)
        return np.asarray(3.0 * self.size * torque)


@dataclass(frozen=True)
class RoughGaps(SmallLoss):
    """Leakage with an exponent of pressure below one."""

    exponent: float = between(0.6, 0.9)

    def lost_flow(self, at: Conditions) -> FloatArray:
        flow = (np.abs(at.pressure) / 20e6) ** self.exponent
        return np.asarray(1.5e-4 * self.size * flow * np.sign(at.pressure))


@dataclass(frozen=True)
class LoadedBearings(SmallLoss):
    """A share of the output power that grows with the load."""

    exponent: float = between(0.2, 0.6)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        if not isinstance(at, BenchConditions):
            return np.zeros_like(at.pressure)
        share = 0.01 * (at.load_torque / 250.0) ** self.exponent
        return np.asarray(self.size * share * at.load_power)


@dataclass(frozen=True)
class DayDamping(SmallLoss):
    """Damping of the units that follows the oil of the day in part."""

    part: float = between(0.3, 0.8)

    def pump_drag(self, at: Conditions) -> FloatArray:
        excess = thickness(at) ** self.part
        return np.asarray(4.0 * self.size * excess * np.abs(at.pump_speed) / 200.0)


BASE_ERRORS = {kind.name: kind for kind in SmallLoss.__subclasses__()}
