# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A hypothesis: the base model with some effects, their sizes free; and its refit to the bench.

Every hypothesis is refitted together with the base parameters: a few free parameters swallow most
of the signature of any effect, so a comparison at fixed base parameters would compare nothing.

Parameters are theta = (base, sizes): scaled base parameters, and sizes in typical ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from .observations import Observations
from .system import Array, Channel, Effect, Points, System, forms_of

Signature = tuple[Effect, Array]
"""A form, and the change of prediction / deviation by one typical size, shape (channels, n)."""

REFUSED = 100.0
"""Standard deviations charged where a hypothesis has no answer.

More than any misfit, or refits to a large gap would hide the worst points where there is none.
"""

_SCREENED_SIZE = 0.1  # in typical sizes
_UNSEEN = 1e-3  # deviations: an effect this small at typical size has no channel to show in
_PASSES = 20
_PARTS = (1.0, 0.5, 0.2, 0.05, 0.01, 0.0)  # of a step, until it is one down
_SMALL = 0.3  # standard deviations: a last step
_BASE_STEP, _SIZE_STEP = 1e-5, 1e-3  # of the differences


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A system and effects whose sizes are free.

    Attributes:
        system: what stands on the bench.
        effects: with the shapes to use; their sizes are fitted.
        opposite: whether sizes that cannot be negative are negative: effects that nobody listed.
    """

    system: System
    effects: tuple[Effect, ...] = ()
    opposite: bool = False

    @property
    def prior_mean(self) -> Array:
        """Mean of theta; sizes are free and have zero."""
        return np.append(self.system.base.mean, np.zeros(len(self._sizes)))

    @property
    def shared(self) -> int:
        """How many parameters every hypothesis has."""
        return len(self.system.base)

    @property
    def _sizes(self) -> list[Any]:
        return [effect.sizes()[0] for effect in self.effects]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta."""
        base, sizes = self.system.base, self._sizes
        ends = [(item.low / item.typical, item.high / item.typical) for item in sizes]
        if self.opposite:
            ends = [(-high, -max(low, 0.0)) for low, high in ends]
        low, high = np.array(ends).reshape(-1, 2).T
        return np.append(base.low, low), np.append(base.high, high)

    @property
    def signs(self) -> Array:
        """1 or -1 for sizes that have one sign only, 0 for the others, NaN for the base, (p,)."""
        low, high = self.bounds
        one = np.where(low >= 0.0, 1.0, np.where(high <= 0.0, -1.0, 0.0))
        one[:self.shared] = np.nan
        return one

    def with_sizes(self, scaled: Array) -> tuple[Effect, ...]:
        """Return the effects at sizes given in typical ones."""
        return tuple(effect.with_values({item.name: value * item.typical}) for effect, item, value
                     in zip(self.effects, self._sizes, scaled.tolist(), strict=True))

    def predict(
        self, theta: Array, points: Points, channels: Sequence[Channel] = ()
    ) -> Array:
        """Return some channels, or every one, shape (channels, n)."""
        effects = self.with_sizes(theta[self.shared:])
        found = self.system.predict(theta[:self.shared], effects, points)
        names = [channel.name for channel in self.system.channels]
        return found[[names.index(channel.name) for channel in channels]] if channels else found


@dataclass(frozen=True, eq=False)
class Fit:
    """A refitted hypothesis.

    Attributes:
        hypothesis: what was refitted.
        observed: to what.
        theta: where.
        whitened: (measured - predicted) / deviation, shape (channels, n).
        jacobian: of the prediction / deviation by theta, shape (channels, n, p).
        noise: variance of each channel in units of the stated one, shape (channels,).
    """

    hypothesis: Hypothesis
    observed: Observations
    theta: Array
    whitened: Array
    jacobian: Array
    noise: Array

    @property
    def base(self) -> Array:
        """Scaled base parameters."""
        return self.theta[:self.hypothesis.shared]

    @property
    def sizes(self) -> Array:
        """Sizes of the effects, in typical ones."""
        return self.theta[self.hypothesis.shared:]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects at their fitted sizes."""
        return self.hypothesis.with_sizes(self.sizes)

    @property
    def target(self) -> Array:
        """What a linear model near the refit has to reproduce, shape (channels, n)."""
        return np.asarray(self.whitened
                          + self.jacobian @ (self.theta - self.hypothesis.prior_mean))

    @cached_property
    def absorbed(self) -> Array:
        """What a refit nearby absorbs: an orthonormal basis, shape (channels x n + p, p).

        Of its columns, the noise divided out, and of the priors as further rows; for a hypothesis
        without effects.
        """
        scaled = self.jacobian / np.sqrt(self.noise)[:, None, None]
        prior = np.diag(1.0 / self.hypothesis.system.base.spread)
        basis, _ = np.linalg.qr(
            np.concatenate([scaled.reshape(-1, len(self.theta)), prior]))
        return np.asarray(basis)

    @cached_property
    def signatures(self) -> list[Signature]:
        """Every form of the library that can show beside the base model."""
        system, found = self.hypothesis.system, list[Signature]()
        # The refit leaves little of an effect: the slope that counts is that of a small one.
        theta = np.append(self.base, _SCREENED_SIZE)
        for form in (form for kind in system.library for form in forms_of(kind)):
            there = _whitened(Hypothesis(system, (form,)), self.observed, theta)
            # Where the typical size cannot be carried it says nothing.
            change = np.where(there == REFUSED, 0.0, self.whitened - there) / _SCREENED_SIZE
            if np.abs(change).max() >= _UNSEEN:
                found.append((form, change))
        return found

    def left(self, readings: Array, prior: Array | float = 0.0) -> Array:
        """What a refit leaves of changes of the readings, shape (k, channels, n), and of priors.

        Returns:
            The rows of `absorbed` one after another, shape (k, channels x n + p).
        """
        whole = np.concatenate([
            readings.reshape(len(readings), -1),
            np.broadcast_to(prior, (len(readings), len(self.theta)))], axis=1)
        return np.asarray(whole - whole @ self.absorbed @ self.absorbed.T)

    def as_measured(self, points: Points) -> Observations:
        """Other points as if read there: what is foretold, with the noise of the campaign."""
        observed = self.observed
        found = self.hypothesis.predict(self.theta, points, observed.channels)
        deviation = np.stack([channel.deviation(row) for channel, row in zip(
            observed.channels, found, strict=True)])
        deviation[0] = np.median(observed.deviation[0])
        return replace(observed, points=points, measured=found, number=np.arange(found.shape[1]),
                       deviation=deviation * np.sqrt(self.noise)[:, None])


def refit(
    hypothesis: Hypothesis, observed: Observations, start: Array | None = None,
    slopes: Array | None = None,
) -> Fit:
    """Fit base parameters and sizes within their bounds, by steps of Gauss and Newton.

    Sizes are held by their bounds alone; their prior enters when evidence is weighed.

    Args:
        hypothesis: what is assumed.
        observed: the bench.
        start: theta to start from, or its base part; None for the middle of the prior.
        slopes: `Fit.jacobian` there, nearly; the steps mend it (Broyden 1965), and it is taken anew
            only where they lead nowhere. None: at every step.
    """
    from scipy.optimize import lsq_linear

    middle, bounds = hypothesis.prior_mean, hypothesis.bounds
    theta = middle.copy()
    if start is not None:
        theta[:len(start)] = start
    theta = theta.clip(*bounds)
    here = _whitened(hypothesis, observed, theta)
    jacobian = _jacobian(hypothesis, observed, theta, here) if slopes is None else slopes
    prior = np.eye(hypothesis.shared, len(theta)) / hypothesis.system.base.spread[:, None]
    for _ in range(_PASSES):
        root = np.sqrt(_noise(observed, here, len(theta)))[:, None]

        def missed(here: Array, theta: Array, root: Array = root) -> Array:
            return np.append(here / root, prior @ (middle - theta))

        columns = np.concatenate([(jacobian / root[..., None]).reshape(-1, len(theta)), prior])
        left, before, whitened = missed(here, theta), theta, here
        aim = lsq_linear(columns, left + columns @ theta, bounds, "bvls").x
        for part in _PARTS:
            theta = (before + part * (aim - before)).clip(*bounds)  # `aim` may miss by rounding
            here = _whitened(hypothesis, observed, theta) if part else whitened
            if np.sum(missed(here, theta) ** 2) <= np.sum(left**2):
                break
        # A step cut short says nothing of how far it is still: the whole one has to be small.
        stuck, small = part == 0.0, np.linalg.norm(columns @ (aim - before)) < _SMALL
        if (stuck and slopes is None) or (small and not stuck):  # the slopes still hold
            break
        if slopes is None or stuck:
            slopes, jacobian = None, _jacobian(hypothesis, observed, theta, here)
        else:
            step = theta - before
            along = columns.T @ columns @ step
            jacobian = jacobian + (whitened - here - jacobian @ step)[..., None] * along / (
                step @ along)
    return Fit(hypothesis, observed, theta, here, jacobian, _noise(observed, here, len(theta)))


def linearise(
    hypothesis: Hypothesis, observed: Observations, theta: Array, noise: Array
) -> Fit:
    """Return a fit as it stands at given parameters, also at points it was not fitted to."""
    here = _whitened(hypothesis, observed, theta)
    return Fit(hypothesis, observed, theta, here, _jacobian(hypothesis, observed, theta, here),
               noise)


def _noise(observed: Observations, whitened: Array, parameters: int) -> Array:
    """Variance of each channel from its residuals and what was stated."""
    trust, n = observed.trust, len(observed)
    used = min(parameters, n - 1) / len(trust)
    return np.asarray((trust + np.sum(whitened**2, axis=1)) / (trust + max(n - used, 1.0)))


def _whitened(hypothesis: Hypothesis, observed: Observations, theta: Array) -> Array:
    found = hypothesis.predict(theta, observed.points, observed.channels)
    return np.nan_to_num((observed.measured - found) / observed.deviation, nan=REFUSED)


def _jacobian(
    hypothesis: Hypothesis, observed: Observations, theta: Array, here: Array
) -> Array:
    """Change of the prediction / deviation by each parameter, where `here` is left."""
    high, jacobian = hypothesis.bounds[1], np.empty((*here.shape, len(theta)))
    for i in range(len(theta)):
        step = _BASE_STEP if i < hypothesis.shared else _SIZE_STEP
        moved = theta.copy()
        moved[i] += step if theta[i] + step <= high[i] else -step
        there = _whitened(hypothesis, observed, moved)
        # Where an answer comes or goes there is no slope.
        jacobian[..., i] = np.where((there == REFUSED) == (here == REFUSED), here - there, 0.0) / (
            moved[i] - theta[i])
    return jacobian
