# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Flow effects of pump, motor and loop, and their oil."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Conditions, Effect, FloatArray, between, either_sign

#: Density of the oil, kg/m3, and its nominal kinematic viscosity, m2/s.
DENSITY = 860.0
NOMINAL_VISCOSITY = 2.6e-5
#: Low side of the loop and the atmosphere, Pa (absolute).
_CHARGE = 2.0e6
_ATMOSPHERE = 1.0e5
#: Temperature at which the base parameters hold, deg C.
NOMINAL_TEMPERATURE = 60.0
#: lg lg(nu + 0.7) at 40 and 100 deg C of a tractor transmission oil with 60 and 9.5 mm2/s there.
_COOL, _HOT = np.log10(np.log10(np.array([60.0, 9.5]) + 0.7))
_STEEPNESS = (_COOL - _HOT) / np.log10(373.15 / 313.15)


@dataclass(frozen=True)
class PressureLeakage(Effect):
    """Gaps that open under pressure.

    `clearance`: flow through a gap grows with its cube (Reynolds), the gap linearly with
    pressure. `power_law`: flow ~ dp^exponent, of a mixed bundle of gaps (Hall, Iowa State 2014,
    fits such exponents). `eccentric`: side load presses the pistons off their centres, and a ring
    gap leaks 1 + 1.5 e^2 times as much; the eccentricity e saturates (Ivantysyn & Ivantysynova).
    """

    variants: ClassVar[tuple[str, ...]] = ("clearance", "power_law", "eccentric")
    limit: ClassVar[float] = 8.0
    exponent: float = between(1.4, 3.0)
    tilting_pressure: float = between(8e6, 30e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        pressure = at.pressure / 30e6
        laminar = at.leakage * at.pressure / at.gap_viscosity
        if self.variant == "clearance":
            opening = 1.0 + 0.5 * self.size * np.abs(pressure)
            return np.asarray(laminar * (opening**3 - 1.0))
        if self.variant == "eccentric":
            eccentricity = np.tanh(at.pressure / self.tilting_pressure)
            return np.asarray(laminar * self.size * 1.5 * eccentricity**2)
        return np.asarray(
            laminar * 2.0 * self.size * np.abs(pressure) ** (self.exponent - 1.0)
        )


@dataclass(frozen=True)
class OrificeLeakage(Effect):
    """Leak through a short opening (valve plate groove, plug).

    The discharge coefficient grows with the flow number, from laminar to turbulent (McCloy and
    Martin, Control of Fluid Power, 1980): flow is between dp and dp^0.5.
    """

    diameter: float = between(1.5e-4, 1e-3)

    def lost_flow(self, at: Conditions) -> FloatArray:
        velocity = np.sqrt(2.0 * (np.abs(at.pressure) + 1.0) / DENSITY)
        number = self.diameter * velocity / (NOMINAL_VISCOSITY * at.gap_viscosity)
        discharge = 0.65 * np.tanh(2.0 * number / 800.0)
        return np.asarray(
            self.size * 1.0e-6 * discharge * velocity * np.sign(at.pressure)
        )


@dataclass(frozen=True)
class StrokeLeakage(Effect):
    """Slippers that tilt at large stroke and leak; exponent of stroke below two."""

    exponent: float = between(1.0, 2.2)

    def lost_flow(self, at: Conditions) -> FloatArray:
        tilt = np.abs(at.stroke) ** self.exponent * (1.0 + 0.2 * at.pump_speed / 200.0)
        return np.asarray(
            self.size * at.leakage * at.pressure / at.gap_viscosity * tilt
        )


@dataclass(frozen=True)
class Compressibility(Effect):
    """Oil and entrained air compressed in the dead and swept volumes each turn.

    The loss of volume from charge to working pressure is integrated for a liquid whose tangent
    modulus is 1.3 GPa + 10 p and for air compressed polytropically (Gholizadeh, Burton and
    Schoenau, Int. J. Fluid Power 13 (2012) 7). `size` scales dead volume and air alike.
    """

    air: float = between(0.005, 0.08)
    dead_volume: float = between(0.2, 1.2)

    def lost_flow(self, at: Conditions) -> FloatArray:
        high = _CHARGE + np.maximum(at.pressure, -0.9 * _CHARGE)
        modulus, rise = 1.3e9, 10.0
        liquid = np.log((modulus + rise * high) / (modulus + rise * _CHARGE)) / rise
        gas = (_ATMOSPHERE / _CHARGE) ** (1 / 1.3) * (
            1.0 - (_CHARGE / high) ** (1 / 1.3)
        )
        shrinkage = liquid + self.air * gas
        pump = self.dead_volume + 0.5 * (1.0 + at.stroke)
        pump_flow = at.pump_displacement * at.pump_speed * pump
        # A unit that pumps compresses its whole chamber, one that motors its dead volume only.
        pumping = 0.5 * (1.0 - np.tanh(at.motor_speed / 5.0))
        motor = self.dead_volume + pumping
        motor_flow = at.motor_displacement * np.abs(at.motor_speed) * motor
        return np.asarray(self.size * shrinkage * (pump_flow + motor_flow))


@dataclass(frozen=True)
class PortPressureDrop(Effect):
    """Pressure lost in ports and lines, dp ~ Q^m nu^(2 - m).

    1 is laminar, 1.75 smooth-pipe turbulence (Blasius), 2 that of sharp edges.
    """

    exponent: float = between(1.0, 2.0)

    def pressure_drop(self, at: Conditions) -> FloatArray:
        flow = at.pump_displacement * at.pump_speed * at.stroke / 2e-3
        smooth = np.sqrt(flow * flow + 1e-4)
        return np.asarray(
            self.size
            * 3e5
            * flow
            * smooth ** (self.exponent - 1.0)
            * at.film_viscosity ** (2.0 - self.exponent)
        )


@dataclass(frozen=True)
class DisplacementError(Effect):
    """The swash plate does not take the stroke commanded.

    `offset` also droops with loop pressure (compliant servo piston); `gain` is a scale error of
    the feedback; `dead_band` is the overlap of the servo valve, rounded by its clearance;
    `hysteresis` is play of the linkage, taken up as the swash moment grows with loop pressure (a
    bench of a tractor transmission showed one: 10.1177/1687814016676943). `sense` +1 lowers it.
    """

    variants: ClassVar[tuple[str, ...]] = ("offset", "gain", "dead_band", "hysteresis")
    limit: ClassVar[float] = 1.0
    sense: float = either_sign()
    turning_pressure: float = between(3e6, 15e6)

    def true_stroke(self, command: FloatArray, pressure: FloatArray) -> FloatArray:
        if self.variant == "offset":
            droop = 1.0 + 0.15 * np.clip(pressure / 1e7, -3.0, 3.0)
            return np.asarray(command - self.sense * 0.06 * self.size * droop)
        if self.variant == "gain":
            return np.asarray(command * (1.0 - self.sense * 0.08 * self.size))
        if self.variant == "hysteresis":
            side = np.tanh(pressure / self.turning_pressure)
            return np.asarray(command - self.sense * 0.05 * self.size * side)
        band = 0.12 * self.size + 1e-9
        width = 0.2 * band
        above = width * np.logaddexp(0.0, (command - band) / width)
        below = width * np.logaddexp(0.0, (-command - band) / width)
        return np.asarray(above - below)


def relative_viscosity(temperature: FloatArray, slope: float = 1.0) -> FloatArray:
    """Kinematic viscosity over that at 60 deg C; shape as `temperature` (deg C).

    Walther's equation (ASTM D341): lg lg(nu + 0.7) falls linearly with lg T, `slope` times as fast.
    """
    nominal = NOMINAL_TEMPERATURE + 273.15
    level = _COOL - _STEEPNESS * np.log10(nominal / 313.15)
    drop = slope * _STEEPNESS * np.log10((temperature + 273.15) / nominal)
    return np.asarray((10.0**10.0 ** (level - drop) - 0.7) / (10.0**10.0**level - 0.7))


@dataclass(frozen=True)
class OilTemperature(Effect):
    """Viscosity follows the oil's temperature in gaps and in films.

    Gaps carry loop oil and follow the sump fully; films are cooled by the casing and follow it
    by `film_share`. `size` scales the slope of Walther's line.
    """

    limit: ClassVar[float] = 1.5
    film_share: float = between(0.75, 0.95)

    def viscosity(self, oil_temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        film = NOMINAL_TEMPERATURE + self.film_share * (
            oil_temperature - NOMINAL_TEMPERATURE
        )
        return relative_viscosity(oil_temperature, self.size), relative_viscosity(
            film, self.size
        )
