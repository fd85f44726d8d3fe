# SPDX-License-Identifier: Apache-2.0
"""Where the transmission works, and what a model answers there."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .ranges import DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE, OIL_TEMPERATURE

Array = NDArray[np.float64]


class OperatingPoints(NamedTuple):
    """Where the transmission works; arrays of one shape (or None), SI units."""

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    oil_temperature: Array | None = None

    @classmethod
    def checked(
        cls,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> tuple[OperatingPoints, bool]:
        """Return points in range, at least one-dimensional, and whether plain numbers were given.

        Raises:
            InputError: a value is out of range, or the shapes do not broadcast.
        """
        given = [DISPLACEMENT_RATIO.check(displacement_ratio), ENGINE_SPEED.check(engine_speed),
                 LOAD_TORQUE.check(load_torque)]
        if oil_temperature is not None:
            given.append(OIL_TEMPERATURE.check(oil_temperature))
        try:
            arrays = np.broadcast_arrays(*given)
        except ValueError:
            shapes = ", ".join(str(value.shape) for value in given)
            raise InputError(f"operating points of shapes {shapes} do not broadcast") from None
        return cls(*map(np.atleast_1d, arrays)), arrays[0].ndim == 0

    def map(self, function: Any) -> OperatingPoints:
        """Return the points with a function applied to each array."""
        return OperatingPoints._make(None if axis is None else function(axis) for axis in self)


class Answer(NamedTuple):
    """What a formulation says at operating points; arrays of one shape, NaN without an answer.

    Attributes:
        efficiency: output power / engine power [-].
        output_speed: [rad/s].
    """

    efficiency: Array
    output_speed: Array


def is_plain(point: tuple[Any, Any, Any]) -> TypeGuard[tuple[float, float, float]]:
    """Tell whether one point is of plain floats in range: `Range.check` for these, no more."""
    stroke, speed, torque = point
    return (type(stroke) is type(speed) is type(torque) is float
            and DISPLACEMENT_RATIO.low <= stroke <= DISPLACEMENT_RATIO.high
            and ENGINE_SPEED.low <= speed <= ENGINE_SPEED.high
            and LOAD_TORQUE.low <= torque <= LOAD_TORQUE.high)
