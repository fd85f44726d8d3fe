# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far predictions are from measurements: relative errors, misfit and RSQ."""

import numpy as np

from ..transmission.ranges import Array, OperatingPoints
from .model import EfficiencyModel


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
    errors: Array, noise: Array | float, parameter_errors: Array | float
) -> float:
    """Root mean square of errors beyond noise and errors of the parameters [-].

    Args:
        errors: predicted - measured, or the reverse, at samples left out of the fit [-], shape
            (n,); NaN without an answer.
        noise: standard deviation of the measured efficiency [-], shape (n,) or scalar.
        parameter_errors: standard error of the prediction from the parameters [-], shape (n,) or
            scalar.

    Returns:
        0 where noise and parameters explain the errors, or where no sample has an answer.
    """
    squares = errors**2 - np.square(noise) - np.square(parameter_errors)
    answered = squares[np.isfinite(squares)]
    if not len(answered):
        return 0.0
    return float(np.sqrt(max(answered.mean(), 0.0)))


def determination_loss(predicted: Array, measured: Array) -> Array:
    """1 - RSQ, eq. (21), of predictions (..., n), shape (...); NaN where one has no answer.

    As printed, the lower sum runs over predicted (not measured) minus the measured mean.
    """
    spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)
