# SPDX-License-Identifier: Apache-2.0
"""The error of a prediction as the paper states it, in the mean over bench samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..files.bench import BenchSamples
    from .model import EfficiencyModel


class RelativeError(NamedTuple):
    """|Predicted - measured| / measured over samples.

    Attributes:
        mean: over the samples with an answer [-]; NaN where there is none.
        without_answer: number of samples at which the model has none.
    """

    mean: float
    without_answer: int

    @classmethod
    def of(cls, predicted: NDArray[np.float64], measured: NDArray[np.float64]) -> RelativeError:
        """Compare efficiencies of shape (n,); NaN among those predicted is no answer."""
        errors = np.abs(predicted - measured) / measured
        answered = np.isfinite(errors)
        mean = float(errors[answered].mean()) if answered.any() else np.nan
        return cls(mean, int(np.sum(~answered)))

    @classmethod
    def of_model(cls, model: EfficiencyModel, samples: BenchSamples) -> RelativeError:
        """Compare a model with bench samples."""
        return cls.of(np.asarray(model.efficiency(
            samples.displacement_ratio, samples.engine_speed, samples.load_torque,
            samples.oil_temperature)), samples.efficiency)
