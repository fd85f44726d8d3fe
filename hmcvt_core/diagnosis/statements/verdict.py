# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The verdict of a diagnosis."""

from __future__ import annotations

from ..analysis import Analysis
from ..settings import (
    CAUSE_FOUND_PROBABILITY,
    LIKELY,
)
from ..wording import plain


def verdict_of(analysis: Analysis) -> tuple[str, tuple[str, ...]]:
    """Return the verdict, and notes on why no cause, or no more than a set, is named."""
    if not analysis.significant:
        return "no_gap", _why_no_gap(analysis)
    posterior = analysis.posterior
    if posterior.unlisted > LIKELY:
        if posterior.misfit > posterior.unlisted / 2.0:
            note = (
                "the base model is slightly off, smoothly: less than a cause would need"
            )
        else:
            note = "no set of listed effects explains the gap: look at the regions"
        return "unexplained", (note,)
    probability = analysis.leading_class_set.probability
    verdict = "ambiguous"
    if probability >= CAUSE_FOUND_PROBABILITY and not _has_rival(analysis):
        verdict = "cause_found"
    return verdict, (*_bend_of_the_model(analysis), *_smaller_unlisted_loss(analysis))


def _bend_of_the_model(analysis: Analysis) -> tuple[str, ...]:
    """Say that the saved model holds an effect that is no cause."""
    leading, _ = analysis.leading
    if not leading.bend:
        return ()
    causes = " and ".join(map(plain, leading.names))
    return (
        f"the form of {causes} misses something that looks like {plain(leading.bend)}: the model "
        "with the causes holds it as a correction, not as a cause",
    )


def _smaller_unlisted_loss(analysis: Analysis) -> tuple[str, ...]:
    """Say that an unlisted loss is present in addition to the leading set."""
    if not _leads_with_discrepancy(analysis):
        return ()
    return (
        "a smaller loss that is not in the library is present too: look at the regions",
    )


def _why_no_gap(analysis: Analysis) -> tuple[str, ...]:
    """Say why rare readings are no gap."""
    if not analysis.is_rare:
        return ()
    probability = 100.0 * analysis.posterior.no_gap
    return (
        f"readings like these are rare without a gap (p = {analysis.detection.p_value:.2g}), but "
        f"nothing explains them better than chance: with {probability:.0f} % there is no gap",
    )


def _has_rival(analysis: Analysis) -> bool:
    """Whether the readings, without the priors, leave another set of the same size possible.

    A set that no test distinguishes from the leading one is no rival.
    """
    from scipy.special import logit

    leading, _ = analysis.leading
    twins = analysis.leading_class_set.sets
    margin = logit(CAUSE_FOUND_PROBABILITY)
    for names, (explanation, _) in analysis.posterior.sets.items():
        if names in twins or len(names) != len(leading.names) or explanation.bend:
            continue
        if explanation.log_evidence > leading.log_evidence - margin:
            return True
    return False


def _leads_with_discrepancy(analysis: Analysis) -> bool:
    """Whether the likeliest explanation is a listed set and a smaller unlisted loss."""
    first, _ = analysis.posterior.entries[0]
    if first.discrepancy is None:
        return False
    return first.explained_fraction(analysis.posterior.base_only) > LIKELY
