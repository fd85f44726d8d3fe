# SPDX-License-Identifier: Apache-2.0
"""Which competitor explains a gap: posterior probabilities over effects, pairs and the unlisted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .candidates import Candidate, Linear, candidate, fields, nothing, screen, steps, unlisted
from .evidence import log_mean
from .hypothesis import Fit
from .observations import Observations
from .regions import Regions
from .system import Effect, forms_of

Array = NDArray[np.float64]

PRIOR_UNLISTED = 0.10
_PRIOR_PAIR = 0.10  # that a gap has two causes
_CLEAR = 4.0  # squared gap / squared noise of a channel that certainly shows one
_LEADERS = 5
_PAIRS = 8


@dataclass(frozen=True, eq=False)
class Ranking:
    """Competitors weighed.

    Attributes:
        probability: that an effect is present, by name, most probable first.
        best: the most likely candidate that holds each effect, by name.
        leading: the most likely candidate of all, single or pair.
        unlisted: probability of a loss that nobody listed.
        leftover: log evidence that something smooth is left beside the leading candidate.
        explained: part of the squared gap that the leading candidate removes from each channel,
            shape (channels,), from the refits; NaN for a channel without a clear gap.
        pure: lowest noise variance that any competitor leaves, in stated ones, (channels,).
        candidates: all that were refitted, best first.
        nothing: the base model alone.
        field: the best smooth field.
    """

    probability: dict[str, float]
    best: dict[str, Candidate]
    leading: Candidate
    unlisted: float
    leftover: float
    explained: Array
    pure: Array
    candidates: tuple[Candidate, ...]
    nothing: Linear
    field: Linear


def rank(base: Fit, boxes: Regions, candidates: Sequence[Candidate]) -> Ranking:
    """Weigh every competitor.

    Args:
        base: the refit without any effect.
        boxes: where a loss that nobody listed may lie.
        candidates: refitted sets of effects.
    """
    bare = nothing(base)
    smooth = fields(base.observed, bare)
    groups: dict[tuple[str, ...], list[Candidate]] = {}
    candidates = sorted(candidates, key=lambda item: -item.log)
    for item in candidates:
        groups.setdefault(tuple(sorted(item.names)), []).append(item)
    prior = _priors([effect for item in candidates for effect in item.effects])
    logs = {names: np.log(_prior_of(names, prior)) + log_mean([item.log for item in members])
            for names, members in groups.items()}
    logs[()] = np.log(PRIOR_UNLISTED) + unlisted(base.observed, boxes, smooth, bare)
    weights = np.exp(np.array(list(logs.values())) - max(logs.values()))
    posterior = dict(zip(logs, (weights / weights.sum()).tolist(), strict=True))
    probability = {name: sum(p for names, p in posterior.items() if name in names)
                   for name in sorted(prior)}
    likeliest = sorted(groups, key=posterior.__getitem__, reverse=True)
    best = {name: next(groups[names][0] for names in likeliest if name in names)
            for name in prior}
    leading = groups[likeliest[0]][0]
    return Ranking(dict(sorted(probability.items(), key=lambda item: -item[1])), best, leading,
                   posterior[()], *_left(base.observed, boxes, leading, bare),
                   tuple(candidates), bare, max(smooth, key=lambda item: item.log))


def _priors(effects: Sequence[Effect]) -> dict[str, float]:
    """Share of each name among the listed effects; forms of one name share it."""
    weight = {effect.name: effect.prior for effect in effects}
    total = sum(weight.values())
    return {name: value / total for name, value in weight.items()}


def _prior_of(names: tuple[str, ...], prior: dict[str, float]) -> float:
    if len(names) == 1:
        return (1.0 - PRIOR_UNLISTED) * prior[names[0]]
    first, second = names
    return _PRIOR_PAIR * 2.0 * prior[first] * prior[second]


def _left(
    observed: Observations, boxes: Regions, leading: Candidate, bare: Linear
) -> tuple[float, Array, Array]:
    """What the leading candidate leaves: `leftover`, `explained` and `pure` of `Ranking`."""
    smooth = fields(observed, leading.linear)
    leftover = log_mean([item.log for item in smooth]) - leading.linear.log
    noises = [item.noise for item in (leading.linear, *smooth)]
    if len(boxes):
        noises += [steps(observed, boxes, base, channel)[1]
                   for channel in range(len(observed.readings)) for base in (bare, leading.plain)]
    pure = np.min(noises, axis=0)
    before, after = bare.noise - pure, leading.plain.noise - pure
    # A channel whose scatter hardly grows without the cause had no gap to remove.
    clear = before > _CLEAR * pure
    explained = np.where(clear, 1.0 - after / np.where(clear, before, 1.0), np.nan)
    return leftover, explained, pure


def single_candidates(base: Fit) -> list[Candidate]:
    """Refit one form of every kind of effect, and every form of the leading kinds."""
    by_kind: dict[tuple[str, str], Effect] = {}
    for _, form, _ in screen(base):
        by_kind.setdefault((form.name, form.form), form)
    # The screen is linear: good enough to pick a shape within a kind, not to drop a kind.
    found = [candidate(base, (form,)) for form in by_kind.values()]
    found.sort(key=lambda item: -item.log)
    for item in found[:_LEADERS]:
        effect, = item.effects
        done = by_kind[effect.name, effect.form]
        found += [candidate(base, (form,)) for form in forms_of(done) if form != done]
    return sorted(found, key=lambda item: -item.log)


def pair_candidates(base: Fit, singles: Sequence[Candidate]) -> list[Candidate]:
    """Refit the likeliest pairs of a leading effect and another one."""
    leaders: dict[str, Candidate] = {}
    for item in singles:
        leaders.setdefault(item.names[0], item)
    screened = [(log, (*item.effects, form)) for item in list(leaders.values())[:_LEADERS]
                for log, form, _ in screen(item.fit, item.names[0])[:_PAIRS]]
    distinct: dict[frozenset[tuple[str, str]], tuple[Effect, ...]] = {}
    for _, effects in sorted(screened, key=lambda entry: -entry[0]):
        distinct.setdefault(frozenset((effect.name, effect.form) for effect in effects), effects)
    return [candidate(base, effects) for effects in list(distinct.values())[:_PAIRS]]
