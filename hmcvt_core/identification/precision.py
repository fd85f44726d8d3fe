# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Standard errors and correlation of identified parameters, linearised at the best point."""

import numpy as np

from ..files.bench import BenchSamples
from ..transmission.parameters import PARAMETER_NAMES, SEARCH_BOUNDS
from ..transmission.ranges import Array
from .criterion import least_squares
from .problem import Problem

WIDTH = SEARCH_BOUNDS[:, 1] - SEARCH_BOUNDS[:, 0]
"""Width of the bounds of each scaled parameter, shape (3,)."""

_MIN_SCATTER = 1e-3
"""Of the weighted residuals: samples without any would promise certainty."""
_LEAKAGE_PRIOR = 10.0 ** SEARCH_BOUNDS[0, 1] / np.sqrt(12.0)
"""Standard deviation of a leakage that is uniform from 0 to its upper bound [m3/(s Pa)]."""


def precision(
    problem: Problem, scaled: Array, scattered: Problem | None = None
) -> tuple[dict[str, float], Array]:
    """Standard errors and correlation of the parameters.

    From the Jacobian of the weighted residuals at the best point. The width of the bounds enters as
    prior knowledge (a uniform distribution has the variance width^2 / 12), so that a direction the
    samples do not see gets the error of that width rather than infinity. Near its lower bound the
    leakage, whose logarithm is searched, gets at least the width that a uniform leakage would have:
    an error in proportion to its value would shrink to nothing there.

    Args:
        problem: samples and model.
        scaled: the best point, shape (3,).
        scattered: the problem whose residuals give the scatter; `problem` when left out.

    Returns:
        Standard errors by name, in the units of the parameters; correlation, shape (3, 3).
    """
    scale = scatter(problem if scattered is None else scattered, scaled)
    _, slopes = least_squares(problem.residuals).linearised(scaled[None])
    # 0 without an answer.
    jacobian = np.nan_to_num(slopes[0])
    # The leakage is scaled by its logarithm.
    units = np.array([np.log(10.0) * 10.0 ** scaled[0], 1.0, 1.0])
    width = WIDTH / np.sqrt(12.0)
    width[0] = max(width[0], _LEAKAGE_PRIOR / units[0])
    prior = np.diag(1.0 / width**2)
    covariance = np.linalg.inv(jacobian.T @ jacobian / scale**2 + prior)
    spread = np.sqrt(np.diag(covariance))
    errors = dict(zip(PARAMETER_NAMES, (spread * units).tolist(), strict=True))
    return errors, covariance / np.outer(spread, spread)


def degrees_of_freedom(samples: BenchSamples) -> float | None:
    """Return the degrees of freedom of the scatter in standard errors, None for normal errors.

    Stated deviations are known. Without them the residuals give the scatter, unless there are only
    as many samples as parameters: then it is the paper's, eq. (3), taken as known.

    Args:
        samples: those that are fitted.
    """
    free = len(samples) - len(PARAMETER_NAMES)
    if samples.efficiency_std is not None or free <= 0:
        return None
    return float(free)


def scatter(problem: Problem, scaled: Array) -> float:
    """Standard deviation of the weighted residuals, in terms of the deviations assumed.

    Args:
        problem: samples and model.
        scaled: the best point, shape (3,).
    """
    residuals = problem.residuals(scaled)
    free = len(residuals) - len(PARAMETER_NAMES)
    deviation = float(np.sqrt(np.sum(residuals**2) / free)) if free > 0 else 1.0
    if problem.samples.efficiency_std is not None:
        # Stated deviations are taken as correct unless the residuals are larger.
        deviation = max(deviation, 1.0)
    return max(deviation, _MIN_SCATTER)
