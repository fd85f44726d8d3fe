# SPDX-License-Identifier: Apache-2.0
"""The solved power balance at many points, or for many candidates of the parameters, at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.stage import Stage
from .closed_form import Constants

Array = NDArray[np.float64]
CHUNK = 8192
"""Values worked out at a time: their arrays stay in the cache of the processor."""


class ArrayForm(Constants):
    """The answers of `ClosedForm` in arrays."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        """Work out the constants.

        Parameters may be arrays, of shapes (..., 1) that broadcast with points of shape (n,).
        """
        super().__init__(stage, parameters)
        shape = (3, *(1,) * max(1, np.ndim(self.stiffness), np.ndim(self.motor_damping)))
        friction = self.motor_friction
        # Forward, backward and turned along a first axis: a call on arrays costs more than their
        # numbers.
        self._sides = self.side(np.array([self.driving, self.driven, self.driven]).reshape(shape),
                                np.array([friction, -friction, friction]).reshape(shape))

    def efficiency_in_parts(
        self, displacement_ratio: Array, engine_speed: Array, load_torque: Array
    ) -> Array:
        """Efficiency [-] at points of one shape; NaN where the load cannot be carried."""
        given = [np.ravel(item) for item in (displacement_ratio, engine_speed, load_torque)]
        found = np.empty(given[0].size)
        for start in range(0, found.size, CHUNK):
            part = slice(start, start + CHUNK)
            found[part] = self.efficiency(*(item[part] for item in given))
        return found.reshape(np.shape(displacement_ratio))

    def efficiency(
        self, displacement_ratio: Array, engine_speed: Array, load_torque: Array
    ) -> Array:
        """Efficiency [-] at points of shape (n,), for each of the parameters: shape (..., n)."""
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            flow = self.full_flow * displacement_ratio
            motor, pressure = self._motors(flow, engine_speed, load_torque)
            output = self.idle + self.hydraulic * motor
            ideal = pressure * flow
            pump = ideal + self.pump_friction * np.abs(ideal) + self.pump_drag * engine_speed
            gears = self.pump_gear_efficiency
            torque = self.mechanical_load * load_torque / output + (
                np.maximum(pump, 0.0) / gears + np.minimum(pump, 0.0) * gears)
            return np.where((output > 0.0) & (torque > 0.0), load_torque / torque, np.nan)

    def _motors(self, flow: Array, engine_speed: Array, load_torque: Array) -> tuple[Array, Array]:
        """Motor speed per engine speed and pressure torque, as `ClosedForm.motor`."""
        load = load_torque / engine_speed
        speeds = self._roots(flow, load)
        torques = self._sides.load * load_torque / (self.idle + self.hydraulic * speeds)
        pressures = (torques + self.motor_damping * engine_speed * speeds) * self._sides.grip
        (forward, backward, turned), (pressure, held, turned_pressure) = speeds, pressures
        fast = ~(held >= 0.0) & (turned_pressure < 0.0)
        backward = np.where(fast, turned, backward)
        held = np.where(fast, turned_pressure, held)
        standing = backward >= 0.0
        backward = np.where(standing, 0.0, backward)
        held = np.where(standing, flow * self.stiffness * engine_speed, held)
        backward = np.where(np.isnan(forward) & (load > self.collapse), np.nan, backward)
        drives = forward > 0.0
        return np.where(drives, forward, backward), np.where(drives, pressure, held)

    def _roots(self, flow: Array, load: Array) -> Array:
        side = self._sides
        b = side.linear - self.hydraulic * flow
        c = side.constant * load - self.idle * flow
        root = np.sqrt(b * b - 4.0 * side.square * c)
        if b.min() > 0.0:
            return np.asarray(-2.0 * c / (b + root))
        return np.where(b > 0.0, -2.0 * c / (b + root), (root - b) / (2.0 * side.square))
