# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The statements of a diagnosis in one word, with notes on why it is no stronger.

| verdict | rule |
|---|---|
| `no_gap` | no gap, and the readings agree with their stated noise or nothing was stated |
| `excess_scatter` | no gap along any axis, but scatter above its statement |
| `cause_found` | one set is settled, or a member is present whatever its company |
| `class_found` | the same of a class of effects that no test distinguishes |
| `other_form` | a member is present and makes most of the change, but no listed form fits |
| `ambiguous` | listed effects explain the gap, and these readings do not determine which |
| `unexplained` | they do not, or the base model is slightly off and nothing else |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..analysis import Analysis
from ..fitting.refit import Fit
from ..selection.explanation import Explanation
from ..settings import (
    AT_BOUND_FRACTION,
    CAUSE_FOUND_PROBABILITY,
    EXCEEDED_DEVIATIONS,
    LIKELY,
)
from ..wording import plain
from .agreement import Agreement, agreement_of
from .members import Member
from .scatter import ExcessScatter, excess_scatter


class Verdict(NamedTuple):
    """The statements in one word.

    Attributes:
        word: one of the table above.
        notes: why no cause, or no more than a set, is named.
        scatter: that exceeds its statement and is explained by no axis and no cause, or None.
    """

    word: str
    notes: tuple[str, ...]
    scatter: ExcessScatter | None = None


def verdict_of(
    analysis: Analysis, agreement: Agreement, members: Sequence[Member]
) -> Verdict:
    """Return the verdict of a campaign.

    Args:
        analysis: of the campaign.
        agreement: of the readings with their stated noise.
        members: that may be present, most probable first.
    """
    word, notes = word_of(analysis, agreement, members)
    scatter = _scatter_of(analysis, agreement, word)
    if word == "unexplained" and scatter is not None:
        return Verdict("excess_scatter", (), scatter)
    return Verdict(word, notes, scatter)


Word = tuple[str, tuple[str, ...]]
"""The word of a verdict, and its notes."""


def word_of(
    analysis: Analysis, agreement: Agreement, members: Sequence[Member]
) -> Word:
    """Return the word and the notes of a verdict; arguments as of `verdict_of`."""
    if not analysis.significant:
        word = "no_gap" if agreement.holds else "excess_scatter"
        return word, _why_no_gap(analysis)
    present = [item for item in members if item.is_present]
    if analysis.posterior.unlisted > LIKELY:
        return _not_explained(analysis, present)
    notes = (*_form_error_of_the_model(analysis), *_smaller_unlisted_loss(analysis))
    leading, _ = analysis.leading
    exceeded = _exceeded_forms(leading)
    if exceeded and present:
        return "other_form", (*notes, *exceeded)
    doubts = (*_doubts(leading), *exceeded)
    if doubts:
        return "ambiguous", (*notes, *doubts)
    return _explained(analysis, present), notes


def _not_explained(analysis: Analysis, present: Sequence[Member]) -> Word:
    """Return the verdict where listed effects are not all of the gap."""
    posterior = analysis.posterior
    if posterior.misfit > posterior.unlisted / 2.0:
        note = "the base model is slightly off, smoothly: less than a cause would need"
        return "unexplained", (note,)
    named = _main_member(analysis, present)
    if posterior.scatter > posterior.unlisted / 2.0:
        return _beside_scatter(analysis, named)
    if named is None:
        return "unexplained", ("no set of listed effects explains the gap",)
    names = " or ".join(map(plain, named.effects))
    note = (
        f"{names} makes most of the change; the rest needs a form that is not in the library, or "
        "is another loss"
    )
    return "other_form", (note,)


def _main_member(analysis: Analysis, present: Sequence[Member]) -> Member | None:
    """Return the first member whose likeliest explanation makes most of the change, or None."""
    for item in present:
        explanation = _likeliest_with(analysis, item)
        if explanation.makes_most_of_change(analysis.posterior.base_only):
            return item
    return None


def _beside_scatter(analysis: Analysis, named: Member | None) -> Word:
    """Return the verdict where most of what is unlisted varies along no recorded axis.

    Args:
        analysis: of the campaign.
        named: member that makes most of the change, or None.
    """
    if named is not None:
        doubts = _doubts(_likeliest_with(analysis, named))
        if doubts:
            return "ambiguous", doubts
        return _found(named.is_class), ()
    posterior = analysis.posterior
    if posterior.sets and analysis.leading[0].makes_most_of_change(posterior.base_only):
        return "ambiguous", ()
    return "excess_scatter", ()


def _found(is_class: bool) -> str:
    return "class_found" if is_class else "cause_found"


def _scatter_of(
    analysis: Analysis, agreement: Agreement, word: str
) -> ExcessScatter | None:
    """Return the scatter above its statement that is left once a named set is added.

    Where listed effects do not explain the gap, that is None if a loss along the axes is likelier.
    """
    if not analysis.significant or word == "excess_scatter":
        return excess_scatter(analysis.base, agreement)
    if word == "unexplained":
        return _scatter_of_gap(analysis, agreement)
    if word == "other_form":
        return None
    leading, _ = analysis.leading
    return excess_scatter(leading.fit, agreement_of(leading.fit))


def _scatter_of_gap(analysis: Analysis, agreement: Agreement) -> ExcessScatter | None:
    """Return scatter that explains a gap better than a loss along the axes does, or None."""
    likeliest, _ = analysis.posterior.entries[0]
    if likeliest.discrepancy is None or likeliest.names:
        return None
    scatter = excess_scatter(analysis.base, agreement, likeliest.discrepancy)
    return scatter if scatter is not None and scatter.is_probable else None


def _explained(analysis: Analysis, present: Sequence[Member]) -> str:
    """Return the verdict where listed effects explain the gap."""
    if set_is_settled(analysis):
        parts = analysis.leading_class_set.alternatives
        return _found(any(len(names) > 1 for names in parts))
    if not present:
        return "ambiguous"
    return _found(present[0].is_class)


def set_is_settled(analysis: Analysis) -> bool:
    """Whether the leading set, or its class set, is probable and has no rival of its size."""
    if not analysis.significant or not analysis.posterior.sets:
        return False
    probability = analysis.leading_class_set.probability
    return probability >= CAUSE_FOUND_PROBABILITY and not _has_rival(analysis)


def _likeliest_with(analysis: Analysis, member: Member) -> Explanation:
    """Return the likeliest explanation that holds a member."""
    for names, (explanation, _) in analysis.posterior.present.items():
        if not set(member.effects).isdisjoint(names):
            return explanation
    raise KeyError(member.effects)


def _doubts(leading: Explanation) -> tuple[str, ...]:
    """Return notes on fitted values of a set at the bounds of what is physical."""
    fit = leading.served_fit
    notes = []
    for effect in fit.effects:
        if effect.name not in leading.names:
            continue
        for item in effect.parameters():
            value = effect.values()[item.name]
            if item.is_size and at_bound(value, item.low, item.high):
                notes.append(
                    f"{plain(effect.name)}: {plain(item.name)} = {value:.3g} {item.unit} is at "
                    "the bound of what is physical, so it may stand for something else"
                )
    for name in _base_at_bound(fit):
        notes.append(
            f"{plain(name)} of the base model is at its bound with the cause in it, so the cause "
            "may stand for something else"
        )
    return tuple(notes)


def _exceeded_forms(leading: Explanation) -> tuple[str, ...]:
    """Return notes on shapes at the bound of their sources where the readings ask for more.

    A shape may stand at its bound; but a relief valve that opens is a leakage whose exponent would
    be far beyond that of any gap. The estimate is linear near the bound.
    """
    fit = leading.fit
    hypothesis = fit.hypothesis
    deviations = np.sqrt(np.diagonal(leading.model.covariance))
    notes = []
    for number, (i, item) in enumerate(hypothesis.free_parameters):
        effect = fit.effects[i]
        if item.is_size or effect.name not in leading.names:
            continue
        # In parts of the range, 0 to 1.
        index = hypothesis.base_count + number
        fitted = fit.theta[index]
        estimate = hypothesis.prior_mean[index] + leading.model.mean[index]
        reach = EXCEEDED_DEVIATIONS * deviations[index]
        below = fitted < AT_BOUND_FRACTION and estimate < -reach
        above = fitted > 1.0 - AT_BOUND_FRACTION and estimate > 1.0 + reach
        if below or above:
            value = effect.values()[item.name]
            notes.append(
                f"{plain(effect.name)}: {plain(item.name)} = {value:.3g} is the bound of what its "
                "sources give, and the readings ask for more: the form is not in the library, or "
                "it is another loss"
            )
    return tuple(notes)


def at_bound(value: float, low: float, high: float) -> bool:
    """Whether a size is at a bound; at a bound of zero it is absent, which is no doubt."""
    near = AT_BOUND_FRACTION * (high - low)
    return value > high - near or (low != 0.0 and value < low + near)


def _base_at_bound(fit: Fit) -> list[str]:
    """Return the names of the base parameters at a bound."""
    base = fit.hypothesis.system.base
    with np.errstate(invalid="ignore"):
        near = AT_BOUND_FRACTION * np.minimum(base.high - base.low, 1.0)
    is_at_bound = (fit.base < base.low + near) | (fit.base > base.high - near)
    return [base.names[i] for i in np.flatnonzero(is_at_bound)]


def _form_error_of_the_model(analysis: Analysis) -> tuple[str, ...]:
    """Return a note where the saved model holds an effect that is no cause."""
    leading, _ = analysis.leading
    if not leading.form_error:
        return ()
    causes = " and ".join(map(plain, leading.names))
    return (
        f"the form of {causes} misses something that looks like "
        f"{plain(leading.form_error)}: the model with the causes holds it as a correction, not as "
        "a cause",
    )


def _smaller_unlisted_loss(analysis: Analysis) -> tuple[str, ...]:
    """Return a note where an unlisted loss is present in addition to the leading set."""
    first, _ = analysis.posterior.entries[0]
    if first.discrepancy is None:
        return ()
    if first.explained_fraction(analysis.posterior.base_only) <= LIKELY:
        return ()
    return ("a smaller loss that is not in the library is present too",)


def _why_no_gap(analysis: Analysis) -> tuple[str, ...]:
    """Return a note on why rare readings are no gap."""
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
        if names in twins or len(names) != len(leading.names) or explanation.form_error:
            continue
        if explanation.log_evidence > leading.log_evidence - margin:
            return True
    return False
