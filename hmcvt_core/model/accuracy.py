# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far predictions are from measurements: relative errors and RSQ."""

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


def determination_loss(predicted: Array, measured: Array) -> Array:
    """1 - RSQ, eq. (21), of predictions (..., n), shape (...); NaN where one has no answer.

    As printed, the lower sum runs over predicted (not measured) minus the measured mean.
    """
    spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)
