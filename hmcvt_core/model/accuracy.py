# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far predictions are from measurements: relative errors, misfit and RSQ."""

import numpy as np
from numpy.typing import NDArray

from ..transmission.ranges import Array, OperatingPoints
from .model import EfficiencyModel

_TAIL = 6.0
"""Largest variance that counts, in standard errors above its estimate."""
_GRID = 500
"""Values of the standard deviation over which the posterior is summed."""


def carried_at(model: EfficiencyModel, points: OperatingPoints) -> Array:
    """Efficiency at n points, shape (n,) [-]; 0 where the load cannot be carried."""
    return np.nan_to_num(model.solution_at(points).efficiency, nan=0.0)


def relative_errors(predicted: Array, measured: Array) -> Array:
    """|Predicted - measured| / measured (Table 3), shape (..., n) [-]."""
    return np.asarray(np.abs(predicted - measured) / measured)


def mean_error(predicted: Array, measured: Array) -> float:
    """Mean of `relative_errors` (n,) where there is an answer [-]; NaN without any answer."""
    errors = relative_errors(predicted, measured)
    answered = errors[np.isfinite(errors)]
    return float(answered.mean()) if len(answered) else np.nan


def misfit(
    errors: Array,
    noise: Array | float,
    parameter_errors: Array | float,
    gap: float = 0.0,
) -> float:
    """Root mean square of errors beyond noise and errors of the parameters [-].

    Few samples determine it poorly, so it is a posterior mean, with a uniform prior on the standard
    deviation (Gelman 2006, Bayesian Analysis 1, 515): 0 would promise what they do not show.

    Args:
        errors: predicted - measured, or the reverse, at samples left out of the fit [-], shape
            (n,); NaN without an answer.
        noise: standard deviation of the measured efficiency [-], shape (n,) or scalar.
        parameter_errors: standard error of the prediction from the parameters [-], shape (n,) or
            scalar; NaN where other parameters have no answer: such samples do not count.
        gap: root mean square of what is missed beyond the noise, where it is known otherwise [-].

    Returns:
        `gap` where no sample has an answer; 0 where there is no error, noise or gap.
    """
    answered = np.isfinite(errors) & np.isfinite(parameter_errors)
    if not answered.any():
        return gap
    squares = errors[answered] ** 2
    of_noise = _mean_square(noise, answered)
    of_parameters = _mean_square(parameter_errors, answered)
    mean = float(squares.mean()) - of_noise - of_parameters
    if gap > 0.0:
        mean = max(mean, gap**2 - of_parameters)
    # Of a mean of squares of n normal errors.
    uncertainty = max(float(squares.mean()), of_noise) * np.sqrt(2.0 / len(squares))
    if uncertainty == 0.0:
        return 0.0
    largest = max(mean, 0.0) + _TAIL * uncertainty
    deviation = np.linspace(0.0, np.sqrt(largest), _GRID)
    log_weight = -0.5 * ((deviation**2 - mean) / uncertainty) ** 2
    weight = np.exp(log_weight - log_weight.max())
    return float(np.sqrt(weight @ deviation**2 / weight.sum()))


def _mean_square(values: Array | float, rows: NDArray[np.bool_]) -> float:
    """Return the mean square of values in some rows; values are of shape (n,) or scalar."""
    return float(np.mean(np.broadcast_to(values, rows.shape)[rows] ** 2))


def determination_loss(predicted: Array, measured: Array) -> Array:
    """1 - RSQ, eq. (21), of predictions (..., n), shape (...); NaN where one has no answer.

    As printed, the lower sum runs over predicted (not measured) minus the measured mean.
    """
    spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)
