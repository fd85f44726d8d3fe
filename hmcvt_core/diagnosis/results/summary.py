# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Summary of an analysis: causes, sets, regions, parameters and lost power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..analysis import Analysis, model_of
from ..fitting.refit import Fit
from ..selection.explanation import Explanation
from ..selection.posterior import Posterior
from ..settings import (
    CAUSE_FOUND_PROBABILITY,
    INTERVAL_DEVIATIONS,
    LEADING_SETS,
    MAX_CAUSES,
    MAX_CAUSES_UNEXPLAINED,
    RELEVANT_PROBABILITY,
    ROUNDING,
    SIZE_SPREADS,
)
from ..statements.members import Member, condition_of, lost_power
from ..system import Array, BaseParameters, Effect
from .outcome import (
    NAMING,
    Cause,
    CauseSet,
    ParameterEstimate,
    SharedErrorEstimate,
)
from .shrinkage import CrossValidation


def causes_of(
    analysis: Analysis, validation: CrossValidation, verdict: str
) -> tuple[Cause, ...]:
    """Return the effects that may be present; those of the leading set come first."""
    if not analysis.has_candidates:
        return ()
    leading, _ = analysis.leading
    probabilities = analysis.posterior.effects
    members = [name for name in probabilities if name in leading.names]
    others = [
        name
        for name, probability in probabilities.items()
        if name not in leading.names and probability >= RELEVANT_PROBABILITY
    ]
    most = MAX_CAUSES_UNEXPLAINED if verdict == "unexplained" else MAX_CAUSES
    names = (members + others)[:most]
    return tuple(_cause(analysis, validation, name) for name in names)


def _cause(analysis: Analysis, validation: CrossValidation, name: str) -> Cause:
    explanation = analysis.posterior.best_with(name)
    fit = explanation.served_fit
    index = [effect.name for effect in fit.effects].index(name)
    effect = fit.effects[index]
    errors = explanation.parameter_errors
    size_error = float(explanation.size_errors[index])
    shrinkage = validation.shrinkage(explanation)
    partners = [other for other in explanation.names if other != name]
    free = [item.name for i, item in fit.hypothesis.free_parameters if i == index]
    return Cause(
        effect=name,
        form=effect.form,
        component=effect.component,
        probability=analysis.posterior.effects[name],
        indistinguishable_from=indistinguishable_from(analysis.posterior, name),
        together_with=" and ".join(partners) or None,
        parameters=_effect_parameters(effect, size_error),
        gap_after=shrinkage.after,
        shrinkage=shrinkage.fraction,
        drift=_drift(analysis.base, fit, errors),
        summary=effect.summary,
        source=effect.source,
        remedy=effect.remedy,
        model=model_of(explanation, fit),
        has_fixed_shapes=any(
            not item.is_size and item.name not in free for item in effect.parameters()
        ),
        may_be_absent=bool(explanation.may_be_zero[index]),
    )


def indistinguishable_from(posterior: Posterior, name: str) -> tuple[str, ...]:
    """Return the effects that these data cannot distinguish from one.

    They are the rest of the smallest credible set of effects. It is built greedily: each step adds
    the effect that most of the probability not yet covered needs. Sets that consist of partners of
    the effect only are no alternatives to it.
    """
    partners = set(posterior.best_with(name).names) - {name}
    uncovered = {
        names: probability
        for names, (_, probability) in posterior.sets.items()
        if not partners.issuperset(names)
    }
    limit = (1.0 - CAUSE_FOUND_PROBABILITY) * sum(uncovered.values()) + ROUNDING
    chosen: list[str] = []
    while sum(uncovered.values()) > limit:
        needed: dict[str, float] = {}
        for names, probability in uncovered.items():
            for other in names:
                if other not in partners:
                    needed[other] = needed.get(other, 0) + probability
        best = max(needed, key=needed.__getitem__)
        chosen.append(best)
        uncovered = {
            names: probability
            for names, probability in uncovered.items()
            if best not in names
        }
    return tuple(other for other in chosen if other != name)


def _effect_parameters(effect: Effect, size_error: float) -> dict[str, dict[str, Any]]:
    """Return `Cause.parameters`.

    Args:
        effect: as fitted.
        size_error: standard error of the size, in typical sizes.
    """
    values: dict[str, dict[str, Any]] = {}
    for parameter in effect.parameters():
        value = effect.values()[parameter.name]
        entry = {
            "value": value,
            "unit": parameter.unit,
            "meaning": parameter.meaning,
        }
        if parameter.is_size:
            error = abs(size_error * parameter.typical)
            reach = INTERVAL_DEVIATIONS * error
            entry["standard_error"] = error
            entry["interval"] = [
                max(value - reach, parameter.low),
                min(value + reach, parameter.high),
            ]
            entry["plausible"] = is_plausible_size(parameter, value)
        values[parameter.name] = entry
    return values


def is_plausible_size(parameter: Any, value: float) -> bool:
    """Whether a size is inside its range, and not far above what its prior expects."""
    within = parameter.low < value < parameter.high
    usual = abs(value) <= max(SIZE_SPREADS) * abs(parameter.typical)
    return bool(within and usual)


def _drift(before: Fit, after: Fit, errors: Array) -> dict[str, dict[str, float]]:
    """Change of each base parameter when effects are added.

    Args:
        before: the base refit.
        after: the refit with effects.
        errors: standard errors of the scaled base parameters, then of the sizes.
    """
    base = before.hypothesis.system.base
    without_effect = base.values(before.base)
    with_effect = base.values(after.base)
    standard_errors = (before.base - after.base) / errors[: len(base)]
    drift = {}
    for i, name in enumerate(base.names):
        drift[name] = {
            "without_effect": float(without_effect[i]),
            "with_effect": float(with_effect[i]),
            "standard_errors": float(standard_errors[i]),
        }
    return drift


def parameters_of(explanation: Explanation, fit: Fit) -> dict[str, ParameterEstimate]:
    """Return the base parameters of a refit with their standard errors.

    Args:
        explanation: gives the covariance.
        fit: gives the values.
    """
    base: BaseParameters = fit.hypothesis.system.base
    errors = explanation.parameter_errors
    values = base.values(fit.base)
    estimates = {}
    for i, name in enumerate(base.names):
        step = np.zeros(len(base))
        step[i] = 1e-3 * errors[i]  # within the linear range of a logarithm
        change = base.values(fit.base + step)[i] - values[i]
        unit = base.units[i] if base.units else ""
        estimates[name] = ParameterEstimate(
            float(values[i]), abs(1e3 * float(change)), unit
        )
    return estimates


def sets_of(analysis: Analysis, validation: CrossValidation) -> tuple[CauseSet, ...]:
    """Return the sets of effects, most probable first, the first five with their shrinkage."""
    if not analysis.significant:
        return ()
    class_set_of = {}
    for class_set in analysis.class_sets:
        for names in class_set.sets:
            class_set_of[names] = class_set
    sets: list[CauseSet] = []
    for names, (explanation, probability) in analysis.posterior.sets.items():
        class_set = class_set_of[names]
        entry = CauseSet(
            names,
            probability,
            None,
            None,
            class_set.alternatives,
            class_set.probability,
        )
        if len(sets) < LEADING_SETS:
            shrinkage = validation.shrinkage(explanation)
            entry = replace(
                entry, gap_after=shrinkage.after, shrinkage=shrinkage.fraction
            )
        sets.append(entry)
    return tuple(sets)


def lost_power_of(
    analysis: Analysis, members: Sequence[Member], verdict: str, settled: bool
) -> float | None:
    """Return the mean power that the named causes take over the samples [W].

    Conditions of the tests count only where no damage is named.

    Args:
        analysis: of the campaign.
        members: that may be present.
        verdict: as of the diagnosis.
        settled: whether the leading set is settled as a whole.

    Returns:
        None where no cause is named, or the power of one is not known.
    """
    if verdict not in NAMING or verdict == "other_form":
        return None
    if settled or verdict == "ambiguous":
        leading, _ = analysis.leading
        effects = leading.served_fit.effects
        damages = [item.name for item in effects if not condition_of(item)]
        of_damages = tuple(name for name in leading.names if name in damages)
        return lost_power(leading, of_damages or leading.names)
    present = [item for item in members if item.is_present]
    of_damages_alone = [item for item in present if not item.condition] or present
    of_members = [item.lost_power for item in of_damages_alone]
    known = [power for power in of_members if power is not None]
    return sum(known) if len(known) == len(of_members) else None


def shared_errors_of(analysis: Analysis) -> tuple[SharedErrorEstimate, ...]:
    """Return the errors that readings share, averaged over the explanations of the readings."""
    errors = analysis.base.observed.shared_names
    if not errors:
        return ()
    mean, deviation = analysis.shared_errors
    estimates = []
    for i, error in enumerate(errors):
        estimates.append(
            SharedErrorEstimate(
                error=error.name,
                session=error.session,
                value=float(mean[i]) * error.deviation,
                standard_deviation=float(deviation[i]) * error.deviation,
                expected=error.deviation,
                unit=error.unit,
            )
        )
    return tuple(estimates)
