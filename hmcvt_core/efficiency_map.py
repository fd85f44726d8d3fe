# SPDX-License-Identifier: Apache-2.0
"""Efficiency on a grid of displacement ratio, engine speed and load torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .domain import AXES
from .errors import InputError
from .power_balance import OperatingPoints

if TYPE_CHECKING:
    from .model import EfficiencyModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency on a grid.

    Attributes:
        displacement_ratio: axis of shape (a,) [-].
        engine_speed: axis of shape (b,) [rad/s].
        load_torque: axis of shape (c,) [N m].
        efficiency: shape (a, b, c) [-]; NaN where the model has no answer.
        inside_domain: where the data of the identification reach, shape (a, b, c); None for a model
            that does not know them.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    efficiency: Array
    inside_domain: NDArray[np.bool_] | None = None


def efficiency_map(
    model: EfficiencyModel,
    displacement_ratios: ArrayLike,
    engine_speeds: ArrayLike,
    load_torques: ArrayLike,
) -> EfficiencyMap:
    """Evaluate a model on a grid.

    Raises:
        InputError: an axis is empty, not one-dimensional or out of range.
    """
    axes = [np.atleast_1d(np.asarray(axis, dtype=float))
            for axis in (displacement_ratios, engine_speeds, load_torques)]
    for name, axis in zip(AXES, axes, strict=True):
        if axis.ndim != 1 or axis.size == 0:
            raise InputError(f"map axis {name} has shape {axis.shape}; needs (n,) with n > 0")
    grid = np.meshgrid(*axes, indexing="ij", sparse=True)
    inside = None if model.domain is None else model.domain.contains(
        OperatingPoints(*np.broadcast_arrays(*grid)))
    return EfficiencyMap(axes[0], axes[1], axes[2], model.efficiency(*grid), inside)
