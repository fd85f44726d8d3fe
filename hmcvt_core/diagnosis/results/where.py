# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where bench and model differ: regions that summarise the estimated gap.

The gap at the samples is a mixture of normal distributions, one for each relevant explanation, with
the allowances for inexact forms and an inexact base. A sample belongs to a region where the gap
more likely than not exceeds the rms of its mean. Boxes summarise these samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..analysis import Analysis, rms
from ..detection.regions import Box, Settings, covering_boxes
from ..observations import Observations
from ..selection.prediction import Prediction
from ..settings import (
    LIKELY,
    MAX_REGIONS,
    MIN_REGION_DIGITS,
    MIN_REGION_FRACTION,
    REGION_SIGNIFICANCE,
)
from ..system import Array
from .outcome import Region


@dataclass(frozen=True, eq=False)
class GapField:
    """The gap at the n samples under k explanations: measured minus refitted base.

    Attributes:
        probabilities: of the explanations, shape (k,).
        predictions: of the explanations, relative to the readings, in deviations.
        residual: of the refitted base without shared errors, in deviations, shape (channels, n).
        unit: deviation of the first channel, shape (n,).
    """

    probabilities: Array
    predictions: tuple[Prediction, ...]
    residual: Array
    unit: Array

    @classmethod
    def of(cls, analysis: Analysis) -> GapField:
        """Return the field of a campaign."""
        base = analysis.base
        probabilities = []
        predictions = []
        for prediction, probability in analysis.predictions:
            probabilities.append(probability)
            predictions.append(prediction)
        return cls(
            np.array(probabilities),
            tuple(predictions),
            base.with_shared_errors,
            base.observed.deviation[0],
        )

    def mean(self) -> Array:
        """Return the mean over the explanations in every channel, in deviations, (channels, n)."""
        means = np.stack([prediction.mean for prediction in self.predictions])
        return self.residual + np.tensordot(self.probabilities, means, 1)

    def probability_above(self, size: float) -> Array:
        """Return the probability that the gap of the first channel is larger, shape (n,).

        Args:
            size: in the unit of the channel.
        """
        from scipy.special import ndtr

        total = np.zeros(len(self.unit))
        for probability, prediction in zip(
            self.probabilities, self.predictions, strict=True
        ):
            mean = self.unit * (self.residual[0] + prediction.mean[0])
            variance = prediction.reading_covariance[:, 0, 0].clip(1e-300)
            deviation = self.unit * np.sqrt(variance)
            total += probability * ndtr((mean - size) / deviation)
            total += probability * ndtr((-mean - size) / deviation)
        return total

    def mean_over(self, inside: NDArray[np.bool_]) -> tuple[float, float]:
        """Return the mean gap over some samples, and the probability of the opposite sign.

        Args:
            inside: the samples, shape (n,).
        """
        from scipy.special import ndtr

        unit = self.unit[inside]
        means = []
        deviations = []
        for prediction in self.predictions:
            gap = unit * (self.residual[0, inside] + prediction.mean[0, inside])
            column = np.mean(unit[:, None] * prediction.columns[0, inside], axis=0)
            variance = float(column @ prediction.covariance @ column)
            means.append(gap.mean())
            deviations.append(np.sqrt(max(variance, 1e-300)))
        mean = float(self.probabilities @ means)
        towards_zero = -np.sign(mean) * np.array(means) / np.array(deviations)
        return mean, float(self.probabilities @ ndtr(towards_zero))


def regions_of(analysis: Analysis) -> tuple[Region, ...]:
    """Return the regions in which the gap is large and its sign is certain, the largest sum first.

    Regions whose mean is a small part of the largest, or small in the report, are left out.
    """
    if not analysis.significant or not len(analysis.boxes):
        return ()
    observed = analysis.base.observed
    field = GapField.of(analysis)
    expected = field.unit * field.mean()[0]
    large = field.probability_above(rms(expected)) > LIKELY
    settings = Settings.of(observed)
    boxes = []
    # A region is of one sign: means of both would cancel.
    for is_of_sign in (expected < 0.0, expected > 0.0):
        boxes += covering_boxes(
            observed.coordinates,
            analysis.boxes,
            large & is_of_sign,
            MAX_REGIONS,
            settings,
        )
    boxes.sort(key=lambda box: -abs(np.sum(expected[box.members])))
    regions = [_region(box, field, analysis) for box in boxes]
    return _worth_reporting(regions, observed)[:MAX_REGIONS]


def _region(box: Box, field: GapField, analysis: Analysis) -> Region:
    observed = analysis.base.observed
    limits = {}
    for axis, (low, high) in zip(observed.steered, box.limits.tolist(), strict=True):
        limits[axis.name] = (low, high)
    mean, opposite = field.mean_over(box.members)
    # The channel whose field is largest against its noise.
    noise = analysis.posterior.entries[0][0].model.noise
    squares = np.sum(field.mean()[:, box.members] ** 2, axis=1) / noise
    channel = observed.channels[int(squares.argmax())]
    return Region(
        limits=limits,
        mean_residual=mean,
        samples=int(box.members.sum()),
        p_value=opposite,
        channel=channel.name,
        setting=box.setting,
    )


def _worth_reporting(
    regions: list[Region], observed: Observations
) -> tuple[Region, ...]:
    channel = observed.channels[0]
    least = MIN_REGION_DIGITS * 10.0**-channel.digits / channel.factor
    largest = max((abs(region.mean_residual) for region in regions), default=0.0)
    least = max(least, MIN_REGION_FRACTION * largest)
    kept = []
    for region in regions:
        is_certain = region.p_value <= REGION_SIGNIFICANCE
        if is_certain and abs(region.mean_residual) >= least:
            kept.append(region)
    return tuple(kept)
