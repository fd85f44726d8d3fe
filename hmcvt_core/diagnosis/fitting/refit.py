# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The refit of a hypothesis to the bench.

Every hypothesis is refitted together with the base parameters: a few free parameters swallow most
of the signature of any effect, so a comparison at fixed base parameters would compare nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..observations import Observations
from ..settings import (
    AUXILIARY_VARIANCE_RATIO,
    BASE_DIFFERENCE,
    INVISIBLE_SIGNATURE,
    NEGLIGIBLE_STEP,
    NO_ANSWER,
    REFIT_STEPS,
    ROUGH_REFIT_STEPS,
    SIGNATURE_SIZE,
    SIZE_DIFFERENCE,
    STEP_PARTS,
)
from ..system import Array, Effect, Points, forms_of
from .hypothesis import Hypothesis

Signature = tuple[Effect, Array]
"""A form, and the change of prediction / deviation by one typical size, shape (channels, n)."""


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
        return self.theta[: self.hypothesis.base_count]

    @property
    def sizes(self) -> Array:
        """Sizes of the effects, in typical ones."""
        return self.theta[self.hypothesis.size_indices]

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
    def nuisance_basis(self) -> Array:
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
            (form, change)
            for form, change in every
            if np.abs(change).max() >= INVISIBLE_SIGNATURE
        ]

    def signature(self, form: Effect) -> Array:
        """Change by one typical size of a form beside what there is, shape (channels, n)."""
        more = replace(self.hypothesis, effects=(*self.hypothesis.effects, form))
        # The refit leaves little of an effect: the slope that counts is that of a small one.
        there = _whitened(more, self.observed, np.append(self.theta, SIGNATURE_SIZE))
        # Where the typical size cannot be carried it says nothing.
        return np.where(there == NO_ANSWER, 0.0, self.whitened - there) / SIGNATURE_SIZE

    def project_out(self, readings: Array, prior: Array | float = 0.0) -> Array:
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
        return np.asarray(whole - whole @ self.nuisance_basis @ self.nuisance_basis.T)

    def served_fit(self, noise: Array) -> Fit:
        """Refit so that channels that are not served bear what forms are off.

        The likeliest refit may give up one that is, to meet another to the last digit. `noise` is
        that of each channel, forms aside, shape (channels,).
        """
        served = [channel.served for channel in self.observed.channels]
        weights = np.where(
            served, noise, np.maximum(self.noise, AUXILIARY_VARIANCE_RATIO * noise)
        )
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

    def observations_at(self, points: Points) -> Observations:
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
            self.hypothesis.local_variation(
                self.theta, points, observed.channels, found
            ),
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
    for _ in range(ROUGH_REFIT_STEPS if rough else REFIT_STEPS):
        weight = _noise(observed, here, len(theta)) if noise is None else noise
        root = np.sqrt(weight)[:, None]

        def missed(here: Array, theta: Array, root: Array = root) -> Array:
            return np.append(here / root, prior @ (middle - theta))

        columns = np.concatenate(
            [(jacobian / root[..., None]).reshape(-1, len(theta)), prior]
        )
        left, before, whitened = missed(here, theta), theta, here
        aim = lsq_linear(columns, left + columns @ theta, bounds, "bvls").x
        small, edge = np.linalg.norm(columns @ (aim - theta)) < NEGLIGIBLE_STEP, False
        for part in (0.0,) if small else (*STEP_PARTS, 0.0):
            theta = (before + part * (aim - before)).clip(
                *bounds
            )  # `aim` may miss by rounding
            here = _whitened(hypothesis, observed, theta) if part else whitened
            if np.sum(missed(here, theta) ** 2) <= np.sum(left**2) - NEGLIGIBLE_STEP**2:
                break
            edge = edge or bool(((here == NO_ANSWER) > (whitened == NO_ANSWER)).any())
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


def with_free_shapes(fit: Fit, rough: bool = False) -> Fit:
    """Refit with the shapes of all effects free, from where a refit ended."""
    before, observed = fit.hypothesis, fit.observed
    free = replace(before, effects=fit.effects, free_shapes=len(fit.effects))
    theta = free.theta(fit.base)
    known = np.array(
        [
            *np.full(before.base_count, True),
            *(item in before.free_parameters for item in free.free_parameters),
        ]
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


def refit_without(fit: Fit, i: int) -> Fit:
    """Refit without one of the effects, from where a refit ended."""
    before = fit.hypothesis
    kept = np.array(
        [
            *np.full(before.base_count, True),
            *(place != i for place, _ in before.free_parameters),
        ]
    )
    rest = replace(
        before,
        effects=(*fit.effects[:i], *fit.effects[i + 1 :]),
        free_shapes=before.free_shapes - (i < before.free_shapes),
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
    prior_dof, n = observed.prior_dof, len(observed)
    used = min(parameters, n - 1) / len(prior_dof)
    return np.asarray(
        (prior_dof + np.sum(whitened**2, axis=1)) / (prior_dof + max(n - used, 1.0))
    )


def _whitened(hypothesis: Hypothesis, observed: Observations, theta: Array) -> Array:
    found = hypothesis.predict(theta, observed.points, observed.channels)
    return np.nan_to_num(
        (observed.measured - found) / observed.deviation, nan=NO_ANSWER
    )


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
        step = BASE_DIFFERENCE if i < hypothesis.base_count else SIZE_DIFFERENCE
        moved = theta.copy()
        moved[i] += step if theta[i] + step <= high[i] else -step
        there = _whitened(hypothesis, observed, moved)
        # Where an answer comes or goes there is no slope.
        jacobian[..., place] = np.where(
            (there == NO_ANSWER) == (here == NO_ANSWER), here - there, 0.0
        ) / (moved[i] - theta[i])
    return jacobian
