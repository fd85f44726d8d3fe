# SPDX-License-Identifier: Apache-2.0
r"""What to measure next: the points at which the surviving causes disagree most.

For two refitted causes f and g the gain of a set of points is what a test there would say against g
if f were true, after g has bent its free parameters to the new readings too:

.. math:: gain = \sum_i \frac{(f(x_i) - g_{i-1}(x_i))^2}{1 + v_{g,i-1}(x_i)}

in squared deviations of the readings, g being conditioned on each point in turn (Buzzi-Ferraris &
Forzatti 1983, with refit). Points are chosen one after another; both directions are averaged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .candidates import Candidate
from .hypothesis import Fit, linearise
from .observations import Observations, Reading
from .ranking import Ranking
from .result import NextTest

Array = NDArray[np.float64]

ALIVE = 0.03
"""Causes less probable than this are not worth a test."""

DECISIVE = 9.0
"""A gain that settles the question: three standard deviations."""

_TESTS = 6
_CAUSES = 4
_CHANNEL_PAYS = 3.0


class _Rival(NamedTuple):
    """A cause on the pool of possible tests, linear in its free parameters.

    Attributes:
        predicted: in deviations of the readings, shape (points, channels).
        columns: shape (points, channels, p).
        covariance: of the free parameters, shape (p, p).
    """

    predicted: Array
    columns: Array
    covariance: Array

    def reads(self, channels: int) -> _Rival:
        """Return the same where only the first channels are read."""
        return self._replace(predicted=self.predicted[:, :channels],
                             columns=self.columns[:, :channels])

    def gains(self, truth: Array) -> Array:
        """Squared surprise at each point if `truth` is read there, shape (points,)."""
        variance = np.einsum("icp,pq,ieq->ice", self.columns, self.covariance, self.columns)
        variance += np.eye(truth.shape[1])
        miss = truth - self.predicted
        surprise = np.linalg.solve(variance, miss[..., None])[..., 0]
        return np.asarray(np.einsum("ic,ic->i", miss, surprise))

    def given(self, index: int, reading: Array) -> _Rival:
        """Return the same conditioned on a reading at one point (Kalman update)."""
        own = self.columns[index]
        gain = self.covariance @ own.T @ np.linalg.inv(
            own @ self.covariance @ own.T + np.eye(len(own)))
        change = gain @ (reading - self.predicted[index])
        return self._replace(predicted=self.predicted + self.columns @ change,
                             covariance=self.covariance - gain @ own @ self.covariance)


def next_tests(base: Fit, ranking: Ranking) -> tuple[NextTest, ...]:
    """Choose tests that separate the leading cause from each other one alive."""
    names = [name for name, p in ranking.probability.items() if p >= ALIVE][:_CAUSES]
    if len(names) < 2:
        return ()
    pool = _pool(base)
    rivals = {name: _rival(ranking.best[name], pool) for name in names}
    read = len(base.observed.readings)
    tests: list[NextTest] = []
    for name in names[1:]:
        pair, most = (names[0], name), _TESTS if name == names[1] else 2
        both = [rivals[each] for each in pair]
        chosen, measure = _choose([each.reads(read) for each in both], most), None
        if read < len(pool.readings):
            fuller = _choose(both, most)
            if sum(fuller.values()) > _CHANNEL_PAYS * max(sum(chosen.values()), 1.0):
                chosen = fuller
                measure = ", ".join(item.channel.name for item in pool.readings[read:])
        tests += [NextTest({axis.name: float(pool.points[axis.name][i]) for axis in pool.steered},
                           pair, gain, measure)
                  for i, gain in chosen.items() if gain > 0.1 * DECISIVE / most]
        if sum(chosen.values()) < DECISIVE:
            # No operating point decides: say what does.
            remedies = {effect.remedy for each in pair for effect in ranking.best[each].effects
                        if effect.name == each}
            tests += [NextTest(None, pair, 0.0, remedy) for remedy in sorted(remedies) if remedy]
    return tuple(tests)


def _pool(base: Fit) -> Observations:
    """Possible tests, in every channel that there is, as if read with the present noise."""
    observed, system = base.observed, base.hypothesis.system
    points = system.candidates(observed.points, base.base)
    predicted = system.predict(base.base, (), points)
    readings = []
    for i, (channel, values) in enumerate(zip(system.channels, predicted, strict=True)):
        deviation = channel.uncertainty * values if channel.relative else np.full(
            len(values), np.median(observed.scale[i]) * np.sqrt(base.noise[i]))
        readings.append(Reading(channel, values, deviation, 1.0))
    return replace(observed, points=points, readings=tuple(readings),
                   number=np.arange(predicted.shape[1]))


def _rival(item: Candidate, pool: Observations) -> _Rival:
    there = linearise(item.fit.hypothesis, pool, item.fit.theta, item.fit.noise)
    p = len(item.fit.theta)
    return _Rival(-there.whitened.T, np.moveaxis(there.jacobian, 0, 1),
                  item.linear.covariance[:p, :p])


def _choose(rivals: Sequence[_Rival], most: int) -> dict[int, float]:
    """Pick points one after another; each with its mean gain over both directions."""
    first, second = rivals
    one, other = second, first  # each adapts itself to what the other one foretells
    chosen: dict[int, float] = {}
    for _ in range(most):
        gains = (one.gains(first.predicted) + other.gains(second.predicted)) / 2.0
        gains[list(chosen)] = -1.0
        best = int(gains.argmax())
        chosen[best] = float(gains[best])
        one = one.given(best, first.predicted[best])
        other = other.given(best, second.predicted[best])
    return chosen
