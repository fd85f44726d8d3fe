# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects and leading sets that no verdict names, because their refit contradicts them.

An effect of size zero within its error is not shown to be present: the set without it explains as
much. A size at its physical bound means that the form only stands for something else. A size of
zero, or a prediction of samples left out that is worse than without the set, means that the set
explains nothing. The probability of such a set counts as unlisted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...diagnosis import Diagnosis
from ...diagnosis.results.outcome import NAMING, Cause, CauseSet, keeping_base
from ...diagnosis.statements.verdict import at_bound
from ...diagnosis.wording import plain

NEGLIGIBLE_SIZE = 1e-3
"""Typical sizes below which the size of an effect counts as zero; chosen.

No bench shows a thousandth of a typical loss.
"""
FLOW_HOOKS = (
    "leakage_flow",
    "true_displacement_ratio",
    "stroke_lag",
    "viscosity_ratio",
)
TORQUE_HOOKS = (
    "pump_drag",
    "motor_drag",
    "true_displacement_ratio",
    "stroke_lag",
    "film_viscosity_ratio",
)
HOOKS_OF_CHANNELS = {
    "flow_loss": FLOW_HOOKS,
    "drain_flow": FLOW_HOOKS,
    "torque_loss": TORQUE_HOOKS,
    "electric_power": TORQUE_HOOKS,
}
"""Hooks by which an effect changes a channel of a unit; the efficiency is changed by all."""


def refuse_contradicted(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis that names no set which its refit contradicts.

    Args:
        diagnosis: of a unit, or of a change of one.
    """
    if diagnosis.verdict not in NAMING or not diagnosis.causes:
        return diagnosis
    effects = leading_effects(diagnosis)
    reason = _contradicting_size(effects)
    if reason is None and _worsens(diagnosis, effects):
        reason = (
            "samples left out are predicted worse with the leading set than without"
        )
    if reason is None:
        return diagnosis
    return _refused(diagnosis, reason)


def _refused(diagnosis: Diagnosis, reason: str) -> Diagnosis:
    """Return a diagnosis whose leading set counts as unlisted.

    Args:
        diagnosis: that names it.
        reason: why, as a clause.
    """
    leading = diagnosis.sets[0]
    causes = []
    for cause in diagnosis.causes:
        probability = cause.probability
        if cause.effect in leading.effects:
            probability = max(probability - leading.probability, 0.0)
        causes.append(replace(cause, probability=probability))
    sets = (*diagnosis.sets[1:], replace(leading, probability=0.0))
    causes.sort(
        key=lambda cause: (cause.effect not in sets[0].effects, -cause.probability)
    )
    return replace(
        keeping_base(diagnosis),
        verdict="unexplained",
        causes=tuple(causes),
        sets=sets,
        unlisted=min(diagnosis.unlisted + leading.probability, 1.0),
        notes=(*diagnosis.notes, f"{reason}: it counts as unlisted"),
    )


def without_absent(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis whose sets hold no effect that may be absent.

    The probability of such a set counts for the set without the effect; that of an effect which
    may be absent by itself counts as unlisted.

    Args:
        diagnosis: of a unit, or of a change, that names causes.
    """
    absent = {
        cause.effect: _most_probable_set(cause)
        for cause in diagnosis.causes
        if cause.may_be_absent
    }
    if not absent:
        return diagnosis
    kept: dict[tuple[str, ...], CauseSet] = {}
    unlisted = diagnosis.unlisted
    for item in diagnosis.sets:
        gone = {name for name, likeliest in absent.items() if likeliest == item.effects}
        names = tuple(name for name in item.effects if name not in gone)
        if not names:
            unlisted += item.probability
            continue
        before = kept.get(names)
        if before is None:
            alternatives = tuple(
                members
                for members in item.alternatives
                if not set(members).issubset(gone)
            )
            kept[names] = replace(item, effects=names, alternatives=alternatives)
        else:
            probability = before.probability + item.probability
            kept[names] = replace(before, probability=probability)
    sets = tuple(sorted(kept.values(), key=lambda item: -item.probability))
    if not sets:
        return _refused(diagnosis, "no effect is shown to be present")
    return _with_sets(diagnosis, sets, min(unlisted, 1.0))


def _most_probable_set(cause: Cause) -> tuple[str, ...]:
    """Return the names of the most probable set that holds a cause, sorted."""
    partners = cause.together_with.split(" and ") if cause.together_with else []
    return tuple(sorted([cause.effect, *partners]))


def _with_sets(
    diagnosis: Diagnosis, sets: tuple[CauseSet, ...], unlisted: float
) -> Diagnosis:
    """Return a diagnosis with other sets, and with the causes and members that they hold."""
    causes = []
    for cause in diagnosis.causes:
        of_sets = [item for item in sets if cause.effect in item.effects]
        if not of_sets:
            continue
        probability = sum(item.probability for item in of_sets)
        partners = [name for name in of_sets[0].effects if name != cause.effect]
        causes.append(
            replace(
                cause,
                probability=min(probability, cause.probability),
                together_with=" and ".join(partners) or None,
                model=_with_effects(cause.model, of_sets[0].effects, diagnosis),
            )
        )
    leading = sets[0].effects
    causes.sort(key=lambda cause: (cause.effect not in leading, -cause.probability))
    present = {name for item in sets for name in item.effects}
    members = tuple(
        item for item in diagnosis.members if not present.isdisjoint(item.effects)
    )
    return replace(
        diagnosis, sets=sets, causes=tuple(causes), members=members, unlisted=unlisted
    )


def _with_effects(model: Any, names: Sequence[str], diagnosis: Diagnosis) -> Any:
    """Return a model without the candidates that are not among some names."""
    candidates = {cause.effect for cause in diagnosis.causes}
    kept = []
    for effect in model.effects:
        if effect.name in names or effect.name not in candidates:
            kept.append(effect)
    return replace(model, effects=tuple(kept))


def leading_effects(diagnosis: Diagnosis) -> tuple[Any, ...]:
    """Return the effects of the leading set at their sizes, none where no set leads."""
    if not diagnosis.causes:
        return ()
    names = diagnosis.sets[0].effects
    model = diagnosis.causes[0].model
    return tuple(effect for effect in model.effects if effect.name in names)


def _contradicting_size(effects: Sequence[Any]) -> str | None:
    """Return a clause on a size that is zero or at its physical bound, or None.

    Args:
        effects: of the leading set, as fitted.
    """
    for effect in effects:
        size = effect.sizes()[0]
        value = effect.values()[size.name]
        if abs(value) < NEGLIGIBLE_SIZE * abs(size.typical):
            return f"the size of {plain(effect.name)} is zero"
        if at_bound(value, size.low, size.high):
            return (
                f"{plain(effect.name)} is at the bound of its size, {value:.3g} {size.unit}, "
                "beyond which it is not physical"
            )
    return None


def _worsens(diagnosis: Diagnosis, effects: Sequence[Any]) -> bool:
    """Return whether effects make the prediction of samples left out worse.

    The shrinkage is that of the first channel, so that effects which leave that channel as it is do
    not count.

    Args:
        diagnosis: of a unit, or of a change of one.
        effects: of the leading set.
    """
    shrinkage = diagnosis.shrinkage.fraction
    if shrinkage is None or shrinkage >= 0.0:
        return False
    hooks = HOOKS_OF_CHANNELS.get(diagnosis.channel.name)
    return hooks is None or any(effect.acts_at(*hooks) for effect in effects)
