# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""All that is inferred of a campaign before it is summarised."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .detection.regions import Regions
from .detection.significance import Significance
from .fitting.refit import Fit
from .selection.classes import ClassSet, EffectClass, merge_sets
from .selection.explanation import Explanation
from .selection.posterior import Posterior, Weighted
from .selection.prediction import Prediction
from .settings import CERTAIN_GAP, GAP_SIGNIFICANCE, LIKELY, SMALL_CAMPAIGN
from .system import Array


@dataclass(frozen=True, eq=False)
class Analysis:
    """Detection and selection on one campaign.

    Attributes:
        posterior: over all explanations.
        boxes: candidate regions.
        detection: significance of the gap.
        seed: of every random number.
        classes: effects that no test distinguishes.
    """

    posterior: Posterior
    boxes: Regions
    detection: Significance
    seed: int
    classes: tuple[EffectClass, ...] = ()

    @property
    def base(self) -> Fit:
        """The refit without any effect."""
        return self.posterior.base_only.fit

    @property
    def significant(self) -> bool:
        """Whether there is a gap.

        The readings must be rare without a gap, and some explanation must make them likelier; or
        that explanation leaves no doubt. Of a small campaign the size of the scatter alone may be a
        gap, which no explanation shows.
        """
        if self.posterior.no_gap <= CERTAIN_GAP:
            return True
        if len(self.base.observed) < SMALL_CAMPAIGN:
            return self.is_rare
        return self.is_rare and self.posterior.no_gap < LIKELY

    @property
    def is_rare(self) -> bool:
        """Whether a campaign without a gap hardly ever has such readings."""
        return self.detection.p_value <= GAP_SIGNIFICANCE

    @property
    def has_candidates(self) -> bool:
        """Whether there is a gap, and a set of listed effects that may cause it."""
        return self.significant and bool(self.posterior.sets)

    @cached_property
    def leading(self) -> tuple[Explanation, float]:
        """The most probable set of listed effects, and its probability."""
        return next(iter(self.posterior.sets.values()))

    @cached_property
    def class_sets(self) -> tuple[ClassSet, ...]:
        """The sets, merged where no test distinguishes them, most probable first."""
        sets = [(names, p) for names, (_, p) in self.posterior.sets.items()]
        return merge_sets(sets, self.classes)

    @cached_property
    def leading_class_set(self) -> ClassSet:
        """The most probable set, and those that no test distinguishes from it."""
        leading, _ = self.leading
        for item in self.class_sets:
            if leading.names in item.sets:
                return item
        raise KeyError(leading.names)

    @cached_property
    def predictions(self) -> tuple[tuple[Prediction, float], ...]:
        """Relevant explanations at the samples, with allowances, and their probabilities."""
        observed = self.base.observed
        predictions = []
        for explanation, probability in self.posterior.relevant.entries:
            prediction = explanation.prediction_at(observed, with_allowances=True)
            predictions.append((prediction, probability))
        return tuple(predictions)

    @cached_property
    def shared_errors(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the shared errors over the posterior, shape (m,) each.

        In their prior deviations. Without a gap they are those of the base model alone.
        """
        posterior = self.posterior
        entries: tuple[Weighted, ...] = ((posterior.base_only, 1.0),)
        if self.significant:
            entries = posterior.relevant.entries
        shared = self.base.hypothesis.shared
        weights = np.array([probability for _, probability in entries])
        means = np.stack([explanation.model.mean[shared] for explanation, _ in entries])
        variances = []
        for explanation, _ in entries:
            variances.append(np.diagonal(explanation.model.covariance)[shared])
        mean = weights @ means
        variance = weights @ (np.stack(variances) + (means - mean) ** 2)
        return mean, np.sqrt(variance)

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the first channel, (n,); without a gap that of the base model."""
        model = self.posterior.base_only.plain_model
        if self.significant:
            model = self.posterior.entries[0][0].model
        return np.asarray(self.base.observed.deviation[0] * np.sqrt(model.noise[0]))


def model_of(explanation: Explanation, fit: Fit) -> Any:
    """Return the system's model of a fit, with the covariance of its base parameters.

    It is that at the fitted shapes, which the model holds.

    Args:
        explanation: gives the covariance.
        fit: the refit that the model holds.
    """
    count = len(fit.hypothesis.system.base)
    covariance = explanation.covariance_at_fitted_shapes[:count, :count]
    system = fit.hypothesis.system
    return system.model_of(fit.base, fit.effects, fit.observed.samples, covariance)


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
