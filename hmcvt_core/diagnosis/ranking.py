# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which explanation is how probable: sets of one, two or three effects, and what nobody listed.

All compete with one evidence. The search always looks for sets: the linear screen proposes, the
exact refit decides, and whoever leads is asked what may stand beside it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit, Signature
from .regions import Regions
from .rivals import (
    Proposal,
    Rival,
    exact,
    explanation,
    fields,
    local,
    misfitting,
    nothing,
    screen,
)

Array = NDArray[np.float64]

PRIOR_NO_GAP = 0.5
"""Probability of an exact base and nothing else, before any bench; the rest is given a gap."""
PRIOR_OF_SIZE = {1: 0.40, 2: 0.15, 3: 0.05}
"""Probability that a gap has so many listed causes; all sets of one size are alike.

Each further cause is rarer by a factor of three to four: what a larger set has to pay.
"""
PRIOR_MISFIT = 0.30
"""Probability that a gap is a base model that is a little off, and nothing else.

No model is exact: that is nearly as likely as a single cause.
"""
PRIOR_UNLISTED = 0.10
"""Probability that a loss that nobody listed is all of a gap; the same of one beside each set."""

_KINDS = 12  # single effects refitted, and sets refitted exactly at the end
_LEADERS, _SETS = 4, 6  # whom to ask for a further effect; how many of each proposal are refitted
_SAMPLES_EACH = 16  # for each cause of a set: three causes need about 48
_BESIDE = 4  # leading sets that are tried with an unlisted loss beside them
# A form stays in the race whose gain is so near the best, in part and in nats.
_NEAR, _BEHIND = 0.7, 4.0
_HOPELESS = 10.0  # nats behind the best
_OPPOSITE = 3  # effects tried with the wrong sign
Names = tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Ranking:
    """Rivals weighed.

    Attributes:
        rivals: the likeliest refit of each set and of each kind of unlisted loss, best first.
        probability: of each, given that there is a gap; they sum to 1.
        bare: the base model alone, which has none.
        no_gap: the probability of that.
    """

    rivals: tuple[Rival, ...]
    probability: tuple[float, ...]
    bare: Rival
    no_gap: float

    def entries(self) -> Iterator[tuple[Rival, float]]:
        """Rivals and their probabilities."""
        return zip(self.rivals, self.probability, strict=True)

    @cached_property
    def sets(self) -> dict[Names, tuple[Rival, float]]:
        """Refit and probability of each set of listed effects alone, most probable first."""
        return {rival.names: (rival, p) for rival, p in self.entries() if rival.listed}

    @cached_property
    def unlisted(self) -> float:
        """Probability that listed effects are not all of it."""
        return 1.0 - sum(p for _, p in self.sets.values())

    def is_misfit(self, rival: Rival) -> bool:
        """Whether a rival is a base model that is a little off and nothing else."""
        return not rival.names and rival.beside is not None and rival.beside.of_base

    @cached_property
    def misfit(self) -> float:
        """Probability that the base model is a little off and nothing else."""
        return sum(p for rival, p in self.entries() if self.is_misfit(rival))

    @cached_property
    def effects(self) -> dict[str, float]:
        """Probability that an effect is present, by name, most probable first."""
        names = {name for rival in self.rivals for name in rival.names}
        each = {name: min(1.0, sum(p for rival, p in self.entries() if name in rival.names
                          and not rival.fit.hypothesis.opposite)) for name in sorted(names)}
        return dict(sorted(((name, p) for name, p in each.items() if p), key=lambda item: -item[1]))

    def best_with(self, name: str) -> Rival:
        """The most probable set that holds an effect."""
        return next(rival for names, (rival, _) in self.sets.items() if name in names)


def rank(base: Fit, boxes: Regions) -> Ranking:
    """Search and weigh.

    Args:
        base: the refit without any effect.
        boxes: where a loss that nobody listed may lie.
    """
    bare, library = nothing(base), base.signatures
    sets, kinds = search(base, library)
    found = [(rival, math.log(PRIOR_OF_SIZE[len(rival.names)]
                              / math.comb(kinds, len(rival.names))) + log) for rival, log in sets]
    found.sort(key=lambda item: -item[1])
    for i, (rival, log) in enumerate(found[:_BESIDE]):
        prior = log - rival.log + math.log(PRIOR_UNLISTED / 2.0)
        found += _shared(fields(rival), prior)
        if i == 0 and (placed := local(rival, boxes)) is not None:
            found += _shared([placed], prior)
    found += _shared([misfitting(bare)], math.log(PRIOR_MISFIT))
    # A loss that nobody listed: smooth, in some place, or of a listed effect with the wrong sign.
    placed = local(bare, boxes)
    wrong = _distinct(screen(base, library, opposite=True))
    families = [fields(bare), [] if placed is None else [placed],
                [replace(rival := exact(explanation(each.refit(True))), log=rival.log + each.price)
                 for each in wrong[:_OPPOSITE] if each.gain > 0.0]]
    counts = len(families[0]), 1, len(wrong)
    for members, count in zip(families, counts, strict=True):
        found += _shared(members, math.log(PRIOR_UNLISTED / len(families)), count)
    found.sort(key=lambda item: -item[1])
    weight = np.exp([log - found[0][1] for _, log in found])
    odds = math.log(PRIOR_NO_GAP / (1.0 - PRIOR_NO_GAP)) + bare.log - (
        found[0][1] + math.log(weight.sum()))
    return Ranking(tuple(rival for rival, _ in found), tuple((weight / weight.sum()).tolist()),
                   bare, float(np.exp(-np.logaddexp(0.0, -odds))))


def _shared(rivals: Sequence[Rival], prior: float, count: int = 0) -> list[tuple[Rival, float]]:
    """Share a log prior among rivals, or as many as `count` of which these are the best."""
    return [(rival, prior + rival.log - math.log(count or len(rivals))) for rival in rivals]


def search(base: Fit, library: Sequence[Signature]) -> tuple[list[tuple[Rival, float]], int]:
    """Refit the sets of listed effects that may explain a gap.

    Returns:
        The best refit of each set and its log evidence over all forms, and how many effects there
        are to choose from.
    """
    found: dict[Names, tuple[Rival, float]] = {}
    refined = set[Names]()

    def weight(names: Names) -> float:
        return found[names][0].log + found[names][1]

    def refitted(proposals: Iterable[Proposal]) -> None:
        for each in proposals:
            rival = explanation(each.refit())
            if rival.names not in found or rival.log + each.price > weight(rival.names):
                found[rival.names] = rival, each.price
                refined.discard(rival.names)

    def refine(names: Names) -> Rival:
        if names not in refined:
            found[names] = exact(found[names][0]), found[names][1]
            refined.add(names)
        return found[names][0]

    def leaders(size: int, count: int) -> list[Names]:
        sized = [names for names in found if len(names) == size]
        return sorted(sized, key=weight, reverse=True)[:count]

    alone = screen(base, library)
    refitted(_promising(_distinct(alone, by_form=True))[:_KINDS])
    for names in leaders(1, _LEADERS):
        refitted(_promising([item for item in alone if item.effects[0].name in names
                             and item.effects != found[names][0].fit.hypothesis.effects])[:_SETS])
    largest = len(base.observed) // _SAMPLES_EACH
    if largest > 1:  # two that hold the leader are found from it, below
        (first,), = leaders(1, 1)
        refitted([item for item in _promising(_distinct(screen(base, library, 2)))
                  if first not in {effect.name for effect in item.effects}][:_SETS])
    for size in range(1, min(largest, max(PRIOR_OF_SIZE))):
        refitted(_distinct(sorted((
            each._replace(gain=rival.log + each.gain, price=each.price + found[rival.names][1])
            for rival in map(refine, leaders(size, _LEADERS))
            for each in _distinct(screen(rival.fit, library))[:_SETS] if each.gain > 0.0),
            key=lambda each: -each.gain))[:2 * _SETS])
    best = max(map(weight, found))
    for names in sorted(found, key=weight, reverse=True)[:_KINDS]:
        if weight(names) > best - _HOPELESS:
            refine(names)
    return [(rival, weight(names)) for names, (rival, _) in found.items()], len(
        {each.effects[0].name for each in alone})


def _promising(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Leave out what the screen, which is linear, puts far behind the best."""
    best = proposals[0].gain if proposals else 0.0
    least = min(_NEAR * best, best) - _BEHIND
    return [proposal for proposal in proposals if proposal.gain > least]


def _distinct(proposals: Sequence[Proposal], by_form: bool = False) -> list[Proposal]:
    """The best shapes of each set of names (and forms), best first."""
    first: dict[Names, Proposal] = {}
    for proposal in proposals:
        first.setdefault(tuple(sorted(
            effect.name + by_form * effect.form for effect in proposal.effects)), proposal)
    return list(first.values())
