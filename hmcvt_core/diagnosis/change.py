# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Has a gap opened: a test on residuals that is looked at after every one of them.

Residuals of a model that is right are its noise, and what its base does not know: a linear form of
a few unknowns with a prior, as it follows from the standard errors of an identification. A Kalman
filter over these unknowns takes both out; what is left, the innovations, is independent and of
deviation 1 as long as nothing changes (recursive residuals: Brown, Durbin & Evans 1975). A gap that
opens at sample k adds a known signature to them (Willsky & Jones 1976). The likelihood ratio of
each k, averaged over sizes of either sign, is a martingale of mean 1 where there is no gap, and so
is their sum with weights 1 / (k (k + 1)) (Robbins 1970; Lai 1995 for so many k as are kept).
It ever exceeds 1 / alpha with a chance of at most alpha, however long the stream (Ville 1939).

Innovations count up to 3 deviations, so that one bad sample opens no gap, and the deviation of the
noise is taken as larger than stated where those before scattered more: functions that rise no
faster than their argument keep the inequality (Gaussian concentration; Boucheron, Lugosi & Massart
2013).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MOST = 3.0
"""Deviations that one sample counts."""
_KEPT = 400  # openings that are still thought of
_WORTH = 20.0  # samples that the noise stated is worth
_LEVEL = 0.95


class ChangeTest:
    """Running test for a step in the mean of residuals, of either sign.

    Attributes:
        samples: taken so far.
        evidence: logarithm of the sum of the weighted likelihood ratios, the largest so far.
    """

    def __init__(self, prior: Array, spreads: Sequence[float]) -> None:
        """Begin with the covariance (p, p) of what is not known of the base.

        Args:
            prior: of the unknowns whose rows `take` is given.
            spreads: of a gap's size, in units of the residuals; equally likely.
        """
        self.samples, self.evidence = 0, -np.inf
        self._squares: float = _WORTH  # of innovations, in units of the noise stated
        self._covariance, self._state = np.array(prior), np.zeros(len(prior))
        self._sizes = np.square(spreads)[:, None]
        self._starts = np.empty(0, dtype=int)
        # Of each opening: what the filter makes of a step of one, and two sums over innovations.
        self._steps, self._sums = np.empty((0, len(prior))), np.empty((2, 0))

    def take(self, residual: float, deviation: float, row: Array) -> None:
        """Take the next residual, the deviation of its noise, and its slopes (p,)."""
        self.samples += 1
        self._starts = np.append(self._starts, self.samples)
        self._steps = np.vstack([self._steps, np.zeros(len(row))])
        self._sums = np.column_stack([self._sums, np.zeros(2)])
        larger = max(1.0, self._squares / (_WORTH + self.samples - 1))
        gain = self._covariance @ row
        scale = np.sqrt(larger * deviation**2 + row @ gain)
        innovation = np.clip((residual - row @ self._state) / scale, -MOST, MOST)
        self._squares += float(larger * innovation**2)
        signature = (1.0 - self._steps @ row) / scale
        self._sums += signature * innovation, signature**2
        self._state += gain / scale * innovation
        self._steps += np.outer(signature, gain / scale)
        self._covariance -= np.outer(gain, gain) / scale**2
        ratios = self._log_ratios()
        weighted = ratios - np.log(self._starts * (self._starts + 1.0))
        self.evidence = max(self.evidence, float(np.logaddexp.reduce(weighted)))
        if len(ratios) > _KEPT:  # among the older half, the one that nothing speaks for
            self._drop(int(np.argmin(weighted[:_KEPT // 2])))

    def since(self) -> tuple[int, int, int]:
        """Most likely first sample with a gap, and those that hold 95 % (first and last)."""
        ratios = self._log_ratios()
        weights = np.exp(ratios - ratios.max())
        order = np.argsort(-weights)
        held = order[:1 + int(np.searchsorted(np.cumsum(weights[order]), _LEVEL * weights.sum()))]
        return int(self._starts[order[0]]), *self._starts[[held.min(), held.max()]].tolist()

    def _log_ratios(self) -> Array:
        along, square = self._sums
        grown = 1.0 + self._sizes * square
        logs = 0.5 * (self._sizes * along**2 / grown - np.log(grown))
        return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(len(logs)))

    def _drop(self, i: int) -> None:
        self._starts = np.delete(self._starts, i)
        self._steps = np.delete(self._steps, i, axis=0)
        self._sums = np.delete(self._sums, i, axis=1)


def step_size(
    residuals: Array, deviations: Array, rows: Array, prior: Array, start: int
) -> tuple[float, float]:
    """Size of a step from sample `start` (from 1) on, and its standard deviation.

    Least squares with what is not known of the base; single bad samples count little (Huber 1964).

    Args:
        residuals, deviations: shape (n,).
        rows: slopes, shape (n, p).
        prior: covariance of the unknowns, shape (p, p).
        start: first sample with the gap.
    """
    from scipy.optimize import least_squares

    n, p = rows.shape
    values, vectors = np.linalg.eigh(prior)  # a correlation may be complete
    rows = rows @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    step = np.arange(1, n + 1) >= start
    excess = 0.0
    for _ in range(4):  # a gap need not be the same everywhere: its scatter widens the interval
        spread = np.sqrt(deviations**2 + step * excess)
        # The prior's rows are among the data, in standard units.
        design = np.block([[step[:, None] / spread[:, None], rows / spread[:, None]],
                           [np.zeros((p, 1)), np.eye(p)]])
        target = np.append(residuals / spread, np.zeros(p))
        found = least_squares(
            lambda at, rows, values: rows @ at - values, np.zeros(p + 1), lambda _, rows, __: rows,
            loss="huber", f_scale=MOST, args=(design, target))
        left = (residuals - rows @ found.x[1:] - found.x[0])[step]
        excess = max(0.0, float(np.mean(left**2 - deviations[step]**2)))
    return float(found.x[0]), float(np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[0, 0]))
