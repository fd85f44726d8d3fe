# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Leading sets that no verdict names, because their refit contradicts them.

A size at its physical bound says that the form only stands for something else. A size of zero, or a
prediction of samples left out that is worse than without the set, says that the set explains
nothing. The probability of such a set counts as unlisted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ...diagnosis import Diagnosis
from ...diagnosis.results.outcome import NAMING
from ...diagnosis.wording import plain

BOUND_PART = 1e-3
"""Part of the range of a size within which it counts as at its bound; chosen.

A refit ends at a bound to about 1e-6 of the range.
"""
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
"""Hooks by which an effect changes the flow and the torque of a unit."""


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
    before = diagnosis.delivered.rmse_before
    return replace(
        diagnosis,
        verdict="unexplained",
        causes=tuple(causes),
        sets=sets,
        unlisted=min(diagnosis.unlisted + leading.probability, 1.0),
        delivered=replace(diagnosis.delivered, rmse_after=before),
        parameters=diagnosis.base_parameters,
        notes=(*diagnosis.notes, f"{reason}: it counts as unlisted"),
    )


def leading_effects(diagnosis: Diagnosis) -> tuple[Any, ...]:
    """Return the effects of the leading set at their sizes, none where no set leads."""
    if not diagnosis.causes:
        return ()
    names = diagnosis.sets[0].effects
    model = diagnosis.causes[0].model
    return tuple(effect for effect in model.effects if effect.name in names)


def _contradicting_size(effects: Sequence[Any]) -> str | None:
    """Say which size is zero or at its physical bound, or return None.

    Args:
        effects: of the leading set, as fitted.
    """
    for effect in effects:
        size = effect.sizes()[0]
        value = effect.values()[size.name]
        near = BOUND_PART * (size.high - size.low)
        if abs(value) < NEGLIGIBLE_SIZE * abs(size.typical):
            return f"the size of {plain(effect.name)} is zero"
        at_low = size.low != 0.0 and value < size.low + near
        if value > size.high - near or at_low:
            return (
                f"{plain(effect.name)} is at the bound of its size, {value:.3g} {size.unit}, "
                "beyond which it is not physical"
            )
    return None


def _worsens(diagnosis: Diagnosis, effects: Sequence[Any]) -> bool:
    """Return whether effects make the prediction of samples left out worse.

    The shrinkage is that of the first channel, so it says nothing of effects that leave that
    channel as it is.

    Args:
        diagnosis: of a unit, or of a change of one.
        effects: of the leading set.
    """
    shrinkage = diagnosis.shrinkage.fraction
    if shrinkage is None or shrinkage >= 0.0:
        return False
    of_flow = diagnosis.channel.name in ("flow_loss", "drain_flow")
    hooks = FLOW_HOOKS if of_flow else TORQUE_HOOKS
    return any(effect.acts_at(*hooks) for effect in effects)
