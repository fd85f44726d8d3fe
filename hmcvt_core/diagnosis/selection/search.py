# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which sets of effects are worth weighing: the linear screen proposes, refits decide.

From single effects on, whoever leads is asked what may stand beside it. An effect came in the form,
or in the place of another, that was best while the rest was missing: of the leading sets each is
therefore held against its other forms, against other effects and against none.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from ..fitting.refit import Fit, Signature, refit_without, with_free_shapes
from ..settings import (
    EXACT_REFIT_MARGIN,
    EXACT_REFITS,
    EXCHANGE_ROUNDS,
    EXCHANGED_EFFECTS,
    EXCHANGED_FORMS,
    EXCHANGED_SETS,
    LEADING_SETS,
    NEAR_BEST_MARGIN,
    NEAR_BEST_PART,
    PROPOSED_FORMS,
    REFITTED_SETS,
)
from ..system import Array, Effect
from .explanation import Explanation, explain
from .screen import Proposal, screen

Names = tuple[str, ...]


def search(
    bare: Explanation, library: Sequence[Signature], most: int
) -> tuple[list[tuple[Explanation, float]], int]:
    """Refit the sets of listed effects that may explain a gap.

    Args:
        bare: the base model alone.
        library: all forms, with their signatures beside it.
        most: effects of the largest set.

    Returns:
        The best refit of each set that is near the best and its log evidence over all forms, and
        how many effects there are to choose from.
    """
    found = _Search(bare, library)
    found.start()
    for size in range(1, most):
        found.grow(found.leaders(size))
    found.exchange(most)
    return found.settled(), len(found.prices)


class _Search:
    """The best refit of each set so far, with the price of its forms; see `Proposal.price`."""

    def __init__(self, bare: Explanation, library: Sequence[Signature]) -> None:
        self.bare, self.library = bare, library
        self.found: dict[Names, tuple[Explanation, Array]] = {}
        self.prices: dict[str, Array] = {}  # of single effects
        self.free_shapes, self.grown, self.exchanged = (
            set[Explanation](),
            set[Explanation](),
            set[Explanation](),
        )
        self.held = set[Names]()  # what exchange has held, each beside what forms

    def start(self) -> None:
        """Refit single effects, and pairs that show together only."""
        alone = screen(self.bare.fit, self.library)
        # Where the base bends much the linear screen misleads: each is refitted once at least.
        self.refit(distinct(alone))
        self.prices = {each.effects[0].name: each.price for each in alone}
        forms = distinct(alone, by_form=True)
        for names in self.leaders(1):
            self.refit(
                _promising([each for each in forms if each.effects[0].name in names]),
                bent=True,
            )
        # Pairs with the leader are found from it.
        first = self._ranked(self.found)[0]
        pairs = screen(
            self.bare.fit, [(each.effects[0], each.changes[0]) for each in forms], 2
        )
        self.refit(
            [
                each._replace(price=self._price(each.effects))
                for each in _promising(distinct(pairs))
                if not {effect.name for effect in each.effects}.intersection(first)
            ][:REFITTED_SETS]
        )

    def grow(self, sets: Iterable[Names]) -> None:
        """Refit what may stand beside some sets."""
        proposals = list[Proposal]()
        for rival, price in map(self.refined, sets):
            if rival not in self.grown:
                self.grown.add(rival)
                told = screen(rival.fit, self.library)
                first = distinct(
                    told
                )  # each effect, however little it gained beside the base
                told = distinct([*first, *told], by_form=True)[
                    : len(first) + PROPOSED_FORMS
                ]
                proposals += [
                    each._replace(
                        gain=rival.log_evidence + each.gain, price=each.price + price
                    )
                    for each in distinct(self._there(rival.fit, told))[:REFITTED_SETS]
                    if each.gain > 0.0
                ]
        self.refit(
            distinct(sorted(proposals, key=lambda each: -each.gain))[
                : 2 * REFITTED_SETS
            ]
        )

    def exchange(self, most: int) -> None:
        """Hold each effect of the leading sets against its other forms, others and none."""
        for _ in range(EXCHANGE_ROUNDS):
            leading = (
                self.refined(names)[0]
                for names in self._ranked(self.found)[:EXCHANGED_SETS]
            )
            rival = next((each for each in leading if each not in self.exchanged), None)
            if rival is None:
                break
            self.exchanged.add(rival)
            for i in range(len(rival.names)):
                self._hold_against(rival, i)
            if len(rival.names) < most:
                self.grow([rival.names])

    def settled(self) -> list[tuple[Explanation, float]]:
        """The sets near the best, those that matter refitted exactly."""
        ranked = self._ranked(self.found)
        best = self.weight(ranked[0])
        for names in ranked[:EXACT_REFITS]:
            if self.weight(names) > best - EXACT_REFIT_MARGIN:
                rival, price = self.found[names]
                self.found[names] = explain(with_free_shapes(rival.fit)), price[[1, 1]]
        return [
            (self.found[names][0], self.weight(names))
            for names in self._near(self.found)
        ]

    # --- steps --------------------------------------------------------------------------------

    def weight(self, names: Names) -> float:
        """Log evidence of a set over its forms."""
        rival, price = self.found[names]
        return float(rival.log_evidence + price[0])

    def consider(self, rival: Explanation, price: Array) -> None:
        """Keep a refit if it is the best of its set."""
        if rival.names not in self.found or rival.log_evidence + price[0] > self.weight(
            rival.names
        ):
            self.found[rival.names] = rival, price

    def bend(self, fit: Fit, price: Array) -> tuple[Explanation, Array]:
        """Refit with free shapes."""
        rival = explain(with_free_shapes(fit, rough=True))
        self.free_shapes.add(rival)
        return rival, price[[1, 1]]

    def refit(self, proposals: Iterable[Proposal], bent: bool = False) -> None:
        """Refit proposals, with free shapes as well if they are to be bent."""
        for each in proposals:
            fit = each.refit()
            self.consider(
                *(self.bend(fit, each.price) if bent else (explain(fit), each.price))
            )

    def refined(self, names: Names) -> tuple[Explanation, Array]:
        """Return a set with its shapes free."""
        if self.found[names][0] not in self.free_shapes:
            rival, price = self.found[names]
            self.found[names] = self.bend(rival.fit, price)
        return self.found[names]

    def leaders(self, size: int) -> list[Names]:
        """The best sets of a size."""
        return self._ranked(
            self._near(names for names in self.found if len(names) == size)
        )[:LEADING_SETS]

    def _price(self, effects: Iterable[Effect]) -> Array:
        """What the forms of a set cost, as those of each effect alone."""
        return np.sum(
            [np.zeros(2), *(self.prices[effect.name] for effect in effects)], axis=0
        )

    def _ranked(self, sets: Iterable[Names]) -> list[Names]:
        return sorted(sets, key=self.weight, reverse=True)

    def _near(self, sets: Iterable[Names]) -> list[Names]:
        # Without allowances: what a misfit of the base explains is not theirs.
        gains = {
            names: self.found[names][0].plain_model.log_evidence
            - self.bare.log_evidence
            for names in sets
        }
        least = _least(max(gains.values(), default=0.0))
        return [names for names, gain in gains.items() if gain > least]

    def _hold_against(self, rival: Explanation, i: int) -> None:
        own, beside = (
            rival.fit.effects[i],
            (*rival.fit.effects[:i], *rival.fit.effects[i + 1 :]),
        )
        held = own.name, *sorted(each.name + each.form for each in beside)
        if held in self.held:
            return
        rest, price = refit_without(rival.fit, i), self._price(beside)
        if rest.effects:
            self.consider(*self.bend(rest, price))
        if (
            rival.plain_model.log_evidence >= rival.log_evidence
        ):  # forms that need no allowance are no others
            return
        self.held.add(held)
        told = distinct(screen(rest, self.library), by_form=True)
        forms = self._there(
            rest,
            [
                each
                for each in told
                if each.effects[-1].name == own.name
                and each.effects[-1].form != own.form
            ],
        )
        others = self._there(
            rest,
            [each for each in told if each.effects[-1].name != own.name][
                :PROPOSED_FORMS
            ],
        )
        tried = [
            (explain(each.refit()), each.price + price)
            for each in (*forms[:EXCHANGED_FORMS], *others[:EXCHANGED_EFFECTS])
        ]
        if tried:
            best, price = max(tried, key=lambda item: item[0].log_evidence + item[1][0])
            self.consider(*self.bend(best.fit, price))

    def _there(self, fit: Fit, told: Sequence[Proposal]) -> list[Proposal]:
        """Weigh forms with signatures taken beside a refit, not beside the base, best first."""
        prices = {each.effects: each.price for each in told}
        here = [(each.effects[-1], fit.signature(each.effects[-1])) for each in told]
        return [each._replace(price=prices[each.effects]) for each in screen(fit, here)]


def distinct(proposals: Sequence[Proposal], by_form: bool = False) -> list[Proposal]:
    """The best shapes of each set of names (and forms), best first."""
    first: dict[Names, Proposal] = {}
    for proposal in proposals:
        first.setdefault(
            tuple(
                sorted(
                    effect.name + by_form * effect.form for effect in proposal.effects
                )
            ),
            proposal,
        )
    return list(first.values())


def _promising(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Leave out what the screen, which is linear, puts far behind the best."""
    least = _least(proposals[0].gain if proposals else 0.0)
    return [proposal for proposal in proposals if proposal.gain > least]


def _least(best: float) -> float:
    """The gain above which a rival of the best stays in the race."""
    return min(NEAR_BEST_PART * best, best) - NEAR_BEST_MARGIN
