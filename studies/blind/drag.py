# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Drag of charge pump, oil, bearings, seals and open clutches; friction of units and gears."""

from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from studies.blind.effect import Conditions, Effect, FloatArray, between, drawn


@dataclass(frozen=True)
class ChargePump(Effect):
    """Charge pump on the pump shaft against its relief valve.

    The valve's pressure rises with the flow that the loop's leakage leaves; `size` 1 is 12 cm3/r.
    """

    limit: ClassVar[float] = 6.0
    cracking_pressure: float = between(1.4e6, 2.2e6)
    override: float = between(0.1, 0.5)

    def pump_drag(self, at: Conditions) -> FloatArray:
        displacement = self.size * 12e-6 / (2.0 * pi)
        flow = displacement * at.pump_speed
        spare = flow - at.leakage * np.abs(at.pressure) / at.gap_viscosity
        # Never less than a trickle through the relief valve.
        spare = 0.5 * (spare + np.sqrt(spare * spare + (0.05 * flow) ** 2))
        full = displacement * 250.0 + 1e-12
        pressure = self.cracking_pressure * (
            1.0 + self.override * (spare / full) ** 0.8
        )
        return np.asarray(displacement * pressure / 0.88)


@dataclass(frozen=True)
class Churning(Effect):
    """Oil churned by the engine-side gears.

    Windage and churning ~ speed^2.8 viscosity^0.2 (Anderson and Loewenthal, NASA TP-1622, 1980;
    2.4 to 3.0 by regime: Changenet and Velex, J. Mech. Des. 129 (2007) 210), less what the gears
    fling away at speed, which lowers the level they dip into.
    """

    exponent: float = between(2.4, 3.0)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        dip = 1.0 / np.sqrt(1.0 + (at.engine_speed / 400.0) ** 2)
        power = (
            900.0 * (at.engine_speed / 180.0) ** self.exponent * at.film_viscosity**0.2
        )
        return np.asarray(self.size * power * dip)


@dataclass(frozen=True)
class OutputChurning(Effect):
    """Oil churned by the final gears, which turn with the output shaft."""

    exponent: float = between(2.4, 3.0)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        dip = 1.0 / (1.0 + (at.output_speed / 900.0) ** 2)
        power = (
            400.0 * (at.output_speed / 190.0) ** self.exponent * at.film_viscosity**0.2
        )
        return np.asarray(self.size * power * dip)


@dataclass(frozen=True)
class BearingDrag(Effect):
    """Bearings and seals on the engine side.

    Rolling moment ~ (viscosity x speed)^0.6 (0.4 to 0.8) and a seal moment that barely moves with
    speed (form of the SKF model of bearing friction).
    """

    seal_share: float = between(0.1, 0.9)
    rolling_exponent: float = between(0.4, 0.8)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        rolling = (at.film_viscosity * at.engine_speed / 150.0) ** self.rolling_exponent
        seal = (at.engine_speed / 150.0) ** 0.1
        torque = 3.0 * ((1.0 - self.seal_share) * rolling + self.seal_share * seal)
        return np.asarray(self.size * torque * at.engine_speed)


@dataclass(frozen=True)
class ClutchDrag(Effect):
    """Open wet clutches between a shaft that follows the output and one that follows the engine.

    Shear of a full film up to the slip at which it needs more oil than it is fed; beyond it the
    wetted radius shrinks (Yuan, Guo, Hu and Peng, J. Fluids Eng. 129 (2007) 923), until the plates
    flutter. The faster the engine drives the feed pump, the later the film breaks (Iqbal 2013).
    """

    slip_ratio: float = between(0.6, 1.2)
    engine_share: float = drawn(0.0, lambda rng: max(0.0, rng.uniform(-0.4, 0.4)))
    peak_slip: float = between(60.0, 180.0)
    feed: float = between(0.0, 0.8)
    decay: float = between(1.2, 2.4)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        slip = np.abs(
            self.slip_ratio * at.output_speed - self.engine_share * at.engine_speed
        )
        peak = self.peak_slip * (at.engine_speed / 150.0) ** self.feed
        relative = slip / peak * at.film_viscosity**0.3
        wetted = 1.0 / (1.0 + relative**4) ** (self.decay / 4.0)
        flutter = 0.02 * (slip / 300.0) ** 2
        return np.asarray(self.size * 8.0 * (relative * wetted + flutter) * slip)


@dataclass(frozen=True)
class PressureFriction(Effect):
    """Sliding friction of pump and motor at full stroke.

    The coefficient follows the Hersey number, viscosity x speed / pressure (Stribeck; Manring,
    Fluid Power Pumps and Motors, 2013), above a Coulomb floor, in the pump at zero stroke too.
    """

    hersey: float = between(2e-7, 1.5e-6)
    floor: float = between(0.1, 0.8)

    def _coefficient(self, speed: FloatArray, at: Conditions) -> FloatArray:
        number = 0.022 * at.film_viscosity * np.abs(speed) / (np.abs(at.pressure) + 1e5)
        mixed = 1.0 / (1.0 + (number / self.hersey) ** 1.4)
        return np.asarray(self.size * 0.03 * (self.floor + (1.0 - self.floor) * mixed))

    def pump_drag(self, at: Conditions) -> FloatArray:
        load = np.abs(at.pressure) * at.pump_displacement
        return np.asarray(self._coefficient(at.pump_speed, at) * load)

    def motor_drag(self, at: Conditions) -> FloatArray:
        load = np.abs(at.pressure) * at.motor_displacement
        return np.asarray(self._coefficient(at.motor_speed, at) * load)


@dataclass(frozen=True)
class GearMesh(Effect):
    """Gear pairs that lose more than their nominal share.

    `friction`: coefficient of friction ~ log10(29.66 W' / (eta v_s v_t^2)) (Benedict and Kelley,
    ASLE Trans. 4 (1961) 59): rises with tooth load, falls with speed. `film`: boundary friction
    where the film, ~ (viscosity x speed)^0.7 load^-0.13 (Dowson and Higginson), is thinner than the
    roughness, a power of load and speed above it (ISO/TR 14179-2). `efficiency`: pairs less
    efficient than assumed, each by its own amount (`uneven`, in the order 2, 3, 4, 5, 6, 11).
    """

    variants: ClassVar[tuple[str, ...]] = ("friction", "film", "efficiency")
    limit: ClassVar[float] = 8.0
    roughness: float = between(0.6, 1.6)
    load_exponent: float = between(0.0, 0.6)
    uneven: tuple[float, ...] = drawn(
        (1.0,) * 6, lambda rng: tuple(rng.uniform(0.4, 1.6, 6).tolist())
    )

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        if self.variant == "efficiency":
            place = (2, 3, 4, 5, 6, 11).index(pair)
            return np.full_like(torque, 0.004 * self.size * self.uneven[place])
        load = (np.abs(torque) + 2.0) / 300.0
        pace = (np.abs(speed) + 5.0) / 150.0
        if self.variant == "film":
            film = pace**0.7 * load**-0.13 / self.roughness
            boundary = 1.0 / (1.0 + film**4)
            share = load**self.load_exponent * (
                boundary + (1.0 - boundary) * pace**-0.2
            )
            return np.asarray(np.minimum(0.004 * self.size * share, 0.2))
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

    bearing: float = between(0.0, 0.3)

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        mesh = (np.abs(rolling_speed) / 150.0 + 0.05) ** -0.25
        centrifugal = self.bearing * (at.carrier_speed / 120.0) ** 2
        carried = 250.0 / (np.abs(ring_torque) + 25.0)
        share = 0.01 * self.size * (mesh + centrifugal * carried)
        return np.asarray(np.minimum(share, 0.5))
