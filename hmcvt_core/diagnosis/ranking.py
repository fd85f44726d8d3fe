# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which competitor explains a gap: linear models near their refits, their evidence and ranking.

Three kinds compete: every form of every known effect, and pairs of them (with an allowance for a
form that is a little off); a loss that nobody listed (a smooth field, or a step inside a region);
and nothing.
"""

from __future__ import annotations

import math
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

PRIOR_UNLISTED = 0.10
_PRIOR_OF = {1: 1.0 - PRIOR_UNLISTED, 2: 0.10 * 2.0}  # one cause; two, in either order
_CLEAR = 4.0  # squared gap / squared noise of a channel that certainly shows one
_LEADERS = 5
_PAIRS = 8


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
    fit = refit(hypothesis, observed, base.base)
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


def steps(observed: Observations, boxes: Regions, beside: Linear) -> tuple[Array, list[Array]]:
    """Weigh a loss inside each box beside an hypothesis, channel by channel.

    Returns:
        Log evidence of each, shape (channels x boxes,), and for each channel the noise that the
        best of its boxes leaves, shape (channels,).
    """
    shared, target = beside.columns, beside.target
    p = shared.shape[-1]
    keep = np.append(np.arange(p), p + 1)
    every, noises = np.empty((len(target), len(boxes))), []
    for channel, reading in enumerate(observed.readings if len(boxes) else ()):
        column = boxes.members * reading.unit_loss
        grams = np.zeros((len(boxes), len(target), p + 2, p + 2))
        grams[:, :, keep[:, None], keep] = gram(shared, target)
        grams[:, channel, p, p] = np.sum(column**2, axis=1)
        cross = column @ np.concatenate([shared[channel], target[channel][:, None]], axis=1)
        grams[:, channel, p, keep] = cross
        grams[:, channel, keep, p] = cross
        found = [evidence(grams, len(observed),
                          np.broadcast_to(np.append(beside.spread, scale), (len(boxes), p + 1)),
                          observed.trusts) for scale in reading.channel.step_spreads]
        logs = every[channel] = np.logaddexp.reduce([item.log for item in found]) - np.log(
            len(found))
        noises.append(found[0].noise[logs.argmax()])
    return every.ravel(), noises


# --- the ranking ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Ranking:
    """Competitors weighed.

    Attributes:
        probability: that an effect is present, by name, most probable first.
        best: the most likely candidate that holds each effect, by name.
        unlisted: probability of a loss that nobody listed.
        leftover: log evidence that something smooth is left beside the leading candidate.
        explained: part of the squared gap that the leading candidate removes from each channel,
            shape (channels,), from the refits; NaN for a channel without a clear gap.
        noise: variance of the first channel in stated ones, by the best competitor of all.
        candidates: all that were refitted, best first.
        nothing: the base model alone.
    """

    probability: dict[str, float]
    best: dict[str, Candidate]
    unlisted: float
    leftover: float
    explained: Array
    noise: float
    candidates: tuple[Candidate, ...]
    nothing: Linear


def rank(base: Fit, boxes: Regions, candidates: Sequence[Candidate]) -> Ranking:
    """Weigh every competitor.

    Args:
        base: the refit without any effect.
        boxes: where a loss that nobody listed may lie.
        candidates: refitted sets of effects.
    """
    bare, = weigh(base.observed, base.jacobian, base.target, base.hypothesis.prior_spread[None])
    smooth, (placed, noises) = fields(base.observed, bare), steps(base.observed, boxes, bare)
    groups: dict[tuple[str, ...], list[Candidate]] = {}
    candidates = sorted(candidates, key=lambda item: -item.log)
    for item in candidates:
        groups.setdefault(tuple(sorted(item.names)), []).append(item)
    # Share of each name among the listed effects; forms of one name share it.
    prior = {effect.name: effect.prior for item in candidates for effect in item.fit.effects}
    total = sum(prior.values())
    prior = {name: value / total for name, value in prior.items()}
    logs = {names: np.log(math.prod((_PRIOR_OF[len(names)], *(prior[name] for name in names))))
            + log_mean([item.log for item in members]) for names, members in groups.items()}
    # A loss that nobody listed: half a smooth field, half a step somewhere.
    logs[()] = np.log(PRIOR_UNLISTED) + log_mean([
        log_mean(each) for each in ([item.log for item in smooth], placed) if len(each)])
    weights = np.exp(np.array(list(logs.values())) - max(logs.values()))
    posterior = dict(zip(logs, (weights / weights.sum()).tolist(), strict=True))
    probability = {name: sum(p for names, p in posterior.items() if name in names)
                   for name in sorted(prior)}
    likeliest = sorted(groups, key=posterior.__getitem__, reverse=True)
    best = {name: next(groups[names][0] for names in likeliest if name in names)
            for name in prior}
    leading = groups[likeliest[0]][0]
    left = fields(base.observed, leading.linear)
    noises += [item.noise for item in (leading.linear, *left)]
    pure = np.min([*noises, *steps(base.observed, boxes, leading.plain)[1]], axis=0)
    before, after = bare.noise - pure, leading.plain.noise - pure
    # A channel whose scatter hardly grows without the cause had no gap to remove.
    clear = before > _CLEAR * pure
    weighed = max((bare, *smooth, leading.linear), key=lambda item: item.log)
    # A narrow band would pass as noise for every competitor without one.
    noise = pure if posterior[()] > 0.5 else weighed.noise
    return Ranking(
        dict(sorted(probability.items(), key=lambda item: -item[1])), best, posterior[()],
        log_mean([item.log for item in left]) - leading.linear.log,
        np.where(clear, 1.0 - after / np.where(clear, before, 1.0), np.nan), float(noise[0]),
        tuple(candidates), bare)


def single_candidates(base: Fit) -> list[Candidate]:
    """Refit one form of every kind of effect, and every form of the leading kinds."""
    by_kind: dict[tuple[str, str], Effect] = {}
    for _, form, _ in screen(base):
        by_kind.setdefault((form.name, form.form), form)
    # The screen is linear: good enough to pick a shape within a kind, not to drop a kind.
    found = [candidate(base, (form,)) for form in by_kind.values()]
    found.sort(key=lambda item: -item.log)
    for item in found[:_LEADERS]:
        effect, = item.fit.effects
        done = by_kind[effect.name, effect.form]
        found += [candidate(base, (form,)) for form in forms_of(done) if form != done]
    return sorted(found, key=lambda item: -item.log)


def pair_candidates(base: Fit, singles: Sequence[Candidate]) -> list[Candidate]:
    """Refit the likeliest pairs of a leading effect and another one."""
    leaders: dict[str, Candidate] = {}
    for item in singles:
        leaders.setdefault(item.names[0], item)
    screened = [(log, (*item.fit.effects, form)) for item in list(leaders.values())[:_LEADERS]
                for log, form, _ in screen(item.fit, item.names[0])[:_PAIRS]]
    distinct: dict[frozenset[tuple[str, str]], tuple[Effect, ...]] = {}
    for _, effects in sorted(screened, key=lambda entry: -entry[0]):
        distinct.setdefault(frozenset((effect.name, effect.form) for effect in effects), effects)
    return [candidate(base, effects) for effects in list(distinct.values())[:_PAIRS]]
