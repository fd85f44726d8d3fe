# SPDX-License-Identifier: Apache-2.0
r"""What to measure next: the points at which the surviving causes disagree most.

For two refitted causes f and g the gain of a set of points is what a test there would say against g
if f were true, after g has bent its free parameters to the new readings too:

.. math:: gain = \sum_i \frac{(f(x_i) - g_{i-1}(x_i))^2}{1 + v_{g,i-1}(x_i)}

in squared deviations of the readings, g being conditioned on each point in turn (Buzzi-Ferraris &
Forzatti 1983, with refit). Points are chosen one after another; both directions are averaged.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..transmission.ranges import EFFICIENCY, ENGINE_SPEED_LIMITS, LOAD_TORQUE
from .candidates import Bench, Candidate
from .hypothesis import Hypothesis, linearise
from .observations import OUTPUT_SPEED_UNCERTAINTY, Channel, Observations
from .ranking import Ranking
from .result import NextTest

Array = NDArray[np.float64]

ALIVE = 0.03
"""Causes less probable than this are not worth a test."""

DECISIVE = 9.0
"""A gain that settles the question: three standard deviations."""

_TESTS = 6
_CAUSES = 4
_GRID = (9, 6, 6)
_LEAST_POWER = 4e3  # W: below, no bench reads efficiency well
_CHANNEL_PAYS = 3.0


class _Rival(NamedTuple):
    """A cause on the pool of possible tests, linear in its free parameters."""

    predicted: Array  # in deviations of the readings, shape (points, channels)
    columns: Array  # shape (points, channels, p)
    covariance: Array  # of the free parameters, shape (p, p)


def next_tests(bench: Bench, ranking: Ranking) -> tuple[NextTest, ...]:
    """Choose tests that separate the leading cause from each other one alive."""
    names = [name for name, p in ranking.probability.items() if p >= ALIVE][:_CAUSES]
    tests: list[NextTest] = []
    if len(names) < 2:
        return ()
    speed = bench.channels > 1
    pool = _pool(bench, with_speed=True)
    first = ranking.best[names[0]]
    for name in names[1:]:
        tests += _for_pair(bench, first, ranking.best[name], pool, speed,
                           (names[0], name), _TESTS if name == names[1] else 2)
    return tuple(tests)


def _for_pair(
    bench: Bench,
    first: Candidate,
    second: Candidate,
    pool: Observations,
    speed: bool,
    names: tuple[str, str],
    most: int,
) -> list[NextTest]:
    rivals = [_rival(bench, item, pool) for item in (first, second)]
    channels = slice(None) if speed else slice(0, 1)
    chosen = _choose(rivals, channels, most)
    total = sum(gain for _, gain in chosen)
    measure = None
    if not speed:
        with_speed = _choose(rivals, slice(None), most)
        if sum(gain for _, gain in with_speed) > _CHANNEL_PAYS * max(total, 1.0):
            chosen, measure = with_speed, "output_speed"
            total = sum(gain for _, gain in with_speed)
    s = pool.samples
    tests = [NextTest(float(s.displacement_ratio[i]), float(s.engine_speed[i]),
                      float(s.load_torque[i]), names, gain, measure)
             for i, gain in chosen if gain > 0.1 * DECISIVE / most]
    if total < DECISIVE:
        # No operating point decides: say what does.
        remedies = {item.effects[item.names.index(name)].remedy
                    for item, name in zip((first, second), names, strict=True)}
        tests += [NextTest(None, None, None, names, 0.0, remedy)
                  for remedy in sorted(remedies) if remedy]
    return tests


def _pool(bench: Bench, with_speed: bool) -> Observations:
    """Possible tests over the working range, as if read with the present noise."""
    s = bench.observed.samples
    strokes = np.linspace(-1.0, 1.0, _GRID[0])
    speeds = np.linspace(min(ENGINE_SPEED_LIMITS[0], s.engine_speed.min()),
                         max(ENGINE_SPEED_LIMITS[1], s.engine_speed.max()), _GRID[1])
    highest = max(s.load_torque.max(), 2.0 * _LEAST_POWER / speeds[0])
    points = []
    for stroke, speed in itertools.product(strokes, speeds):
        lowest = max(_LEAST_POWER / speed, LOAD_TORQUE.low)
        points += [(stroke, speed, torque) for torque in np.linspace(lowest, highest, _GRID[2])]
    axes = np.array(points).T
    model = Hypothesis(bench.model).model_at(bench.base.base, np.empty(0))
    temperature = None
    if s.oil_temperature is not None:
        temperature = np.full(axes.shape[1], float(np.median(s.oil_temperature)))
    efficiency = model.efficiency(axes[0], axes[1], axes[2], temperature)
    usable = EFFICIENCY.contains(efficiency)  # nor NaN: no answer there
    axes, efficiency = axes[:, usable], efficiency[usable]
    temperature = None if temperature is None else temperature[usable]
    output = model.output_speed(axes[0], axes[1], axes[2], temperature)
    samples = BenchSamples(axes[0], axes[1], axes[2], efficiency, oil_temperature=temperature,
                           source="possible tests")
    level = float(np.median(bench.observed.scale[0]) * np.sqrt(bench.base.noise[0]))
    channels = [Channel("efficiency", efficiency, np.full(len(efficiency), level), 1.0)]
    if with_speed:
        relative = OUTPUT_SPEED_UNCERTAINTY
        channels.append(Channel("output_speed", output, relative * output, 1.0))
    return Observations(samples, tuple(channels), "as before")


def _rival(bench: Bench, item: Candidate, pool: Observations) -> _Rival:
    hypothesis = Hypothesis(bench.model, item.effects)
    whitened, columns = linearise(hypothesis, pool, item.fit)
    p = columns.shape[-1]
    covariance = item.linear.found.covariance[0][:p, :p]
    return _Rival(-whitened.T, np.moveaxis(columns, 0, 1), covariance)


def _choose(rivals: list[_Rival], channels: slice, most: int) -> list[tuple[int, float]]:
    """Pick points one after another; each with its mean gain over both directions."""
    a, b = ([rival.predicted[:, channels], rival.columns[:, channels], rival.covariance]
            for rival in rivals)
    one, other = _Conditioned(*b), _Conditioned(*a)
    chosen: list[tuple[int, float]] = []
    for _ in range(most):
        gains = (one.gains(a[0]) + other.gains(b[0])) / 2.0
        gains[[i for i, _ in chosen]] = -1.0
        best = int(gains.argmax())
        chosen.append((best, float(gains[best])))
        one.learn(best, a[0][best])
        other.learn(best, b[0][best])
    return chosen


class _Conditioned:
    """A rival that adapts its parameters to readings, point by point."""

    def __init__(self, predicted: Array, columns: Array, covariance: Array) -> None:
        self.predicted, self.columns = predicted.copy(), columns
        self.covariance = covariance.copy()

    def gains(self, truth: Array) -> Array:
        """Squared surprise at each point, shape (points,)."""
        variance = np.einsum("icp,pq,ieq->ice", self.columns, self.covariance, self.columns)
        variance += np.eye(truth.shape[1])
        miss = truth - self.predicted
        surprise = np.linalg.solve(variance, miss[..., None])[..., 0]
        return np.asarray(np.einsum("ic,ic->i", miss, surprise))

    def learn(self, index: int, reading: Array) -> None:
        """Condition on a reading at one point (Kalman update)."""
        own = self.columns[index]
        gain = self.covariance @ own.T @ np.linalg.inv(
            own @ self.covariance @ own.T + np.eye(len(own)))
        change = gain @ (reading - self.predicted[index])
        self.predicted = self.predicted + self.columns @ change
        self.covariance = self.covariance - gain @ own @ self.covariance
