# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sequential test for a step in the mean of residuals, and an estimate of its size.

Residuals of a correct model are its noise and what its base does not know: a linear form of a few
unknowns with a prior, as it follows from the standard errors of an identification. A Kalman filter
over these unknowns removes both; the innovations that remain are independent and of deviation 1 as
long as nothing changes (recursive residuals: Brown, Durbin & Evans 1975). A gap that opens at
sample k adds a known signature to them (Willsky & Jones 1976). The likelihood ratio of each k,
averaged over sizes of either sign, is a martingale of mean 1 where there is no gap, and so is the
sum of these ratios with weights 1 / (k (k + 1)) (Robbins 1970; Lai 1995 for keeping a limited
number of k). It ever exceeds 1 / alpha with a chance of at most alpha, however long the stream
(Ville 1939).

Innovations count up to 3 deviations, so that one bad sample opens no gap, and the deviation of the
noise is taken as larger than stated where earlier samples scattered more: functions that rise no
faster than their argument keep the inequality (Gaussian concentration; Boucheron, Lugosi & Massart
2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..transmission.ranges import Array

FALSE_ALARMS = 0.01
"""Chance of a false alarm over a whole stream, however long."""
LARGEST_INNOVATION = 3.0
"""Deviations that one sample counts at most (Huber 1964)."""
KEPT_CANDIDATES = 400
"""First samples of a gap that are still considered; limits time and memory per sample."""
NOISE_WORTH = 20.0
"""Samples that the stated noise is worth; chosen on simulated streams (docs/studies/streams.md)."""
LEVEL = 0.95
"""Probability of the interval for the first sample of a gap."""
REWEIGHTINGS = 20
"""Rounds of robust weights in `step_size`, after which the weights no longer change."""


@dataclass(frozen=True)
class GapStart:
    """A candidate for the first sample of a gap.

    Attributes:
        number: among the samples that were tested, from 1.
        sample: among all samples of the stream, from 1.
        stamp: time of the sample [s].
    """

    number: int
    sample: int
    stamp: float


class _Candidates:
    """First samples of a gap that are still considered, k of them.

    Attributes:
        number: among the samples tested, shape (k,).
        sample: among all samples of the stream, shape (k,).
        stamp: time [s], shape (k,).
        correlation: sum of signature x innovation, shape (k,).
        square: sum of squared signatures, shape (k,).
        response: of the filter's unknowns to a unit step that begins there, shape (k, p).
    """

    def __init__(self, unknowns: int) -> None:
        self.number = np.empty(0)
        self.sample = np.empty(0)
        self.stamp = np.empty(0)
        self.correlation = np.empty(0)
        self.square = np.empty(0)
        self.response = np.empty((0, unknowns))

    def __len__(self) -> int:
        return len(self.number)

    def add(self, start: GapStart) -> None:
        self.number = np.append(self.number, float(start.number))
        self.sample = np.append(self.sample, float(start.sample))
        self.stamp = np.append(self.stamp, start.stamp)
        self.correlation = np.append(self.correlation, 0.0)
        self.square = np.append(self.square, 0.0)
        none_yet = np.zeros((1, self.response.shape[1]))
        self.response = np.concatenate([self.response, none_yet])

    def remove(self, index: int) -> None:
        self.number = np.delete(self.number, index)
        self.sample = np.delete(self.sample, index)
        self.stamp = np.delete(self.stamp, index)
        self.correlation = np.delete(self.correlation, index)
        self.square = np.delete(self.square, index)
        self.response = np.delete(self.response, index, axis=0)

    def start(self, index: int) -> GapStart:
        return GapStart(
            int(self.number[index]), int(self.sample[index]), float(self.stamp[index])
        )


class ChangeTest:
    """Running test for a step in the mean of residuals, of either sign.

    Attributes:
        samples: taken so far.
        evidence: logarithm of the sum of the weighted likelihood ratios, the largest so far.
    """

    def __init__(self, prior: Array, spreads: Sequence[float]) -> None:
        """Begin with what is not known of the base.

        Args:
            prior: covariance of the unknowns whose slopes `take` is given, shape (p, p).
            spreads: standard deviations of a gap's size, in units of the residuals; equally likely.
        """
        self.samples = 0
        self.evidence = -np.inf
        # Sum of squared innovations in units of the stated noise, and of its worth in samples.
        self._squares: float = NOISE_WORTH
        self._covariance = np.array(prior)
        self._state = np.zeros(len(prior))
        self._size_variances = np.square(spreads)[:, None]
        self._candidates = _Candidates(len(prior))

    def take(
        self,
        residual: float,
        deviation: float,
        slopes: Array,
        sample: int,
        stamp: float,
    ) -> None:
        """Take the next residual.

        Args:
            residual: measured less predicted.
            deviation: standard deviation of its noise, same unit.
            slopes: change of the residual with each unknown, shape (p,).
            sample: its number in the stream, from 1.
            stamp: its time [s].
        """
        self.samples += 1
        candidates = self._candidates
        candidates.add(GapStart(self.samples, sample, stamp))
        # Variance of the noise / that stated, where samples so far scattered more.
        excess = max(1.0, self._squares / (NOISE_WORTH + self.samples - 1))
        gain = self._covariance @ slopes
        scale = np.sqrt(excess * deviation**2 + slopes @ gain)
        innovation = np.clip(
            (residual - slopes @ self._state) / scale,
            -LARGEST_INNOVATION,
            LARGEST_INNOVATION,
        )
        self._squares += float(excess * innovation**2)
        signature = (1.0 - candidates.response @ slopes) / scale
        candidates.correlation += signature * innovation
        candidates.square += signature**2
        self._state += gain / scale * innovation
        candidates.response += np.outer(signature, gain / scale)
        self._covariance -= np.outer(gain, gain) / scale**2
        number = candidates.number
        weighted = self._log_ratios() - np.log(number * (number + 1.0))
        self.evidence = max(self.evidence, float(np.logaddexp.reduce(weighted)))
        if len(candidates) > KEPT_CANDIDATES:
            older_half = weighted[: KEPT_CANDIDATES // 2]
            candidates.remove(int(np.argmin(older_half)))

    def start(self) -> tuple[GapStart, GapStart, GapStart]:
        """Return the most likely first sample of a gap, and the ends of its 95 % interval."""
        ratios = self._log_ratios()
        weights = np.exp(ratios - ratios.max())
        order = np.argsort(-weights)
        below_level = np.searchsorted(np.cumsum(weights[order]), LEVEL * weights.sum())
        credible = order[: 1 + int(below_level)]
        return (
            self._candidates.start(int(order[0])),
            self._candidates.start(int(credible.min())),
            self._candidates.start(int(credible.max())),
        )

    def _log_ratios(self) -> Array:
        """Log likelihood ratio of each candidate, averaged over the sizes, shape (k,)."""
        correlation = self._candidates.correlation
        growth = 1.0 + self._size_variances * self._candidates.square
        logs = 0.5 * (self._size_variances * correlation**2 / growth - np.log(growth))
        return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(len(logs)))


def step_size(
    residuals: Array, deviations: Array, slopes: Array, prior: Array, start: int
) -> tuple[float, float]:
    """Estimate the size of a step by least squares, together with what is not known of the base.

    Single bad samples count little (Huber 1964).

    Args:
        residuals: measured less predicted, shape (n,).
        deviations: standard deviations of their noise, shape (n,).
        slopes: change of each residual with each unknown, shape (n, p).
        prior: covariance of the unknowns, shape (p, p).
        start: first sample with the gap, from 1.

    Returns:
        Size and its standard deviation, in units of the residuals.
    """
    # A square root of the prior by eigenvalues, because unknowns may be completely correlated.
    values, vectors = np.linalg.eigh(prior)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    after_start = np.arange(1, len(slopes) + 1) >= start
    design = np.column_stack([after_start, slopes @ root])
    prior_precision = np.diag(np.append(0.0, np.ones(len(prior))))
    spread = deviations
    weight = np.ones(len(slopes))
    for _ in range(REWEIGHTINGS):
        weighted = (weight / spread**2)[:, None] * design
        normal = design.T @ weighted + prior_precision
        estimate = np.linalg.solve(normal, weighted.T @ residuals)
        remainder = residuals - design @ estimate
        # A gap that differs over the operating points scatters, which widens the interval.
        excess = max(0.0, float(np.mean((remainder**2 - deviations**2)[after_start])))
        spread = np.sqrt(deviations**2 + after_start * excess)
        weight = 1.0 / np.maximum(
            1.0, np.abs(remainder) / (LARGEST_INNOVATION * spread)
        )
    return float(estimate[0]), float(np.sqrt(np.linalg.inv(normal)[0, 0]))
