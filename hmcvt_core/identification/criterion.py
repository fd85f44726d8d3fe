# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What an identification minimises, and the local search that finishes it.

Both criteria are counted in units of a scatter, so that t_0 = 1 of the annealing means the same for
every bench: weighted squares in the variance of the noise, 1 - RSQ in the spread of the
predictions.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from ..model.accuracy import determination_loss
from ..physics.formulation import POWER_BALANCE, PUBLISHED
from ..transmission.parameters import SEARCH_BOUNDS
from ..transmission.ranges import Array
from .side_by_side import LeastSquares

NO_ANSWER = 1e3
"""Residual, or 1 - RSQ, where the model has no answer: larger than any that it gives."""

_RELATIVE_STEP = 1e-6
"""Of the width of the bounds, of the differences."""
_SIMPLEX_RUNS = 2  # one run may collapse before it arrives


class Criterion(Protocol):
    """What is minimised over the scaled parameters."""

    @property
    def name(self) -> str:
        """The name in reports."""

    @property
    def meaning(self) -> str:
        """How to read its value, one line for reports."""

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        """Return the criterion.

        Args:
            predicted: efficiencies, shape (..., n) [-].
            measured: efficiencies, shape (n,) [-].
            deviation: standard deviation of each, shape (n,) [-].

        Returns:
            Shape (...); NaN where a sample has no answer.
        """

    def local_searches(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        starts: Array,
    ) -> Array:
        """Return the ends of local searches within `SEARCH_BOUNDS`, shape (m, 3).

        Args:
            residuals: weighted residuals (m, k, n) of scaled parameters (m, k, 3).
            objective: criterion of scaled parameters (3,).
            starts: scaled parameters, shape (m, 3).
        """


class _WeightedSquares:
    """Mean of squared residuals by their variance: 1 for a true model."""

    name = "weighted squares"
    meaning = "mean of residual^2 / noise^2; noise alone gives about 1"

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        residuals = (predicted - measured) / deviation
        return np.asarray((residuals**2).mean(axis=-1))

    def local_searches(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        starts: Array,
    ) -> Array:
        def answered(scaled: Array) -> Array:
            return np.nan_to_num(residuals(scaled), nan=NO_ANSWER)

        return least_squares(answered).fitted(starts)[0]


class _Determination:
    """1 - RSQ, eq. (21)."""

    name = "1 - RSQ, eq. (21)"
    meaning = "0 for a model that meets every sample"

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        return determination_loss(predicted, measured)

    def local_searches(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        starts: Array,
    ) -> Array:
        """Search by a simplex, which follows the edge of consistency, where RSQ may be highest."""
        from scipy.optimize import minimize

        ends = []
        for point in starts:
            for _ in range(_SIMPLEX_RUNS):
                point = minimize(
                    lambda scaled: np.nan_to_num(objective(scaled), nan=NO_ANSWER),
                    point,
                    method="Nelder-Mead",
                    bounds=SEARCH_BOUNDS,
                    options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 2000},
                ).x
            ends.append(point)
        return np.array(ends)


def least_squares(residuals: Callable[[Array], Array]) -> LeastSquares:
    """Return least squares of weighted residuals over the scaled parameters.

    Args:
        residuals: (m, k, n) of scaled parameters (m, k, 3).
    """
    width = SEARCH_BOUNDS[:, 1] - SEARCH_BOUNDS[:, 0]
    return LeastSquares(residuals, SEARCH_BOUNDS, _RELATIVE_STEP * width)


CRITERIA: Mapping[str, Criterion] = {
    POWER_BALANCE.name: _WeightedSquares(),
    PUBLISHED.name: _Determination(),
}
"""What is minimised, by formulation."""
