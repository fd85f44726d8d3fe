# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which samples belong together: reweighted least trimmed squares.

[Rousseeuw & Leroy 1987, Robust Regression and Outlier Detection, ch. 5]
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.domain import AXES
from ..transmission.parameters import PARAMETER_NAMES, SEARCH_BOUNDS, from_scaled
from ..transmission.ranges import Array
from .prior import Prior
from .problem import Problem
from .side_by_side import LeastSquares

MEDIAN_TO_DEVIATION = 1.4826
"""Median of absolute values to standard deviation, normal distribution."""

Mask = NDArray[np.bool_]

_SAME_POINT = 0.05
"""Width of the cells whose samples share an operating point, in terms of the range of displacement
ratio, speed and torque. Near copies of a sample lie in one cell, also when they are jittered by 1 %
of the range; chosen on development campaigns."""
_SHIFTS = np.array(list(itertools.product((0.0, 0.5), repeat=len(AXES))))
"""Grids of cells, in widths of a cell: near copies lie in one cell of at least one of them."""
_FALSE_ALARM = 0.01
"""Share of campaigns in which an honest sample may be rejected, at most."""
_SMALL_SAMPLE = 5.0
"""Correction of the scatter for few samples, by Rousseeuw & Leroy: 1 + 5 / (n - p)."""
_LEAKAGE_SHARES = (0.95, 0.9, 0.8, 0.65, 0.5, 0.3)
"""Of the leakage of a consensus: fits that begin with less leakage carry more load."""
_TRIED = 1000
"""Random changes; with twice as many no more wrong samples are found (development campaigns)."""
_STARTS = 10
"""Best of them, to be concentrated: as many as in FAST-LTS [Rousseeuw & Van Driessen 2006]."""
_CONCENTRATIONS = 3
_CONCENTRATION_GAIN = 1e-3
"""Of the weighted squares, of order 1 for each sample: a step that gains less ends a concentration,
which only finds where the reweighted fit begins."""
_REWEIGHTINGS = 10
_NO_ANSWER = 1e3  # residual
_STEP = 1e-5  # of the differences, in terms of `Prior.root`
_MAX_ANNEALED = 500
"""Samples that an annealing looks at: it costs some 13,000 predictions of each."""


def thinned(samples: BenchSamples) -> BenchSamples:
    """As many samples as the annealing looks at, spread over the displacement ratio."""
    if len(samples) <= _MAX_ANNEALED:
        return samples
    return samples.select(thinned_rows(samples))


def thinned_rows(samples: BenchSamples) -> NDArray[np.intp]:
    """Return the positions of the samples that `thinned` keeps, by displacement ratio."""
    order = np.argsort(samples.displacement_ratio, kind="stable")
    count = min(len(order), _MAX_ANNEALED)
    spread = np.linspace(0, len(order) - 1, count).astype(int)
    return np.asarray(order[spread])


@dataclass(frozen=True, eq=False)
class RobustProblem(Problem):
    """Samples and the model in service; variables are changes of it in terms of `Prior.root`."""

    @cached_property
    def prior(self) -> Prior:
        """What the model in service states."""
        return Prior.of(self.model)

    @cached_property
    def point_numbers(self) -> NDArray[np.intp]:
        """Number of the operating point of each sample, shape (n,).

        A sample belongs to the cell with most samples among those of several grids.
        """
        columns = np.array([getattr(self.samples, axis) for axis in AXES])
        size = np.array([1.0, *columns[1:].max(axis=1)])
        position = columns.T / (_SAME_POINT * size)
        fullest = np.zeros(len(position), dtype=np.intp)
        numbers = np.zeros(len(position), dtype=np.intp)
        first_free = 0
        for shift in _SHIFTS:
            cells = np.floor(position + shift)
            cell = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
            count = np.bincount(cell)[cell]
            fuller = count > fullest
            numbers = np.where(fuller, first_free + cell, numbers)
            fullest = np.maximum(count, fullest)
            first_free += int(cell.max()) + 1
        return np.unique(numbers, return_inverse=True)[1].ravel()

    @cached_property
    def votes(self) -> Array:
        """Weight of each sample, shape (n,): those at one operating point have one vote."""
        return 1.0 / np.bincount(self.point_numbers)[self.point_numbers]

    def parameters(self, variables: Array) -> Array:
        """Parameters in SI units of changes (..., 3)."""
        return self.prior.parameters(variables)

    def residuals(self, variables: Array) -> Array:
        """(Predicted - measured) / deviation, shape (..., n); large where there is no answer."""
        return np.nan_to_num(super().residuals(variables), nan=_NO_ANSWER)

    def slopes(self, change: Array) -> Array:
        """Derivatives of the residuals, shape (n, 3)."""
        step = _STEP * np.eye(len(change))
        residuals = self.residuals(np.vstack([change - step, change + step]))
        below, above = np.split(residuals, 2)
        return (above - below).T / (2.0 * _STEP)

    def scatter(self, residuals: Array, weights: Array) -> Array:
        """Standard deviation of residuals (..., n); the stated one counts as one residual."""
        free = np.maximum(weights.sum(axis=-1) - len(PARAMETER_NAMES), 0.0)
        return np.sqrt((1.0 + (weights * residuals**2).sum(axis=-1)) / (1.0 + free))

    def least_squares(self, start: Array, weights: Array) -> Array:
        """Weighted least squares with the prior: the change, shape (3,)."""
        return self._fits(start[None], weights)[0]

    def nearest(
        self, start: Array, weights: Array, directions: Array, precision: Array
    ) -> Array:
        """Weighted least squares along some directions, each with a prior.

        Args:
            start: steps along them, shape (k,).
            weights: of the squared residuals, shape (n,).
            directions: columns, in terms of `Prior.root`, shape (3, k).
            precision: of the prior of a step along each, shape (k,).

        Returns:
            The change, shape (3,).
        """
        steps = self._steps(start[None], weights, directions, precision)[0]
        return np.asarray(directions @ steps)

    def _fits(self, starts: Array, weights: Array, small_gain: float = 0.0) -> Array:
        """Weighted least squares with the prior from m starts: changes, shape (m, 3).

        Args:
            starts: changes, shape (m, 3).
            weights: of the squared residuals of each, shape (m, n) or (n,).
            small_gain: a step that changes the squares by less ends a search.
        """
        count = starts.shape[1]
        return self._steps(starts, weights, np.eye(count), np.ones(count), small_gain)

    def _steps(
        self,
        starts: Array,
        weights: Array,
        directions: Array,
        precision: Array,
        small_gain: float = 0.0,
    ) -> Array:
        """Steps (m, k) of least squares from m starts (m, k), see `nearest` and `_fits`."""
        weight_roots = np.sqrt(weights)[..., None, :]
        prior_roots = np.sqrt(precision)

        def misses(steps: Array) -> Array:
            residuals = weight_roots * self.residuals(steps @ directions.T)
            return np.concatenate([residuals, prior_roots * steps], axis=-1)

        count = starts.shape[1]
        everywhere = np.tile([-np.inf, np.inf], (count, 1))
        squares = LeastSquares(misses, everywhere, np.full(count, _STEP))
        return squares.fitted(starts, small_gain=small_gain)[0]

    def better_half(self, residuals: Array) -> Mask:
        """Which samples (..., n) are the smallest majority of the votes by their residuals."""
        order = np.argsort(np.abs(residuals), axis=-1)
        majority = 0.5 * (self.votes.sum() + len(PARAMETER_NAMES) + 1.0)
        before = np.cumsum(self.votes[order], axis=-1) - self.votes[order]
        half = np.empty(order.shape, dtype=bool)
        np.put_along_axis(half, order, before < majority - 1e-9, axis=-1)
        return half

    def consensus(self, seed: int) -> tuple[Array, Mask]:
        """Reweighted least trimmed squares.

        Args:
            seed: of the random numbers.

        Returns:
            The change that most samples agree on, shape (3,); which samples belong, shape (n,).
        """
        change = self._least_trimmed_squares(seed)
        residuals = self.residuals(change)
        free = max(self.votes.sum() - len(change), 1.0)
        largest = float(np.abs(residuals[self.better_half(residuals)]).max())
        scatter = MEDIAN_TO_DEVIATION * (1.0 + _SMALL_SAMPLE / free) * largest
        belongs = np.abs(residuals) <= self._cutoff() * scatter
        change, belongs = self._reweighted(change, belongs, scatter)
        return self._with_unanswered(change, belongs)

    def _cutoff(self, free: float = np.inf) -> float:
        """Maximum deviation of an honest sample, in standard deviations.

        Args:
            free: degrees of freedom of the residuals that give the standard deviation.
        """
        from scipy.stats import t

        return float(t.isf(0.5 * _FALSE_ALARM / len(self.samples), free))

    def _reweighted(
        self, change: Array, belongs: Mask, scatter: float
    ) -> tuple[Array, Mask]:
        """Fit the samples that belong, and decide under that fit which belong, until both agree.

        Args:
            change: to begin with, shape (3,).
            belongs: to begin with, shape (n,).
            scatter: standard deviation of the residuals to begin with.
        """
        for _ in range(_REWEIGHTINGS):
            weights = self.votes * belongs
            change = self.least_squares(change, weights / scatter**2)
            residuals = self.residuals(change)
            slopes = self.slopes(change) / scatter
            scatter = float(self.scatter(residuals, weights))
            leverage = _leverage(slopes, weights)
            # The fit misses a sample that it has not seen by more than one that it has seen.
            spread = scatter * np.sqrt(np.where(belongs, 1.0, 1.0 + leverage))
            # The stated deviation counts as one residual.
            free = 1.0 + max(float(weights.sum()) - len(change), 0.0)
            still_belongs = np.abs(residuals) <= self._cutoff(free) * spread
            settled = bool((still_belongs == belongs).all())
            belongs = still_belongs
            if settled:
                break
        return change, belongs

    def _with_unanswered(self, change: Array, belongs: Mask) -> tuple[Array, Mask]:
        """Add samples at which the consensus has no answer, where a fit close to it has one.

        Close to stall a little more leakage than the true one leaves a load without an answer. Its
        residual decides nothing then, but a fit that begins with less leakage does.
        """
        for share in _LEAKAGE_SHARES:
            unanswered = ~belongs & np.isnan(self.predict(change))
            if not unanswered.any():
                break
            start = self.parameters(change) * np.array([share, 1.0, 1.0])
            start = self.prior.change(start)
            answered = unanswered & np.isfinite(self.predict(start))
            if not answered.any():
                continue
            weights = self.votes * belongs
            scatter = float(self.scatter(self.residuals(change), weights))
            fit, agreeing = self._reweighted(start, belongs | answered, scatter)
            if agreeing[belongs].all() and agreeing.sum() > belongs.sum():
                change = fit
                belongs = agreeing
        return change, belongs

    def _least_trimmed_squares(self, seed: int) -> Array:
        """The change under which the better half of the samples has the least squares, (3,).

        The best of many random changes, and no change, are concentrated side by side.
        """
        few = replace(self, samples=thinned(self.samples))

        def trimmed_mean(changes: Array) -> Array:
            residuals = few.residuals(changes)
            half = few.votes * few.better_half(residuals)
            return np.asarray((half * residuals**2).sum(axis=-1) / half.sum(axis=-1))

        rng = np.random.default_rng(seed)
        low, high = SEARCH_BOUNDS.T
        tried = rng.uniform(low, high, (_TRIED, len(SEARCH_BOUNDS)))
        changes = self.prior.change(from_scaled(tried))
        starts = changes[np.argsort(trimmed_mean(changes))[:_STARTS]]
        in_service = np.zeros(len(PARAMETER_NAMES))
        fits = few._concentrated(np.vstack([starts, in_service]))
        return np.asarray(fits[int(np.argmin(trimmed_mean(fits)))])

    def _concentrated(self, changes: Array) -> Array:
        """Fit the better half of the samples, and again the better half under that fit.

        Args:
            changes: starts, each with its own better half, shape (m, 3).
        """
        changes = changes.copy()
        fitted = np.zeros((len(changes), len(self.samples)), dtype=bool)
        for _ in range(_CONCENTRATIONS):
            residuals = self.residuals(changes)
            better = self.better_half(residuals)
            changed = np.flatnonzero((better != fitted).any(axis=1))
            if not changed.size:
                break
            fitted = better
            half = self.votes * better
            weights = half / self.scatter(residuals, half)[:, None] ** 2
            changes[changed] = self._fits(
                changes[changed], weights[changed], _CONCENTRATION_GAIN
            )
        return changes


def _leverage(slopes: Array, weights: Array) -> Array:
    """Variance of the prediction at each sample, in terms of the scatter, shape (n,)."""
    precision = np.eye(slopes.shape[1]) + (slopes.T * weights) @ slopes
    return np.asarray(
        np.einsum("ni,ij,nj->n", slopes, np.linalg.inv(precision), slopes)
    )
