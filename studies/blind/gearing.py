# SPDX-License-Identifier: Apache-2.0
"""Mesh losses of gear pairs and of the planetary row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Conditions, Effect, FloatArray


@dataclass(frozen=True)
class GearMesh(Effect):
    """Gear pairs that lose more than their nominal share.

    `friction`: coefficient of friction ~ log10(29.66 W' / (eta v_s v_t^2)) (Benedict and Kelley,
    ASLE Trans. 4 (1961) 59): rises with tooth load, falls with speed. `efficiency`: pairs less
    efficient than assumed, each by its own amount (`uneven`, in the order 2, 3, 4, 5, 6, 11).
    """

    name: ClassVar[str] = "gear_mesh"
    variants: ClassVar[tuple[str, ...]] = ("friction", "efficiency")
    limit: ClassVar[float] = 8.0
    uneven: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)

    def mesh_loss(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the further share of power lost in the pair."""
        if self.variant == "efficiency":
            place = (2, 3, 4, 5, 6, 11).index(pair)
            return np.full_like(torque, 0.004 * self.size * self.uneven[place])
        load = (np.abs(torque) + 2.0) / 300.0
        pace = (np.abs(speed) + 5.0) / 150.0
        # 1.4 decades above the full film at 300 N m and 150 rad/s; smooth floor at zero.
        decades = 1.4 + np.log10(load) - 3.0 * np.log10(pace)
        bearing = np.logaddexp(0.0, 4.0 * decades) / 4.0
        return np.asarray(np.minimum(0.003 * self.size * bearing, 0.2))


@dataclass(frozen=True)
class PlanetaryMesh(Effect):
    """Meshes and planet bearings of the planetary row.

    Mesh friction falls with rolling speed ^0.25; the planets' centrifugal force loads their
    bearings whatever the torque (as in Muller, Epicyclic Drive Trains, 1982, for fast carriers).
    """

    name: ClassVar[str] = "planetary_mesh"
    bearing: float = 0.15

    def planetary_loss(
        self, at: Conditions, ring_torque: FloatArray, rolling_speed: FloatArray
    ) -> FloatArray:
        """Return the share of rolling power lost in meshes and planet bearings."""
        mesh = (np.abs(rolling_speed) / 150.0 + 0.05) ** -0.25
        centrifugal = self.bearing * (at.carrier_speed / 120.0) ** 2
        carried = 250.0 / (np.abs(ring_torque) + 25.0)
        share = 0.01 * self.size * (mesh + centrifugal * carried)
        return np.asarray(np.minimum(share, 0.5))
