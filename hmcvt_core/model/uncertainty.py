# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Standard errors of the parameters, carried on to an answer by what each does to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_RANGES, HydraulicParameters

Array = NDArray[np.float64]


class Prediction(NamedTuple):
    """What the model says at operating points; floats, or arrays of one shape.

    Attributes:
        efficiency: output power / engine power [-]; NaN where the model has no answer.
        standard_error: from the covariance of the parameters [-]; NaN where none is known.
        inside_domain: whether the point lies in the box of the identification data.
    """

    efficiency: Any
    standard_error: Any
    inside_domain: Any


class Uncertainty:
    """Of one model.

    Attributes:
        neighbours: parameters a small step away from the model's, one after the other, (3, 3).
    """

    def __init__(
        self, parameters: HydraulicParameters, standard_errors: Mapping[str, float],
        correlation: Array,
    ) -> None:
        self._errors = np.array([standard_errors[name] for name in PARAMETER_NAMES])
        self._correlation, base = correlation, parameters.to_array()
        # A step of a thousandth of the error stays in the linear range, also next to a bound.
        steps = np.maximum(1e-3 * self._errors, 1e-6 * base + 1e-18)
        highest = [limits.high for limits in PARAMETER_RANGES]
        self._steps = np.where(base + steps <= highest, steps, -steps)
        self.neighbours = base + np.diag(self._steps)

    def of(self, here: Array | float, there: Array) -> Array:
        """Standard error of answers `here`, shape (...), that are `there`, (3, ...), next to it."""
        slope = (there - here).T / self._steps
        gradient = slope * self._errors
        variance = ((gradient @ self._correlation) * gradient).sum(axis=-1)
        # `published` takes a fixed eta_H at eps = 0: its parameters say nothing there.
        blind = (slope == 0.0).all(axis=-1)
        return np.where(blind, np.nan, np.sqrt(np.maximum(variance, 0.0)))
