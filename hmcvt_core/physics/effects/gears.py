# SPDX-License-Identifier: Apache-2.0
"""Mesh losses beyond the assumed gear efficiency: gear pairs and the planetary row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, ShaftState, Value, shape, size

_SPEED = 150.0  # rad/s
_TORQUE = 250.0  # N m: sizes are stated at this torque of the path's shaft


@dataclass(frozen=True)
class GearEfficiency(Effect):
    """Every pair loses another part of its power than assumed; better gears are negative."""

    name = "gear_mesh"
    form = "constant"
    component = "gears"
    summary = "the gear pairs are not as efficient as assumed"
    source = "paper, Table 3 (0.96 to 1); ISO/TR 14179"
    remedy = "calibrate the torque meters: their gain looks the same"

    loss: float = size("-", 0.004, -0.02, 0.05, "further part of the power lost in each pair")

    def gear_loss(self, power: Array, speed: Array) -> Value:
        return self.loss


@dataclass(frozen=True)
class GearMesh(Effect):
    """Lost part ~ torque^a speed^-b: mesh friction that depends on load and sliding speed."""

    name = "gear_mesh"
    form = "load and speed"
    component = "gears"
    summary = "mesh friction depends on load and speed, which a constant gear efficiency leaves out"
    source = "ISO/TR 14179-2, Niemann: mu ~ (load / (sum speed, radius))^0.2 nu^-0.05"
    remedy = "calibrate the torque meters: their gain looks nearly the same"

    loss: float = size("-", 0.004, 0.0, 0.05,
                       "further part lost in each pair at 250 N m and 150 rad/s")
    load_exponent: float = shape("-", (0.3, 0.6, 1.0), "power of the torque")
    speed_exponent: float = shape("-", (0.0, 0.3), "falling power of the speed")

    def gear_loss(self, power: Array, speed: Array) -> Value:
        turning = np.maximum(np.abs(speed), 1.0)
        torque = np.abs(power) / turning
        # No pair can lose more than it carries, however far a fit strays.
        part = (torque / _TORQUE) ** self.load_exponent * (turning / _SPEED) ** -self.speed_exponent
        return self.loss * np.minimum(part, 10.0)


@dataclass(frozen=True)
class PlanetaryMesh(Effect):
    """Loss = k |T_sun (n_sun - n_carrier)|: rolling power of the planetary row."""

    name = "planetary_mesh"
    form = "torque ratio"
    component = "planetary"
    summary = ("the planets' mesh loses a part of the rolling power, which the base model takes "
               "as lossless")
    source = "Mueller, Die Umlaufgetriebe: rolling power"
    remedy = "spin the row at two sun speeds with the same torque"

    loss: float = size("-", 0.03, 0.0, 0.2, "part of the rolling power lost")

    def planetary_loss(self, state: ShaftState) -> Value:
        return self.loss


@dataclass(frozen=True)
class PlanetaryRolling(Effect):
    """The same loss paid by the member that the engine drives; the motor's torque stays."""

    name = "planetary_mesh"
    form = "rolling power"
    component = "planetary"
    summary = PlanetaryMesh.summary
    source = "loss = k T_sun |n_sun - n_carrier|, charged to the carrier"
    remedy = PlanetaryMesh.remedy

    loss: float = size("-", 0.03, 0.0, 0.2, "part of the rolling power lost")

    def engine_drag(self, state: ShaftState) -> Value:
        return self.loss * state.sun_torque * np.abs(state.sun_speed) / state.engine_speed
