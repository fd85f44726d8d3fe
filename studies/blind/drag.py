# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Drag of charge pump, oil, bearings, seals and open clutches; friction of units and gears."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from studies.blind.effect import Conditions, Effect, FloatArray


@dataclass(frozen=True)
class ChargePump(Effect):
    """Charge pump on the pump shaft against its relief valve.

    The valve's pressure rises with the flow left over after the loop's leakage is made up
    (override); `size` 1 is 12 cm3/r.
    """

    limit: ClassVar[float] = 6.0
    cracking_pressure: float = 1.7e6
    override: float = 0.3

    def pump_drag(self, at: Conditions) -> FloatArray:
        """Return displacement x relief pressure, over the pump's efficiency."""
        displacement = self.size * 12e-6 / (2.0 * pi)
        flow = displacement * at.pump_speed
        spare = flow - at.leakage * np.abs(at.pressure) / at.gap_viscosity
        # Never less than a trickle through the relief valve.
        spare = 0.5 * (spare + np.sqrt(spare * spare + (0.05 * flow) ** 2))
        full = displacement * 250.0 + 1e-12
        pressure = self.cracking_pressure * (1.0 + self.override * (spare / full) ** 0.8)
        return np.asarray(displacement * pressure / 0.88)


@dataclass(frozen=True)
class Churning(Effect):
    """Oil churned by the engine-side gears.

    Windage and churning ~ speed^2.8 viscosity^0.2 (Anderson and Loewenthal, NASA TP-1622, 1980),
    less what the gears fling away at speed, which lowers the level they dip into.
    """

    exponent: float = 2.8

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        """Return the power churned, at the engine shaft."""
        dip = 1.0 / np.sqrt(1.0 + (at.engine_speed / 400.0) ** 2)
        power = 900.0 * (at.engine_speed / 180.0) ** self.exponent * at.film_viscosity**0.2
        return np.asarray(self.size * power * dip)


@dataclass(frozen=True)
class OutputChurning(Effect):
    """Oil churned by the final gears, which turn with the output shaft."""

    exponent: float = 2.7

    def output_drag_power(self, at: Conditions) -> FloatArray:
        """Return the power churned, at the output shaft."""
        dip = 1.0 / (1.0 + (at.output_speed / 900.0) ** 2)
        power = 400.0 * (at.output_speed / 190.0) ** self.exponent * at.film_viscosity**0.2
        return np.asarray(self.size * power * dip)


@dataclass(frozen=True)
class BearingSealDrag(Effect):
    """Bearings and seals on the engine side.

    Rolling moment ~ (viscosity x speed)^0.6 and a seal moment that barely moves with speed (form
    of the SKF model of bearing friction).
    """

    seal_share: float = 0.5

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        """Return rolling and seal moments times speed."""
        rolling = (at.film_viscosity * at.engine_speed / 150.0) ** 0.6
        seal = (at.engine_speed / 150.0) ** 0.1
        torque = 3.0 * ((1.0 - self.seal_share) * rolling + self.seal_share * seal)
        return np.asarray(self.size * torque * at.engine_speed)


@dataclass(frozen=True)
class ClutchDrag(Effect):
    """Open wet clutches on the output side.

    Shear of a full film up to the speed at which the film needs more oil than it is fed; beyond
    it the wetted radius shrinks and drag falls (Yuan, Guo, Hu and Peng, J. Fluids Eng. 129 (2007)
    923); at high speed the plates flutter and drag rises a little.
    """

    slip_ratio: float = 0.9
    peak_slip: float = 110.0
    decay: float = 1.7

    def output_drag_power(self, at: Conditions) -> FloatArray:
        """Return drag torque times slip of the open clutch."""
        slip = np.abs(self.slip_ratio * at.output_speed)
        relative = slip / self.peak_slip * at.film_viscosity**0.3
        wetted = 1.0 / (1.0 + relative**4) ** (self.decay / 4.0)
        flutter = 0.02 * (slip / 300.0) ** 2
        return np.asarray(self.size * 8.0 * (relative * wetted + flutter) * slip)


@dataclass(frozen=True)
class PressureFriction(Effect):
    """Sliding friction of pump and motor at full stroke.

    The coefficient follows the Hersey number, viscosity x speed / pressure (Stribeck curve;
    Manring, Fluid Power Pumps and Motors, 2013), above a Coulomb floor; the pump pays it at
    zero stroke too.
    """

    hersey: float = 5e-7
    floor: float = 0.35

    def _coefficient(self, speed: FloatArray, at: Conditions) -> FloatArray:
        number = 0.022 * at.film_viscosity * np.abs(speed) / (np.abs(at.pressure) + 1e5)
        mixed = 1.0 / (1.0 + (number / self.hersey) ** 1.4)
        return np.asarray(self.size * 0.03 * (self.floor + (1.0 - self.floor) * mixed))

    def pump_drag(self, at: Conditions) -> FloatArray:
        """Return the friction of the pump's pistons and slippers."""
        load = np.abs(at.pressure) * at.pump_displacement
        return np.asarray(self._coefficient(at.pump_speed, at) * load)

    def motor_drag(self, at: Conditions) -> FloatArray:
        """Return the friction of the motor's pistons and slippers."""
        load = np.abs(at.pressure) * at.motor_displacement
        return np.asarray(self._coefficient(at.motor_speed, at) * load)


@dataclass(frozen=True)
class GearMesh(Effect):
    """Gear pairs that lose more than their nominal share.

    `friction`: coefficient of friction ~ log10(29.66 W' / (eta v_s v_t^2)) (Benedict and Kelley,
    ASLE Trans. 4 (1961) 59): rises with tooth load, falls with speed. `efficiency`: pairs less
    efficient than assumed, each by its own amount (`uneven`, in the order 2, 3, 4, 5, 6, 11).
    """

    variants: ClassVar[tuple[str, ...]] = ("friction", "efficiency")
    limit: ClassVar[float] = 8.0
    uneven: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the further share of power lost in the pair."""
        if self.variant == "efficiency":
            place = (2, 3, 4, 5, 6, 11).index(pair)
            return np.full_like(torque, 0.004 * self.size * self.uneven[place])
        load = (np.abs(torque) + 2.0) / 300.0
        pace = (np.abs(speed) + 5.0) / 150.0
        # 1.4 decades above the full film at 300 N m and 150 rad/s; smooth floor at zero.
        decades = 1.4 + np.log10(load) - 3.0 * np.log10(pace)
        bearing = np.logaddexp(0.0, 4.0 * decades) / 4.0
        return np.asarray(np.minimum(0.003 * self.size * bearing, 0.2))


@dataclass(frozen=True)
class PlanetaryMesh(Effect):
    """Meshes and planet bearings of the planetary row.

    Mesh friction falls with rolling speed ^0.25; the planets' centrifugal force loads their
    bearings whatever the torque (as in Muller, Epicyclic Drive Trains, 1982, for fast carriers).
    """

    bearing: float = 0.15

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        """Return the share of rolling power lost in meshes and planet bearings."""
        mesh = (np.abs(rolling_speed) / 150.0 + 0.05) ** -0.25
        centrifugal = self.bearing * (at.carrier_speed / 120.0) ** 2
        carried = 250.0 / (np.abs(ring_torque) + 25.0)
        share = 0.01 * self.size * (mesh + centrifugal * carried)
        return np.asarray(np.minimum(share, 0.5))
