# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Search for sets of effects worth comparing: the linear screen proposes, refits decide.

The search grows sets from single effects: each leading set is extended by one effect. An effect
entered in the form, or in place of another effect, that was best while the rest was missing. In
the leading sets each effect is therefore exchanged for its other forms, for other effects, and left
out.
"""

from collections.abc import Iterable, Sequence

from ..fitting.refit import Fit, Signature, refit_without, with_free_shapes
from ..settings import (
    EQUAL_EVIDENCE,
    EXCHANGE_ROUNDS,
    EXCHANGED_SETS,
    EXCHANGES,
    LEADING_SETS,
    NEAR_BEST_FRACTION,
    NEAR_BEST_MARGIN,
    PROPOSALS,
)
from ..system import Effect
from .explanation import Explanation, explain
from .screen import LogFormPrior, Proposal, screen
from .screen import Names as Names


def search(
    base_only: Explanation, library: Sequence[Signature], most: int
) -> tuple[list[tuple[Explanation, float]], int]:
    """Refit the sets of listed effects that may explain a gap.

    Args:
        base_only: the base model alone.
        library: all forms, with their signatures added to it.
        most: effects of the largest set.

    Returns:
        The best refit of each set that is near the best and its log evidence over all forms, and
        the number of effects that sets are drawn from.
    """
    candidates = _Candidates(base_only)
    steps = _Search(candidates, library)
    steps.add_singles_and_pairs()
    for size in range(1, most):
        steps.extend(candidates.leaders(size))
    steps.exchange_effects(most)
    steps.refit_leaders_exactly()
    return candidates.near_best(), len(candidates.log_form_priors)


class _Candidates:
    """The best refit of each set so far.

    Attributes:
        base_only: the base model alone.
        best: the best refit of each set and its log form prior, by the names of its effects.
        log_form_priors: of single effects, by name.
    """

    def __init__(self, base_only: Explanation) -> None:
        self.base_only = base_only
        self.best: dict[Names, tuple[Explanation, LogFormPrior]] = {}
        self.log_form_priors: dict[str, LogFormPrior] = {}
        self._with_free_shapes: set[Explanation] = set()

    def log_evidence(self, names: Names) -> float:
        """Return the log evidence of a set over its forms."""
        explanation, log_form_prior = self.best[names]
        return explanation.log_evidence + log_form_prior.all_forms

    def consider(self, explanation: Explanation, log_form_prior: LogFormPrior) -> None:
        """Keep a refit if it is the best of its set."""
        names = explanation.names
        log_evidence = explanation.log_evidence + log_form_prior.all_forms
        is_new = names not in self.best
        if is_new or log_evidence > self.log_evidence(names) + EQUAL_EVIDENCE:
            self.best[names] = (explanation, log_form_prior)

    def refit(self, proposals: Iterable[Proposal]) -> None:
        """Refit proposals at their shapes, and consider them."""
        for proposal in proposals:
            self.consider(explain(proposal.refit()), proposal.log_form_prior)

    def refit_with_free_shapes(self, fit: Fit, log_form_prior: LogFormPrior) -> None:
        """Refit with free shapes, and consider the result."""
        self.consider(*self._freed(fit, log_form_prior))

    def refined(self, names: Names) -> tuple[Explanation, LogFormPrior]:
        """Return the best refit of a set, with free shapes, and its log form prior."""
        explanation, log_form_prior = self.best[names]
        if explanation not in self._with_free_shapes:
            self.best[names] = self._freed(explanation.fit, log_form_prior)
        return self.best[names]

    def refit_exactly(self, names: Names) -> None:
        """Replace the refit of a set by an exact one with free shapes."""
        explanation, log_form_prior = self.best[names]
        exact = explain(with_free_shapes(explanation.fit))
        self.best[names] = (exact, log_form_prior.once_free())

    def log_form_prior(self, effects: Iterable[Effect]) -> LogFormPrior:
        """Return the log form prior of a set, from those of its effects alone."""
        total = LogFormPrior()
        for effect in effects:
            total = total.times(self.log_form_priors[effect.name])
        return total

    def ranked(self, sets: Iterable[Names] | None = None) -> list[Names]:
        """Return sets, all by default, by their log evidence, best first."""
        names = self.best if sets is None else sets
        return sorted(names, key=self.log_evidence, reverse=True)

    def leaders(self, size: int) -> list[Names]:
        """Return the best sets of a size."""
        of_size = [names for names in self.best if len(names) == size]
        return self.ranked(self._near(of_size))[:LEADING_SETS]

    def near_best(self) -> list[tuple[Explanation, float]]:
        """Return the sets near the best, with their log evidence over all forms."""
        kept = []
        for names in self._near([*self.best]):
            kept.append((self.best[names][0], self.log_evidence(names)))
        return kept

    def _near(self, sets: Sequence[Names]) -> list[Names]:
        """Return the sets whose gain is near the best.

        Without allowances: what a discrepancy of the base explains is no gain of theirs.
        """
        gains = {}
        for names in sets:
            plain = self.best[names][0].plain_model.log_evidence
            gains[names] = plain - self.base_only.log_evidence
        least = _least_gain(max(gains.values(), default=0.0))
        return [names for names, gain in gains.items() if gain > least]

    def _freed(
        self, fit: Fit, log_form_prior: LogFormPrior
    ) -> tuple[Explanation, LogFormPrior]:
        explanation = explain(with_free_shapes(fit, rough=True))
        self._with_free_shapes.add(explanation)
        return explanation, log_form_prior.once_free()


class _Search:
    """The steps of the search, with what they have done already."""

    def __init__(self, candidates: _Candidates, library: Sequence[Signature]) -> None:
        """Begin a search.

        Args:
            candidates: to add to.
            library: all forms, with their signatures.
        """
        self.candidates = candidates
        self.library = library
        self._extended: set[Explanation] = set()
        self._exchanged: set[Explanation] = set()
        # Effects that were exchanged, each with the forms of the others.
        self._tried_exchanges: set[Names] = set()

    def add_singles_and_pairs(self) -> None:
        """Refit single effects, and pairs that show together only."""
        candidates = self.candidates
        base = candidates.base_only.fit
        singles = screen(base, self.library)
        for single in singles:
            name = single.effects[0].name
            candidates.log_form_priors[name] = single.log_form_prior
        # Where the base bends much the linear screen misleads, so each effect is refitted once.
        candidates.refit(distinct(singles))
        forms = distinct(singles, by_form=True)
        for leader in candidates.leaders(1):
            of_leader = [form for form in forms if form.effects[0].name in leader]
            for form in _promising(of_leader):
                candidates.refit_with_free_shapes(form.refit(), form.log_form_prior)
        self._add_pairs(forms)

    def _add_pairs(self, forms: Sequence[Proposal]) -> None:
        """Refit the best pairs without the leader; pairs with it are grown from it."""
        candidates = self.candidates
        leader = candidates.ranked()[0]
        signatures = [(form.effects[0], form.changes[0]) for form in forms]
        pairs = distinct(screen(candidates.base_only.fit, signatures, 2))
        further = []
        for pair in _promising(pairs):
            if not {effect.name for effect in pair.effects}.intersection(leader):
                log_form_prior = candidates.log_form_prior(pair.effects)
                further.append(pair._replace(log_form_prior=log_form_prior))
        candidates.refit(further[:PROPOSALS])

    def extend(self, sets: Iterable[Names]) -> None:
        """Refit sets extended by one effect each."""
        proposals: list[Proposal] = []
        for names in sets:
            explanation, log_form_prior = self.candidates.refined(names)
            if explanation in self._extended:
                continue
            self._extended.add(explanation)
            for proposal in self._extensions(explanation.fit):
                if proposal.gain > 0.0:
                    total = explanation.log_evidence + proposal.gain
                    prior = proposal.log_form_prior.times(log_form_prior)
                    proposals.append(
                        proposal._replace(gain=total, log_form_prior=prior)
                    )
        proposals.sort(key=lambda proposal: -proposal.gain)
        self.candidates.refit(distinct(proposals)[: 2 * PROPOSALS])

    def _extensions(self, fit: Fit) -> list[Proposal]:
        """Return the best effects to add to a refit."""
        screened = screen(fit, self.library)
        # Each effect in its best form, however little it gains, and the best further forms.
        of_effects = distinct(screened)
        forms = distinct([*of_effects, *screened], by_form=True)
        kept = forms[: len(of_effects) + PROPOSALS]
        return distinct(_with_signatures_at(fit, kept))[:PROPOSALS]

    def exchange_effects(self, most: int) -> None:
        """Exchange the effects of the leading sets, and extend what results.

        Args:
            most: effects of the largest set.
        """
        for _ in range(EXCHANGE_ROUNDS):
            explanation = self._next_leader()
            if explanation is None:
                return
            self._exchanged.add(explanation)
            for i in range(len(explanation.names)):
                self._exchange_effect(explanation, i)
            if len(explanation.names) < most:
                self.extend([explanation.names])

    def _next_leader(self) -> Explanation | None:
        """Return the first leading set whose effects have not been exchanged."""
        for names in self.candidates.ranked()[:EXCHANGED_SETS]:
            explanation, _ = self.candidates.refined(names)
            if explanation not in self._exchanged:
                return explanation
        return None

    def _exchange_effect(self, explanation: Explanation, i: int) -> None:
        """Leave out one effect of a set, and try other forms and effects in its place.

        Args:
            explanation: the set.
            i: index of the effect.
        """
        effects = explanation.fit.effects
        effect = effects[i]
        others = (*effects[:i], *effects[i + 1 :])
        exchange = (effect.name, *sorted(other.name + other.form for other in others))
        if exchange in self._tried_exchanges:
            return
        rest = refit_without(explanation.fit, i)
        log_form_prior = self.candidates.log_form_prior(others)
        if rest.effects:
            self.candidates.refit_with_free_shapes(rest, log_form_prior)
        needs_allowances = (
            explanation.plain_model.log_evidence < explanation.log_evidence
        )
        if not needs_allowances:
            # Forms that need no allowance are not mistaken for others.
            return
        self._tried_exchanges.add(exchange)
        self._try_in_place_of(effect, rest, log_form_prior)

    def _try_in_place_of(
        self, effect: Effect, rest: Fit, log_form_prior: LogFormPrior
    ) -> None:
        """Refit other forms and other effects in place of one, and consider the best.

        Args:
            effect: that was left out.
            rest: the refit without it.
            log_form_prior: of the effects of the rest.
        """
        other_forms = []
        other_effects = []
        for proposal in distinct(screen(rest, self.library), by_form=True):
            added = proposal.effects[-1]
            if added.name != effect.name:
                other_effects.append(proposal)
            elif added.form != effect.form:
                other_forms.append(proposal)
        forms = _with_signatures_at(rest, other_forms)[:EXCHANGES]
        exchanged = _with_signatures_at(rest, other_effects[:PROPOSALS])
        refitted: list[tuple[Explanation, LogFormPrior]] = []
        for proposal in (*forms, *exchanged[:EXCHANGES]):
            prior = proposal.log_form_prior.times(log_form_prior)
            refitted.append((explain(proposal.refit()), prior))
        if refitted:
            explanation, prior = max(
                refitted, key=lambda pair: pair[0].log_evidence + pair[1].all_forms
            )
            self.candidates.refit_with_free_shapes(explanation.fit, prior)

    def refit_leaders_exactly(self) -> None:
        """Refit the leading sets exactly."""
        for names in self.candidates.ranked()[:LEADING_SETS]:
            self.candidates.refit_exactly(names)


# --- proposals ------------------------------------------------------------------------------


def _with_signatures_at(fit: Fit, proposals: Sequence[Proposal]) -> list[Proposal]:
    """Screen proposals again with their signatures at a refit instead of at the base model.

    Args:
        fit: the refit that they are added to.
        proposals: each with one added form.

    Returns:
        Best first.
    """
    log_form_priors = {}
    forms = []
    for proposal in proposals:
        log_form_priors[proposal.effects] = proposal.log_form_prior
        forms.append(proposal.effects[-1])
    signatures = list(zip(forms, fit.signatures_of(forms), strict=True))
    screened = []
    for proposal in screen(fit, signatures):
        log_form_prior = log_form_priors[proposal.effects]
        screened.append(proposal._replace(log_form_prior=log_form_prior))
    return screened


def distinct(proposals: Sequence[Proposal], by_form: bool = False) -> list[Proposal]:
    """Return the first proposal of each set of names, or of each set of forms.

    Args:
        proposals: best first.
        by_form: whether other forms of the same effects are kept.
    """
    first: dict[Names, Proposal] = {}
    for proposal in proposals:
        keys = []
        for effect in proposal.effects:
            keys.append(effect.name + effect.form if by_form else effect.name)
        first.setdefault(tuple(sorted(keys)), proposal)
    return list(first.values())


def _promising(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Leave out proposals that the screen puts far behind the first."""
    least = _least_gain(proposals[0].gain if proposals else 0.0)
    return [proposal for proposal in proposals if proposal.gain > least]


def _least_gain(best: float) -> float:
    """Return the gain in log evidence above which a candidate is kept, given the best.

    A part of a negative best would lie above it.
    """
    return min(NEAR_BEST_FRACTION * best, best) - NEAR_BEST_MARGIN
