# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cross-validated errors of linear models."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..observations import Observations, replicate_groups
from ..settings import FOLD_ASSIGNMENTS, FOLDS
from ..system import Array
from .evidence import LinearModel, gram, model_evidence


def fold_assignments(observed: Observations, seed: int) -> list[list[NDArray[np.intp]]]:
    """Deal the samples to folds several times; once where every point is left out alone.

    Each fold is the part left out; repeated points stay together.
    """
    group = replicate_groups(observed.axes, observed.points)
    points = int(group.max()) + 1
    orders = [
        np.random.default_rng(seed + 1000 * i).permutation(points)
        for i in range(1 if points <= FOLDS else FOLD_ASSIGNMENTS)
    ]
    return [
        [
            np.flatnonzero(np.isin(group, part))
            for part in np.array_split(order, min(FOLDS, points))
        ]
        for order in orders
    ]


def cross_validated_errors(
    model: LinearModel,
    observed: Observations,
    dealt: Sequence[Sequence[NDArray[np.intp]]],
) -> Array:
    """Errors of the first channel at samples left out, (n,); all coefficients refitted each time.

    How samples are dealt to the folds is chance: over several deals the root of the mean square at
    each sample, with the sign of the mean.
    """
    n, errors = len(observed), np.empty((len(dealt), len(observed)))
    for parts, own in zip(dealt, errors, strict=True):
        count = np.array([[n - len(part)] for part in parts])
        left_out = np.stack(
            [gram(model.columns[:, part], model.target[:, part]) for part in parts]
        )
        found = model_evidence(
            gram(model.columns, model.target) - left_out,
            count,
            model.spread,
            observed.prior_dof,
            model.signs,
        )
        for part, mean, covariance in zip(
            parts, found.mean, found.covariance, strict=True
        ):
            for size in np.flatnonzero(model.signs * mean < 0.0):
                # The others as they are once it is known to be zero.
                along = covariance[:, size]
                mean = mean - along * mean[size] / along[size]
            own[part] = model.target[0, part] - model.columns[0, part] @ mean
    errors *= observed.deviation[0]
    return np.asarray(
        np.copysign(np.sqrt(np.mean(errors**2, axis=0)), errors.mean(axis=0))
    )
