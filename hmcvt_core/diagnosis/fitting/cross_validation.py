# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cross-validated errors of linear models."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..observations import Observations, replicate_groups
from ..settings import FOLD_ASSIGNMENTS, FOLDS
from ..system import Array
from .evidence import LinearModel, gram, model_evidence

Fold = NDArray[np.intp]
"""Indices of the samples left out."""


def fold_assignments(observed: Observations, seed: int) -> list[list[Fold]]:
    """Assign the samples to folds several times, at random.

    Repeated points stay in one fold. A campaign of few points is assigned once, each point a fold.

    Args:
        observed: the campaign.
        seed: of the assignments.

    Returns:
        For each assignment its folds.
    """
    group = replicate_groups(observed.axes, observed.points)
    points = int(group.max()) + 1
    leave_one_out = points <= FOLDS
    assignments = []
    for i in range(1 if leave_one_out else FOLD_ASSIGNMENTS):
        order = np.random.default_rng(seed + 1000 * i).permutation(points)
        parts = np.array_split(order, min(FOLDS, points))
        assignments.append([np.flatnonzero(np.isin(group, part)) for part in parts])
    return assignments


def cross_validated_errors(
    model: LinearModel,
    observed: Observations,
    assignments: Sequence[Sequence[Fold]],
) -> Array:
    """Return errors of the first channel at samples left out, all coefficients refitted.

    The assignment to folds is chance. Over several of them the error of a sample is its root mean
    square, with the sign of its mean.

    Args:
        model: refitted in each fold.
        observed: the readings.
        assignments: from `fold_assignments`.

    Returns:
        In the unit of the channel, shape (n,).
    """
    whole = gram(model.columns, model.target)
    rows = []
    for folds in assignments:
        rows.append(_left_out_errors(model, observed, folds, whole))
    errors = np.stack(rows) * observed.deviation[0]
    magnitude = np.sqrt(np.mean(errors**2, axis=0))
    return np.asarray(np.copysign(magnitude, errors.mean(axis=0)))


def _left_out_errors(
    model: LinearModel, observed: Observations, folds: Sequence[Fold], whole: Array
) -> Array:
    """Return errors of the first channel for one assignment, in deviations, shape (n,).

    Args:
        model: refitted in each fold.
        observed: the readings.
        folds: the parts left out.
        whole: Gram matrices of all samples, shape (channels, p + 1, p + 1).
    """
    n = len(observed)
    kept = np.array([[n - len(fold)] for fold in folds])
    left_out = []
    for fold in folds:
        left_out.append(gram(model.columns[:, fold], model.target[:, fold]))
    posterior = model_evidence(
        whole - np.stack(left_out),
        kept,
        model.spread,
        observed.prior_dof,
        model.signs,
    )
    errors = np.empty(n)
    for fold, mean, covariance in zip(
        folds, posterior.mean, posterior.covariance, strict=True
    ):
        coefficients = _with_possible_signs(mean, covariance, model.signs)
        predicted = model.columns[0, fold] @ coefficients
        errors[fold] = model.target[0, fold] - predicted
    return errors


def _with_possible_signs(mean: Array, covariance: Array, signs: Array) -> Array:
    """Set sizes of an impossible sign to zero, the other coefficients to their mean given that.

    One size after another, with the covariance as given: exact for a single one.

    Args:
        mean: posterior mean, shape (p,).
        covariance: posterior covariance, shape (p, p).
        signs: as in `Hypothesis.signs`, shape (p,).
    """
    for i in np.flatnonzero(signs * mean < 0.0):
        along = covariance[:, i]
        mean = mean - along * mean[i] / along[i]
    return mean
