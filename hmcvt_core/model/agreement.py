# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How well samples agree with a model (the paper's two measures) and with a gear train."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..transmission.ranges import OperatingPoints
from ..transmission.stage import Stage, speed_ratio
from .model import EfficiencyModel

Array = NDArray[np.float64]
_SLIP = 0.1  # part of the output speed that may be missing or too much before it is told
_ENDS = (0.1, 0.5, 0.9)  # quantiles: a few outliers are no mistake of a column


def predicted_at(model: EfficiencyModel, samples: BenchSamples) -> Array:
    """Efficiency that a model predicts for n samples, shape (n,) [-]; NaN where it has none."""
    return model.answer_at(samples.points).efficiency


def by_stage(model: EfficiencyModel, samples: BenchSamples) -> Iterator[tuple[str, BenchSamples]]:
    """Yield the samples of each stage that occurs; all of them where they do not say.

    Raises:
        InputError: a sample names a stage that the model does not have.
    """
    names = samples.points.stage
    if names is None:
        yield model.stage.name, samples
        return
    for name in dict.fromkeys(names.tolist()):
        model.in_stage(name)
        yield name, samples.select(names == name)


def carried_at(model: EfficiencyModel, points: OperatingPoints) -> Array:
    """Efficiency at n points, shape (n,) [-]; 0 where the load cannot be carried."""
    return np.nan_to_num(model.answer_at(points).efficiency, nan=0.0)


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


def output_speed_remark(stage: Stage, samples: BenchSamples) -> str | None:
    """Say that the output speed is not the one of this gear train; None where it may be."""
    if samples.output_speed is None:
        return None
    ratio = speed_ratio(stage, samples.displacement_ratio)
    turning = ratio > _SLIP  # next to standstill slip is all
    if not turning.any():
        return None
    without_slip = samples.engine_speed[turning] * ratio[turning]
    low, middle, high = np.quantile(samples.output_speed[turning] / without_slip, _ENDS)
    if low >= 1.0 - _SLIP and high <= 1.0 + _SLIP:
        return None
    return (f"the output speed is {middle:.2f} times that of gear train and displacement ratio "
            f"({low:.2f} to {high:.2f} in most samples): check its unit and column, the sign of "
            "the displacement ratio, and the transmission")
