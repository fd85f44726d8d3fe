# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Does a refit predict samples that it has not seen, as well as the model in service does?

The samples are dealt into five folds that all span the displacement ratio; each fold is predicted
by a refit of the others. With four or five samples that is one sample at a time.

Noise decides over small differences, so the refit is called worse only when it is worse by more
than an allowance, and when it answers differently by more than that. A fit of p parameters to n
samples flatters itself by about p / n of the noise against new samples, and the model in service
may be such a fit to these very samples; the allowance is twice that. Without the second condition
a refit of unchanged samples, which gives the model in service again, could be called worse than it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.agreement import carried_at, relative_errors
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, PARAMETER_NAMES
from .annealing import Schedule

Array = NDArray[np.float64]
FOLDS = 5
QUICK = Schedule(chains=8, moves=2)
"""Annealing enough for the refits: only what the local search makes of it counts."""
FEWEST = len(PARAMETER_NAMES) + 1
"""Fewest samples that can spare one; fewer cannot determine the parameters without it."""

MEDIAN_TO_DEVIATION = 1.4826
"""Median of absolute values to standard deviation, normal distribution."""

_NOISIEST = 3.0  # benches, in terms of the paper's; beyond that it is no noise
_ALLOWANCE = 2.0


@dataclass(frozen=True)
class CrossValidation:
    """Outcome of the comparison; every error is a mean of |predicted - measured| / measured [-].

    Attributes:
        samples: how many, each predicted once by a refit that has not seen it.
        folds: how many refits predicted them.
        error_refit: of these refits.
        error_in_service: of the model in service, at the same samples.
        allowance: by how much the first may exceed the second.
        change: mean of |refit to all samples - model in service| / measured.
    """

    samples: int
    folds: int
    error_refit: float
    error_in_service: float
    allowance: float
    change: float

    @property
    def worse(self) -> bool:
        """Whether the refit is worse by more than noise explains."""
        return (self.error_refit - self.error_in_service > self.allowance
                and self.change > self.allowance)


def cross_validate(
    samples: BenchSamples,
    refit: EfficiencyModel,
    in_service: EfficiencyModel,
    fit: Callable[[BenchSamples], EfficiencyModel],
    seed: int = 0,
) -> CrossValidation | None:
    """Compare a refit with the model in service on samples that it has not seen.

    Args:
        samples: that `refit` was fitted to.
        refit: the model fitted to all of them.
        in_service: the model to beat.
        fit: makes a refit to a part of the samples.
        seed: of the deal into folds.

    Returns:
        The comparison, None when there are fewer than `FEWEST` samples.
    """
    if len(samples) < FEWEST:
        return None
    measured, unseen = samples.efficiency, np.empty(len(samples))
    parts = list(folds(samples.displacement_ratio, seed))
    for part in parts:
        others = np.setdiff1d(np.arange(len(samples)), part)
        unseen[part] = carried_at(
            fit(samples.select(others)), samples.select(part).points)
    served, refitted = carried_at(in_service, samples.points), carried_at(refit, samples.points)
    errors = relative_errors(served, measured)
    noise = _noise(errors, relative_errors(refitted, measured))
    return CrossValidation(
        len(samples), len(parts), float(relative_errors(unseen, measured).mean()),
        float(errors.mean()),
        float(_ALLOWANCE * len(PARAMETER_NAMES) / len(samples) * noise),
        float(np.mean(np.abs(refitted - served) / measured)))


def folds(displacement_ratio: Array, seed: int) -> Iterator[NDArray[np.intp]]:
    """Deal samples into folds of like displacement ratios; yields the indices of each fold.

    Power circulates on one side of zero and not on the other: a fit that has seen one side only
    says little about the other.
    """
    count = len(displacement_ratio)
    number = min(count, FOLDS)
    rng = np.random.default_rng(seed)
    fold = np.empty(count, dtype=int)
    fold[np.argsort(displacement_ratio, kind="stable")] = np.concatenate(
        [rng.permutation(number) for _ in range(0, count, number)])[:count]
    for label in range(number):
        yield np.flatnonzero(fold == label)


def _noise(in_service: Array, refit: Array) -> float:
    """Relative standard deviation of the readings, as the better of the two models sees it.

    From medians, so that a few bad samples do not pass for noise and excuse the refit they spoil;
    not below what the paper's bench has, since a fit to a handful of samples leaves no residual.
    """
    seen = MEDIAN_TO_DEVIATION * min(np.median(in_service), np.median(refit))
    return float(np.clip(seen, PAPER_EFFICIENCY_UNCERTAINTY,
                         _NOISIEST * PAPER_EFFICIENCY_UNCERTAINTY))
