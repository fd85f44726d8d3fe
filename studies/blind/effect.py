# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What an effect of the twin may act on, and the conditions under which it acts."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]


def drawn(default: Any, draw: Callable[[np.random.Generator], Any]) -> Any:
    """Declare a parameter of a form that every plant draws anew."""
    return field(default=default, metadata={"draw": draw})


def between(low: float, high: float) -> Any:
    """Declare one that lies between the ends of what the source of the form spans."""
    return drawn(0.5 * (low + high), lambda rng: float(rng.uniform(low, high)))


def either_sign() -> Any:
    """Declare one that is +1 or -1."""
    return drawn(1.0, lambda rng: float(rng.choice([-1.0, 1.0])))


@dataclass(frozen=True)
class Conditions:
    """State of the stage that an effect sees; arrays of one shape (..., n), SI units.

    `pressure` is the high minus the low side of the loop at the motor; `motor_speed` is positive
    for a positive stroke; viscosities are relative to those at the nominal oil temperature.
    """

    command: FloatArray
    stroke: FloatArray
    engine_speed: FloatArray
    pump_speed: FloatArray
    motor_speed: FloatArray
    carrier_speed: FloatArray
    output_speed: FloatArray
    pressure: FloatArray
    load_torque: FloatArray
    gap_viscosity: FloatArray
    film_viscosity: FloatArray
    pump_displacement: float
    motor_displacement: float
    leakage: float


@dataclass(frozen=True)
class Effect:
    """A loss or fault that the base plant lacks; every hook does nothing unless overridden.

    `size` scales the effect, 0 switches it off; `limit` is the largest that is still physical.
    """

    name: ClassVar[str]
    limit: ClassVar[float] = 10.0
    variants: ClassVar[tuple[str, ...]] = ()

    size: float = 1.0
    variant: str = ""

    def __init_subclass__(cls) -> None:
        cls.name = re.sub("(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()

    def drawn(self, rng: np.random.Generator) -> Effect:
        """Return one of random shape, and of a random variant where none is chosen yet."""
        shape = {
            item.name: item.metadata["draw"](rng)
            for item in fields(self)
            if item.metadata
        }
        if self.variants and not self.variant:
            shape["variant"] = str(rng.choice(self.variants))
        return replace(self, **shape)

    def true_stroke(self, command: FloatArray, pressure: FloatArray) -> FloatArray:
        """Displacement ratio that the swash plate really takes."""
        return command

    def clutch_slip(self, torque: FloatArray) -> FloatArray:
        """Sliding speed of the closed clutch of the mechanical path [rad/s].

        Torque and speed are referred to the engine shaft.
        """
        return np.zeros_like(torque)

    def viscosity(self, oil_temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Relative viscosity in leakage gaps, and in bearing and sliding films."""
        return np.ones_like(oil_temperature), np.ones_like(oil_temperature)

    def lost_flow(self, at: Conditions) -> FloatArray:
        """Flow lost from the high-pressure side, m3/s."""
        return np.zeros_like(at.pressure)

    def pressure_drop(self, at: Conditions) -> FloatArray:
        """Pressure at the pump less that at the motor, Pa; has the sign of the flow."""
        return np.zeros_like(at.pressure)

    def pump_drag(self, at: Conditions) -> FloatArray:
        """Torque that brakes the pump shaft, N m, not negative."""
        return np.zeros_like(at.pressure)

    def motor_drag(self, at: Conditions) -> FloatArray:
        """Magnitude of the torque that opposes the motor's rotation, N m."""
        return np.zeros_like(at.pressure)

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        """Power lost at the engine shaft, W."""
        return np.zeros_like(at.pressure)

    def output_drag_power(self, at: Conditions) -> FloatArray:
        """Power lost at the output shaft, W."""
        return np.zeros_like(at.pressure)

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        """Share of power that a gear pair loses beyond its nominal efficiency."""
        return np.zeros_like(torque)

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        """Share of the rolling power lost between sun and ring; speed is sun less carrier."""
        return np.zeros_like(ring_torque)

    def read(
        self, engine_torque: FloatArray, output_torque: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What the two torque meters show of the true torques, N m."""
        return engine_torque, output_torque


def acting(effects: Sequence[Effect], hook: str) -> list[Effect]:
    """Return the effects that do something at one place of the machine."""
    idle = getattr(Effect, hook)
    return [effect for effect in effects if getattr(type(effect), hook) is not idle]


def pumping(at: Conditions) -> FloatArray:
    """Return 1 where the unit of variable stroke pumps and 0 where it runs as a motor [-].

    Rounded over 5 % of stroke and 0.5 MPa.
    """
    flow = np.tanh(at.stroke / 0.05)
    return np.asarray(np.maximum(flow * np.tanh(at.pressure / 5e5), 0.0))
