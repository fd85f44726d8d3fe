# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""How far the gap shrinks, promised for operating points and sessions not yet measured.

.. math:: S = 1 - G^2_{after} / G^2_{before}

G^2 is the mean square of what the machine does differently from a model, over the range that the
tests span: plans put many tests at its edges, where gaps are large, so each sample counts for the
part of the range that is nearest to it. By cross-validation G^2 is estimated twice:

- measured: the mean squared error at samples left out, less the noise. The folds are random points,
  blocks of neighbouring points, and whole sessions;
- expected: the mean square of the gap by the posterior over all explanations, each with an
  allowance for its forms. It holds what no fold shows: which explanation is right, and that
  coefficients fitted to few samples are uncertain.

Both count alike, but G^2 is not below the expected one. Of that the posterior promises its median
fraction. The interval pools the distributions of both
(linear opinion pool; Stone 1961, Ann. Math. Stat. 32, 1339), so that it is wide where they
disagree. On a holdout, G^2 is the measured one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import InputError
from ..analysis import Analysis, rms
from ..fitting.cross_validation import (
    Fold,
    block_assignments,
    cross_validated_errors,
    fold_assignments,
    session_assignments,
)
from ..fitting.refit import Fit
from ..observations import Observations, tie_free
from ..preparation import describe_samples
from ..selection.explanation import Explanation
from ..settings import DRAWS, MIN_SHRINKAGE, ROUNDING, SHRINKAGE_TAIL
from ..system import Array
from .outcome import Measurement, Predict, ShrinkageSummary


@dataclass(frozen=True, eq=False)
class ExpectedGap:
    """Draws of the gap from the posterior over all explanations.

    Attributes:
        before: of the base model, shape (draws, n); NaN where a drawn explanation has no answer.
        after: of the model with effects added, same shape.
    """

    before: Array
    after: Array


class CrossValidation:
    """Errors of explanations and models at samples left out, and how far each shrinks the gap.

    Args:
        analysis: of the campaign.
    """

    on = "cross-validation"

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        observed = analysis.base.observed
        self._assignments = fold_assignments(observed, analysis.seed)
        self._blocks = block_assignments(observed, analysis.seed)
        self._sessions = session_assignments(observed)
        self._errors: dict[Explanation, Array] = {}
        self._shrinkage: dict[Explanation, ShrinkageSummary] = {}

    @property
    def base_errors(self) -> Array:
        """Errors of the base model with random folds, shape (n,)."""
        return self.errors(self.analysis.posterior.base_only)

    def errors(self, explanation: Explanation) -> Array:
        """Return errors of the first channel at samples left out at random, shape (n,).

        A fold does not hold a size at its bound as the served fit does; the larger errors count.
        """
        if explanation not in self._errors:
            observed = self.analysis.base.observed
            left_out = cross_validated_errors(
                explanation.plain_model, observed, self._assignments
            )
            served = explanation.served_fit.whitened[0] * observed.deviation[0]
            larger = served if rms(served) > rms(left_out) else left_out
            self._errors[explanation] = larger + self._taken_by_meters(explanation)
        return self._errors[explanation]

    def _taken_by_meters(self, explanation: Explanation) -> Array:
        """Return what an explanation takes for errors of meters and all together do not, (n,).

        The base model alone takes a part of the gap for the zero of a meter.
        """
        fit = explanation.fit
        of_all, _ = self.analysis.shared_errors
        alone = explanation.plain_model.mean[fit.hypothesis.shared]
        change = fit.observed.shared_columns[0] @ (alone - of_all)
        return np.asarray(change * fit.observed.deviation[0])

    def shrinkage(self, explanation: Explanation) -> ShrinkageSummary:
        """Return how far the gap shrinks with an explanation held in every fold."""
        if explanation not in self._shrinkage:
            observed = self.analysis.base.observed
            self._shrinkage[explanation] = self._summary(
                self._errors_of_all_folds(explanation),
                _errors_at(observed, _handed_over(explanation)),
            )
        return self._shrinkage[explanation]

    def measured(self, explanation: Explanation) -> Measurement:
        """Return how far the gap shrinks with the model of an explanation, and its errors."""
        return Measurement(
            self.shrinkage(explanation),
            self.analysis.base.observed.samples,
            self.base_errors,
            self.errors(explanation),
        )

    def measured_model(self, predict: Predict, left_out: Array) -> Measurement:
        """Return how far the gap shrinks with any model, and its errors.

        Args:
            predict: the first channel at samples, by the model fitted to all samples.
            left_out: errors of the model at samples left out, shape (assignments, n).
        """
        samples = self.analysis.base.observed.samples
        measured = self.analysis.base.observed.measured[0]
        after = np.sqrt(np.mean(np.square(left_out), axis=0))
        summary = self._summary(after, measured - predict(samples))
        return Measurement(summary, samples, self.base_errors, left_out.mean(axis=0))

    def _summary(self, left_out: Array, at_samples: Array) -> ShrinkageSummary:
        """Return how far the gap shrinks with a model.

        Args:
            left_out: its errors at samples left out, shape (n,).
            at_samples: errors at the samples, when it is fitted to all of them, shape (n,).
        """
        if not self.analysis.significant:
            errors = self.base_errors
            noise = self.analysis.noise
            seed = self.analysis.seed
            return shrinkage(errors, errors, noise, self.on, seed, False)
        base = _errors_at(self.analysis.base.observed, self.analysis.base)
        after = self._gap_draws - base + at_samples
        return shrinkage(
            self._errors_of_all_folds(self.analysis.posterior.base_only),
            left_out,
            self._believed_noise,
            self.on,
            self.analysis.seed,
            blocks=[*self._blocks, *self._sessions],
            expected=ExpectedGap(self._gap_draws, after),
            shares=self._shares,
        )

    def _errors_of_all_folds(self, explanation: Explanation) -> Array:
        """Return root mean squares of the errors with random folds, blocks and sessions, (n,)."""
        kinds = [self.errors(explanation)]
        for assignments in (self._blocks, self._sessions):
            if assignments:
                left_out = cross_validated_errors(
                    explanation.plain_model, self.analysis.base.observed, assignments
                )
                kinds.append(left_out + self._taken_by_meters(explanation))
        return np.asarray(np.sqrt(np.mean(np.square(kinds), axis=0)))

    @property
    def _believed_noise(self) -> Array:
        """Noise of the first channel, shape (n,), not above its statement.

        What exceeds a stated noise counts as gap: a fit explains away as noise what it misses.
        """
        observed = self.analysis.base.observed
        if observed.assumed:
            return self.analysis.noise
        return np.minimum(self.analysis.noise, observed.deviation[0])

    @cached_property
    def _shares(self) -> Array:
        """What each sample counts, shape (n,)."""
        return shares_of_range(self.analysis.base)

    @cached_property
    def _gap_draws(self) -> Array:
        """Draws of the gap of the base model at the samples, shape (draws, n).

        An explanation is drawn by its probability, then its coefficients from their posterior.
        """
        observed = self.analysis.base.observed
        entries = self.analysis.predictions
        probabilities = [probability for _, probability in entries]
        rng = np.random.default_rng(self.analysis.seed)
        drawn = rng.choice(len(entries), DRAWS, p=probabilities)
        most = max(len(prediction.covariance) for prediction, _ in entries)
        # One row for each draw, whatever explanation it is of: how often one explanation is drawn
        # changes no draw of another.
        normal = rng.standard_normal((DRAWS, most))
        draws = np.empty((DRAWS, len(observed)))
        for i in np.unique(drawn):
            prediction, _ = entries[i]
            rows = np.flatnonzero(drawn == i)
            root = _root(prediction.covariance)
            change = normal[rows, : root.shape[1]] @ root.T
            draws[rows] = prediction.mean[0] + change @ prediction.columns[0].T
        # Predicted minus measured, and measured minus base.
        base = _errors_at(observed, self.analysis.base)
        return np.asarray(draws * observed.deviation[0] + base)


def _root(covariance: Array) -> Array:
    """Return a matrix whose product with its transpose is a covariance, shape (p, p).

    Units of coefficients differ by orders of magnitude, so the correlations are factored. Their
    symmetric root is unique: rounding does not change what is drawn.
    """
    deviation = np.sqrt(np.diagonal(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    root = vectors * np.sqrt(values.clip(0.0)) @ vectors.T
    return np.asarray(deviation[:, None] * root)


def shares_of_range(base: Fit) -> Array:
    """Return the part of the range of the tests that each sample is nearest to, shape (n,).

    The range holds the samples, and the tests that can be run between the lowest and the highest
    of each axis. Samples at one point share its part.
    """
    from scipy.spatial import cKDTree

    observed = base.observed
    tests = base.hypothesis.system.candidates(observed.points, base.base)
    possible = observed.coordinates_of(tests)
    inside = observed.is_inside(possible)
    within = np.concatenate([possible[:, inside], observed.coordinates], axis=1)
    within = tie_free(within, observed.coordinates).T
    points, point, repeats = np.unique(
        within[-len(observed) :], axis=0, return_inverse=True, return_counts=True
    )
    _, nearest = cKDTree(points).query(within)
    near = np.bincount(nearest, minlength=len(points)) / len(within)
    return np.asarray((near / repeats)[point.ravel()])


class Holdout:
    """Errors of models on a holdout, and how far each shrinks the gap.

    Samples that do not state their noise have that of the campaign.

    Args:
        analysis: of the campaign.
        held_out: samples of the holdout.
    """

    on = "holdout"

    def __init__(self, analysis: Analysis, held_out: Observations) -> None:
        self.analysis = analysis
        self.held_out = held_out

    def measured(self, explanation: Explanation) -> Measurement:
        """Return how far the gap shrinks with the model of an explanation, and its errors.

        Raises:
            InputError: the model has no answer at any sample of the holdout.
        """
        return self._measured(_errors_at(self.held_out, _handed_over(explanation)))

    def measured_model(self, predict: Predict, left_out: Array) -> Measurement:
        """Return how far the gap shrinks with any model, and its errors.

        Args:
            predict: the first channel at samples, by the model fitted to the campaign.
            left_out: errors at samples of the campaign left out; the holdout needs none.

        Raises:
            InputError: as `measured`.
        """
        predicted = predict(self.held_out.samples)
        return self._measured(self.held_out.measured[0] - predicted)

    def _measured(self, after: Array) -> Measurement:
        held_out = self.held_out
        before = _errors_at(held_out, self.analysis.base)
        answered = np.isfinite(before) & np.isfinite(after)
        if not answered.any():
            raise InputError(
                f"{held_out.samples.source}: the model has no answer at any of the operating "
                "points held out"
            )
        counted = held_out.select(np.flatnonzero(answered))
        noise = counted.deviation[0]
        if counted.assumed:
            noise = np.full(len(counted), rms(self.analysis.noise))
        before = before[answered]
        after = after[answered]
        summary = shrinkage(
            before,
            after,
            noise,
            self.on,
            self.analysis.seed,
            self.analysis.significant,
        )
        refused = np.flatnonzero(~answered)
        return Measurement(
            summary, counted.samples, before, after, self._notes(refused)
        )

    def _notes(self, refused: Fold) -> tuple[str, ...]:
        """Return a note on samples that do not count."""
        if not len(refused):
            return ()
        held_out = self.held_out
        refusal = self.analysis.base.hypothesis.system.refusal
        return (
            f"{len(refused)} of {len(held_out)} held-out samples {refusal} and do not "
            f"count: {describe_samples(held_out, refused)}",
        )


def _handed_over(explanation: Explanation) -> Fit:
    """Return the fit of the model that is handed over with an explanation."""
    return explanation.served_fit if explanation.names else explanation.fit


def _errors_at(observed: Observations, fit: Fit) -> Array:
    """Return measured minus predicted of the first channel; NaN without an answer, shape (n,)."""
    predicted = fit.hypothesis.predict(fit.theta, observed.points)[0]
    return np.asarray(observed.measured[0] - predicted)


def shrinkage(
    before: Array,
    after: Array,
    noise: Array | float,
    on: str,
    seed: int,
    significant: bool = True,
    *,
    blocks: Sequence[Sequence[Fold]] = (),
    expected: ExpectedGap | None = None,
    shares: Array | None = None,
) -> ShrinkageSummary:
    """Return how far the gap shrinks, from errors on data not used for the fit.

    Args:
        before: errors of the first channel with the base model, shape (n,).
        after: the same with effects added, shape (n,).
        noise: standard deviation of the first channel at each, shape (n,) or scalar.
        on: where the errors come from.
        seed: of the bootstrap.
        significant: whether there is a gap at all; without one `fraction` is None.
        blocks: assignments of the samples to blocks, which are drawn whole; single samples are
            drawn if there are none.
        expected: draws of the gap by the posterior; None counts the errors alone.
        shares: what each sample counts, shape (n,), with the sum 1; even if None.
    """
    if shares is None:
        shares = np.full(len(before), 1.0 / len(before))
    variances = np.broadcast_to(np.square(noise), before.shape)
    squares = np.stack([before**2, after**2], axis=1) - variances[:, None]
    gap_squares = np.maximum(shares @ squares, 0.0)
    if expected is not None:
        gap_squares = _squares_with_posterior(gap_squares, expected, shares)
    fraction = None
    interval = None
    if significant and gap_squares[0] > 0.0:
        fraction = float(_fractions(gap_squares[None])[0])
        weights = _bootstrap_weights(shares, seed, blocks)
        interval = _interval(squares, fraction, weights, expected)
    root_before, root_after = np.sqrt(gap_squares).tolist()
    return ShrinkageSummary(root_before, root_after, fraction, interval, on)


def _squares_with_posterior(
    measured: Array, expected: ExpectedGap, shares: Array
) -> Array:
    """Return G^2 before and after, from the posterior and from errors, shape (2,).

    The posterior gives its median fraction, because a few draws with a large gap would lower every
    promise. What the errors exceed the posterior mean by counts half: both count alike.

    Args:
        measured: G^2 before and after, from errors at samples left out, shape (2,).
        expected: draws of the gap by the posterior.
        shares: as of `shrinkage`.
    """
    draws = _mean_squares(expected, np.broadcast_to(shares, expected.before.shape))
    mean = draws.mean(axis=0)
    excess = np.maximum(measured - mean, 0.0) / 2.0
    kept = 1.0 - np.median(_fractions(draws))
    return np.array([mean[0], mean[0] * kept]) + excess


def _fractions(squares: Array) -> Array:
    """Fraction removed of rows of G^2 before and after, shape (k, 2) to (k,)."""
    before, after = squares.T
    # After: not below the noise, and a gap shrinks by no more than all of it.
    return np.clip(1.0 - after / before, MIN_SHRINKAGE, 1.0)


def _interval(
    squares: Array, fraction: float, weights: Array, expected: ExpectedGap | None
) -> tuple[float, float] | None:
    """Return the interval of a fraction, widened to contain it; None where no draw has a gap.

    Args:
        squares: squared errors before and after less the noise, shape (n, 2).
        fraction: the estimate.
        weights: of the samples in each draw, shape (draws, n).
        expected: as of `shrinkage`; every other draw is one of the posterior.
    """
    draws = weights @ squares
    if expected is not None:
        draws[1::2] = _mean_squares(expected, weights)[1::2]
    draws = draws[draws[:, 0] > 0.0]
    if not len(draws):
        return None
    tails = [SHRINKAGE_TAIL, 1.0 - SHRINKAGE_TAIL]
    low, high = np.quantile(_fractions(draws), tails).tolist()
    return min(low, fraction), max(high, fraction)


def _mean_squares(expected: ExpectedGap, weights: Array) -> Array:
    """Return mean squares of drawn gaps before and after, shape (draws, 2).

    Args:
        expected: the draws.
        weights: of the samples in each draw, shape (draws, n).
    """
    columns = []
    for gap in (expected.before, expected.after):
        answered = np.isfinite(gap) & np.isfinite(expected.before)
        weight = weights * answered
        total = np.sum(weight * np.where(answered, gap, 0.0) ** 2, axis=1)
        columns.append(total / np.maximum(weight.sum(axis=1), ROUNDING))
    return np.stack(columns, axis=1)


def _bootstrap_weights(
    shares: Array, seed: int, blocks: Sequence[Sequence[Fold]]
) -> Array:
    """Return weights of samples in draws with replacement, rows summing to 1, shape (draws, n).

    Samples of one block share what they deviate by, so blocks are drawn whole (block bootstrap;
    Kuensch 1989, Ann. Stat. 17, 1217). The assignments take turns.

    Args:
        shares: as of `shrinkage`.
        seed: of the draws.
        blocks: as of `shrinkage`.
    """
    n = len(shares)
    rng = np.random.default_rng(seed)
    weights = np.empty((DRAWS, n))
    labels = [np.arange(n)]
    if blocks:
        labels = [_labels(n, folds) for folds in blocks]
    for draw in range(DRAWS):
        # In pairs: every other draw is one of the posterior.
        label = labels[draw // 2 % len(labels)]
        count = int(label.max()) + 1
        drawn = np.bincount(rng.integers(0, count, count), minlength=count)
        weights[draw] = shares * drawn[label]
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _labels(n: int, folds: Sequence[Fold]) -> Fold:
    """Return the number of the fold of each sample, shape (n,)."""
    label = np.empty(n, dtype=np.intp)
    for number, fold in enumerate(folds):
        label[fold] = number
    return label
