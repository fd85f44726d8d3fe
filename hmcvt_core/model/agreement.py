# SPDX-License-Identifier: Apache-2.0
"""How well predicted efficiencies agree with measured ones, in the paper's two measures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from .model import EfficiencyModel

Array = NDArray[np.float64]


def predicted_at(model: EfficiencyModel, samples: BenchSamples) -> Array:
    """Efficiency that a model predicts for n samples, shape (n,) [-]; NaN where it has none."""
    return np.asarray(model.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque,
        samples.oil_temperature))


def relative_errors(predicted: Array, measured: Array) -> Array:
    """|Predicted - measured| / measured (Table 3), shape (..., n) [-]."""
    return np.asarray(np.abs(predicted - measured) / measured)


def determination_loss(predicted: Array, measured: Array) -> Array:
    """1 - RSQ, eq. (21), of predictions (..., n), shape (...); NaN where one has no answer.

    As printed, the lower sum runs over predicted (not measured) minus the measured mean.
    """
    spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)


class RelativeError(NamedTuple):
    """|Predicted - measured| / measured over samples.

    Attributes:
        mean: over the samples with an answer [-]; NaN where there is none.
        without_answer: number of samples at which the model has none.
    """

    mean: float
    without_answer: int

    @classmethod
    def of(cls, predicted: Array, measured: Array) -> RelativeError:
        """Compare efficiencies of shape (n,); NaN among those predicted is no answer."""
        errors = relative_errors(predicted, measured)
        answered = np.isfinite(errors)
        mean = float(errors[answered].mean()) if answered.any() else np.nan
        return cls(mean, int(np.sum(~answered)))
