# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Listed effects in forms that neither the served model nor the twin has.

Each has the name of the effect that it is; where the twin has two families of forms for one effect,
a campaign draws from one of them or from here. Constants are chosen so that size 1 costs about one
point of efficiency; shapes are drawn from the range that the source or practice spans.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import (
    Conditions,
    Effect,
    FloatArray,
    between,
    drawn,
    either_sign,
)

#: Viscosity of a tractor oil by Vogel's equation: ln mu = a + b / (T + c), T in deg C.
_VOGEL_B = 880.0
_VOGEL_C = 95.0
_NOMINAL_TEMPERATURE = 60.0


@dataclass(frozen=True)
class ListedLoss(Effect):
    """An effect that the diagnosis lists, in a form of its own."""


@dataclass(frozen=True)
class ChargePump(ListedLoss):
    """A gerotor against a relief valve with a droop: torque = V p(Q) + a viscous part."""

    limit: ClassVar[float] = 8.0
    droop: float = between(0.05, 0.3)
    viscous: float = between(0.0, 0.25)

    def pump_drag(self, at: Conditions) -> FloatArray:
        pace = at.pump_speed / 230.0
        pressure = 1.0 + self.droop * (pace - 1.0)
        rubbing = self.viscous * pace * at.film_viscosity
        return np.asarray(self.size * 4.0 * (pressure + rubbing))


@dataclass(frozen=True)
class Churning(ListedLoss):
    """Churning in two regimes: power ~ speed^2 below a critical speed, ~ speed^3 above it."""

    critical: float = between(110.0, 190.0)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        pace = at.engine_speed / 150.0
        blend = 1.0 / (1.0 + (at.engine_speed / self.critical) ** 6)
        slow = 700.0 * pace**2
        fast = 700.0 * pace**3 * (150.0 / self.critical)
        return np.asarray(self.size * (blend * slow + (1.0 - blend) * fast))


@dataclass(frozen=True)
class OutputChurning(ListedLoss):
    """A final gear that lifts oil: a torque that grows linearly with speed, then squared."""

    turning: float = between(100.0, 260.0)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        pace = at.output_speed / self.turning
        torque = 2.0 * (np.sqrt(1.0 + pace**4) - 1.0 + 0.3 * pace**2)
        return np.asarray(self.size * torque * at.output_speed)


@dataclass(frozen=True)
class BearingDrag(ListedLoss):
    """Tapered bearings with preload: a constant, and a part with the square root of speed."""

    rolling: float = between(0.1, 0.7)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        pace = np.sqrt(at.film_viscosity * at.engine_speed / 150.0)
        torque = 3.0 * (1.0 - self.rolling + self.rolling * pace)
        return np.asarray(self.size * torque * at.engine_speed)


@dataclass(frozen=True)
class ClutchDrag(ListedLoss):
    """A shear torque that fades as air enters between the plates, exponentially in slip."""

    peak_slip: float = between(70.0, 200.0)
    rest: float = between(0.05, 0.3)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        relative = at.output_speed / self.peak_slip
        aerated = relative * np.exp(1.0 - relative)
        torque = 8.0 * (aerated + self.rest * relative / (1.0 + relative))
        return np.asarray(self.size * torque * at.output_speed)


@dataclass(frozen=True)
class PressureFriction(ListedLoss):
    """Friction under pressure: Coulomb, and a mixed part that falls with the log of speed."""

    mixed: float = between(0.0, 0.5)

    def _rubbing(
        self, speed: FloatArray, at: Conditions, displacement: float
    ) -> FloatArray:
        fading = np.log1p(np.abs(speed) / 25.0) / np.log(11.0)
        part = 1.0 - self.mixed * np.minimum(fading, 1.5)
        return np.asarray(0.025 * part * np.abs(at.pressure) * displacement)

    def pump_drag(self, at: Conditions) -> FloatArray:
        stroke = 0.4 + 0.6 * np.abs(at.stroke)
        rubbing = self._rubbing(at.pump_speed, at, at.pump_displacement)
        return np.asarray(self.size * stroke * rubbing)

    def motor_drag(self, at: Conditions) -> FloatArray:
        rubbing = self._rubbing(at.motor_speed, at, at.motor_displacement)
        return np.asarray(self.size * rubbing)


@dataclass(frozen=True)
class GearMesh(ListedLoss):
    """A friction coefficient (load / sum of speeds)^0.2 with a wear that raises some pairs more."""

    limit: ClassVar[float] = 8.0
    load_power: float = between(0.1, 0.35)
    speed_power: float = between(0.1, 0.35)
    worn: tuple[float, ...] = drawn(
        (1.0,) * 6, lambda rng: tuple(rng.uniform(0.7, 1.3, 6).tolist())
    )

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        worn = self.worn[(2, 3, 4, 5, 6, 11).index(pair)]
        load = ((np.abs(torque) + 15.0) / 250.0) ** self.load_power
        pace = ((np.abs(speed) + 15.0) / 150.0) ** -self.speed_power
        return np.asarray(np.minimum(0.004 * self.size * worn * load * pace, 0.2))


@dataclass(frozen=True)
class PlanetaryMesh(ListedLoss):
    """A share of the rolling power that falls with its speed towards a floor."""

    floor: float = between(0.3, 0.9)
    fading: float = between(60.0, 200.0)

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        film = 1.0 / (1.0 + np.abs(rolling_speed) / self.fading)
        share = 0.015 * self.size * (self.floor + (1.0 - self.floor) * 2.0 * film)
        return np.asarray(np.minimum(share, 0.5))


@dataclass(frozen=True)
class PressureLeakage(ListedLoss):
    """Gaps that open exponentially with pressure, as a housing yields."""

    limit: ClassVar[float] = 8.0
    yielding: float = between(6e6, 20e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        opening = np.expm1(np.minimum(np.abs(at.pressure) / self.yielding, 8.0))
        scale = np.expm1(20e6 / self.yielding)
        laminar = at.leakage * at.pressure / at.gap_viscosity
        return np.asarray(2.0 * self.size * laminar * opening / scale)


@dataclass(frozen=True)
class OrificeLeakage(ListedLoss):
    """A sharp leak next to a short gap: the root of the pressure, rounded where it is small."""

    laminar_below: float = between(2e5, 3e6)

    def lost_flow(self, at: Conditions) -> FloatArray:
        smooth = np.sqrt(np.abs(at.pressure) + self.laminar_below)
        flow = 3.5e-8 * at.pressure / smooth
        return np.asarray(self.size * flow)


@dataclass(frozen=True)
class StrokeLeakage(ListedLoss):
    """Slippers that tilt beyond a stroke: leakage rises from it to full stroke."""

    onset: float = between(0.0, 0.4)

    def lost_flow(self, at: Conditions) -> FloatArray:
        beyond = 0.05 * np.logaddexp(0.0, (np.abs(at.stroke) - self.onset) / 0.05)
        laminar = at.leakage * at.pressure / at.gap_viscosity
        return np.asarray(self.size * 1.2 * laminar * beyond / (1.0 - self.onset))


@dataclass(frozen=True)
class Compressibility(ListedLoss):
    """Oil with air by Wylie's modulus, in a dead volume that the stroke does not change."""

    air: float = between(0.002, 0.03)
    dead: float = between(0.3, 1.2)

    def lost_flow(self, at: Conditions) -> FloatArray:
        pressure = np.abs(at.pressure)
        stiff = 1.0 / 1.35e9 + self.air / (2e6 + pressure)
        volumes = at.pump_displacement * at.pump_speed * (self.dead + 0.5)
        volumes = volumes + at.motor_displacement * np.abs(at.motor_speed) * self.dead
        return np.asarray(self.size * at.pressure * stiff * volumes)


@dataclass(frozen=True)
class PortPressureDrop(ListedLoss):
    """A laminar and a turbulent resistance in series."""

    turbulent: float = between(0.2, 0.9)

    def pressure_drop(self, at: Conditions) -> FloatArray:
        flow = at.pump_displacement * at.pump_speed * at.stroke / 2e-3
        laminar = (1.0 - self.turbulent) * at.film_viscosity * flow
        return np.asarray(
            self.size * 3e5 * (laminar + self.turbulent * flow * np.abs(flow))
        )


@dataclass(frozen=True)
class DisplacementError(ListedLoss):
    """A feedback whose scale is bent, or that stands off by an amount that the stroke shifts."""

    variants: ClassVar[tuple[str, ...]] = ("bent_gain", "shifted_offset")
    limit: ClassVar[float] = 1.0
    sense: float = either_sign()
    form_error: float = between(-0.4, 0.4)

    def true_stroke(self, command: FloatArray, pressure: FloatArray) -> FloatArray:
        if self.variant == "bent_gain":
            gain = (
                0.08
                * self.sense
                * self.size
                * (1.0 + self.form_error * np.abs(command))
            )
            return np.asarray(command * (1.0 - gain))
        offset = 0.06 * self.sense * self.size * (1.0 + 0.5 * self.form_error * command)
        return np.asarray(command - offset)


@dataclass(frozen=True)
class OilTemperature(ListedLoss):
    """Viscosity by Vogel in gaps; films are thinner still, as sheared oil warms."""

    limit: ClassVar[float] = 1.5
    film_part: float = between(0.6, 1.0)

    def viscosity(self, oil_temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        warm = _VOGEL_B / (oil_temperature + _VOGEL_C)
        nominal = _VOGEL_B / (_NOMINAL_TEMPERATURE + _VOGEL_C)
        gap = np.exp(self.size * (warm - nominal))
        return gap, gap**self.film_part


@dataclass(frozen=True)
class TorqueSensor(ListedLoss):
    """A meter that was never adjusted: a zero, or a gain that is larger at small torque."""

    variants: ClassVar[tuple[str, ...]] = (
        "engine_zero",
        "engine_gain",
        "output_zero",
        "output_gain",
    )
    limit: ClassVar[float] = 12.0
    sense: float = either_sign()

    def read(
        self, engine_torque: FloatArray, output_torque: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        meter, _, error = self.variant.partition("_")
        torque = engine_torque if meter == "engine" else output_torque
        if error == "zero":
            shown = torque + self.sense * 2.0 * self.size
        else:
            bent = 1.0 - 0.06 * np.abs(torque) / 500.0
            shown = torque * (1.0 + 0.01 * self.sense * self.size * bent)
        if meter == "engine":
            return shown, output_torque
        return engine_torque, shown


LISTED_LOSSES = {kind.name: kind for kind in ListedLoss.__subclasses__()}
