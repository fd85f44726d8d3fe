# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Size of a change, from all channels and from all sets that hold it.

The model that is saved fits the served channel first; its size may differ from that which all
channels show by more than their error. The size of a change is therefore that of the posterior.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...diagnosis import Diagnosis
from ...diagnosis.results.outcome import Cause
from ...diagnosis.selection.explanation import Explanation
from ...diagnosis.settings import INTERVAL_DEVIATIONS


class SizeEstimate(NamedTuple):
    """Size of an effect and its standard error, in typical sizes."""

    value: float
    standard_error: float


def with_posterior_size(diagnosis: Diagnosis, cause: Cause) -> Cause:
    """Return a cause whose size is the mean over the sets that hold it.

    Args:
        diagnosis: of the change.
        cause: of it; one that no refitted set holds stays as it is.
    """
    estimate = posterior_size(diagnosis, cause.effect)
    if estimate is None:
        return cause
    effect = next(
        item
        for item in diagnosis.posterior.best_with(cause.effect).fit.effects
        if item.name == cause.effect
    )
    size = effect.sizes()[0]
    value = estimate.value * size.typical
    error = estimate.standard_error * abs(size.typical)
    reach = INTERVAL_DEVIATIONS * error
    entry: dict[str, Any] = {
        **cause.parameters[size.name],
        "value": value,
        "standard_error": error,
        "interval": [max(value - reach, size.low), min(value + reach, size.high)],
    }
    return replace(cause, parameters={**cause.parameters, size.name: entry})


def posterior_size(diagnosis: Diagnosis, name: str) -> SizeEstimate | None:
    """Return the size of an effect over all sets that hold it, None if there is none.

    Args:
        diagnosis: of the change.
        name: of the effect.
    """
    weights = []
    values = []
    variances = []
    for names, (explanation, probability) in diagnosis.posterior.sets.items():
        if name in names and probability > 0.0:
            value, error = _size_in(explanation, name)
            weights.append(probability)
            values.append(value)
            variances.append(error**2)
    if not weights:
        return None
    parts = np.array(weights) / sum(weights)
    mean = float(parts @ values)
    variance = float(parts @ (np.array(variances) + (np.array(values) - mean) ** 2))
    return SizeEstimate(mean, float(np.sqrt(variance)))


def _size_in(explanation: Explanation, name: str) -> SizeEstimate:
    """Return the size of an effect in one set.

    An effect that only corrects the form of others is part of their loss, so the size is that for
    no correction. The correction still counts in its error.
    """
    fit = explanation.fit
    first = fit.hypothesis.base_count
    names = [effect.name for effect in fit.effects]
    sizes = fit.theta[fit.hypothesis.size_indices]
    index = names.index(name)
    covariance = explanation.parameter_covariance[first:, first:]
    value = float(sizes[index])
    if explanation.form_error:
        correction = names.index(explanation.form_error)
        slope = covariance[index, correction] / covariance[correction, correction]
        value -= float(slope * sizes[correction])
    return SizeEstimate(value, float(np.sqrt(covariance[index, index])))
