# SPDX-License-Identifier: Apache-2.0
"""The local searches that finish what the annealing found."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..annealing import Objective
from .problem import BOUNDS, Problem

Array = NDArray[np.float64]
_STEP = 1e-6  # of the differences, in scaled variables
_INSIDE = 1e-9  # the search wants to start off the bounds
_NO_ANSWER = 1e3  # residual, in standard deviations, where the model has no answer
_WORST = 1e9  # objective there


def least_squares_polish(problem: Problem, ends: Array) -> tuple[Array, float]:
    """Finish points (m, 3) by least squares; return the best and its mean squared residual.

    The value is infinite where no answer at every sample was found.
    """
    from scipy.optimize import least_squares

    def residuals(scaled: Array) -> Array:
        return np.nan_to_num(problem.residuals(scaled), nan=_NO_ANSWER)

    def slopes(scaled: Array) -> Array:
        # Backward next to an upper bound; all four points in one evaluation.
        steps = np.where(scaled + _STEP <= BOUNDS[:, 1], _STEP, -_STEP)
        found = residuals(np.vstack([scaled, scaled + np.diag(steps)]))
        return np.asarray(((found[1:] - found[0]) / steps[:, None]).T)

    points = []
    for end in ends:
        start = np.clip(end, BOUNDS[:, 0] + _INSIDE, BOUNDS[:, 1] - _INSIDE)
        points.append(least_squares(residuals, start, jac=slopes, bounds=BOUNDS.T, xtol=1e-12,
                                    ftol=1e-12, gtol=1e-12, max_nfev=200).x)
    values = np.nan_to_num(problem.weighted_squares(np.array(points)), nan=np.inf)
    return points[int(values.argmin())], float(values.min())


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
