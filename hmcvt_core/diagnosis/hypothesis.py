# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A hypothesis: the base model with some effects, their sizes free; and its refit to the bench.

Every hypothesis is refitted together with the base parameters: a few free parameters swallow most
of the signature of any effect, so a comparison at fixed base parameters would compare nothing.

Parameters are theta: scaled base parameters, then of every effect its size, in typical ones, and
its shapes where they are free, as parts of their range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .observations import Observations
from .system import Array, Channel, Effect, Points, System, forms_of

Signature = tuple[Effect, Array]
"""A form, and the change of prediction / deviation by one typical size, shape (channels, n)."""

REFUSED = 100.0
"""Standard deviations charged where a hypothesis has no answer.

More than any misfit, or refits to a large gap would hide the worst points where there is none.
"""

_SCREENED_SIZE = 0.1  # in typical sizes
_UNSEEN = (
    1e-3  # deviations: an effect this small at typical size has no channel to show in
)
_PASSES, _ROUGH = 60, 6  # at most; of a rough refit
_PARTS = (
    1.0,
    0.5,
    0.2,
    0.05,
    0.01,
    0.0,
)  # of a step, until it is one down; at last none
_OTHERS_BEAR = (
    9.0  # times the variance of their noise, at least, the channels not served
)
_SMALL = (
    0.3  # standard deviations: a step that changes or gains less is not worth making
)
_BASE_STEP, _SIZE_STEP = 1e-5, 1e-3  # of the differences
# Anywhere in its range, as a normal: its mean, and the deviation that gives it the density there.
_MIDDLE, _ANYWHERE = 0.5, (2.0 * np.pi) ** -0.5


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A system and effects whose sizes are free.

    Attributes:
        system: what stands on the bench.
        effects: with the shapes to use; what is free of them is fitted.
        opposite: whether sizes that cannot be negative are negative: effects that nobody listed.
        bent: of how many effects, from the first, the shapes are free too.
    """

    system: System
    effects: tuple[Effect, ...] = ()
    opposite: bool = False
    bent: int = 0

    @property
    def shared(self) -> int:
        """How many parameters every hypothesis has."""
        return len(self.system.base)

    @cached_property
    def free(self) -> list[tuple[int, Any]]:
        """Which effect, and which parameter of it, each theta after the shared ones is."""
        return [
            (i, item)
            for i, effect in enumerate(self.effects)
            for item in (
                effect.sizes()[0],
                *(
                    other
                    for other in effect.parameters()
                    if i < self.bent and other.bends
                ),
            )
        ]

    @cached_property
    def sizes(self) -> NDArray[np.intp]:
        """Places of the sizes in theta, one for each effect."""
        return self.shared + np.flatnonzero([item.is_size for _, item in self.free])

    @property
    def prior_mean(self) -> Array:
        """Mean of theta; sizes are free and have zero."""
        return np.append(
            self.system.base.mean,
            [0.0 if item.is_size else _MIDDLE for _, item in self.free],
        )

    def spread(self, sizes: Array | float) -> Array:
        """Prior standard deviations of theta, for those of the sizes."""
        found = np.append(self.system.base.spread, np.full(len(self.free), _ANYWHERE))
        found[self.sizes] = sizes
        return found

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta."""
        base, ends = self.system.base, []
        for _, item in self.free:
            low, high = _scaled(item, item.low), _scaled(item, item.high)
            ends.append(
                (-high, -max(low, 0.0))
                if self.opposite and item.is_size
                else (low, high)
            )
        lowest, highest = np.array(ends).reshape(-1, 2).T
        return np.append(base.low, lowest), np.append(base.high, highest)

    @property
    def signs(self) -> Array:
        """1 or -1 for sizes of one sign only, 0 for the others, NaN for what is none, (p,)."""
        low, high = (end[self.sizes] for end in self.bounds)
        one = np.full(self.shared + len(self.free), np.nan)
        one[self.sizes] = np.where(low >= 0.0, 1.0, np.where(high <= 0.0, -1.0, 0.0))
        return one

    def effects_at(self, theta: Array) -> tuple[Effect, ...]:
        """Return the effects as they are at theta."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for (i, item), value in zip(
            self.free, theta[self.shared :].tolist(), strict=True
        ):
            values[i][item.name] = _value(item, value)
        return tuple(
            effect.with_values(each)
            for effect, each in zip(self.effects, values, strict=True)
        )

    def theta(self, base: Array) -> Array:
        """Return where the effects are as they stand, for scaled base parameters."""
        return np.append(
            base,
            [
                _scaled(item, self.effects[i].values()[item.name])
                for i, item in self.free
            ],
        )

    def predict(
        self, theta: Array, points: Points, channels: Sequence[Channel] = ()
    ) -> Array:
        """Return some channels, or every one, shape (channels, n)."""
        found = self.system.predict(
            theta[: self.shared], self.effects_at(theta), points
        )
        names = [channel.name for channel in self.system.channels]
        return (
            found[[names.index(channel.name) for channel in channels]]
            if channels
            else found
        )

    def turning(
        self, theta: Array, points: Points, channels: Sequence[Channel], here: Array
    ) -> Array:
        """How far readings, `here`, turn within `Axis.turns` of points, in their units.

        What is served hardly does, and what is stated of its noise stands. Shape (channels, n).
        """
        found = np.zeros_like(here)
        for axis in (axis for axis in self.system.axes if axis.turns):
            around = sum(
                self.predict(theta, {**points, axis.name: place}, channels)
                for place in points[axis.name] + axis.turns * np.array([[-1.0], [1.0]])
            )
            found = np.fmax(
                found, np.abs(around / 2.0 - here)
            )  # of NaN and a number, the number
        found[[channel.served for channel in channels]] = 0.0
        return found


def _scaled(item: Any, value: float) -> float:
    """A size in typical ones; a shape as the part of its range, in proportion where it can be."""
    if item.is_size:
        return value / item.typical
    if item.low > 0.0:
        return math.log(value / item.low) / math.log(item.high / item.low)
    return (value - item.low) / (item.high - item.low)


def _value(item: Any, scaled: float) -> float:
    """What `_scaled` gives back; a shape stays in its range, however it is rounded."""
    if item.is_size:
        return scaled * item.typical
    found = (
        item.low * (item.high / item.low) ** scaled
        if item.low > 0.0
        else (item.low + scaled * (item.high - item.low))
    )
    return min(max(found, item.low), item.high)


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
        return self.theta[: self.hypothesis.shared]

    @property
    def sizes(self) -> Array:
        """Sizes of the effects, in typical ones."""
        return self.theta[self.hypothesis.sizes]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects as fitted."""
        return self.hypothesis.effects_at(self.theta)

    @property
    def target(self) -> Array:
        """What a linear model near the refit has to reproduce, shape (channels, n)."""
        return np.asarray(
            self.whitened + self.jacobian @ (self.theta - self.hypothesis.prior_mean)
        )

    @cached_property
    def absorbed(self) -> Array:
        """What a refit nearby absorbs: an orthonormal basis, shape (channels x n + p, p).

        Of its columns, the noise divided out, and of the priors as further rows; for a hypothesis
        without effects.
        """
        scaled = self.jacobian / np.sqrt(self.noise)[:, None, None]
        prior = np.diag(1.0 / self.hypothesis.system.base.spread)
        basis, _ = np.linalg.qr(
            np.concatenate([scaled.reshape(-1, len(self.theta)), prior])
        )
        return np.asarray(basis)

    @cached_property
    def signatures(self) -> list[Signature]:
        """Every form of the library that can show beside the base model."""
        every = (
            (form, self.signature(form))
            for kind in self.hypothesis.system.library
            for form in forms_of(kind)
        )
        return [
            (form, change) for form, change in every if np.abs(change).max() >= _UNSEEN
        ]

    def signature(self, form: Effect) -> Array:
        """Change by one typical size of a form beside what there is, shape (channels, n)."""
        more = replace(self.hypothesis, effects=(*self.hypothesis.effects, form))
        # The refit leaves little of an effect: the slope that counts is that of a small one.
        there = _whitened(more, self.observed, np.append(self.theta, _SCREENED_SIZE))
        # Where the typical size cannot be carried it says nothing.
        return np.where(there == REFUSED, 0.0, self.whitened - there) / _SCREENED_SIZE

    def left(self, readings: Array, prior: Array | float = 0.0) -> Array:
        """What a refit leaves of changes of the readings, shape (k, channels, n), and of priors.

        Returns:
            The rows of `absorbed` one after another, shape (k, channels x n + p).
        """
        whole = np.concatenate(
            [
                readings.reshape(len(readings), -1),
                np.broadcast_to(prior, (len(readings), len(self.theta))),
            ],
            axis=1,
        )
        return np.asarray(whole - whole @ self.absorbed @ self.absorbed.T)

    def delivered(self, noise: Array) -> Fit:
        """Refit so that channels that are not served bear what forms are off.

        The likeliest refit may give up one that is, to meet another to the last digit. `noise` is
        that of each channel, forms aside, shape (channels,).
        """
        served = [channel.served for channel in self.observed.channels]
        weights = np.where(served, noise, np.maximum(self.noise, _OTHERS_BEAR * noise))
        return (
            self
            if all(served)
            else refit(
                self.hypothesis,
                self.observed,
                self.theta,
                self.jacobian,
                rough=True,
                noise=weights,
            )
        )

    def as_measured(self, points: Points) -> Observations:
        """Other points as if read there: what is foretold, with the noise of the campaign."""
        observed = self.observed
        found = self.hypothesis.predict(self.theta, points, observed.channels)
        deviation = np.stack(
            [
                channel.deviation(row)
                for channel, row in zip(observed.channels, found, strict=True)
            ]
        )
        deviation[0] = np.median(observed.deviation[0])
        deviation = np.hypot(
            deviation * np.sqrt(self.noise)[:, None],
            self.hypothesis.turning(self.theta, points, observed.channels, found),
        )
        return replace(
            observed,
            points=points,
            measured=found,
            number=np.arange(found.shape[1]),
            deviation=deviation,
        )


def refit(
    hypothesis: Hypothesis,
    observed: Observations,
    start: Array | None = None,
    slopes: Array | None = None,
    *,
    rough: bool = False,
    noise: Array | None = None,
) -> Fit:
    """Fit base parameters and sizes within their bounds, by steps of Gauss and Newton.

    Sizes are held by their bounds alone; their prior enters when evidence is weighed. At the
    edge of what can be carried, where steps from the start lose an answer and none is one down, the
    middle of the prior is another start.

    Args:
        hypothesis: what is assumed.
        observed: the bench.
        start: theta to start from, or its base part; None for the middle of the prior.
        slopes: `Fit.jacobian` there, nearly. The steps mend it (Broyden 1965); it is taken anew
            where they lead nowhere and at the end.
        rough: whether to end there instead, unless they lead nowhere from the start.
        noise: variance of each channel to weigh them by; None for what the residuals say.
    """
    from scipy.optimize import lsq_linear

    middle, bounds = hypothesis.prior_mean, hypothesis.bounds
    theta = middle.copy()
    if start is not None:
        theta[: len(start)] = start
    theta = theta.clip(*bounds)
    here = _whitened(hypothesis, observed, theta)
    exact, moved = slopes is None, False
    jacobian = (
        _jacobian(hypothesis, observed, theta, here) if slopes is None else slopes
    )
    prior = np.diag(1.0 / hypothesis.spread(np.inf))
    for _ in range(_ROUGH if rough else _PASSES):
        weight = _noise(observed, here, len(theta)) if noise is None else noise
        root = np.sqrt(weight)[:, None]

        def missed(here: Array, theta: Array, root: Array = root) -> Array:
            return np.append(here / root, prior @ (middle - theta))

        columns = np.concatenate(
            [(jacobian / root[..., None]).reshape(-1, len(theta)), prior]
        )
        left, before, whitened = missed(here, theta), theta, here
        aim = lsq_linear(columns, left + columns @ theta, bounds, "bvls").x
        small, edge = np.linalg.norm(columns @ (aim - theta)) < _SMALL, False
        for part in (0.0,) if small else _PARTS:
            theta = (before + part * (aim - before)).clip(
                *bounds
            )  # `aim` may miss by rounding
            here = _whitened(hypothesis, observed, theta) if part else whitened
            if np.sum(missed(here, theta) ** 2) <= np.sum(left**2) - _SMALL**2:
                break
            edge = edge or bool(((here == REFUSED) > (whitened == REFUSED)).any())
        if part:
            step = theta - before
            along = columns.T @ columns @ step
            moved, exact, jacobian = (
                True,
                False,
                jacobian
                + (whitened - here - jacobian @ step)[..., None]
                * along
                / (step @ along),
            )
        elif exact or (rough and (small or moved)):
            if edge and not moved and start is not None and noise is None:
                other = refit(hypothesis, observed, rough=rough)
                if (
                    np.sum(np.log(other.noise / _noise(observed, here, len(theta))))
                    < 0.0
                ):
                    return other
            break
        else:
            exact, jacobian = True, _jacobian(hypothesis, observed, theta, here)
    return Fit(
        hypothesis, observed, theta, here, jacobian, _noise(observed, here, len(theta))
    )


def freed(fit: Fit, rough: bool = False) -> Fit:
    """Refit with the shapes of all effects free, from where a refit ended."""
    before, observed = fit.hypothesis, fit.observed
    free = replace(before, effects=fit.effects, bent=len(fit.effects))
    theta = free.theta(fit.base)
    known = np.array(
        [*np.full(before.shared, True), *(item in before.free for item in free.free)]
    )
    slopes = np.empty((*fit.whitened.shape, len(theta)))
    slopes[..., known] = fit.jacobian
    slopes[..., ~known] = _jacobian(
        free,
        observed,
        theta,
        _whitened(free, observed, theta),
        np.flatnonzero(~known).tolist(),
    )
    return refit(free, observed, theta, slopes, rough=rough)


def without(fit: Fit, i: int) -> Fit:
    """Refit without one of the effects, from where a refit ended."""
    before = fit.hypothesis
    kept = np.array(
        [*np.full(before.shared, True), *(place != i for place, _ in before.free)]
    )
    rest = replace(
        before,
        effects=(*fit.effects[:i], *fit.effects[i + 1 :]),
        bent=before.bent - (i < before.bent),
    )
    return refit(
        rest, fit.observed, fit.theta[kept], fit.jacobian[..., kept], rough=True
    )


def linearise(
    hypothesis: Hypothesis, observed: Observations, theta: Array, noise: Array
) -> Fit:
    """Return a fit as it stands at given parameters, also at points it was not fitted to."""
    here = _whitened(hypothesis, observed, theta)
    return Fit(
        hypothesis,
        observed,
        theta,
        here,
        _jacobian(hypothesis, observed, theta, here),
        noise,
    )


def _noise(observed: Observations, whitened: Array, parameters: int) -> Array:
    """Variance of each channel from its residuals and what was stated."""
    trust, n = observed.trust, len(observed)
    used = min(parameters, n - 1) / len(trust)
    return np.asarray(
        (trust + np.sum(whitened**2, axis=1)) / (trust + max(n - used, 1.0))
    )


def _whitened(hypothesis: Hypothesis, observed: Observations, theta: Array) -> Array:
    found = hypothesis.predict(theta, observed.points, observed.channels)
    return np.nan_to_num((observed.measured - found) / observed.deviation, nan=REFUSED)


def _jacobian(
    hypothesis: Hypothesis,
    observed: Observations,
    theta: Array,
    here: Array,
    which: Sequence[int] | None = None,
) -> Array:
    """Change of the prediction / deviation by each parameter, or some, where `here` is left."""
    which = range(len(theta)) if which is None else which
    high, jacobian = hypothesis.bounds[1], np.empty((*here.shape, len(which)))
    for place, i in enumerate(which):
        step = _BASE_STEP if i < hypothesis.shared else _SIZE_STEP
        moved = theta.copy()
        moved[i] += step if theta[i] + step <= high[i] else -step
        there = _whitened(hypothesis, observed, moved)
        # Where an answer comes or goes there is no slope.
        jacobian[..., place] = np.where(
            (there == REFUSED) == (here == REFUSED), here - there, 0.0
        ) / (moved[i] - theta[i])
    return jacobian
