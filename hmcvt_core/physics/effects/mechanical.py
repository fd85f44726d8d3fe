# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Drag on shafts whatever the load, and mesh losses beyond the assumed gear efficiency."""

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
from .hydraulic import oil_factor

_ENGINE_REFERENCE = (
    150.0  # rad/s, mid speed of the paper's engine: sizes are stated there
)
_OUTPUT_REFERENCE = 180.0  # rad/s, the same at the output of HM4
_TORQUE_REFERENCE = 250.0  # N m of a path's shaft
_UNIT_REFERENCE = 200.0  # rad/s of pump or motor


@dataclass(frozen=True)
class ChargePump(Effect):
    """T = p_c V_c / efficiency: relief pressure times charge displacement, independent of load."""

    name = "charge_pump"
    component = "pump"
    summary = (
        "the charge pump takes a nearly constant torque, so light loads lose most; the "
        "base model attributes it to pump damping"
    )
    source = (
        "charge pressure 15 to 21 bar, closed-circuit practice; T = p V / efficiency"
    )
    remedy = "measure charge pressure and flow, or the pump shaft torque"

    torque: float = size("N m", 4.0, 0.0, 25.0, "torque on the pump shaft")

    def pump_drag(self, state: ShaftState) -> Value:
        return self.torque


@dataclass(frozen=True)
class BearingDrag(Effect):
    """T ~ w^a, M0 of Palmgren: a = 0 for seals, 2/3 for lubricated bearings."""

    name = "bearing_drag"
    component = "gears"
    summary = (
        "bearings and seals on the engine side drag with a torque that is nearly "
        "independent of the load"
    )
    source = "Palmgren M0 ~ (nu n)^(2/3); SKF four-source friction model"
    remedy = "spin the transmission without load and without charge pressure"

    torque: float = size(
        "N m", 3.0, 0.0, 20.0, "drag torque on the engine shaft at 150 rad/s"
    )
    exponent: float = shape("-", (0.0, 0.67), "power of speed in the torque")

    def engine_drag(self, state: ShaftState) -> Value:
        return self.torque * (state.engine_speed / _ENGINE_REFERENCE) ** self.exponent


@dataclass(frozen=True)
class ViscousBearingDrag(BearingDrag):
    """T ~ (nu w)^(2/3), M0 of Palmgren with the viscosity of the oil; seals follow it less."""

    form = "with the oil"
    needs_oil_temperature = True
    assumes_oil_temperature = True

    exponent: float = shape(
        "-", (0.67,), "power of speed in the torque", limits=(0.0, 1.0)
    )
    oil_exponent: float = shape(
        "-", (0.67,), "power of viscosity in the torque", limits=(0.0, 1.0)
    )

    def engine_drag(self, state: ShaftState) -> Value:
        return super().engine_drag(state) * oil_factor(state, self.oil_exponent)


@dataclass(frozen=True)
class Churning(BearingDrag):
    """P = k w^n: oil churning and windage of the engine-side gears, n = 2.5 to 3.

    Windage and churning by ISO/TR 14179-1 grow with the cube of speed, windage as n = 2.8 to 2.9.
    Gears that dip into a sump throw its oil off and aerate it: the torque rho w^2 R^3 S C_m / 2 of
    Changenet & Velex 2007 (J. Mech. Des. 129, 128), C_m ~ Fr^-0.6 Re^-0.21 below Re = 6000 and ~
    Fr^-0.88 above 9000, with Fr ~ w^2 and Re ~ w, grows as w^0.59 and w^0.24 only, the power as
    n = 1.6 and 1.2. No test of speed distinguishes this from `bearing_drag`, and the damping of the
    base takes what lies between, n = 2.
    """

    name = "churning"
    summary = "engine-side gears churn oil: the loss grows with nearly the cube of engine speed"
    source = (
        "n = 3: ISO/TR 14179-1; n = 2.8 to 2.9: windage, Anderson & Loewenthal 1980 and Dawson "
        "1984; tractor DCT test: Agriculture 2023, 13, 1225"
    )
    remedy = "repeat one point at lowered oil level"

    torque: float = size(
        "N m", 6.0, 0.0, 60.0, "drag torque on the engine shaft at 150 rad/s"
    )
    exponent: float = shape("-", (1.5, 2.0), "power of speed in the torque")


@dataclass(frozen=True)
class ViscousChurning(Churning):
    """P = k w^n mu^m: the same with the viscosity of the oil.

    m = 0.21 in Changenet & Velex (C_m ~ Re^-0.21), 1 in ISO/TR 14179-1.
    """

    form = "with the oil"
    needs_oil_temperature = True
    assumes_oil_temperature = True

    oil_exponent: float = shape(
        "-", (0.21, 1.0), "power of viscosity in the torque", limits=(0.0, 1.0)
    )

    def engine_drag(self, state: ShaftState) -> Value:
        return super().engine_drag(state) * oil_factor(state, self.oil_exponent)


@dataclass(frozen=True)
class AccessoryDrive(Effect):
    """T = (P_150 / w) (w / 150 rad/s)^e: an accessory that takes nearly the same power always.

    A regulated consumer (alternator, swash plate compressor, stand-by hydraulics with load
    sensing) draws what it is asked for at any speed, e = 0; its own drag lets the power grow with
    speed. What grows in proportion to speed is a constant torque, `bearing_drag`. An alternator of
    14 V and 60 to 200 A takes 1.2 to 5 kW at an efficiency of 55 to 70 %.
    """

    name = "accessory_drive"
    component = "gears"
    summary = (
        "an accessory on the engine shaft (alternator, compressor, stand-by hydraulics) takes the "
        "same power at every speed, so low speeds and light loads lose most"
    )
    source = "P = U I / efficiency; alternators: Bosch, Automotive Handbook"
    remedy = "switch the accessory off, or take its belt off, and repeat a test at low engine speed"

    power: float = size("W", 900.0, 0.0, 10e3, "power on the engine shaft at 150 rad/s")
    exponent: float = shape(
        "-", (0.0,), "power of speed in the power", limits=(-0.2, 0.3)
    )

    def engine_drag(self, state: ShaftState) -> Value:
        speed = state.engine_speed / _ENGINE_REFERENCE
        return self.power / _ENGINE_REFERENCE * speed ** (self.exponent - 1.0)


@dataclass(frozen=True)
class FanDrive(Effect):
    """T = T_150 (w / 150 rad/s)^2 s, s = 0 below a temperature of the oil, 1 a band above it.

    A narrow band is a switched drive, a wide one a proportional one, as of a viscous clutch, whose
    bimetal rounds both ends off. A fan that always runs is `churning`. Without an oil temperature
    the fan is off.
    """

    name = "fan_drive"
    component = "gears"
    needs_oil_temperature = True
    summary = (
        "a fan or auxiliary drive on the engine shaft runs when the oil is warm: the loss "
        "grows with the cube of engine speed"
    )
    source = (
        "laws of similarity of fans: torque ~ speed^2; clutch engaged by temperature: "
        "EP 0 081 311"
    )
    remedy = "repeat a test at high engine speed with the fan off"

    torque: float = size(
        "N m", 8.0, 0.0, 80.0, "torque on the engine shaft at 150 rad/s, fully on"
    )
    start: float = shape(
        "deg C", (40.0, 50.0, 60.0, 70.0, 80.0, 90.0), "oil temperature of switch-on"
    )
    band: float = shape("K", (2.0, 7.0, 20.0), "rise from switch-on to fully on")
    width: float = shape(
        "-", (0.02,), "half width of either end of the band / band", limits=(0.02, 0.6)
    )

    def engine_drag(self, state: ShaftState) -> Value:
        if state.oil_temperature is None:
            return 0.0
        rise = (state.oil_temperature - self.start) / self.band
        on = ramp(rise, self.width) - ramp(rise - 1.0, self.width)
        return self.torque * on * (state.engine_speed / _ENGINE_REFERENCE) ** 2


@dataclass(frozen=True)
class OutputChurning(Effect):
    """P = k w^n at the output shaft, n = 2.5 to 3: as `Churning` says."""

    name = "output_churning"
    component = "gears"
    summary = (
        "output-side gears churn oil: the loss grows with nearly the cube of output speed, "
        "so it rises with the displacement ratio"
    )
    source = "as of `churning`: ISO/TR 14179-1; windage of gears"
    remedy = "repeat one point at lowered oil level"

    torque: float = size(
        "N m", 3.0, 0.0, 40.0, "drag torque on the output shaft at 180 rad/s"
    )
    exponent: float = shape("-", (1.5, 2.0), "power of speed in the torque")

    def output_drag(self, state: ShaftState) -> Value:
        return self.torque * (state.output_speed / _OUTPUT_REFERENCE) ** self.exponent


@dataclass(frozen=True)
class ViscousOutputChurning(OutputChurning):
    """P = k w^n mu^m at the output shaft: as `ViscousChurning` says."""

    form = "with the oil"
    needs_oil_temperature = True
    assumes_oil_temperature = True

    oil_exponent: float = shape(
        "-", (0.21, 1.0), "power of viscosity in the torque", limits=(0.0, 1.0)
    )

    def output_drag(self, state: ShaftState) -> Value:
        return super().output_drag(state) * oil_factor(state, self.oil_exponent)


@dataclass(frozen=True)
class ClutchDrag(Effect):
    """T = T_peak q 2 x / (1 + x^2), x = slip speed / (speed of the peak q), q = feed flow.

    The film shears (torque rises with slip), then needs more oil than it is fed and breaks (it
    falls): what is fed moves the peak and leaves the shear below it alone. A feed pump on the
    engine makes q = (engine speed / 150 rad/s)^m, m = 0 where a valve holds the flow. Every open
    clutch drags alike, by the slip that the data of the stage give it, referred to the output; its
    torque acts on engine and output as the slip follows their speeds. Without such data one
    clutch stands for all, and slips as the output shaft turns.
    """

    name = "clutch_drag"
    form = "output side"
    component = "clutches"
    summary = (
        "open wet clutches drag on the output side: the torque rises with slip, peaks and "
        "falls as the oil film breaks"
    )
    source = "Yuan et al. 2007; Iqbal et al. 2013; review: Lubricants 2025, 13, 27"
    remedy = "spin the output side alone with the clutches open"

    torque: float = size(
        "N m", 6.0, 0.0, 40.0, "drag torque at its peak, engine at 150 rad/s"
    )
    peak_speed: float = shape("rad/s", (60.0, 110.0, 200.0), "slip speed at the peak")
    feed_exponent: float = shape(
        "-", (0.0, 1.0), "power of engine speed in the feed flow"
    )

    def _drag(self, slip: Array, engine_speed: Array) -> Array:
        feed = (engine_speed / _ENGINE_REFERENCE) ** self.feed_exponent
        x = slip / (self.peak_speed * feed)
        return np.asarray(self.torque * feed * 2.0 * x / (1.0 + x * x))

    def _referred(self, state: ShaftState, shaft: int) -> Value:
        """Sum of the drag of the open clutches at the engine (0) or the output (1)."""
        return sum(
            slip[shaft]
            * self._drag(
                slip[0] * state.engine_speed + slip[1] * state.output_speed,
                state.engine_speed,
            )
            for slip in state.open_clutches
        )

    def output_drag(self, state: ShaftState) -> Value:
        return self._referred(state, 1)

    def engine_drag(self, state: ShaftState) -> Value:
        return self._referred(state, 0)


@dataclass(frozen=True)
class ViscousClutchDrag(ClutchDrag):
    """T = T_peak mu^m q 2 x / (1 + x^2): a film that shears follows the viscosity (Petroff)."""

    form = "output side, with the oil"
    needs_oil_temperature = True
    assumes_oil_temperature = True

    oil_exponent: float = shape(
        "-", (1.0,), "power of viscosity in the torque", limits=(0.0, 1.0)
    )

    def output_drag(self, state: ShaftState) -> Value:
        return super().output_drag(state) * oil_factor(state, self.oil_exponent)

    def engine_drag(self, state: ShaftState) -> Value:
        return super().engine_drag(state) * oil_factor(state, self.oil_exponent)


@dataclass(frozen=True)
class ClutchDragBetween(ClutchDrag):
    """The same between the output and a shaft that the engine turns: x of the difference."""

    form = "between engine and output"
    summary = (
        "open wet clutches drag between shafts of the engine and of the output: the torque "
        "vanishes where the two run alike"
    )

    peak_speed: float = shape("rad/s", (70.0, 150.0), "slip speed at the peak")
    feed_exponent: float = shape("-", (0.5,), "power of engine speed in the feed flow")
    speed_ratio: float = shape(
        "-", (0.8,), "output / engine speed at which the slip vanishes"
    )

    def output_drag(self, state: ShaftState) -> Value:
        return self._drag(
            state.output_speed - self.speed_ratio * state.engine_speed,
            state.engine_speed,
        )

    def engine_drag(self, state: ShaftState) -> Value:
        return -self.speed_ratio * self.output_drag(state)


@dataclass(frozen=True)
class GearEfficiency(Effect):
    """Every pair loses another part of its power than assumed; better gears are negative."""

    name = "gear_mesh"
    form = "constant"
    component = "gears"
    summary = "the gear pairs are not as efficient as assumed"
    source = "paper, Table 3 (0.96 to 1); ISO/TR 14179"
    remedy = "calibrate the torque meters: their gain looks the same"

    loss: float = size(
        "-", 0.004, -0.02, 0.05, "further part of the power lost in each pair"
    )

    def gear_loss(self, power: Array, speed: Array) -> Value:
        return self.loss


@dataclass(frozen=True)
class GearMesh(Effect):
    """Lost part ~ torque^a speed^-b: mesh friction from mixed to full film.

    a, b are 0.2, 0.2 in Niemann, Schlenk and ISO/TR 14179-2, and -0.4, 0.7 in ISO/TR 14179-1.
    Benedict & Kelley's logarithm lies between a steep fall with speed and none; teeth that bend or
    tilt lose in proportion to load. Bearings under load lose alike: their torque M1 of Palmgren
    grows as load^1 (rollers) to load^1.55 (balls), which is a = 0 to 0.55, b = 0. Viscosity has 0.3
    of the speed's exponent in both standards: less than a bench sees of a loss of this size.
    """

    name = "gear_mesh"
    form = "load and speed"
    component = "gears"
    summary = "mesh friction depends on load and speed, which a constant gear efficiency leaves out"
    source = (
        "ISO/TR 14179-1 and -2; Benedict & Kelley, ASLE Trans. 4 (1961) 59: the friction "
        "follows load, speed and film"
    )
    remedy = "calibrate the torque meters: their gain looks nearly the same"

    loss: float = size(
        "-", 0.004, 0.0, 0.05, "further part lost in each pair at 250 N m and 150 rad/s"
    )
    load_exponent: float = shape("-", (-0.4, 0.2, 0.8), "power of the torque")
    speed_exponent: float = shape("-", (0.0, 0.5), "falling power of the speed")

    def gear_loss(self, power: Array, speed: Array) -> Value:
        torque = np.abs(power) / np.maximum(np.abs(speed), 1.0)
        return self.loss * _mesh_part(
            torque, speed, self.load_exponent, self.speed_exponent
        )


def _mesh_part(
    torque: Array, speed: Array, load_exponent: float, speed_exponent: float
) -> Array:
    """Loss / loss at 250 N m and 150 rad/s."""
    load = np.maximum(np.abs(torque), 1.0) / _TORQUE_REFERENCE
    turning = np.maximum(np.abs(speed), 1.0) / _ENGINE_REFERENCE
    # No pair can lose more than it carries, however far a fit strays.
    return np.minimum(load**load_exponent * turning**-speed_exponent, 10.0)


@dataclass(frozen=True)
class PlanetaryMesh(Effect):
    """Loss = k |T_sun (n_sun - n_carrier)|: rolling power of the planetary row."""

    name = "planetary_mesh"
    form = "torque ratio"
    component = "planetary"
    summary = (
        "the planets' mesh loses a part of the rolling power, which the base model takes "
        "as lossless"
    )
    source = "Mueller, Die Umlaufgetriebe: rolling power"
    remedy = "spin the row at two sun speeds with the same torque"

    loss: float = size("-", 0.03, 0.0, 0.2, "part of the rolling power lost")

    def planetary_loss(self, state: ShaftState) -> Value:
        return self.loss


@dataclass(frozen=True)
class PlanetaryFilm(PlanetaryMesh):
    """The same with a lost part ~ T_sun^a |n_sun - n_carrier|^-b, as of any pair of gears."""

    form = "load and speed"
    source = "as of `gear_mesh`, load and speed: ISO/TR 14179-1 and -2"

    loss: float = size("-", 0.03, 0.0, 0.2, "part lost at 250 N m and 150 rad/s")
    load_exponent: float = shape("-", (-0.4, 0.2, 0.8), "power of the sun's torque")
    speed_exponent: float = shape("-", (0.0, 0.5), "falling power of the rolling speed")

    def planetary_loss(self, state: ShaftState) -> Value:
        return self.loss * _mesh_part(
            state.sun_torque, state.sun_speed, self.load_exponent, self.speed_exponent
        )


class PlanetaryRolling(PlanetaryMesh):
    """The same loss paid by the member that the engine drives; the motor's torque stays."""

    form = "rolling power"
    source = "loss = k T_sun |n_sun - n_carrier|, charged to the carrier"

    def planetary_loss(self, state: ShaftState) -> Value:
        return 0.0

    def engine_drag(self, state: ShaftState) -> Value:
        return (
            self.loss * state.sun_torque * np.abs(state.sun_speed) / state.engine_speed
        )


@dataclass(frozen=True)
class _Drag(Effect):
    """T = T_0 (w / 200 rad/s)^a (dp / 20 MPa)^b, against the shaft of a unit on its own bench."""

    unit_only = True
    component = "pump"
    powers: ClassVar[tuple[int, int]] = (0, 0)
    torque: float = 0.0

    def pump_drag(self, state: ShaftState) -> Value:
        return self._torque(state.pump_speed, state.pressure)

    def motor_drag(self, state: ShaftState) -> Value:
        return self._torque(state.motor_speed, state.pressure)

    def _torque(self, speed: Array, pressure: Array) -> Value:
        a, b = self.powers
        return (
            self.torque
            * np.abs(speed / _UNIT_REFERENCE) ** a
            * np.abs(pressure / PRESSURE_REFERENCE) ** b
        )


@dataclass(frozen=True)
class ConstantTorque(_Drag):
    """T = T_c: what neither pressure nor speed changes."""

    name = "constant_torque"
    summary = (
        "a torque that is always there: shaft seals, springs and preloaded bearings, or a "
        "charge pump on the shaft"
    )
    source = "Wilson 1950, T_c; Thoma 1964"
    remedy = "turn the unit by hand without pressure"
    torque: float = size("N m", 4.0, 0.0, 25.0, "torque on the shaft")


@dataclass(frozen=True)
class BarrelChurning(_Drag):
    """T = T_200 (w / 200 rad/s)^2: the barrel turns in a case full of oil."""

    name = "barrel_churning"
    summary = "the barrel churns the oil of its case: the torque grows with the square of speed"
    source = "Schloesser 1961: C_h rho w^2 V^(5/3); Ivantysyn & Ivantysynova"
    remedy = "repeat a test without pressure at high speed with the case drained"
    powers = 2, 0
    torque: float = size("N m", 4.0, 0.0, 80.0, "torque at 200 rad/s")


@dataclass(frozen=True)
class PressureViscosity(_Drag):
    """T = T_200 (w / 200 rad/s) (dp / 20 MPa): damping that grows with pressure.

    By Barus a mineral oil is 1.5 times as thick at 20 MPa, and loaded gaps are narrower.
    """

    name = "pressure_viscosity"
    component = "oil"
    summary = "oil is thicker under pressure and gaps are narrower: damping grows with the load"
    source = "Barus 1893, alpha = 0.02 / MPa; loaded gaps: Ivantysyn & Ivantysynova"
    remedy = "measure the torque at one pressure and two speeds"
    powers = 1, 1
    torque: float = size(
        "N m", 8.0, 0.0, 80.0, "further torque at 20 MPa and 200 rad/s"
    )
