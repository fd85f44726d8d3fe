# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cross-validation: a refit and the model in service on samples that the refit has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.accuracy import carried_at, relative_errors
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, PARAMETER_NAMES
from ..transmission.ranges import Array
from .robust import MEDIAN_TO_DEVIATION

FOLDS = 5
FEWEST = len(PARAMETER_NAMES) + 1
"""Fewest samples that can spare one; fewer cannot determine the parameters without it."""

_NOISIEST = 3.0
"""Noise of the worst bench, in terms of the paper's; chosen on development campaigns."""
_ALLOWANCE = 2.0
"""In terms of what a fit flatters itself by, see `cross_validate`."""


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
        return (
            self.error_refit - self.error_in_service > self.allowance
            and self.change > self.allowance
        )


def cross_validate(
    samples: BenchSamples,
    refit: EfficiencyModel,
    in_service: EfficiencyModel,
    fold: NDArray[np.intp],
    others: Sequence[EfficiencyModel],
) -> CrossValidation:
    """Compare a refit with the model in service on samples that it has not seen.

    Noise decides over small differences, so the refit counts as worse only when it is worse by more
    than an allowance, and when it answers differently by more than that. A fit of p parameters to n
    samples flatters itself by about p / n of the noise against new samples, and the model in
    service may be such a fit to these very samples; the allowance is twice that. Without the second
    condition a refit of unchanged samples, which gives the model in service again, could count as
    worse than it.

    Args:
        samples: that `refit` was fitted to.
        refit: the model fitted to all of them.
        in_service: the model to beat.
        fold: of each sample, shape (n,), see `folds`.
        others: for each fold, the refit to the samples outside it.
    """
    measured = samples.efficiency
    unseen = np.empty(len(samples))
    for number, other in enumerate(others):
        left_out = fold == number
        unseen[left_out] = carried_at(other, samples.select(left_out).points)
    served = carried_at(in_service, samples.points)
    refitted = carried_at(refit, samples.points)
    errors = relative_errors(served, measured)
    noise = _noise(errors, relative_errors(refitted, measured))
    return CrossValidation(
        samples=len(samples),
        folds=len(others),
        error_refit=float(relative_errors(unseen, measured).mean()),
        error_in_service=float(errors.mean()),
        allowance=float(_ALLOWANCE * len(PARAMETER_NAMES) / len(samples) * noise),
        change=float(np.mean(np.abs(refitted - served) / measured)),
    )


def _noise(served_errors: Array, refit_errors: Array) -> float:
    """Noise as the better of the two models sees it, relative [-].

    From medians, so that a few bad samples do not pass for noise and excuse the refit they spoil;
    not below that of the paper's bench: a fit to a handful of samples leaves no residual.
    """
    better = min(np.median(served_errors), np.median(refit_errors))
    return float(
        np.clip(
            MEDIAN_TO_DEVIATION * better,
            PAPER_EFFICIENCY_UNCERTAINTY,
            _NOISIEST * PAPER_EFFICIENCY_UNCERTAINTY,
        )
    )


def folds(samples: BenchSamples, seed: int) -> NDArray[np.intp]:
    """Assign n samples to folds of like displacement ratios.

    Power circulates on one side of zero and not on the other: a fit that has seen one side only
    says little about the other. With four or five samples a fold is one of them.

    Args:
        samples: to assign.
        seed: of the random numbers.

    Returns:
        Number of the fold of each sample, shape (n,); -1 for fewer than `FEWEST`.
    """
    count = len(samples)
    fold = np.full(count, -1)
    if count < FEWEST:
        return fold
    number = min(count, FOLDS)
    rng = np.random.default_rng(seed)
    # Among neighbours in the displacement ratio each fold gets one.
    blocks = [rng.permutation(number) for _ in range(0, count, number)]
    order = np.argsort(samples.displacement_ratio, kind="stable")
    fold[order] = np.concatenate(blocks)[:count]
    return fold
