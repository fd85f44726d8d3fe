# SPDX-License-Identifier: Apache-2.0
"""Efficiency on a grid of displacement ratio, engine speed and load torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..transmission.points import OperatingPoints
from .domain import Domain

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency on a grid.

    Attributes:
        displacement_ratio: axis of shape (a,) [-].
        engine_speed: axis of shape (b,) [rad/s].
        load_torque: axis of shape (c,) [N m].
        efficiency: shape (a, b, c) [-]; NaN where the model has no answer.
        domain: of the model; None for one that does not know its data.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    efficiency: Array
    domain: Domain | None = None

    @property
    def inside_domain(self) -> NDArray[np.bool_] | None:
        """Where the data of the identification reach, shape (a, b, c); None if unknown."""
        if self.domain is None:
            return None
        return self.domain.contains(OperatingPoints(*np.meshgrid(
            self.displacement_ratio, self.engine_speed, self.load_torque, indexing="ij")))
