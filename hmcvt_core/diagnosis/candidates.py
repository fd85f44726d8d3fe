# SPDX-License-Identifier: Apache-2.0
"""The competitors for a gap, as linear models near their refits, and their evidence.

Three kinds compete: every form of every known effect (with an allowance for a form that is a
little off), a loss that nobody listed (a smooth field, or a step inside a region), and nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .evidence import evidence, gram, log_mean
from .hypothesis import Fit, Hypothesis, refit
from .observations import Observations
from .regions import Regions, smooth_functions
from .system import Effect, forms_of

Array = NDArray[np.float64]

SIZE_SPREADS = (0.5, 1.5, 5.0)
"""Prior standard deviations of a size, in typical sizes; equally likely."""

FORM_ALLOWANCES = (0.07, 0.25)
"""How far a form may bend, smoothly over the working space, as a part of its own signature."""

_ALLOWED_DEGREE = 2
_FIELD_DEGREE = 3
_UNSEEN = 1e-3  # deviations: an effect this small at typical size has no channel to show in
_SCREENED_SIZE = 0.1  # in typical sizes


@dataclass(frozen=True, eq=False)
class Linear:
    """One hypothesis as a linear model.

    Attributes:
        columns: of the prediction / deviation, shape (channels, n, p); base, nuisances, then its
            own.
        target: what the coefficients should reproduce, shape (channels, n).
        spread: prior standard deviations, shape (p,).
        positive: index of a coefficient that cannot be negative, or None.
        log: log evidence.
        covariance: posterior, of the coefficients, shape (p, p).
        noise: variance of each channel, shape (channels,).
    """

    columns: Array
    target: Array
    spread: Array
    positive: int | None
    log: float
    covariance: Array
    noise: Array


@dataclass(frozen=True, eq=False)
class Candidate:
    """One form of one effect (or of several), refitted.

    Attributes:
        fit: the refit.
        linear: the linear model at the refit with bends of the form, at its most likely prior
            scale: what is weighed.
        plain: the same without bends: what the saved model predicts.
        log: log evidence over the prior scales.
    """

    fit: Fit
    linear: Linear
    plain: Linear
    log: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        """With fitted sizes."""
        return self.fit.effects

    @property
    def names(self) -> tuple[str, ...]:
        """Effect names."""
        return tuple(effect.name for effect in self.fit.hypothesis.effects)


def weigh(
    observed: Observations, columns: Array, target: Array, spreads: Array,
    positive: int | None = None,
) -> list[Linear]:
    """Weigh the same columns under several priors, spreads of shape (m, p)."""
    one = gram(columns, target)
    found = evidence(np.broadcast_to(one, (len(spreads), *one.shape)), len(observed), spreads,
                     observed.trusts, positive)
    return [Linear(columns, target, spread, positive, float(log), covariance, noise)
            for spread, log, _, covariance, noise in zip(spreads, *found, strict=True)]


def nothing(base: Fit) -> Linear:
    """Weigh the base model alone."""
    return weigh(base.observed, base.jacobian, base.target,
                 base.hypothesis.prior_spread[None, :])[0]


# --- known effects --------------------------------------------------------------------------------


def screen(fit: Fit, without: str = "") -> list[tuple[float, Effect, Array]]:
    """Evidence of every form added to a refitted hypothesis, in linear approximation, best first.

    Args:
        fit: of the hypothesis that each form is added to.
        without: name of effects to leave out.

    Returns:
        Log evidence, form, and its signature: change of prediction / deviation by one typical
        size, shape (channels, n).
    """
    observed, system = fit.observed, fit.hypothesis.system
    here = observed.whiten(fit.hypothesis.predict(fit.theta, observed.points))
    spread = np.concatenate([fit.hypothesis.prior_spread, np.full(len(fit.sizes), 1.5)])
    spreads = np.stack([np.append(spread, scale) for scale in SIZE_SPREADS])
    results = []
    for form in (form for kind in system.library if kind.name != without
                 for form in forms_of(kind)):
        # The refit leaves little of an effect: the slope that counts is that of a small one.
        small = form.with_values({item.name: _SCREENED_SIZE * item.typical
                                  for item in form.sizes()})
        there = system.predict(fit.base, (*fit.effects, small), observed.points)
        change = np.nan_to_num((here - observed.whiten(there)) / _SCREENED_SIZE)
        # Where the typical size cannot be carried it says nothing.
        if np.abs(change).max() < _UNSEEN:
            continue
        tried = weigh(observed, np.concatenate([fit.jacobian, change[..., None]], axis=-1),
                      fit.target, spreads, _positive(form, len(spread)))
        results.append((log_mean([item.log for item in tried]), form, change))
    return sorted(results, key=lambda item: -item[0])


def _positive(effect: Effect, index: int) -> int | None:
    return index if effect.sizes()[0].low >= 0.0 else None


def candidate(base: Fit, effects: tuple[Effect, ...]) -> Candidate:
    """Refit an hypothesis exactly and weigh it, with an allowance for its form.

    Args:
        base: the refit without any effect, to start from.
        effects: with the shapes to use.
    """
    observed, hypothesis = base.observed, Hypothesis(base.hypothesis.system, effects)
    fit = refit(hypothesis, observed, base.base, base.nuisance)
    shared, k = hypothesis.shared, len(fit.sizes)
    bends = smooth_functions(observed.place, _ALLOWED_DEGREE)[0][:, 1:]
    own = [fit.jacobian[..., [shared + i]] * size * bends for i, size in enumerate(fit.sizes)]
    columns = np.concatenate([fit.jacobian, *own], axis=-1)
    each = np.ones(bends.shape[1] * k) / np.sqrt(bends.shape[1] / len(observed.place))
    spreads = np.stack([
        np.concatenate([hypothesis.prior_spread, np.full(k, scale), allowance * each])
        for scale in SIZE_SPREADS for allowance in FORM_ALLOWANCES])
    positive = _positive(effects[-1], shared + k - 1)
    tried = weigh(observed, columns, fit.target, spreads, positive)
    best = max(tried, key=lambda item: item.log)
    plain = weigh(observed, fit.jacobian, fit.target, best.spread[None, :shared + k], positive)[0]
    return Candidate(fit, best, plain, log_mean([item.log for item in tried]))


# --- what nobody listed ---------------------------------------------------------------------------


def fields(observed: Observations, beside: Linear) -> list[Linear]:
    """Weigh a loss that varies smoothly over the working space, channel by channel."""
    functions, degree = smooth_functions(observed.place, _FIELD_DEGREE)
    decay = 2.0 ** -(degree - 1.0).clip(0.0) / 2.0
    models = []
    for i, reading in enumerate(observed.readings):
        own = np.zeros((*beside.target.shape, functions.shape[1]))
        own[i] = functions * reading.unit_loss[:, None]
        columns = np.concatenate([beside.columns, own], axis=-1)
        spreads = np.stack([np.concatenate([beside.spread, scale * decay])
                            for scale in reading.channel.field_spreads])
        models += weigh(observed, columns, beside.target, spreads, beside.positive)
    return models


def steps(
    observed: Observations, boxes: Regions, beside: Linear, channel: int
) -> tuple[Array, Array]:
    """Weigh a loss in one channel inside each box beside an hypothesis.

    Returns:
        Log evidence of each, shape (boxes,), and the noise of the best, shape (channels,).
    """
    shared, target, reading = beside.columns, beside.target, observed.readings[channel]
    column = boxes.columns * reading.unit_loss
    p = shared.shape[-1]
    grams = np.zeros((len(boxes), len(target), p + 2, p + 2))
    keep = np.append(np.arange(p), p + 1)
    grams[:, :, keep[:, None], keep] = gram(shared, target)
    grams[:, channel, p, p] = np.sum(column**2, axis=1)
    cross = column @ np.concatenate([shared[channel], target[channel][:, None]], axis=1)
    grams[:, channel, p, keep] = cross
    grams[:, channel, keep, p] = cross
    found = [evidence(grams, len(observed),
                      np.broadcast_to(np.append(beside.spread, scale), (len(boxes), p + 1)),
                      observed.trusts) for scale in reading.channel.step_spreads]
    logs = np.logaddexp.reduce([item.log for item in found]) - np.log(len(found))
    return np.asarray(logs), found[0].noise[logs.argmax()]


def unlisted(
    observed: Observations, boxes: Regions, smooth: Sequence[Linear], beside: Linear
) -> float:
    """Log evidence of a loss that nobody listed: half a smooth field, half a step somewhere."""
    log = log_mean([item.log for item in smooth])
    if not len(boxes):
        return log
    placed = log_mean(np.concatenate([steps(observed, boxes, beside, channel)[0]
                                      for channel in range(len(observed.readings))]))
    return float(np.logaddexp(log, placed) - np.log(2.0))
