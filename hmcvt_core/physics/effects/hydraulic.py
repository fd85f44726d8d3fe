# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects inside the pump-motor pair: leakage, friction, ports, and its oil.

Those that are `unit_only` the bench of a transmission shows under other names.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .base import (
    PRESSURE_REFERENCE,
    Array,
    Effect,
    ShaftState,
    Value,
    ramp,
    shape,
    size,
)

_REVERSAL = 2.0  # rad/s, over which a unit turns from motor to pump
_PRESSURE_REVERSAL = 5e5  # Pa, over which pump and motor change their parts
_ATMOSPHERE, _CHARGE = 1.013e5, 2e6  # Pa; the second a usual one of closed circuits
_BULK = 1e9  # Pa, so that compressibility comes in 1/GPa
REFERENCE_TEMPERATURE = 60.0  # deg C, viscosity ratio 1
_KELVIN = 273.15
_VG46 = (46.0, 6.8)  # mm2/s at 40 and 100 deg C


@dataclass(frozen=True)
class _LeakOfOil(Effect):
    """A leakage through gaps, as the viscosity of a logged oil makes it."""

    needs_oil_temperature = True
    assumes_oil_temperature = True

    oil_exponent: float = shape(
        "-", (1.0,), "power of viscosity in the leakage", limits=(0.0, 1.0)
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        # Its own viscosity takes the place of that of `oil_temperature`.
        flow = super().leakage_flow(state) * state.viscosity_ratio
        return flow / oil_factor(state, self.oil_exponent)


@dataclass(frozen=True)
class PressureLeakage(Effect):
    """q = c dp (|dp| / 20 MPa)^m / mu: gaps that open with pressure leak faster than linearly."""

    name = "pressure_leakage"
    component = "pump"
    summary = "gaps open under pressure: at high load more flow leaks than the base model expects"
    source = "Ivantysyn & Ivantysynova, Hydrostatic Pumps and Motors: gap flow ~ h^3 dp"
    remedy = "measure the output speed at full load"

    leakage: float = size("m3/(s Pa)", 1.5e-11, 0.0, 3e-10, "further leakage at 20 MPa")
    exponent: float = shape(
        "-", (0.5, 1.0, 2.0), "power of pressure in the further leakage"
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        opening = (np.abs(state.pressure) / PRESSURE_REFERENCE) ** self.exponent
        return self.leakage / state.viscosity_ratio * state.pressure * opening


@dataclass(frozen=True)
class PistonLeakage(PressureLeakage):
    """q = c dp e^2 / mu: pistons pressed aside leak up to 2.5 times as much, 1 + 1.5 e^2.

    The side force on a piston is that of its pressure times the tilt of the swash plate, and the
    eccentricity e follows: dp |eps| in the pump, dp in the motor, whose plate does not move.
    """

    form = "tilted pistons"
    summary = "pistons pressed aside open their gaps: leakage grows with pressure cubed and stroke"
    source = "eccentric annular gap: Ivantysyn & Ivantysynova; Manring 2013"
    remedy = "measure the output speed at one pressure and two strokes"

    exponent: float = shape("-", (2.0,), "power of pressure in the further leakage")
    motor_part: float = shape(
        "-", (0.0, 1.0), "1 if the motor's pistons leak too, 0 if not", between=False
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        return super().leakage_flow(state) * (
            state.displacement_ratio**2 + self.motor_part
        )


@dataclass(frozen=True)
class ViscousPressureLeakage(_LeakOfOil, PressureLeakage):
    """q = c dp (|dp| / 20 MPa)^m / mu^n: gaps that open with pressure leak more of a warm oil."""

    form = "with the oil"
    source = "flow through a gap ~ 1 / viscosity: Merritt 1967, 3.2; Ivantysyn & Ivantysynova"
    remedy = "measure the output speed at one pressure with cold and warm oil"


@dataclass(frozen=True)
class OrificeLeakage(Effect):
    """q = k sqrt(dp): short sharp gaps (valve plate) leak without viscosity."""

    name = "orifice_leakage"
    component = "pump"
    summary = "sharp-edged gaps leak with the root of pressure, whatever the viscosity"
    source = "Bernoulli orifice; valve plate notches in Ivantysyn & Ivantysynova"
    remedy = "measure the output speed at low load"

    flow: float = size("m3/s", 1.5e-4, 0.0, 2e-3, "flow lost at 20 MPa")

    def leakage_flow(self, state: ShaftState) -> Value:
        root = np.sqrt(np.abs(state.pressure) / PRESSURE_REFERENCE)
        return self.flow * np.sign(state.pressure) * root


@dataclass(frozen=True)
class StrokeLeakage(Effect):
    """q = c dp |eps|^m / mu: slippers and cylinder block leak more as the swash plate tilts."""

    name = "stroke_leakage"
    component = "pump"
    summary = "leakage grows with the pump's stroke"
    source = "Jeong 2007; McCandlish & Dorey 1984"
    remedy = "measure the output speed at the same pressure and different strokes"

    leakage: float = size(
        "m3/(s Pa)", 1.5e-11, 0.0, 3e-10, "further leakage at full stroke"
    )
    exponent: float = shape("-", (1.0, 2.0), "power of the displacement ratio")

    def leakage_flow(self, state: ShaftState) -> Value:
        tilt = np.abs(state.displacement_ratio) ** self.exponent
        return self.leakage / state.viscosity_ratio * state.pressure * tilt


@dataclass(frozen=True)
class ViscousStrokeLeakage(_LeakOfOil, StrokeLeakage):
    """q = c dp |eps|^m / mu^n: gaps that open with the stroke leak more of a warm oil."""

    form = "with the oil"
    source = "flow through a gap ~ 1 / viscosity: Merritt 1967, 3.2"
    remedy = (
        "measure the output speed at one pressure and stroke with cold and warm oil"
    )


@dataclass(frozen=True)
class ReliefValve(Effect):
    """q = c (|dp| - p_crack) above p_crack, none below: a relief valve that opens too early.

    Each line of a closed circuit has one, so the flow has the sense of the pressure, also in
    overrun. Where no test exceeds the cracking pressure, the effect is invisible. A worn seat, or a
    pressure that pulses (by some 10 % in piston pumps), rounds the onset off within `width` on
    either side.
    """

    name = "relief_valve"
    component = "pump"
    summary = "a relief valve opens too early: oil escapes above a certain pressure, none below"
    source = (
        "opening in proportion to the pressure above the setting: Simscape Fluids, Pressure "
        "Relief Valve; one on each high-pressure port: Bosch Rexroth, RA 92003; pressure ripple: "
        "Ivantysyn & Ivantysynova"
    )
    remedy = "measure the flow in the return line of the valve at full load"

    leak: float = size("m3/(s Pa)", 5e-11, 0.0, 1e-9, "flow for each Pa above cracking")
    cracking: float = shape(
        "MPa",
        (4.0, 6.0, 9.0, 13.0, 19.0, 28.0, 42.0),
        "pressure at which the valve opens",
    )
    width: float = shape(
        "MPa", (0.5,), "half width of the onset of its flow", limits=(0.1, 3.0)
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        excess = np.abs(state.pressure) - 1e6 * self.cracking
        above = ramp(excess, 1e6 * self.width)
        return self.leak * np.sign(state.pressure) * above


@dataclass(frozen=True)
class InletStarvation(Effect):
    """q = x V |eps|^(1-m) (w |eps|^m - w_full) above w_full: cylinders that pump do not fill.

    The unit that pumps is the pump under pull, and the motor (eps = 1) where it drives the pump.
    What its cylinders lack flows back into them from the high-pressure line, so that the torque
    stays and the lost flow costs pressure times flow. At x = 1 the flow grows no more with speed.
    Cylinders cease to fill over a range of speeds, as oil gives off its air before it cavitates and
    their inlet pressures differ: the onset is rounded off within `width` on either side.
    """

    name = "inlet_starvation"
    component = "pump"
    summary = (
        "the inlet does not fill the pump at high speed: above a certain speed part of the "
        "flow is missing"
    )
    source = (
        "filling limit of axial piston pumps, which boost pressure raises: Harris, Edge & "
        "Tilley 1994, J. Dyn. Syst. Meas. Control 116, 281; air given off before cavitation: "
        "Merritt 1967, 2.2"
    )
    remedy = "measure the charge pressure at high speed, or raise it and repeat a test"

    deficit: float = size(
        "-", 0.2, 0.0, 1.0, "part of the flow above the limit that is missing"
    )
    full_speed: float = shape(
        "rad/s", (120.0, 170.0, 240.0, 340.0), "speed up to which cylinders fill"
    )
    stroke_exponent: float = shape(
        "-",
        (0.0, 1.0),
        "1 if the limit is one of flow, 0 if one of speed",
        between=False,
    )
    motor_part: float = shape(
        "-",
        (0.0, 1.0),
        "1 if the motor starves too where it pumps, 0 if not",
        between=False,
    )
    width: float = shape("rad/s", (5.0,), "half width of the onset", limits=(2.0, 80.0))

    def leakage_flow(self, state: ShaftState) -> Value:
        sense = np.tanh(state.pressure / _PRESSURE_REVERSAL)
        delivered_sense = np.sign(state.displacement_ratio * state.pump_speed)
        # A unit pumps where its flow has the sense in which pressure rises over it.
        pump_gives = np.maximum(sense * delivered_sense, 0.0)
        motor_gives = np.maximum(-sense * np.sign(state.motor_speed), 0.0)
        missing = pump_gives * self._missing_of_pump(state)
        of_motor = motor_gives * self._excess(np.abs(state.motor_speed))
        missing = missing + self.motor_part * of_motor
        flow = self.deficit * state.displacement * missing
        return np.asarray(np.sign(state.pressure) * flow)

    def _missing_of_pump(self, state: ShaftState) -> Array:
        """Flow of the pump above what its inlet fills / displacement [rad/s]."""
        stroke = np.abs(state.displacement_ratio)
        demand = np.abs(state.pump_speed) * stroke**self.stroke_exponent
        return np.asarray(stroke ** (1.0 - self.stroke_exponent) * self._excess(demand))

    def _excess(self, speed: Array) -> Array:
        return ramp(speed - self.full_speed, self.width)


@dataclass(frozen=True)
class SlowLeakage(Effect):
    """q = c dp / (1 + w / w_s): leakage that falls as the unit turns faster."""

    unit_only = True
    name = "slow_leakage"
    component = "pump"
    summary = "a slow unit leaks more: films that centre its parts have not built up"
    source = "Dorey 1988: slip coefficient as a power of pressure and speed"
    remedy = "measure the flow at one pressure and several low speeds"

    leakage: float = size(
        "m3/(s Pa)", 5e-12, 0.0, 3e-10, "further leakage at standstill"
    )
    fade_speed: float = shape(
        "rad/s", (5.0, 20.0, 80.0), "speed at which half of it is left"
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        speed = np.maximum(np.abs(state.pump_speed), np.abs(state.motor_speed))
        return self.leakage / state.viscosity_ratio * state.pressure * self._part(speed)

    def _part(self, speed: Array) -> Array:
        """Leakage at a speed / `leakage`."""
        return 1.0 / (1.0 + speed / self.fade_speed)


@dataclass(frozen=True)
class SlowLeakagePower(SlowLeakage):
    """q = c dp (w_0 / w)^m, w_0 = 100 rad/s; no more than at the speed where films are gone."""

    form = "power of speed"

    leakage: float = size(
        "m3/(s Pa)", 1e-12, 0.0, 6e-11, "further leakage at 100 rad/s"
    )
    fade_speed: float = shape("rad/s", (5.0,), "speed below which it grows no more")
    exponent: float = shape("-", (0.5, 1.0, 2.0), "falling power of the speed")

    def _part(self, speed: Array) -> Array:
        return np.asarray((100.0 / np.maximum(speed, self.fade_speed)) ** self.exponent)


@dataclass(frozen=True)
class Compressibility(Effect):
    """q = dp (1/beta) sum of V w (V_r + swept part): oil squeezed on every stroke is flow lost.

    A cylinder under compression holds the dead volume and the part of the stroke still to be swept:
    (1 + eps) / 2 in the pump, over centre too (McCandlish & Dorey); in the motor the whole stroke
    while it pumps and none while it motors. `softening` lets the bulk modulus fall at low pressure,
    as free air does.
    """

    name = "compressibility"
    component = "oil"
    summary = "oil is squeezed on every stroke: flow is lost in proportion to pressure times speed"
    source = "McCandlish & Dorey 1984; dead volume: Energies 2022, 15, 298"
    remedy = "measure the output speed at one pressure and two engine speeds"

    compliance: float = size("1/GPa", 1.5, 0.0, 20.0, "1 / effective bulk modulus")
    dead_volume: float = shape(
        "-", (0.1, 0.5, 2.0), "dead volume / volume of a full stroke"
    )
    motor_part: float = shape(
        "-", (0.0, 1.0), "1 if the motor squeezes oil too, 0 if not", between=False
    )
    softening: float = shape(
        "MPa", (0.0, 5.0), "pressure below which the oil is softer"
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        pump = (
            self.dead_volume + self._swept(state.displacement_ratio)
        ) * state.pump_speed
        pumping = 0.5 * (1.0 - np.tanh(state.motor_speed / _REVERSAL))
        motor = (self.dead_volume + pumping) * np.abs(state.motor_speed)
        squeezed = self.compliance / _BULK * self._squeezed(state.pressure)
        return squeezed * state.displacement * (pump + self.motor_part * motor)

    def _squeezed(self, pressure: Array) -> Array:
        """Pressure that squeezes oil without air as much."""
        level = self.softening * 1e6
        return (
            pressure * (1.0 + level / (np.abs(pressure) + level))
            if level > 0.0
            else pressure
        )

    def _swept(self, displacement_ratio: Array) -> Array:
        return (1.0 + displacement_ratio) / 2.0


class CompressibilityStroke(Compressibility):
    """As `Compressibility`, with a swept part that grows with the stroke on either side."""

    form = "stroke either way"

    def _swept(self, displacement_ratio: Array) -> Array:
        return super()._swept(np.abs(displacement_ratio))


@dataclass(frozen=True)
class CompressibilityAir(Compressibility):
    """As `Compressibility`, with bubbles of air in the oil, squeezed adiabatically.

    Of the air a at 1 atm, a (p_0/p)^(1/1.4) is left at p; what has gone by the charge pressure
    costs no flow.
    """

    form = "entrained air"
    source = (
        "Merritt 1967, Hydraulic Control Systems, 2.2; Int. J. Fluid Power 13 (2012) 7"
    )

    softening: float = shape("MPa", (0.0,), "pressure below which the oil is softer")
    air: float = shape(
        "%", (1.0, 10.0), "free air / oil whose own bulk modulus is 1.5 GPa, at 1 atm"
    )

    def _squeezed(self, pressure: Array) -> Array:
        left = (
            _ATMOSPHERE / (_CHARGE + np.array([0.0 * pressure, np.abs(pressure)]))
        ) ** (1 / 1.4)
        return pressure + 1.5e7 * self.air * np.sign(pressure) * (left[0] - left[1])


@dataclass(frozen=True)
class CompressionWork(Compressibility):
    r"""As `Compressibility`, the work of compression returned to the shaft of a pump.

    Pistons that compress what they hold before it meets the port, and let the dead volume push them
    back, take the torque :math:`V dp (1 - (dp/\beta)(V_0/V + 1/2))` instead of V dp: the mechanical
    efficiency by ISO 4409 looks too good at high pressure, and may pass 100 %.
    """

    unit_only = True
    form = "work returned"
    summary = (
        "oil is squeezed on every stroke: flow is lost in proportion to pressure times "
        "speed, and part of the work comes back as torque"
    )
    source = "Achten et al., FPMC2019: ISO 4409 and the bulk modulus"

    motor_part: float = shape("-", (0.0,), "1 if the motor squeezes oil too, 0 if not")
    softening: float = shape("MPa", (0.0,), "pressure below which the oil is softer")

    def pump_drag(self, state: ShaftState) -> Value:
        # No dead angle compresses anything without a stroke.
        pumping = np.maximum(state.displacement_ratio * np.sign(state.pressure), 0.0)
        part = state.pressure**2 * self.compliance / 1e9 * (self.dead_volume + 0.5)
        return -part * pumping * state.displacement


@dataclass(frozen=True)
class PressureFrictionStroke(Effect):
    """c dp V with c other than 0.01, in the pump in proportion to stroke as eq. (15) has it."""

    name = "pressure_friction"
    form = "at the stroke"
    component = "pump"
    summary = "parts pressed together rub: friction torque grows with pressure"
    source = "eqs (14), (15) with other c_fm, c_fp"
    remedy = "measure the loop pressure"
    with_stroke: ClassVar[bool] = True

    coefficient: float = size(
        "-", 0.02, 0.0, 0.15, "further friction torque / pressure torque"
    )

    def pump_drag(self, state: ShaftState) -> Value:
        ratio = state.displacement_ratio if self.with_stroke else 1.0
        return self._rubbing(state.pressure * ratio, state.pump_speed, state)

    def motor_drag(self, state: ShaftState) -> Value:
        return self._rubbing(state.pressure, state.motor_speed, state)

    def _rubbing(self, pressure: Array, speed: Array, state: ShaftState) -> Value:
        return (
            self.coefficient * self._part(speed) * np.abs(pressure) * state.displacement
        )

    def _part(self, speed: Array) -> Value:
        """Friction at a speed / `coefficient`."""
        return 1.0


class PressureFrictionFull(PressureFrictionStroke):
    """c dp V at full displacement in pump and motor: it does not vanish at eps = 0."""

    form = "at full stroke"
    summary = (
        "parts pressed together rub: friction torque grows with pressure, in the pump also "
        "at no stroke"
    )
    source = "McCandlish & Dorey 1984: C_f dp D_max"
    with_stroke = False


@dataclass(frozen=True)
class PressureFrictionStribeck(PressureFrictionStroke):
    """c dp V exp(-|w| / w_s): mixed friction that fades as a film builds up with speed."""

    form = "Stribeck"
    component = "motor"
    summary = (
        "at low motor speed the oil film is thin and friction under pressure is high"
    )
    source = "Stribeck curve; mixed film at low speed: SAE 2012-01-2041"
    remedy = "measure the loop pressure near motor standstill"
    with_stroke = False

    coefficient: float = size(
        "-", 0.06, 0.0, 0.4, "friction torque / pressure torque at rest"
    )
    fade_speed: float = shape(
        "rad/s", (15.0, 40.0, 100.0), "speed at which the film builds up"
    )

    def _part(self, speed: Array) -> Array:
        return np.exp(-np.abs(speed) / self.fade_speed)


@dataclass(frozen=True)
class CoulombStribeck(PressureFrictionStroke):
    """c dp V (1 + r exp(-|w| / w_s)): friction that falls to a rest as the film builds up."""

    unit_only = True
    form = "Coulomb and Stribeck"
    summary = "parts pressed together rub, at low speed more: friction falls with speed to a rest"
    source = "Stribeck curve; mixed film at low speed: SAE 2012-01-2041"

    rise: float = shape(
        "-", (1.0, 4.0), "friction at standstill / friction at speed - 1"
    )
    fade_speed: float = shape(
        "rad/s", (15.0, 40.0, 100.0), "speed at which the film builds up"
    )

    def _part(self, speed: Array) -> Array:
        return np.asarray(1.0 + self.rise * np.exp(-np.abs(speed) / self.fade_speed))


class CoulombStribeckFull(CoulombStribeck):
    """The same at full displacement in pump and motor."""

    unit_only = False
    form = "Coulomb and Stribeck at full stroke"
    with_stroke = False


@dataclass(frozen=True)
class PortPressureDrop(Effect):
    """dp = k Q |Q|^(m - 1) mu^(2 - m): what lines and ports between pump and motor take.

    Q lies between the flow of the pump, where only the motor leaks, and that of the motor, where
    only the pump does; either leaks as at the pressure of the motor, eq. (13).
    """

    name = "port_pressure_drop"
    component = "motor"
    summary = "ports and lines between pump and motor take pressure: the loss grows as speed cubed"
    source = (
        "laminar (m = 1), Blasius (1.75) to rough (2) lines; Ivantysyn & Ivantysynova"
    )
    remedy = "measure the pressure at the pump and at the motor"

    drop: float = size(
        "Pa", 3e5, 0.0, 5e6, "pressure drop at the flow of a motor at 200 rad/s"
    )
    exponent: float = shape("-", (1.0, 1.75, 2.0), "power of the flow")
    leaking_before: float = shape(
        "-", (0.0, 1.0), "part of the leakage off before the lines"
    )

    def pressure_drop(self, state: ShaftState) -> Value:
        delivered = state.delivered_speed
        x = (delivered + self.leaking_before * (state.motor_speed - delivered)) / 200.0
        return (
            self.drop
            * np.sign(x)
            * np.abs(x) ** self.exponent
            * state.viscosity_ratio ** (2.0 - self.exponent)
        )


def oil_factor(state: ShaftState, exponent: float) -> Value:
    """(viscosity / viscosity at 60 deg C)^exponent [-]; 1 where no oil temperature is known."""
    if state.oil_temperature is None:
        return 1.0
    viscosity = walther_log_viscosity(state.oil_temperature)
    at_reference = walther_log_viscosity(np.array(REFERENCE_TEMPERATURE))
    return np.asarray(np.exp(exponent * (viscosity - at_reference)))


def walther_log_viscosity(
    oil_temperature: Array, at_40: float = _VG46[0], at_100: float = _VG46[1]
) -> Array:
    """ln of the kinematic viscosity of an oil, Walther (ASTM D341) [ln(mm2/s)].

    Args:
        oil_temperature: [deg C].
        at_40: kinematic viscosity at 40 deg C [mm2/s]; an ISO VG 46 oil unless given.
        at_100: the same at 100 deg C.
    """
    warm, hot = (np.log10(np.log10(value + 0.7)) for value in (at_40, at_100))
    slope = (warm - hot) / np.log10((100.0 + _KELVIN) / (40.0 + _KELVIN))
    level = warm + slope * np.log10(40.0 + _KELVIN)
    double = level - slope * np.log10(np.asarray(oil_temperature) + _KELVIN)
    return np.asarray(np.log(10.0 ** (10.0**double) - 0.7))


@dataclass(frozen=True)
class OilTemperature(Effect):
    """mu / mu_60 = (ratio of an oil by Walther)^strength; 1 is that oil, 0 no dependence.

    The oil is given by its viscosities at 40 and 100 deg C, as a data sheet states them. Where it
    is not known, strength and viscosity at 100 deg C stand for both numbers: between 30 and 90 deg
    C they meet the ratios of other oils (VG 15 to 220, viscosity index 95 to 210) within 0.2 %,
    strength alone within 3 %. Damping follows mu in full films (Petroff), with 2/3 of its power in
    rolling ones (Palmgren). Films are warmer than the tank by what is lost around them (Shang &
    Ivantysynova 2015, Int. J. Fluid Power 16, 35), so that damping varies from point to point in
    addition.
    """

    name = "oil_temperature"
    component = "oil"
    summary = "oil temperature changes viscosity: hot oil leaks more and damps less"
    source = "Walther / ASTM D341; Petroff 1883; Palmgren M0 ~ (nu n)^(2/3)"
    remedy = (
        "repeat a test at two oil temperatures, and compare with the oil's data sheet"
    )
    varied = ("motor_damping", "pump_damping", "damping")
    condition = f"oil at {REFERENCE_TEMPERATURE:g} deg C"

    strength: float = size("-", 1.0, 0.0, 2.5, "sensitivity / that of the oil")
    film_exponent: float = shape("-", (0.67, 1.0), "power of viscosity in the damping")
    viscosity_40: float = shape(
        "mm2/s",
        (_VG46[0],),
        "viscosity of the oil at 40 deg C",
        between=False,
        limits=(20.0, 500.0),
    )
    viscosity_100: float = shape(
        "mm2/s", (_VG46[1],), "viscosity of the oil at 100 deg C", limits=(4.0, 20.0)
    )

    def viscosity_ratio(self, oil_temperature: Array) -> Value:
        change = self._log_viscosity(oil_temperature) - self._log_viscosity(
            np.array(REFERENCE_TEMPERATURE)
        )
        return np.asarray(np.exp(self.strength * change))

    def _log_viscosity(self, oil_temperature: Array) -> Array:
        return walther_log_viscosity(
            oil_temperature, self.viscosity_40, self.viscosity_100
        )

    def film_viscosity_ratio(self, oil_temperature: Array) -> Value:
        return self.viscosity_ratio(oil_temperature) ** self.film_exponent
