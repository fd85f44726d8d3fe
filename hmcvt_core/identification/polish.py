# SPDX-License-Identifier: Apache-2.0
"""The local searches that finish what the annealing found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .annealing import Objective
from .least_squares import least_squares
from .problem import BOUNDS, Problem

Array = NDArray[np.float64]
_NO_ANSWER = 1e3  # residual, in standard deviations, where the model has no answer
_WORST = 1e9  # objective there


def least_squares_polish(problem: Problem, ends: Array) -> tuple[Array, float]:
    """Finish points (m, 3) by least squares; return the best and its mean squared residual.

    The value is infinite where no answer at every sample was found.
    """
    def residuals(linear: Array) -> Array:
        found = problem.residuals(_from_linear(linear))
        found[np.isnan(found)] = _NO_ANSWER
        return found

    linear = least_squares(residuals, _to_linear(ends), _to_linear(BOUNDS.T).T)
    points = np.clip(_from_linear(linear), *BOUNDS.T)
    values = np.nan_to_num(problem.weighted_squares(points), nan=np.inf)
    return points[int(values.argmin())], float(values.min())


def _to_linear(scaled: Array) -> Array:
    """Return the leakage itself, in its upper bound, in place of its logarithm.

    The losses are nearly linear in it: from a leakage far too small, where the logarithm has no
    slope left, the first step already goes most of the way.
    """
    linear = scaled.copy()
    linear[..., 0] = 10.0 ** (scaled[..., 0] - BOUNDS[0, 1])
    return linear


def _from_linear(linear: Array) -> Array:
    scaled = linear.copy()
    scaled[..., 0] = np.log10(linear[..., 0]) + BOUNDS[0, 1]
    return scaled


def simplex_polish(objective: Objective, ends: Array) -> tuple[Array, float]:
    """Finish points (m, 3) by a simplex within the bounds; return the best and its objective.

    It also serves eq. (21), whose answers may end at the edge of consistency.
    """
    from scipy.optimize import minimize

    def value(scaled: Array) -> float:
        found = float(objective(scaled[None, :])[0])
        return found if np.isfinite(found) else _WORST

    best, lowest = ends[0], np.inf
    for point in ends:
        for _ in range(2):  # one run may collapse early
            point = minimize(value, point, method="Nelder-Mead", bounds=BOUNDS,
                             options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 2000}).x
        if value(point) < lowest:
            best, lowest = point, value(point)
    return best, lowest if lowest < _WORST else np.inf
