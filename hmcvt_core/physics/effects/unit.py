# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a bench of one pump or motor shows and a bench of the transmission does not tell apart.

There the same curves stand under other names (a constant torque is `charge_pump`), so that these
are candidates on the bench of a unit alone. Both hooks of drag are the same law of the own speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from .base import Array, Effect, ShaftState, Value, shape, size
from .hydraulic import Compressibility, PressureFrictionStroke

_PRESSURE = 20e6  # Pa, sizes are stated at this pressure
_SPEED = 200.0  # rad/s, and at this speed
OF_ANY_SIZE = ("-", "1/GPa")
"""Units of sizes that are the same in small pumps and motors and in large ones."""


@dataclass(frozen=True)
class _Drag(Effect):
    """T = T_0 (w / 200 rad/s)^a (dp / 20 MPa)^b, against the shaft of the unit."""

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
        return self.torque * np.abs(speed / _SPEED) ** a * np.abs(pressure / _PRESSURE) ** b


@dataclass(frozen=True)
class ConstantTorque(_Drag):
    """T = T_c: what neither pressure nor speed changes."""

    name = "constant_torque"
    summary = ("a torque that is always there: shaft seals, springs and preloaded bearings, or a "
               "charge pump on the shaft")
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
    torque: float = size("N m", 8.0, 0.0, 80.0, "further torque at 20 MPa and 200 rad/s")


@dataclass(frozen=True)
class ReferenceDisplacement(Effect):
    """True displacement = stated (1 - excess): an error of the losses, not of the unit.

    Flow is lost then in proportion to speed, also without pressure, and the same part of the
    pressure torque is gained.
    """

    unit_only = True
    name = "reference_displacement"
    component = "sensor"
    summary = "the displacement by which the losses are reckoned is not that of the unit"
    source = "derived capacity: ISO 8426; Toet et al., Energies 2019, 12, 415"
    remedy = "measure the flow near no pressure at several speeds (ISO 8426)"

    excess: float = size("-", 0.01, -0.1, 0.1, "stated / true displacement - 1")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        return displacement_ratio * (1.0 - self.excess)


@dataclass(frozen=True)
class SlowLeakage(Effect):
    """q = c dp / (1 + w / w_s): leakage that falls as the unit turns faster."""

    unit_only = True
    name = "slow_leakage"
    component = "pump"
    summary = "a slow unit leaks more: films that centre its parts have not built up"
    source = "Dorey 1988: slip coefficient as a power of pressure and speed"
    remedy = "measure the flow at one pressure and several low speeds"

    leakage: float = size("m3/(s Pa)", 5e-12, 0.0, 3e-10, "further leakage at standstill")
    fade_speed: float = shape("rad/s", (5.0, 20.0, 80.0), "speed at which half of it is left")

    def leakage_flow(self, state: ShaftState) -> Value:
        speed = np.maximum(np.abs(state.pump_speed), np.abs(state.motor_speed))
        left = 1.0 / (1.0 + speed / self.fade_speed)
        return self.leakage / state.viscosity_ratio * state.pressure * left


@dataclass(frozen=True)
class CompressionWork(Compressibility):
    r"""As `Compressibility`, the work of compression returned to the shaft of a pump.

    Pistons that compress what they hold before it meets the port, and let the dead volume push them
    back, take the torque :math:`V dp (1 - (dp/\beta)(V_0/V + 1/2))` instead of V dp: the mechanical
    efficiency by ISO 4409 looks too good at high pressure, and may pass 100 %.
    """

    unit_only = True
    form = "work returned"
    summary = ("oil is squeezed on every stroke: flow is lost in proportion to pressure times "
               "speed, and part of the work comes back as torque")
    source = "Achten et al., FPMC2019: ISO 4409 and the bulk modulus"

    motor_part: float = shape("-", (0.0,), "1 if the motor squeezes oil too, 0 if not")
    softening: float = shape("MPa", (0.0,), "pressure below which the oil is softer")

    def pump_drag(self, state: ShaftState) -> Value:
        # No dead angle compresses anything without a stroke.
        pumping = np.maximum(state.displacement_ratio * np.sign(state.pressure), 0.0)
        part = state.pressure**2 * self.compliance / 1e9 * (self.dead_volume + 0.5)
        return -part * pumping * state.displacement


@dataclass(frozen=True)
class CoulombStribeck(PressureFrictionStroke):
    """c dp V (1 + r exp(-|w| / w_s)): friction that falls to a rest as the film builds up."""

    unit_only = True
    form = "Coulomb and Stribeck"
    summary = "parts pressed together rub, at low speed more: friction falls with speed to a rest"
    source = "Stribeck curve; mixed film at low speed: SAE 2012-01-2041"

    rise: float = shape("-", (1.0, 4.0), "friction at standstill / friction at speed - 1")
    fade_speed: float = shape("rad/s", (15.0, 40.0, 100.0), "speed at which the film builds up")

    def pump_drag(self, state: ShaftState) -> Value:
        return super().pump_drag(state) * self._part(state.pump_speed)

    def motor_drag(self, state: ShaftState) -> Value:
        return super().motor_drag(state) * self._part(state.motor_speed)

    def _part(self, speed: Array) -> Array:
        return np.asarray(1.0 + self.rise * np.exp(-np.abs(speed) / self.fade_speed))


def sized(effect: type[Effect], factor: float, kind: str) -> Effect:
    """Return an effect with the sizes typical of the paper's unit in one of another displacement.

    Args:
        effect: what acts.
        factor: displacement / that of the paper's unit: so much larger most sizes are.
        kind: `pump` or `motor`: of the two it belongs to the one on the bench.
    """
    own = tuple(
        replace(item, typical=factor * item.typical, low=factor * item.low, high=factor * item.high)
        if item.is_size and item.unit not in OF_ANY_SIZE else item for item in effect.parameters())
    component = kind if effect.component in ("pump", "motor") else effect.component
    larger: type[Effect] = type(effect.__name__, (effect,), {
        "component": component, "parameters": staticmethod(lambda: own)})
    return larger()
