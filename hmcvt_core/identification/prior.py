# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The model in service as prior of a refit.

Parameters are counted in widths of their wear (`PRIOR_SPREAD`), and changes of them in directions
that are independent before the samples come: the columns of `Prior.root`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model.model import EfficiencyModel
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    SEARCH_BOUNDS,
    from_scaled,
)
from ..transmission.ranges import Array

_MIN_ERROR = 1e-6
"""Of a parameter in service, in widths of its wear: a smaller one is numerically certain."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the parameters before the samples, in widths of their wear.

    Attributes:
        unit: parameters of one such width, shape (3,).
        centre: parameters of the model in service.
        covariance: of the model in service, shape (3, 3).
        stated: whether the model states its errors; the wear stands for errors that are unknown.
    """

    unit: Array
    centre: Array
    covariance: Array
    stated: bool

    @classmethod
    def of(cls, model: EfficiencyModel) -> Prior:
        """Return the prior that a model states."""
        values = model.parameters.to_array()
        unit = PRIOR_SPREAD.copy()
        # The leakage wears by its logarithm.
        unit[0] *= np.log(10.0) * max(values[0], 10.0 ** PRIOR_MEAN[0])
        if not model.states_errors:
            return cls(unit, values / unit, np.eye(len(unit)), stated=False)
        errors = np.array([model.standard_errors[name] for name in PARAMETER_NAMES])
        spread = np.maximum(errors / unit, _MIN_ERROR)
        covariance = np.outer(spread, spread) * np.asarray(model.correlation)
        return cls(unit, values / unit, covariance, stated=True)

    @cached_property
    def root(self) -> Array:
        """Root of covariance and wear together, (3, 3): columns are the changes to be expected."""
        return np.asarray(np.linalg.cholesky(self.covariance + np.eye(len(self.unit))))

    def parameters(self, change: Array) -> Array:
        """Parameters in SI units, within the bounds, for changes (..., 3) in terms of `root`."""
        low, high = from_scaled(SEARCH_BOUNDS.T)
        centre = self.centre * self.unit
        values = centre + change @ self.root.T * self.unit
        # A model in service may lie outside the bounds of the search, and stay so.
        return np.clip(values, np.minimum(low, centre), np.maximum(high, centre))

    def change(self, parameters: Array) -> Array:
        """Inverse of `parameters`."""
        return np.asarray(
            (parameters / self.unit - self.centre) @ np.linalg.inv(self.root).T
        )
