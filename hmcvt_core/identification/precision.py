# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Standard errors and correlation of identified parameters, linearised at the best point."""

import numpy as np

from ..transmission.parameters import PARAMETER_NAMES, SEARCH_BOUNDS
from ..transmission.ranges import Array
from .problem import Problem

WIDTH = SEARCH_BOUNDS[:, 1] - SEARCH_BOUNDS[:, 0]
"""Width of the bounds of each scaled parameter, shape (3,)."""

_RELATIVE_STEP = 1e-6  # of the width, of the differences
_LEAST_SCATTER = 1e-3
"""Of the weighted residuals: samples without any would promise certainty."""


def precision(
    problem: Problem, scaled: Array, scattered: Problem | None = None
) -> tuple[dict[str, float], Array]:
    """Standard errors and correlation of the parameters.

    From the Jacobian of the weighted residuals at the best point. The width of the bounds enters as
    prior knowledge (a uniform distribution has the variance width^2 / 12), so that a direction the
    samples do not see gets the error of that width rather than infinity.

    Args:
        problem: samples and model.
        scaled: the best point, shape (3,).
        scattered: the problem whose residuals give the scatter; `problem` when left out.

    Returns:
        Standard errors by name, in the units of the parameters; correlation, shape (3, 3).
    """
    residuals = (problem if scattered is None else scattered).residuals(scaled)
    scale = _scatter(residuals, problem.samples.efficiency_std is not None)
    jacobian = _jacobian(problem, scaled)
    prior = np.diag(12.0 / WIDTH**2)
    covariance = np.linalg.inv(jacobian.T @ jacobian / scale**2 + prior)
    spread = np.sqrt(np.diag(covariance))
    # The leakage is scaled by its logarithm.
    units = np.array([np.log(10.0) * 10.0 ** scaled[0], 1.0, 1.0])
    errors = dict(zip(PARAMETER_NAMES, (spread * units).tolist(), strict=True))
    return errors, covariance / np.outer(spread, spread)


def _jacobian(problem: Problem, scaled: Array) -> Array:
    """Differences of the residuals within the bounds, shape (n, 3); 0 without an answer."""
    step = np.diag(_RELATIVE_STEP * WIDTH)
    below = np.maximum(scaled - step, SEARCH_BOUNDS[:, 0])
    above = np.minimum(scaled + step, SEARCH_BOUNDS[:, 1])
    residuals = problem.residuals(np.vstack([below, above]))
    rise = np.subtract(residuals[len(below) :], residuals[: len(below)])
    return np.nan_to_num(rise / np.diag(above - below)[:, None]).T


def _scatter(residuals: Array, stated: bool) -> float:
    """Standard deviation of weighted residuals (n,), in terms of the deviations assumed."""
    free = len(residuals) - len(PARAMETER_NAMES)
    scatter = float(np.sqrt(np.sum(residuals**2) / free)) if free > 0 else 1.0
    if stated:
        # Stated deviations are believed unless the residuals are larger.
        scatter = max(scatter, 1.0)
    return max(scatter, _LEAST_SCATTER)
