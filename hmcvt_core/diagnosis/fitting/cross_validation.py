# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cross-validated errors of linear models.

Random folds measure how well a model interpolates between the points of a campaign. A promise also
holds for operating points and sessions that the campaign does not have, so other folds leave out
blocks of neighbouring points, or whole sessions (Roberts et al. 2017, Ecography 40, 913).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..observations import (
    SESSION,
    Observations,
    replicate_groups,
    tie_free,
)
from ..settings import FOLD_ASSIGNMENTS, FOLDS
from ..system import Array
from .evidence import LinearModel, gram, model_evidence

Fold = NDArray[np.intp]
"""Indices of the samples left out."""

BLOCK_ASSIGNMENTS = 4
"""Assignments of samples to blocks that are averaged.

Source: chosen; the clusters depend on where k-means begins.
"""

MIN_FREEDOM = 0.5
"""Minimum fraction of the degrees of freedom of left-out samples that their shared errors leave.

Source: chosen; with less, the correction of the errors would rest on a few readings.
"""

_SCIPY_SEEDS = 2**32
"""Seeds that SciPy takes: from 0 to below this number."""

_NEVER_KEPT = 1e-9
"""Fraction of a squared column in the kept samples up to which it is rounding."""


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


def block_assignments(observed: Observations, seed: int) -> list[list[Fold]]:
    """Assign the samples to blocks of neighbouring operating points several times.

    The blocks are clusters along the steered axes (k-means), as many as there are random folds.

    Args:
        observed: the campaign.
        seed: of the assignments.

    Returns:
        For each assignment its blocks.
    """
    from scipy.cluster.vq import kmeans2

    scaled = tie_free(observed.coordinates).T
    points = len(np.unique(scaled, axis=0))
    assignments = []
    for i in range(BLOCK_ASSIGNMENTS):
        with warnings.catch_warnings():
            # An empty cluster is no block; fewer blocks do as well.
            warnings.simplefilter("ignore", UserWarning)
            _, label = kmeans2(
                scaled,
                min(FOLDS, points),
                minit="++",
                seed=_scipy_seed(seed + 1000 * i),
            )
        assignments.append(_folds_of(label))
    return assignments


def _scipy_seed(seed: int) -> int | np.random.Generator:
    """Return a seed as SciPy takes it; a large one as a generator of NumPy."""
    if seed < _SCIPY_SEEDS:
        return seed
    return np.random.default_rng(seed)


def session_assignments(observed: Observations) -> list[list[Fold]]:
    """Assign the samples to folds that are whole sessions.

    Args:
        observed: the campaign; samples without a session form one more fold.

    Returns:
        The only assignment; none where fewer than two sessions are recorded.
    """
    label = observed.points.get(SESSION)
    if label is None or len(np.unique(label[label >= 0.0])) < 2:
        return []
    return [_folds_of(label)]


def _folds_of(label: NDArray[np.intp] | Array) -> list[Fold]:
    return [np.flatnonzero(label == value) for value in np.unique(label)]


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
        assignments: from `fold_assignments`, or of blocks or sessions.

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
    kept_count = np.array([[n - len(fold)] for fold in folds])
    left_out = []
    for fold in folds:
        left_out.append(gram(model.columns[:, fold], model.target[:, fold]))
    kept = whole - np.stack(left_out)
    posterior = model_evidence(
        kept,
        kept_count,
        model.spread,
        observed.prior_dof,
        model.signs,
        np.tile(model.noise, (len(folds), 1)),
    )
    # Squares of each column, over all channels.
    all_squares = np.einsum("cpp->p", whole)[:-1]
    kept_squares = np.einsum("fcpp->fp", kept)[:, :-1]
    never_kept = (kept_squares <= _NEVER_KEPT * all_squares) & (all_squares > 0.0)
    # An effect that only the samples left out show is a prediction that fails.
    only_left_out = never_kept & np.isnan(model.signs)
    errors = np.empty(n)
    for i, fold in enumerate(folds):
        coefficients = _with_possible_signs(
            posterior.mean[i], posterior.covariance[i], model.signs
        )
        error = model.target[0, fold] - model.columns[0, fold] @ coefficients
        shared = model.columns[0, fold][:, only_left_out[i]]
        if shared.shape[1]:
            spread = model.spread[only_left_out[i]]
            error = _without_shared_error(error, shared, spread, posterior.noise[i, 0])
        errors[fold] = error
    return errors


def _without_shared_error(
    error: Array, columns: Array, spread: Array, noise: float
) -> Array:
    """Return errors of left-out samples without the errors that they alone share.

    The zero of a meter in a session left out cannot be predicted, and is no gap of the model. It is
    estimated from the errors, which then lose degrees of freedom; the scale makes up for these.

    Args:
        error: in deviations, shape (m,).
        columns: of coefficients on which no other sample depends, shape (m, k).
        spread: prior standard deviations of these coefficients, shape (k,).
        noise: variance of the readings.
    """
    information = columns.T @ columns / noise + np.diag(spread**-2.0)
    smoother = columns @ np.linalg.solve(information, columns.T) / noise
    freedom = max(1.0 - np.trace(smoother) / len(error), MIN_FREEDOM)
    return np.asarray((error - smoother @ error) / np.sqrt(freedom))


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
