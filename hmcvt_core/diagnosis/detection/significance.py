# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Test for a gap: is anything left after the refit, in any region or of any known form?

A search over thousands of regions and dozens of effects always finds something. The statistic is
therefore the maximum over all looks, and its distribution without a gap comes from simulated
campaigns put through the same refit (max-T; Westfall & Young 1993, *Resampling-Based Multiple
Testing*). The noise is estimated from the residuals of each simulated campaign, as of the real one,
so that noise stated wrongly raises no alarm.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.refit import Fit
from ..settings import ABSORBED_FRACTION, DRAWS, NULL_BATCH, SMALL_CAMPAIGN
from ..system import Array
from .regions import Regions


class Significance(NamedTuple):
    """Outcome of the test for a gap.

    Attributes:
        p_value: of the largest statistic over regions and effects together.
    """

    p_value: float


def significance(
    fit: Fit, boxes: Regions, seed: int, replicates: int = DRAWS
) -> Significance:
    """Test whether anything is left after a refit.

    Args:
        fit: the refit of the base model.
        boxes: regions to look at, in each channel.
        seed: of the simulated campaigns.
        replicates: number of simulated campaigns.
    """
    looks = _Looks(fit, boxes)
    no_prior_rows = np.zeros((1, len(fit.theta)))
    whitened = fit.target / np.sqrt(fit.noise)[:, None]
    observed = looks.statistics(whitened[None], no_prior_rows)
    null = _null_maxima(looks, whitened.shape, len(fit.theta), seed, replicates)
    p_value = _combined_p_value(null, observed.maxima())
    if len(fit.observed) < SMALL_CAMPAIGN:
        # Bonferroni over all tests: the shape of the scatter, and its size in each channel.
        sizes = looks.lack_of_fit(whitened)
        p_value = min(1.0, (1 + len(sizes)) * min(p_value, *sizes.tolist()))
    return Significance(p_value)


def _null_maxima(
    looks: "_Looks", shape: tuple[int, ...], parameters: int, seed: int, replicates: int
) -> Array:
    """Return the largest statistics of simulated campaigns without a gap.

    Args:
        looks: what is looked at.
        shape: of the readings, (channels, n).
        parameters: number of prior rows.
        seed: of the simulation.
        replicates: number of campaigns.

    Returns:
        Shape (2, replicates): over boxes and over effects.
    """
    rng = np.random.default_rng(seed)
    maxima = []
    for start in range(0, replicates, NULL_BATCH):
        count = min(NULL_BATCH, replicates - start)
        readings = rng.standard_normal((count, *shape))
        prior_rows = rng.standard_normal((count, parameters))
        maxima.append(looks.statistics(readings, prior_rows).maxima())
    return np.concatenate(maxima, axis=1)


def _combined_p_value(null: Array, observed: Array) -> float:
    """Return the p value of the smaller of two p values, judged by the same campaigns.

    Args:
        null: maxima over two families of looks in simulated campaigns, shape (2, replicates).
        observed: maxima in the real campaign, shape (2, 1).
    """
    null_smallest = np.min([_p_values(family, family) for family in null], axis=0)
    of_families = []
    for family, value in zip(null, observed, strict=True):
        of_families.append(_p_values(family, value))
    smallest = np.min(of_families, axis=0)
    at_least_as_small = np.sum(null_smallest <= smallest)
    return float((1.0 + at_least_as_small) / (1.0 + null.shape[1]))


class _Statistics(NamedTuple):
    """Absolute studentised statistics of k campaigns.

    Attributes:
        boxes: shape (k, channels, boxes).
        effects: shape (k, effects).
    """

    boxes: Array
    effects: Array

    def maxima(self) -> Array:
        """Return the largest over all boxes and over all effects, shape (2, k)."""
        of_boxes = self.boxes.max(axis=(1, 2), initial=0.0)
        of_effects = self.effects.max(axis=1, initial=0.0)
        return np.stack([of_boxes, of_effects])


class _Look(NamedTuple):
    """Patterns that are looked for in some readings.

    Attributes:
        readings: which rows of all readings, one channel after another.
        patterns: in units of the noise, shape (patterns, readings).
        norms: root of the squares of each pattern that a refit leaves, shape (patterns,).
    """

    readings: slice
    patterns: NDArray[np.floating]
    norms: Array

    def statistics(self, residuals: Array) -> Array:
        """Return |z| of each pattern in k campaigns, shape (k, patterns).

        Args:
            residuals: studentised, one channel after another, shape (k, channels x n).
        """
        rows = residuals[:, self.readings].astype(self.patterns.dtype)
        return np.asarray(np.abs(rows @ self.patterns.T / self.norms))


class _Looks:
    """All that is looked at: boxes in each channel, and effects in all channels."""

    def __init__(self, fit: Fit, boxes: Regions) -> None:
        """Prepare the patterns.

        Args:
            fit: the refit of the base model.
            boxes: regions to look at.
        """
        observed = fit.observed
        n = len(observed)
        self.fit = fit
        self.prior_dof = observed.prior_dof
        self.noise_deviation = np.sqrt(fit.noise)
        # Discrepancy of each channel as it shows in that channel. Each channel is looked at by
        # itself, so none has to be right for another to show a gap.
        same_channel = np.einsum("iin->in", observed.unit_discrepancy)
        units = same_channel / self.noise_deviation[:, None]
        self.boxes = []
        for i, unit in enumerate(units):
            patterns = (boxes.members * unit).astype(np.float32)
            self.boxes.append(self._look(slice(i * n, (i + 1) * n), patterns))
        signatures = np.stack([change for _, change in fit.signatures])
        scaled = signatures / self.noise_deviation[:, None]
        patterns = scaled.reshape(len(scaled), -1)
        self.effects = self._look(slice(patterns.shape[1]), patterns)
        self.degrees_of_freedom = self._degrees_of_freedom(n)

    def _look(self, readings: slice, patterns: NDArray[np.floating]) -> _Look:
        """Return a look with the norms of what a refit leaves of its patterns."""
        squares = np.sum(patterns**2, axis=1)
        absorbed = patterns @ self.fit.nuisance_basis[readings]
        return _Look(readings, patterns, _norms(squares, absorbed))

    def _degrees_of_freedom(self, n: int) -> Array:
        """Return the degrees of freedom that the refit leaves each channel, (channels,)."""
        channels = len(self.noise_deviation)
        of_readings = self.fit.nuisance_basis[: channels * n].reshape(channels, -1)
        return np.maximum(n - np.sum(of_readings**2, axis=1), 1.0)

    def statistics(self, readings: Array, prior_rows: Array) -> _Statistics:
        """Return the statistics of k campaigns.

        Args:
            readings: in units of the noise, shape (k, channels, n).
            prior_rows: of the priors, in their units, shape (k, p).
        """
        rows = self.fit.project_out(readings, prior_rows)[:, : readings[0].size]
        residuals = rows.reshape(readings.shape)
        squares = np.sum(residuals**2, axis=2)
        scale = np.sqrt(
            (self.prior_dof + squares) / (self.prior_dof + self.degrees_of_freedom)
        )
        studentised = (residuals / scale[..., None]).reshape(len(readings), -1)
        of_boxes = [look.statistics(studentised) for look in self.boxes]
        of_effects = self.effects.statistics(studentised)
        return _Statistics(np.stack(of_boxes, axis=1), of_effects)

    def lack_of_fit(self, whitened: Array) -> Array:
        """Return the p values of the scatter of each channel at its stated or assumed noise.

        F tests: the prior degrees of freedom of the noise are those of the denominator.

        Args:
            whitened: readings in units of the noise, shape (channels, n).

        Returns:
            Shape (channels,).
        """
        from scipy.special import fdtrc

        rows = self.fit.project_out(whitened[None])[0, : whitened.size]
        residuals = rows.reshape(whitened.shape) * self.noise_deviation[:, None]
        variance = np.sum(residuals**2, axis=1) / self.degrees_of_freedom
        return np.asarray(fdtrc(self.degrees_of_freedom, self.prior_dof, variance))


def _norms(squares: NDArray[np.floating], absorbed: NDArray[np.floating]) -> Array:
    """Return the norms of what a refit leaves of patterns, shape (patterns,).

    Infinite where a refit absorbs the whole pattern, so that its statistic is zero.

    Args:
        squares: of the patterns, shape (patterns,).
        absorbed: their components in the nuisance basis, shape (patterns, p).
    """
    total = squares.astype(np.float64)
    remainder = total - np.sum(absorbed.astype(np.float64) ** 2, axis=1)
    visible = remainder > ABSORBED_FRACTION * total
    return np.asarray(np.sqrt(np.where(visible, remainder, np.inf)), dtype=np.float64)


def _p_values(null: Array, values: Array) -> Array:
    """Return the p values of statistics under simulated ones, same shape as the values."""
    at_least = len(null) - np.searchsorted(np.sort(null), values, side="left")
    return np.asarray((1.0 + at_least) / (1.0 + len(null)), dtype=np.float64)
