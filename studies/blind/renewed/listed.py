# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that the library names, in forms of the literature that it does not have.

Size 1 costs about one point of efficiency at the middle of the range. Drags of oil follow the
temperature of the day by Vogel's equation, where their source says so.
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
    drawn,
    either_sign,
    pumping,
)

#: Vogel's equation of a tractor oil (UTTO, 10W-30): ln mu = a + b / (T + c), T in deg C.
_VOGEL_B = 950.0
_VOGEL_C = 105.0
_NOMINAL_TEMPERATURE = 60.0
_NOMINAL_VISCOSITY = 0.028  # Pa s at the nominal temperature


def relative_viscosity(oil_temperature: FloatArray) -> FloatArray:
    """Return the viscosity against that at 60 deg C [-].

    Args:
        oil_temperature: [deg C].
    """
    warm = _VOGEL_B / (oil_temperature + _VOGEL_C)
    return np.asarray(np.exp(warm - _VOGEL_B / (_NOMINAL_TEMPERATURE + _VOGEL_C)))


def thickness(at: Conditions) -> FloatArray:
    """Return the relative viscosity at the temperature of each test [-]."""
    if isinstance(at, BenchConditions):
        return relative_viscosity(at.oil_temperature)
    return np.ones_like(at.pressure)


def softplus(excess: FloatArray, width: float) -> FloatArray:
    """Return the excess above zero, rounded over a width."""
    return np.asarray(width * np.logaddexp(0.0, excess / width))


@dataclass(frozen=True)
class OwnForm(Effect):
    """An effect that the library names, in a form of its own."""


# --- torques without load ---------------------------------------------------------------------


@dataclass(frozen=True)
class ChargePump(OwnForm):
    """Torque of a gear pump against a relief valve with an override, by Wilson's model.

    T = V p(w) + C_v mu w V + C_f p V. Wilson 1950, Positive-displacement pumps and fluid motors.
    """

    limit: ClassVar[float] = 8.0
    override: float = between(0.05, 0.35)
    viscous: float = between(0.05, 0.3)

    def pump_drag(self, at: Conditions) -> FloatArray:
        pace = np.abs(at.pump_speed) / 230.0
        pressure = 1.0 + self.override * (pace - 1.0)
        torque = pressure + self.viscous * pace * thickness(at)
        return np.asarray(4.0 * self.size * torque)


@dataclass(frozen=True)
class BearingDrag(OwnForm):
    """Tapered roller bearings: M ~ sqrt(mu n) x load^(1/3), on a preload.

    Witte 1973, Operating torque of tapered roller bearings, ASLE Trans. 16, 61.
    """

    preload: float = between(0.2, 1.0)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        rolling = np.sqrt(thickness(at) * at.engine_speed / 150.0)
        load = np.cbrt((self.preload + at.load_torque / 250.0) / (1.0 + self.preload))
        return np.asarray(3.0 * self.size * rolling * load * at.engine_speed)


@dataclass(frozen=True)
class Churning(OwnForm):
    """Churning of engine-side gears: by ISO/TR 14179-1, or with Reynolds and Froude numbers.

    `iso`: P ~ mu n^3 (ISO/TR 14179-1:2001, 8). `froude`: drag coefficient ~ Fr^-0.6 Re^-0.21 below
    a critical speed and ~ Fr^-0.6 above it, so P ~ n^1.59 and n^1.8 (Changenet & Velex 2007, J.
    Mech. Des. 129, 128).
    """

    variants: ClassVar[tuple[str, ...]] = ("iso", "froude")
    critical: float = between(110.0, 200.0)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        power = _churned(self.variant, at.engine_speed / 150.0, self.critical / 150.0)
        exponent = 1.0 if self.variant == "iso" else 0.21
        return np.asarray(800.0 * self.size * power * thickness(at) ** exponent)


@dataclass(frozen=True)
class OutputChurning(OwnForm):
    """The same at the output shaft."""

    variants: ClassVar[tuple[str, ...]] = ("iso", "froude")
    critical: float = between(80.0, 220.0)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        power = _churned(self.variant, at.output_speed / 150.0, self.critical / 150.0)
        exponent = 1.0 if self.variant == "iso" else 0.21
        return np.asarray(700.0 * self.size * power * thickness(at) ** exponent)


def _churned(variant: str, pace: FloatArray, critical: float) -> FloatArray:
    """Return the power of churning against that at the reference speed."""
    if variant == "iso":
        return np.asarray(pace**3)
    slow = pace**1.59
    fast = critical ** (1.59 - 1.8) * pace**1.8
    beyond = 1.0 / (1.0 + (critical / np.maximum(pace, 1e-3)) ** 8)
    return np.asarray(slow + (fast - slow) * beyond)


@dataclass(frozen=True)
class ClutchDrag(OwnForm):
    """An open wet clutch: a full film up to a slip, then one that shrinks as slip^-m.

    Kitabayashi, Li & Hiraki 2003, SAE 2003-01-0973; rise again by contact: Pan & Zhou 2019.
    """

    shrinking: float = between(0.4, 1.8)
    full_film: float = between(50.0, 180.0)
    contact: float = between(0.0, 0.4)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        slip = at.output_speed / self.full_film
        film = slip / (1.0 + slip ** (4.0 * (1.0 + self.shrinking))) ** 0.25
        rise = self.contact * np.maximum(slip - 1.5, 0.0) ** 2
        torque = 8.0 * (film * thickness(at) + rise)
        return np.asarray(self.size * torque * at.output_speed)


@dataclass(frozen=True)
class BrakeDrag(OwnForm):
    """A brake that does not free: dry friction that fades exponentially with the speed.

    Bo & Pavelescu 1982, The friction-speed relation, Wear 82, 277.
    """

    fading: float = between(15.0, 80.0)
    static: float = between(0.1, 0.6)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        torque = 1.0 + self.static * np.exp(-np.sqrt(at.output_speed / self.fading))
        return np.asarray(6.0 * self.size * torque * at.output_speed)


@dataclass(frozen=True)
class FanDrive(OwnForm):
    """A fan on a silicone coupling, driven the harder the warmer the oil: power ~ slip x speed^2.

    Viscous couplings: Bosch Automotive Handbook, engine cooling.
    """

    engage: float = between(-3.0, 6.0)
    width: float = between(3.0, 10.0)
    idle: float = between(0.05, 0.25)
    mean_temperature: float = 60.0

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        if not isinstance(at, BenchConditions):
            return np.zeros_like(at.pressure)
        over = at.oil_temperature - self.mean_temperature - self.engage
        speed = self.idle + (1.0 - self.idle) / (1.0 + np.exp(-over / self.width))
        # The coupling turns the engine's full speed into that of the fan.
        return np.asarray(
            1200.0 * self.size * speed**2 * (at.engine_speed / 150.0) ** 3
        )


# --- losses with load -------------------------------------------------------------------------


@dataclass(frozen=True)
class GearMesh(OwnForm):
    """A friction coefficient by the logarithm of load over speed cubed, and a rolling loss.

    Benedict & Kelley 1961, ASLE Trans. 4, 59: mu ~ log10(C w / (mu v_s v_r^2)); rolling: Anderson &
    Loewenthal 1980, NASA TP-1622.
    """

    limit: ClassVar[float] = 8.0
    level: float = between(1.2, 2.4)
    rolling: float = between(0.0, 0.3)

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        share = _benedict_kelley(torque, speed, self.level)
        rolling = self.rolling * np.abs(speed) / (np.abs(torque) + 60.0)
        loss = 0.004 * self.size * (share + rolling)
        return np.asarray(np.clip(loss, -0.015, 0.2))


@dataclass(frozen=True)
class PlanetaryMesh(OwnForm):
    """The same friction coefficient in the meshes of the planetary row."""

    limit: ClassVar[float] = 8.0
    level: float = between(1.2, 2.4)

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        share = _benedict_kelley(ring_torque, rolling_speed, self.level)
        return np.asarray(np.clip(0.015 * self.size * share, -0.015, 0.5))


def _benedict_kelley(torque: FloatArray, speed: FloatArray, level: float) -> FloatArray:
    """Return the friction coefficient against that at 250 N m and 150 rad/s."""
    load = (np.abs(torque) + 20.0) / 270.0
    pace = (np.abs(speed) + 20.0) / 170.0
    return np.asarray(np.maximum(1.0 + np.log10(load / pace**3) / level, 0.1))


@dataclass(frozen=True)
class PressureFriction(OwnForm):
    """Friction of the units in a mixed film, by the Hersey number mu w / p.

    Stribeck 1902; Hersey 1914; in axial piston units: Jeong 2007, J. Mech. Sci. Technol. 21, 83.
    """

    mixed: float = between(0.3, 1.5)
    hersey: float = between(0.1, 0.6)

    def _rubbing(
        self, speed: FloatArray, at: Conditions, displacement: float
    ) -> FloatArray:
        pressure = np.abs(at.pressure) / 20e6
        number = thickness(at) * np.abs(speed) / 150.0 / np.maximum(pressure, 0.02)
        part = 1.0 + self.mixed / (1.0 + number / self.hersey)
        return np.asarray(0.015 * part * np.abs(at.pressure) * displacement)

    def pump_drag(self, at: Conditions) -> FloatArray:
        return self.size * self._rubbing(at.pump_speed, at, at.pump_displacement)

    def motor_drag(self, at: Conditions) -> FloatArray:
        return self.size * self._rubbing(at.motor_speed, at, at.motor_displacement)


@dataclass(frozen=True)
class PortPressureDrop(OwnForm):
    """A check valve on its spring, then a turbulent port.

    Merritt 1967, Hydraulic Control Systems, 3; Idelchik, Handbook of hydraulic resistance.
    """

    spring: float = between(0.1, 0.6)
    small_flow: float = between(0.02, 0.15)

    def pressure_drop(self, at: Conditions) -> FloatArray:
        flow = at.pump_displacement * at.pump_speed * at.stroke / 2e-3
        opening = flow / (np.abs(flow) + self.small_flow)
        port = (1.0 - self.spring) * flow * np.abs(flow)
        return np.asarray(4e5 * self.size * (self.spring * opening + port))


@dataclass(frozen=True)
class ClutchSlip(OwnForm):
    """A closed clutch that creeps as exp(torque), without any holding torque.

    Friction that rises with the logarithm of the sliding speed: Ohtani et al. 1994, JSAE Rev. 15.
    """

    limit: ClassVar[float] = 20.0
    rise: float = between(60.0, 160.0)

    def clutch_slip(self, torque: FloatArray) -> FloatArray:
        creep = np.expm1(np.minimum(torque / self.rise, 8.0))
        creep = creep / np.expm1(400.0 / self.rise)
        return np.asarray(np.minimum(3.0 * self.size * creep, 45.0))


# --- losses of flow ---------------------------------------------------------------------------


@dataclass(frozen=True)
class PressureLeakage(OwnForm):
    """A gap whose height grows linearly with pressure: flow ~ p ((1 + p / p_h)^3 - 1) / mu.

    Wieczorek & Ivantysynova 2002, Int. J. Fluid Power 3, 7.
    """

    limit: ClassVar[float] = 8.0
    stiffness: float = between(15e6, 90e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        opening = (1.0 + np.abs(at.pressure) / self.stiffness) ** 3 - 1.0
        scale = (1.0 + 20e6 / self.stiffness) ** 3 - 1.0
        laminar = at.leakage * at.pressure / thickness(at)
        return np.asarray(1.3 * self.size * laminar * opening / scale)


@dataclass(frozen=True)
class OrificeLeakage(OwnForm):
    """A short gap with an orifice in series: p = a mu q + b q^2.

    McCloy & Martin 1980, Control of Fluid Power, 2; Merritt 1967, 3.2.
    """

    laminar: float = between(0.1, 0.7)

    def lost_flow(self, at: Conditions) -> FloatArray:
        pressure = np.abs(at.pressure) / 20e6
        linear = self.laminar * thickness(at)
        square = 1.0 - self.laminar
        flow = np.sqrt(linear**2 + 4.0 * square * pressure) - linear
        flow = flow / (2.0 * square)
        return np.asarray(1.4e-4 * self.size * flow * np.sign(at.pressure))


@dataclass(frozen=True)
class StrokeLeakage(OwnForm):
    """Slippers that tip by their centrifugal moment: leakage ~ p (stroke^2 + c (stroke w)^2) / mu.

    Koc & Hooke 1996, Tribol. Int. 29, 299.
    """

    tipping: float = between(0.2, 2.0)

    def lost_flow(self, at: Conditions) -> FloatArray:
        pace = np.abs(at.pump_speed) / 230.0
        lift = at.stroke**2 * (1.0 + self.tipping * pace**2) / (1.0 + self.tipping)
        return np.asarray(
            1.2 * self.size * at.leakage * at.pressure * lift / thickness(at)
        )


@dataclass(frozen=True)
class Compressibility(OwnForm):
    """A modulus that rises with pressure, and air that dissolves up to a pressure.

    Murnaghan 1944; dissolving air: Ruan & Burton 2006, IMECE2006-13613. Dead volume at both units.
    """

    stiffening: float = between(6.0, 14.0)
    dead: float = between(0.2, 1.0)
    air: float = between(0.0, 0.02)
    dissolved: float = between(3e6, 12e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        pressure = np.abs(at.pressure)
        oil = np.log1p(self.stiffening * pressure / 1.5e9) / self.stiffening
        free = self.air * -np.expm1(-pressure / self.dissolved)
        swept = 0.5 * (1.0 + np.abs(at.stroke)) + self.dead
        volumes = at.pump_displacement * np.abs(at.pump_speed) * swept
        volumes = volumes + at.motor_displacement * np.abs(at.motor_speed) * self.dead
        return np.asarray(self.size * (oil + free) * volumes * np.sign(at.pressure))


@dataclass(frozen=True)
class ReliefValve(OwnForm):
    """A loop valve that seeps long before it opens: flow ~ softplus of the pressure, squared.

    Static characteristic of direct-acting relief valves: Merritt 1967, 5; Maiti et al. 2002.
    """

    quantile: float = between(0.4, 0.8)
    width: float = between(5e5, 3e6)
    cracking: float = 9e6

    def lost_flow(self, at: Conditions) -> FloatArray:
        over = softplus(np.abs(at.pressure) - self.cracking, self.width)
        over = over * (1.0 + over / 2e7)
        return np.asarray(6e-11 * self.size * over * np.sign(at.pressure))


@dataclass(frozen=True)
class InletStarvation(OwnForm):
    """Filling that falls off smoothly with the speed: a logistic curve, no onset.

    Filling of axial piston pumps: Manring, Mehta, Nelson et al. 2014, JDSMC 136, 031003.
    """

    middle: float = between(230.0, 330.0)
    width: float = between(15.0, 45.0)

    def lost_flow(self, at: Conditions) -> FloatArray:
        swept = at.pump_displacement * np.abs(at.pump_speed * at.stroke)
        lacking = 1.0 / (
            1.0 + np.exp((self.middle - np.abs(at.pump_speed)) / self.width)
        )
        flow = swept * lacking * pumping(at) * np.sign(at.pressure)
        return np.asarray(0.1 * self.size * flow)


# --- stroke, oil, meters ----------------------------------------------------------------------


@dataclass(frozen=True)
class DisplacementError(OwnForm):
    """A plate that yields to the pressure in proportion, or stands off with a bent scale.

    Mandal, Saha & Sanyal 2008, Simul. Model. Pract. Theory 16, 1487; Achten 2013, FPMC.
    """

    variants: ClassVar[tuple[str, ...]] = ("yielding", "standing_off", "bent_scale")
    limit: ClassVar[float] = 1.0
    sense: float = either_sign()
    bend: float = between(-0.5, 0.5)

    def true_stroke(self, command: FloatArray, pressure: FloatArray) -> FloatArray:
        if self.variant == "yielding":
            error = 0.06 * np.abs(pressure) / 20e6
            return np.asarray(
                command - self.sense * self.size * error * np.sign(command)
            )
        if self.variant == "standing_off":
            error = 0.05 * (1.0 + self.bend * command**2)
            return np.asarray(command - self.sense * self.size * error)
        error = 0.08 * (1.0 + self.bend * command**2)
        return np.asarray(command * (1.0 - self.sense * self.size * error))


@dataclass(frozen=True)
class OilTemperature(OwnForm):
    """Viscosity by Vogel in gaps; films shear-heated, so that they follow it in part."""

    limit: ClassVar[float] = 1.6
    film_part: float = between(0.5, 0.9)

    def viscosity(self, oil_temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        gap = relative_viscosity(oil_temperature) ** self.size
        return gap, gap**self.film_part


@dataclass(frozen=True)
class TorqueSensor(OwnForm):
    """A meter with a zero, or a gain with a linearity error of a tenth of it."""

    variants: ClassVar[tuple[str, ...]] = (
        "engine_zero",
        "engine_gain",
        "output_zero",
        "output_gain",
    )
    limit: ClassVar[float] = 12.0
    sense: float = either_sign()
    linearity: float = drawn(0.0, lambda rng: float(rng.uniform(-0.1, 0.1)))

    def read(
        self, engine_torque: FloatArray, output_torque: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        meter, _, error = self.variant.partition("_")
        torque = engine_torque if meter == "engine" else output_torque
        if error == "zero":
            shown = torque + 2.0 * self.sense * self.size
        else:
            bent = 1.0 + self.linearity * np.abs(torque) / 500.0
            shown = torque * (1.0 + 0.01 * self.sense * self.size * bent)
        if meter == "engine":
            return shown, output_torque
        return engine_torque, shown


OWN_FORMS = {kind.name: kind for kind in OwnForm.__subclasses__()}
