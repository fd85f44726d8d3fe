# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The gap at any operating point, and the places where it is large.

What each rival foretells beyond the refitted base model, averaged over the rivals by their
probabilities (Bayesian model averaging; Hoeting et al. 1999, Statistical Science 14), losses that
nobody listed among them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import Observations, Reading
from .rivals import Rival
from .system import Points

Array = NDArray[np.float64]

_ALIVE = 0.01  # less probable rivals are left out
_PAYS = 0.02  # of F1: by how much a further region has to tell the places better


@dataclass(frozen=True, eq=False)
class GapField:
    """Rivals alive and what they foretell.

    Attributes:
        base: the refitted base model.
        alive: rivals and their probabilities given that there is a gap; they sum to 1.
    """

    base: Fit
    alive: tuple[tuple[Rival, float], ...]

    @classmethod
    def of(cls, base: Fit, entries: Iterator[tuple[Rival, float]]) -> GapField:
        """Keep the rivals that matter."""
        kept = [(rival, p) for rival, p in entries if p >= _ALIVE]
        total = sum(p for _, p in kept)
        return cls(base, tuple((rival, p / total) for rival, p in kept))

    def at(self, points: Points | None = None) -> tuple[Array, Array]:
        """Mean and standard deviation of the gap at n points, those of the campaign if None, (n,).

        Measured minus refitted base in the unit of the first channel; NaN where the base model has
        no answer.
        """
        there, start = self.base.observed, self.base.whitened[0]
        if points is not None:
            there, start = as_measured(self.base, points), np.zeros(1)
        deviation = there.readings[0].deviation
        means, variances, weights = [], [], []
        for rival, p in self.alive:
            shift, columns = rival.at(there)
            means.append(deviation * (start + shift[0]))
            variances.append(deviation**2 * np.einsum(
                "np,pq,nq->n", columns[0], rival.plain.covariance, columns[0]))
            # Who has no answer at a point has no say there.
            weights.append(np.where(np.isfinite(shift[0]), p, 0.0))
        weight = np.array(weights)
        with np.errstate(invalid="ignore"):
            weight /= weight.sum(axis=0)
        mean = np.sum(weight * np.nan_to_num(means), axis=0)
        within = np.array(variances) + (np.nan_to_num(means) - mean) ** 2
        return mean, np.sqrt(np.sum(weight * within, axis=0))


def as_measured(base: Fit, points: Points) -> Observations:
    """Points as if read with the noise of the campaign, where the base model is.

    In every channel of the campaign.
    """
    observed, system = base.observed, base.hypothesis.system
    predicted = observed.read(system.predict(base.base, (), points))
    readings = []
    for i, reading in enumerate(observed.readings):
        values, channel = predicted[i], reading.channel
        deviation = channel.deviation(values) if i else np.full(
            len(values), np.median(observed.scale[i]))
        readings.append(Reading(channel, values, deviation * np.sqrt(base.noise[i]), 1.0))
    return replace(observed, points=points, readings=tuple(readings),
                   number=np.arange(predicted.shape[1]))


def covering(members: NDArray[np.bool_], target: NDArray[np.bool_], most: int) -> list[int]:
    """The fewest regions that hold some points and no others, by F1, one after another.

    Args:
        members: which points each region holds, shape (regions, n).
        target: the points, shape (n,).
        most: regions.
    """
    covered, chosen, best = np.zeros(len(target), dtype=bool), list[int](), 0.0
    for _ in range(most):
        union = members | covered
        f1 = 2.0 * (union & target).sum(axis=1) / (union.sum(axis=1) + target.sum())
        one = int(f1.argmax())
        if f1[one] < best + _PAYS:
            break
        best, covered = float(f1[one]), union[one]
        chosen.append(one)
    return chosen
