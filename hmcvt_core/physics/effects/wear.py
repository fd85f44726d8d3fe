# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Changes of a machine against its sound state: growth of what the base model already has.

A refit of the base parameters absorbs them, so they are candidates only where a sound machine is
held as the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, ShaftState, Value, shape, size
from .hydraulic import Compressibility, OilTemperature

UNREAD_TEMPERATURE = 50.0
"""Oil temperature assumed for a baseline that does not read it [deg C].

ISO 4409 asks for 50 deg C where nothing else is agreed.
"""


@dataclass(frozen=True)
class LaminarLeakage(Effect):
    """q = c dp / mu: worn gaps of constant height leak more."""

    change_only = True
    name = "laminar_leakage"
    component = "pump"
    summary = "worn gaps leak more: the flow lost grows with pressure and with thin oil"
    source = "gap flow: Wilson 1950; Ivantysyn & Ivantysynova, h^3 dp / (12 mu l)"
    remedy = "measure the flow at two oil temperatures and at low and high pressure"

    leakage: float = size("m3/(s Pa)", 5e-12, 0.0, 3e-10, "growth of the leakage")

    def leakage_flow(self, state: ShaftState) -> Value:
        return self.leakage / state.viscosity_ratio * state.pressure


@dataclass(frozen=True)
class ViscousDamping(Effect):
    """T = f mu w: films that shear more oil damp more."""

    change_only = True
    name = "viscous_damping"
    component = "pump"
    summary = "narrower films or more wetted surface: drag grows with speed"
    source = "Petroff 1883; eqs (14), (15)"
    remedy = "measure the torque at no pressure and two speeds"

    damping: float = size("N m s/rad", 0.1, 0.0, 2.0, "growth of the damping")

    def pump_drag(self, state: ShaftState) -> Value:
        return self.damping * state.viscosity_ratio * state.pump_speed

    def motor_drag(self, state: ShaftState) -> Value:
        return self.damping * state.viscosity_ratio * np.abs(state.motor_speed)


@dataclass(frozen=True)
class UnreadOilTemperature(OilTemperature):
    """Oil that is warmer than that of the baseline, where no temperature is read.

    The viscosity is that of an ISO VG 46 oil around `UNREAD_TEMPERATURE`.
    """

    change_only = True
    form = "temperature not read"
    summary = "oil warmer or thinner than that of the baseline; no temperature is read"
    remedy = "log the oil temperature in both campaigns"

    strength: float = size(
        "K", 15.0, -40.0, 60.0, "oil temperature above that of the baseline"
    )
    film_exponent: float = 1.0
    viscosity_40: float = 46.0
    viscosity_100: float = 6.8

    def viscosity_ratio(self, oil_temperature: Array) -> Value:
        """Viscosity against that of the baseline [-].

        Args:
            oil_temperature: any values; the shape of the result [deg C].
        """
        nominal = np.full(np.shape(oil_temperature), UNREAD_TEMPERATURE)
        reference = OilTemperature(strength=1.0)
        warmer = np.asarray(reference.viscosity_ratio(nominal + self.strength))
        return warmer / np.asarray(reference.viscosity_ratio(nominal))


@dataclass(frozen=True)
class AeratedOil(Compressibility):
    """Oil that holds more air than that of the baseline, and is squeezed more."""

    change_only = True
    form = "more air"
    summary = (
        "oil with more air is squeezed more: flow is lost with pressure times speed"
    )
    source = (
        "Merritt 1967, Hydraulic Control Systems, 2.2: at most about 3 1/GPa with air"
    )
    remedy = (
        "measure the flow at one pressure and two speeds; look for foam in the tank"
    )

    compliance: float = size("1/GPa", 0.5, 0.0, 3.0, "growth of 1 / bulk modulus")
    dead_volume: float = shape("-", (0.5,), "dead volume / volume of a full stroke")
    motor_part: float = shape("-", (1.0,), "1 if the motor squeezes oil too, 0 if not")
    softening: float = shape("MPa", (0.0,), "pressure below which the oil is softer")
