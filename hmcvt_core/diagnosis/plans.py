# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""What operating points can tell apart: those of a plan, and those to measure next.

For effects a, b of typical size with signatures d_a, d_b (in deviations of the readings, what the
refit of the base parameters absorbs taken out):

.. math:: L_a = \|d_a\|^2, \qquad L_{ab} = \|d_a\|^2 (1 - \cos^2\angle(d_a, d_b))

L_a is how visible a is; L_ab how visible it stays when b may mimic it. Below nine (three standard
deviations) it is not.

What to measure next are the points at which the surviving causes disagree most.
For two refitted causes f and g the gain of a set of points is what a test there would say against g
if f were true, after g has bent its free parameters to the new readings too:

.. math:: gain = \sum_i \frac{(f(x_i) - g_{i-1}(x_i))^2}{1 + v_{g,i-1}(x_i)}

in squared deviations of the readings, g being conditioned on each point in turn (Buzzi-Ferraris &
Forzatti 1983, with refit). Points are chosen one after another; both directions are averaged.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit, Hypothesis, linearise
from .observations import Observations, Reading
from .ranking import Candidate, Ranking, screen
from .result import NextTest
from .system import System
from .words import plain

Array = NDArray[np.float64]

ALIVE = 0.03
"""Causes less probable than this are not worth a test."""

DECISIVE = 9.0
"""What settles a question: three standard deviations, squared."""

_TESTS = 6
_CAUSES = 4
_CHANNEL_PAYS = 3.0
_WIDTH = 100
_MOST_RUNS = 20


@dataclass(frozen=True, eq=False)
class Isolability:
    """What a plan can tell apart.

    Attributes:
        effects: names, sorted.
        detectability: L of each at its typical size, shape (k,).
        separation: row a, column b: L of a when b may mimic it, shape (k, k); the diagonal is
            `detectability`.
        plan: what is to be read where.
        further: name of the channel that a bench may read besides.
        remedies: measurement that settles each effect when no operating point does, by name.
        fuller: the same if the further channel were read too; None where it is.
    """

    effects: tuple[str, ...]
    detectability: Array
    separation: Array
    plan: Observations
    further: str
    remedies: Mapping[str, str]
    fuller: Isolability | None = None

    def confused(self) -> list[dict[str, Any]]:
        """Return what helps where an effect is visible and others may mimic it, as plain data."""
        found = []
        for i in np.flatnonzero(self.detectability >= DECISIVE):
            name, twins = self.effects[i], self.twins(self.effects[i])
            left = twins if self.fuller is None else [
                other for other in twins if other in self.fuller.twins(name)]
            remedies = dict.fromkeys(self.remedies[each] for each in (name, *left) if left)
            if twins:
                found.append({
                    "effect": name, "indistinguishable_from": twins,
                    f"told_by_{self.further}": [each for each in twins if each not in left],
                    "remedies": list(filter(None, remedies))})
        return found

    def twins(self, effect: str) -> list[str]:
        """Return the effects that the plan cannot tell from one that it can see."""
        row = self.separation[self.effects.index(effect)]
        return [other for other, level in zip(self.effects, row, strict=True)
                if other != effect and level < DECISIVE]

    @property
    def _channels(self) -> list[str]:
        return [reading.channel.name for reading in self.plan.readings]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "samples": len(self.plan), "noise": self.plan.usual_noise,
            "noise_source": self.plan.noise_source, "channels": self._channels,
            "threshold": DECISIVE,
            "effects": [{
                "effect": name, "detectability": float(self.detectability[i]),
                "visible": bool(self.detectability[i] >= DECISIVE),
                "indistinguishable_from": self.twins(name),
            } for i, name in enumerate(self.effects)],
            "confused": self.confused(),
            "separation": self.separation.tolist(),
        }

    def report(self, matrix: bool = False) -> str:
        """Return what can be told apart, and what would help, as text for a person.

        Args:
            matrix: whether to print `separation` too.
        """
        confused, first = self.confused(), self.plan.readings[0].channel
        told, hidden = [], []
        for name, level in zip(self.effects, self.detectability.tolist(), strict=True):
            if level < DECISIVE:
                runs = f" ({math.ceil(DECISIVE / level)})" if _MOST_RUNS * level >= DECISIVE else ""
                hidden.append(name + runs)
            elif not self.twins(name):
                told.append(name)
        lines = [f"{len(self.plan)} points; read: {', '.join(self._channels)}",
                 f"noise of the {plain(first.name)}: {first.factor * self.plan.usual_noise:.2g} "
                 f"{first.unit}, {self.plan.noise_source}", "",
                 *_listed("told from all others: ", told)]
        if confused:
            lines += ["", "seen, but not told from:"]
        for item in confused:
            lines += _listed(f"  {item['effect']}: ", item["indistinguishable_from"])
            if by_channel := item[f"told_by_{self.further}"]:
                lines += _listed(f"    reading the {plain(self.further)} too tells it from ",
                                 by_channel)
            if item["remedies"]:
                lines += _listed("    to settle it: ", ["; or ".join(item["remedies"])])
        lines += ["", *_listed("not visible at their typical size (number: runs of the whole plan "
                               "that would show it): ", hidden)]
        if matrix:
            lines += ["", "squared deviations that the row's effect, at its typical size, leaves "
                      "after the refit of the", "base parameters when the column's effect, in the "
                      f"same order, may mimic it; visible from {DECISIVE:g}:"]
            width = max(map(len, self.effects))
            lines += [f"{name:<{width}} " + " ".join(f"{min(value, 99999.0):5.0f}" for value in row)
                      for name, row in zip(self.effects, self.separation, strict=True)]
        return "\n".join(lines)


def isolability(
    system: System, plan: Observations, base: Array, fuller: Observations | None = None
) -> Isolability:
    """Tell which effects a set of operating points can show and tell apart.

    Args:
        system: what is to stand on the bench.
        plan: what is to be read; the readings themselves are not used.
        base: scaled base parameters.
        fuller: the same plan with a further channel read; None where there is none.
    """
    # Nothing is read yet to which base parameters could be fitted.
    fit = linearise(Hypothesis(system), plan, np.append(base, np.zeros(len(system.nuisances))),
                    np.ones(len(plan.readings)))
    screened = screen(fit)
    left = fit.left(np.stack([change for _, _, change in screened]))
    effects = tuple(sorted({form.name for _, form, _ in screened}))
    index = np.array([effects.index(form.name) for _, form, _ in screened])
    squares = np.sum(left**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.nan_to_num((left @ left.T) ** 2 / squares[None, :])
    alone = np.maximum(squares[:, None] - part, 0.0)
    # The worst case over the forms of each effect.
    members = [np.flatnonzero(index == i) for i in range(len(effects))]
    detectability = np.array([squares[own].min() for own in members])
    separation = np.array([[alone[np.ix_(own, other)].min() for other in members]
                           for own in members])
    np.fill_diagonal(separation, detectability)
    read = {reading.channel.name for reading in plan.readings}
    further = [channel.name for channel in system.channels if channel.name not in read]
    return Isolability(
        effects, detectability, separation, plan, (further or [system.channels[-1].name])[0],
        {form.name: form.remedy for _, form, _ in screened},
        None if fuller is None else isolability(system, fuller, base))


def _listed(title: str, names: Iterable[str]) -> list[str]:
    return textwrap.wrap(title + (", ".join(names) or "none"), _WIDTH, subsequent_indent="      ",
                         break_on_hyphens=False)


# --- what to measure next -------------------------------------------------------------------------


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
        chosen, measure = _choose([
            each._replace(predicted=each.predicted[:, :read], columns=each.columns[:, :read])
            for each in both], most), None
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
            remedies = {effect.remedy for each in pair for effect in ranking.best[each].fit.effects
                        if effect.name == each}
            tests += [NextTest(None, pair, 0.0, remedy) for remedy in sorted(remedies) if remedy]
    return tuple(tests)


def _pool(base: Fit) -> Observations:
    """Possible tests, in every channel that there is, as if read with the present noise."""
    observed, system = base.observed, base.hypothesis.system
    points = system.candidates(observed.points, base.base)
    predicted = system.predict(base.base, (), points)
    readings, each = [], np.sqrt(observed.count)  # a test is one sample
    for i, (channel, values) in enumerate(zip(system.channels, predicted, strict=True)):
        deviation = channel.deviation(values) if i else np.full(
            len(values), np.median(observed.scale[i] * each) * np.sqrt(base.noise[i]))
        readings.append(Reading(channel, values, deviation, 1.0))
    return replace(observed, points=points, readings=tuple(readings),
                   number=np.arange(predicted.shape[1]), gathered=None)


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
