# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which explanation is how probable: sets of one, two or three effects, and what nobody listed.

All compete with one evidence, and sets are always looked for.

No form is quite that of a real loss, and evidence then prefers one wrong form to another too
firmly, this bench the one and its repetition the other. Probabilities are therefore the means over
campaigns drawn from the samples (bagged posteriors; Huggins & Miller 2023, Bayesian Anal. 18, 79).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..detection.regions import Regions
from ..fitting.refit import Fit
from ..settings import (
    BOOTSTRAP_CAMPAIGNS,
    PRIOR_BASE_DISCREPANCY,
    PRIOR_NO_GAP,
    PRIOR_OF_SET_SIZE,
    PRIOR_UNLISTED,
    RELEVANT_PROBABILITY,
    REVERSED_EFFECTS,
    SETS_WITH_DISCREPANCY,
)
from ..system import Array, Points
from .explanation import (
    Explanation,
    boxed_discrepancies,
    explain_by_base,
    explain_by_base_discrepancy,
    explain_exactly,
    smooth_discrepancies,
)
from .screen import screen
from .search import Names, distinct, search


@dataclass(frozen=True, eq=False)
class Posterior:
    """Rivals weighed.

    Attributes:
        entries: the likeliest refit of each set and of each kind of unlisted loss, and the
            probability of each, given that there is a gap; best first, they sum to 1.
        bare: the base model alone, which has none.
        no_gap: the probability of that.
    """

    entries: tuple[tuple[Explanation, float], ...]
    base_only: Explanation
    no_gap: float

    @cached_property
    def sets(self) -> dict[Names, tuple[Explanation, float]]:
        """Refit and probability of each set of listed effects, most probable first."""
        found: dict[Names, tuple[Explanation, float]] = {}
        for rival, p in sorted(
            self.entries, key=lambda item: not item[0].is_listed_set
        ):
            if part := rival.explained_fraction(self.base_only):
                first, total = found.get(rival.names, (rival, 0.0))
                found[rival.names] = first, total + part * p
        return dict(sorted(found.items(), key=lambda item: -item[1][1]))

    @cached_property
    def unlisted(self) -> float:
        """Probability that listed effects are not all of it."""
        return max(0.0, 1.0 - sum(p for _, p in self.sets.values()))  # beyond rounding

    @cached_property
    def misfit(self) -> float:
        """Probability that the base model is a little off and nothing else."""
        return sum(p for rival, p in self.entries if rival.is_base)

    @cached_property
    def effects(self) -> dict[str, float]:
        """Probability that an effect is present, by name, most probable first."""
        listed = [
            item for item in self.entries if not item[0].fit.hypothesis.reversed_sign
        ]
        each = {
            name: min(1.0, sum(p for rival, p in listed if name in rival.names))
            for name in sorted({name for rival, _ in listed for name in rival.names})
        }
        return dict(
            sorted(
                ((name, p) for name, p in each.items() if p), key=lambda item: -item[1]
            )
        )

    def best_with(self, name: str) -> Explanation:
        """The most probable set that holds an effect."""
        return next(rival for names, (rival, _) in self.sets.items() if name in names)

    @property
    def relevant(self) -> Posterior:
        """The rivals that matter, their probabilities summing to 1 again."""
        kept = [(rival, p) for rival, p in self.entries if p >= RELEVANT_PROBABILITY]
        total = sum(p for _, p in kept)
        return replace(self, entries=tuple((rival, p / total) for rival, p in kept))

    def gap_at(self, points: Points | None = None) -> tuple[Array, Array]:
        """Mean and standard deviation of the gap at n points, those of the campaign if None, (n,).

        What each rival foretells beyond the refitted base model, averaged by their probabilities
        (Bayesian model averaging; Hoeting et al. 1999, Statistical Science 14), losses that nobody
        listed among them: measured minus refitted base in the unit of the first channel; NaN where
        the base model has no answer.
        """
        there, start = self.base_only.fit.observed, self.base_only.fit.whitened[0]
        if points is not None:
            there, start = self.base_only.fit.observations_at(points), np.zeros(1)
        told = [rival.prediction_at(there) for rival, _ in self.entries]
        means = there.deviation[0] * np.array([start + each.mean[0] for each in told])
        variances = there.deviation[0] ** 2 * np.array(
            [each.reading_covariance[:, 0, 0] for each in told]
        )
        # Who has no answer at a point has no say there.
        weight = np.isfinite(means) * np.array([[p] for _, p in self.entries])
        with np.errstate(invalid="ignore"):
            weight /= weight.sum(axis=0)
        means = np.nan_to_num(means)
        mean = np.sum(weight * means, axis=0)
        return mean, np.sqrt(np.sum(weight * (variances + (means - mean) ** 2), axis=0))


def compute_posterior(base: Fit, boxes: Regions, seed: int) -> Posterior:
    """Search and weigh.

    Args:
        base: the refit without any effect.
        boxes: where a loss that nobody listed may lie.
        seed: of the campaigns drawn.
    """
    from scipy.special import expit, logsumexp, softmax

    bare, library = explain_by_base(base), base.signatures
    sets, kinds = search(bare, library, max(PRIOR_OF_SET_SIZE))
    found = [
        (
            rival,
            math.log(
                PRIOR_OF_SET_SIZE[len(rival.names)] / math.comb(kinds, len(rival.names))
            )
            + log,
        )
        for rival, log in sets
    ]
    found.sort(key=lambda item: -item[1])
    for rival, log in found[:SETS_WITH_DISCREPANCY]:
        prior = log - rival.log_evidence + math.log(PRIOR_UNLISTED / 2.0)
        found += _shared(smooth_discrepancies(rival), prior) + _shared(
            boxed_discrepancies(rival, boxes), prior
        )
    found += _shared(
        [explain_by_base_discrepancy(bare)], math.log(PRIOR_BASE_DISCREPANCY)
    )
    # A loss that nobody listed: smooth, in some place, or of a listed effect with the wrong sign.
    wrong = distinct(screen(base, library, reversed_sign=True))
    turned = [
        replace(
            rival := explain_exactly(each.refit(reversed_sign=True)),
            log_evidence=rival.log_evidence + each.price[0],
        )
        for each in wrong[:REVERSED_EFFECTS]
        if each.gain > 0.0
    ]
    for family, count in (
        (smooth_discrepancies(bare), 0),
        (boxed_discrepancies(bare, boxes), 0),
        (turned, len(wrong)),
    ):
        found += _shared(family, math.log(PRIOR_UNLISTED / 3.0), count)
    logs = np.array([log for _, log in found])
    odds = (
        math.log(PRIOR_NO_GAP / (1.0 - PRIOR_NO_GAP))
        + bare.log_evidence
        - logsumexp(logs)
    )
    observed, n = base.observed, len(base.observed)
    drawn = (
        np.random.default_rng(seed).multinomial(
            n, np.full(n, 1.0 / n), BOOTSTRAP_CAMPAIGNS
        )
        - 1.0
    )
    # The same draw whatever the order of the rows.
    drawn[:, np.lexsort([*observed.measured, *observed.coordinates])] = drawn.copy()
    likelihoods = np.stack([rival.model.likelihoods for rival, _ in found], axis=1)
    entries = zip(
        (rival for rival, _ in found),
        softmax(logs + drawn @ likelihoods, axis=1).mean(axis=0).tolist(),
        strict=True,
    )
    return Posterior(
        tuple(sorted(entries, key=lambda item: -item[1])), bare, float(expit(odds))
    )


def _shared(
    rivals: Sequence[Explanation], prior: float, count: int = 0
) -> list[tuple[Explanation, float]]:
    """Share a log prior among rivals, or as many as `count` of which these are the best."""
    return [
        (rival, prior + rival.log_evidence - math.log(count or len(rivals)))
        for rival in rivals
    ]
