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

NO_ANSWER = 1e3
"""Residual, or 1 - RSQ, where the model has no answer: larger than any that it gives."""

_RELATIVE_STEP = 1e-6
"""Of the width of the bounds, of the differences."""
_TOLERANCE = 1e-14
_SIMPLEX_RUNS = 2  # one run may collapse before it arrives


class Criterion(Protocol):
    """What is minimised over the scaled parameters."""

    @property
    def name(self) -> str:
        """The name in reports."""

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        """Return the criterion.

        Args:
            predicted: efficiencies, shape (..., n) [-].
            measured: efficiencies, shape (n,) [-].
            deviation: standard deviation of each, shape (n,) [-].

        Returns:
            Shape (...); NaN where a sample has no answer.
        """

    def local_search(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        start: Array,
    ) -> Array:
        """Return the end of a local search within `SEARCH_BOUNDS`, shape (3,).

        Args:
            residuals: weighted residuals (..., n) of scaled parameters (..., 3).
            objective: criterion of scaled parameters (3,).
            start: scaled parameters, shape (3,).
        """


class _WeightedSquares:
    """Mean of squared residuals by their variance: 1 for a true model."""

    name = "weighted squares"

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        residuals = (predicted - measured) / deviation
        return np.asarray((residuals**2).mean(axis=-1))

    def local_search(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        start: Array,
    ) -> Array:
        from scipy.optimize import least_squares

        def answered(scaled: Array) -> Array:
            return np.nan_to_num(residuals(scaled), nan=NO_ANSWER)

        # Of SciPy's methods this one puts a parameter on its bound, not next to it.
        solution = least_squares(
            answered,
            start,
            # In one call: it takes as long for six points as for one.
            lambda scaled: slopes_within_bounds(answered, scaled),
            bounds=SEARCH_BOUNDS.T,
            method="dogbox",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
        )
        return np.asarray(solution.x)


class _Determination:
    """1 - RSQ, eq. (21)."""

    name = "1 - RSQ, eq. (21)"

    def value(self, predicted: Array, measured: Array, deviation: Array) -> Array:
        return determination_loss(predicted, measured)

    def local_search(
        self,
        residuals: Callable[[Array], Array],
        objective: Callable[[Array], Array],
        start: Array,
    ) -> Array:
        """Search by a simplex, which follows the edge of consistency, where RSQ may be highest."""
        from scipy.optimize import minimize

        point = start
        for _ in range(_SIMPLEX_RUNS):
            point = minimize(
                lambda scaled: np.nan_to_num(objective(scaled), nan=NO_ANSWER),
                point,
                method="Nelder-Mead",
                bounds=SEARCH_BOUNDS,
                options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 2000},
            ).x
        return point


def slopes_within_bounds(residuals: Callable[[Array], Array], scaled: Array) -> Array:
    """Differences of residuals on either side of a point within the bounds, shape (n, 3).

    Args:
        residuals: (m, n) of scaled parameters (m, 3).
        scaled: the point, shape (3,).
    """
    step = np.diag(_RELATIVE_STEP * (SEARCH_BOUNDS[:, 1] - SEARCH_BOUNDS[:, 0]))
    below = np.maximum(scaled - step, SEARCH_BOUNDS[:, 0])
    above = np.minimum(scaled + step, SEARCH_BOUNDS[:, 1])
    at_ends = residuals(np.vstack([below, above]))
    rise = at_ends[len(below) :] - at_ends[: len(below)]
    return np.asarray((rise / np.diag(above - below)[:, None]).T)


CRITERIA: Mapping[str, Criterion] = {
    POWER_BALANCE.name: _WeightedSquares(),
    PUBLISHED.name: _Determination(),
}
"""What is minimised, by formulation."""
