# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Posterior probabilities of the competing explanations of a gap.

Sets of one, two or three listed effects, unlisted discrepancies, and an inexact base model compete
with one evidence:

.. math:: p(k \mid y) \propto p(k)\, p(y \mid k)

Evidence between misspecified models is overconfident: a repeat of the campaign may reverse it.
Probabilities are therefore means over campaigns drawn from the samples (bagged posteriors; Huggins
& Miller 2023, Bayesian Anal. 18, 79), in each of which a sample counts as often as it was drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..detection.regions import Regions
from ..fitting.refit import Fit
from ..observations import Observations, order_of
from ..settings import (
    DRAWS,
    LEADING_SETS,
    LIKELY,
    PRIOR_BASE_DISCREPANCY,
    PRIOR_FORM_ERROR,
    PRIOR_NO_GAP,
    PRIOR_OF_SET_SIZE,
    PRIOR_UNLISTED,
    RELEVANT_PROBABILITY,
)
from ..system import Array, Points
from .explanation import (
    Explanation,
    boxed_discrepancies,
    explain_by_base,
    explain_by_base_discrepancy,
    explain_exactly,
    scattered,
    smooth_discrepancies,
    with_form_errors,
    without_absent,
)
from .screen import screen
from .search import Names, distinct, search

Weighted = tuple[Explanation, float]
"""An explanation with a log weight (prior times evidence) or a probability."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """The competing explanations with their probabilities.

    Attributes:
        entries: the likeliest refit of each set and of each kind of unlisted discrepancy, and the
            probability of each given that there is a gap, which sum to 1; most probable first.
        base_only: the base model alone, the explanation without a gap.
        no_gap: the probability of an exact base model and nothing else.
    """

    entries: tuple[Weighted, ...]
    base_only: Explanation
    no_gap: float

    @cached_property
    def sets(self) -> dict[Names, Weighted]:
        """Refit and probability of each set of effects that is all of the gap, likeliest first."""
        fractions = []
        for (explanation, p), fraction in zip(
            self.entries, self._explained, strict=True
        ):
            fractions.append((explanation, fraction * p))
        return _by_names(fractions)

    @cached_property
    def present(self) -> dict[Names, Weighted]:
        """Refit and probability of each set of effects, with or without an unlisted loss.

        A set that does not explain the gap counts only if it makes most of the change: any effect
        helps to imitate a loss of unknown form, with an evidence that grows with the samples.
        """
        entries = []
        for (explanation, p), fraction in zip(
            self.entries, self._explained, strict=True
        ):
            if explanation.fit.hypothesis.reversed_sign:
                continue
            if fraction > LIKELY or explanation.makes_most_of_change(self.base_only):
                entries.append((explanation, p))
        return _by_names(entries)

    @cached_property
    def _explained(self) -> list[float]:
        """How far the listed effects of each entry explain the gap, 0 to 1."""
        return [entry.explained_fraction(self.base_only) for entry, _ in self.entries]

    @cached_property
    def unlisted(self) -> float:
        """Probability that listed effects do not explain the whole gap."""
        listed = sum(p for _, p in self.sets.values())
        return max(0.0, 1.0 - listed)  # rounding may exceed 1

    @cached_property
    def misfit(self) -> float:
        """Probability that the base model is a little off and nothing else."""
        return sum(
            p for explanation, p in self.entries if explanation.is_base_discrepancy
        )

    @cached_property
    def scatter(self) -> float:
        """Probability that a loss varies along no recorded axis."""
        return sum(p for explanation, p in self.entries if explanation.has_excess_noise)

    @cached_property
    def effects(self) -> dict[str, float]:
        """Probability that an effect is present, by name, most probable first."""
        totals: dict[str, float] = {}
        for names, (_, p) in self.present.items():
            for name in names:
                totals[name] = totals.get(name, 0.0) + p
        # Equally probable effects come in the order of their names.
        ranked = sorted(totals.items(), key=lambda item: (-min(1.0, item[1]), item[0]))
        return {name: min(1.0, total) for name, total in ranked if total}

    def best_with(self, name: str) -> Explanation:
        """Return the most probable set that contains an effect."""
        for names, (explanation, _) in self.sets.items():
            if name in names:
                return explanation
        raise KeyError(name)

    @property
    def relevant(self) -> Posterior:
        """The explanations that matter, their probabilities summing to 1 again."""
        kept = []
        total = 0.0
        for explanation, p in self.entries:
            if p >= RELEVANT_PROBABILITY:
                kept.append((explanation, p))
                total += p
        scaled = tuple((explanation, p / total) for explanation, p in kept)
        return replace(self, entries=scaled)

    def gap_at(self, points: Points | None = None) -> tuple[Array, Array]:
        """Return mean and standard deviation of the gap at operating points.

        The gap is measured minus refitted base, in the unit of the first channel. It is averaged
        over the explanations by their probabilities (Bayesian model averaging; Hoeting et al. 1999,
        Stat. Sci. 14, 382).

        Args:
            points: operating points; those of the campaign if None.

        Returns:
            Mean and standard deviation, shape (n,) each; NaN where the base model has no answer.
        """
        base = self.base_only.fit
        if points is None:
            at_points = base.observed
            reference = base.with_shared_errors[0]
        else:
            at_points = base.observations_at(points)
            reference = np.zeros(1)
        unit = at_points.deviation[0]
        gaps = []
        variances_in_deviations = []
        probabilities = []
        for explanation, p in self.entries:
            prediction = explanation.prediction_at(at_points)
            gaps.append(reference + prediction.mean[0])
            variances_in_deviations.append(prediction.reading_covariance[:, 0, 0])
            probabilities.append([p])
        means = unit * np.array(gaps)
        variances = unit**2 * np.array(variances_in_deviations)
        # An explanation without an answer at a point has no weight there.
        weight = np.isfinite(means) * np.array(probabilities)
        with np.errstate(invalid="ignore"):
            weight /= weight.sum(axis=0)
        means = np.nan_to_num(means)
        mean = np.sum(weight * means, axis=0)
        variance = np.sum(weight * (variances + (means - mean) ** 2), axis=0)
        return mean, np.sqrt(variance)


def _by_names(entries: Sequence[Weighted]) -> dict[Names, Weighted]:
    """Return refit and probability of each set of names, likeliest first.

    An explanation of these effects and nothing else stands for its names.
    """

    def holds_more(entry: Weighted) -> tuple[bool, bool]:
        explanation, _ = entry
        return not explanation.is_listed_set, bool(explanation.absent)

    totals: dict[Names, Weighted] = {}
    for explanation, p in sorted(entries, key=holds_more):
        names = explanation.names
        if names and p:
            first, total = totals.get(names, (explanation, 0.0))
            totals[names] = (first, total + p)
    return dict(sorted(totals.items(), key=lambda item: -item[1][1]))


def compute_posterior(base: Fit, boxes: Regions, seed: int) -> Posterior:
    """Find the competing explanations of a gap, and their probabilities.

    Args:
        base: the refit of the base model.
        boxes: where an unlisted discrepancy may lie.
        seed: of the campaigns drawn from the samples.
    """
    from scipy.special import expit, logsumexp

    base_only = explain_by_base(base)
    sets, effects = _sets_of_effects(base_only)
    listed = [*sets, *_sets_with_discrepancy(sets[:LEADING_SETS], boxes)]
    competing = [
        *listed,
        *_sets_with_form_error(listed, effects),
        *_with_shared_prior(
            [explain_by_base_discrepancy(base_only)], math.log(PRIOR_BASE_DISCREPANCY)
        ),
        *_unlisted_causes(base_only, boxes),
    ]
    explanations = [explanation for explanation, _ in competing]
    log_weights = np.array([log_weight for _, log_weight in competing])
    probabilities = _bagged(explanations, log_weights, base.observed, seed)
    explanations = [without_absent(explanation) for explanation in explanations]
    entries = zip(explanations, probabilities.tolist(), strict=True)
    prior_odds = math.log(PRIOR_NO_GAP / (1.0 - PRIOR_NO_GAP))
    log_odds = prior_odds + base_only.log_evidence - logsumexp(log_weights)
    return Posterior(
        tuple(sorted(entries, key=lambda entry: -entry[1])),
        base_only,
        float(expit(log_odds)),
    )


# --- the competing explanations, each with the log of prior times evidence ------------------


def _sets_of_effects(base_only: Explanation) -> tuple[list[Weighted], int]:
    """Return the sets of listed effects near the best, best first, and how many effects compete."""
    library = base_only.fit.signatures
    candidates, effects = search(base_only, library, max(PRIOR_OF_SET_SIZE))
    sets = []
    for explanation, log_evidence in candidates:
        log_prior = _log_prior_of_set(len(explanation.names), effects)
        sets.append((explanation, log_prior + log_evidence))
    sets.sort(key=lambda entry: -entry[1])
    return sets, effects


def _sets_with_form_error(sets: Sequence[Weighted], effects: int) -> list[Weighted]:
    """Return sets in which one effect is a form error of the others.

    Args:
        sets: with or without an unlisted loss.
        effects: how many compete.
    """
    with_form_error = []
    for explanation, log_weight in sets:
        causes = len(explanation.names) - 1
        if not causes:
            continue
        log_prior = log_weight - explanation.log_evidence
        log_prior += _log_prior_of_set(causes, effects)
        log_prior -= _log_prior_of_set(causes + 1, effects)
        log_prior += math.log(PRIOR_FORM_ERROR / (effects - causes))
        for item in with_form_errors(explanation):
            with_form_error.append((item, log_prior + item.log_evidence))
    return with_form_error


def _log_prior_of_set(size: int, effects: int) -> float:
    """Return the log prior of one set of so many effects of all."""
    return math.log(PRIOR_OF_SET_SIZE[size] / math.comb(effects, size))


def _sets_with_discrepancy(sets: Sequence[Weighted], boxes: Regions) -> list[Weighted]:
    """Return sets with an unlisted loss: smooth, inside a box, or along no recorded axis."""
    extended = []
    for explanation, log_weight in sets:
        # With the log form prior, which the log weight of a set includes.
        log_prior_of_set = log_weight - explanation.log_evidence
        for kind in (
            smooth_discrepancies(explanation),
            boxed_discrepancies(explanation, boxes),
            scattered(explanation),
        ):
            extended += _with_shared_prior(
                kind, log_prior_of_set + math.log(PRIOR_UNLISTED / 3.0)
            )
    return extended


def _unlisted_causes(base_only: Explanation, boxes: Regions) -> list[Weighted]:
    """Return unlisted causes alone: smooth, inside a box, or effects of reversed sign."""
    reversed_effects, reversed_count = _reversed_effects(base_only.fit)
    log_prior = math.log(PRIOR_UNLISTED / 3.0)
    return [
        *_with_shared_prior(smooth_discrepancies(base_only), log_prior),
        *_with_shared_prior(boxed_discrepancies(base_only, boxes), log_prior),
        *_with_shared_prior(reversed_effects, log_prior, reversed_count),
    ]


def _reversed_effects(base: Fit) -> tuple[list[Explanation], int]:
    """Return the best effects of reversed sign, and how many there are to choose from."""
    proposals = distinct(screen(base, base.signatures, reversed_sign=True))
    explanations = []
    for proposal in proposals[:LEADING_SETS]:
        if proposal.gain > 0.0:
            explanation = explain_exactly(proposal.refit(reversed_sign=True))
            log_form_prior = proposal.log_form_prior.all_forms
            explanations.append(
                replace(
                    explanation,
                    log_evidence=explanation.log_evidence + log_form_prior,
                )
            )
    return explanations, len(proposals)


def _with_shared_prior(
    explanations: Sequence[Explanation], log_prior: float, count: int = 0
) -> list[Weighted]:
    """Share a prior probability evenly among explanations.

    Args:
        explanations: that share it.
        log_prior: log of that of all together.
        count: how many share it if these are the best of more; 0 if these are all.
    """
    weighted = []
    for explanation in explanations:
        log_share = (
            log_prior + explanation.log_evidence - math.log(count or len(explanations))
        )
        weighted.append((explanation, log_share))
    return weighted


def _bagged(
    explanations: Sequence[Explanation],
    log_weights: Array,
    observed: Observations,
    seed: int,
) -> Array:
    """Return posterior probabilities averaged over campaigns drawn from the samples.

    Near the real campaign, log evidence is linear in how often each sample counts, with the
    slopes `LinearModel.log_likelihoods`.

    Args:
        explanations: that compete.
        log_weights: log of prior times evidence in the real campaign, shape (explanations,).
        observed: the real campaign.
        seed: of the draws.

    Returns:
        Shape (explanations,).
    """
    from scipy.special import softmax

    n = len(observed)
    rng = np.random.default_rng(seed)
    even = np.full(n, 1.0 / n)
    extra_counts = rng.multinomial(n, even, DRAWS) - 1.0
    # Draws are assigned in the order of the readings, so the order of the rows does not matter.
    order = order_of(observed.coordinates[::-1], observed.measured)
    extra_counts[:, order] = extra_counts.copy()
    slopes = []
    for explanation in explanations:
        slopes.append(explanation.model.log_likelihoods)
    log_posterior = log_weights + extra_counts @ np.stack(slopes, axis=1)
    return np.asarray(softmax(log_posterior, axis=1).mean(axis=0))
