# SPDX-License-Identifier: Apache-2.0
"""Efficiency on a grid of displacement ratio, engine speed and load torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..transmission.points import OperatingPoints
from .domain import AXES, Domain

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


def efficiency_map(
    efficiency: Callable[[Any, Any, Any], Array],
    displacement_ratios: ArrayLike,
    engine_speeds: ArrayLike,
    load_torques: ArrayLike,
    domain: Domain | None = None,
) -> EfficiencyMap:
    """Evaluate the efficiency on a grid.

    Args:
        efficiency: of arrays that broadcast; checks their range.
        displacement_ratios, engine_speeds, load_torques: axes of shape (n,).
        domain: of the model, where it knows its data.

    Raises:
        InputError: an axis is empty, not one-dimensional or out of range.
    """
    axes = [np.atleast_1d(np.asarray(axis, dtype=float))
            for axis in (displacement_ratios, engine_speeds, load_torques)]
    for name, axis in zip(AXES, axes, strict=True):
        if axis.ndim != 1 or axis.size == 0:
            raise InputError(f"map axis {name} has shape {axis.shape}; needs (n,) with n > 0")
    values = efficiency(*np.meshgrid(*axes, indexing="ij", sparse=True))
    return EfficiencyMap(axes[0], axes[1], axes[2], values, domain)
