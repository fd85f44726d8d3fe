# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Statement: which effects are present, whatever else is.

The inclusion probability of an effect is the sum over all explanations that hold it as a cause,
with or without an unlisted loss (Barbieri & Berger 2004, Ann. Stat. 32, 870), if their listed
effects explain the gap or make most of the change. It may be high where no exact set is probable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..analysis import Analysis
from ..selection.explanation import Explanation
from ..selection.search import Names
from ..settings import LIKELY, MAX_MEMBERS, PRESENT_PROBABILITY, REPORTED_MEMBER
from ..system import Array, Effect, predict_cases

SLOPE_STEP = 0.01
"""Change by which slopes are found: of a base parameter in prior deviations, of a size in typical
sizes, of a shape in its range."""


@dataclass(frozen=True)
class Member:
    """An effect, or a class of effects that no test distinguishes, as a part of the cause.

    Attributes:
        effects: name of the effect, or of all members of the class.
        component: the part it belongs to, None where the members of a class differ in it.
        probability: that it is present, over all sets of effects and unlisted losses.
        form_fits: whether a form in the library describes it; otherwise it acts in another form.
        lost_power: mean power that it takes over the samples [W], None where its form is not known.
        lost_power_error: standard error of that [W], or None.
        condition: where it is a condition of the test and no damage, that at which it is off;
            otherwise empty.
    """

    effects: Names
    component: str | None
    probability: float
    form_fits: bool = True
    lost_power: float | None = None
    lost_power_error: float | None = None
    condition: str = ""

    @property
    def is_class(self) -> bool:
        """Whether no test distinguishes it from others."""
        return len(self.effects) > 1

    @property
    def is_present(self) -> bool:
        """Whether it is a cause, although others may join it."""
        return self.probability >= PRESENT_PROBABILITY


def members_of(analysis: Analysis) -> tuple[Member, ...]:
    """Return the effects and classes that may be present, most probable first.

    Args:
        analysis: of a campaign; without a gap there are none.
    """
    if not analysis.significant:
        return ()
    in_classes: set[str] = set()
    members = []
    for effect_class in analysis.classes:
        members.append(_of_effects(analysis, effect_class.members))
        in_classes.update(effect_class.members)
    for name in analysis.posterior.effects:
        if name not in in_classes:
            members.append(_of_effects(analysis, (name,)))
    probable = [entry for entry in members if entry[0].probability >= REPORTED_MEMBER]
    probable.sort(key=lambda entry: -entry[0].probability)
    reported = []
    for member, likeliest in probable[:MAX_MEMBERS]:
        if member.form_fits:
            power = lost_power(likeliest, member.effects)
            if power is not None:
                error = lost_power_error(likeliest, member.effects)
                member = replace(member, lost_power=power, lost_power_error=error)
        reported.append(member)
    return tuple(reported)


def _of_effects(analysis: Analysis, effects: Names) -> tuple[Member, Explanation]:
    """Return the member that any of some effects makes, and the likeliest explanation with it.

    Several of them in one set count once. The member has no lost power yet.

    Args:
        analysis: of a campaign.
        effects: names, at least one of them in an explanation.
    """
    probability = 0.0
    listed = 0.0
    likeliest: Explanation | None = None
    for names, (explanation, p) in analysis.posterior.present.items():
        if set(effects).isdisjoint(names):
            continue
        likeliest = likeliest or explanation
        probability += p
        _, as_whole = analysis.posterior.sets.get(names, (explanation, 0.0))
        listed += as_whole
    assert likeliest is not None
    form_fits = listed > LIKELY * probability
    system = analysis.base.hypothesis.system
    kinds = [item for item in system.library if item.name in effects]
    components = {item.component for item in kinds}
    conditions = {condition_of(item) for item in kinds}
    member = Member(
        effects=effects,
        component=components.pop() if len(components) == 1 else None,
        probability=min(probability, 1.0),
        form_fits=form_fits,
        condition=conditions.pop() if len(conditions) == 1 else "",
    )
    return member, likeliest


def condition_of(effect: Effect) -> str:
    """Return the condition at which an effect is off; empty for one that may be a damage."""
    return str(getattr(effect, "condition", ""))


def lost_power(explanation: Explanation, names: Names) -> float | None:
    """Return the mean power that some effects of a set take over its samples [W].

    None where the system states no power.
    """
    (power,) = _mean_powers(explanation, names, [explanation.served_fit.theta])
    return None if np.isnan(power) else float(power)


def lost_power_error(explanation: Explanation, names: Names) -> float:
    """Return the standard error of `lost_power` [W], from those of base, sizes and shapes."""
    fit = explanation.served_fit
    hypothesis = fit.hypothesis
    base = hypothesis.system.base
    moved = list(range(len(base)))
    for i, (effect_index, _) in enumerate(hypothesis.free_parameters):
        if hypothesis.effects[effect_index].name in names:
            moved.append(hypothesis.base_count + i)
    steps = SLOPE_STEP * np.eye(len(fit.theta))[moved]
    steps[: len(base)] *= base.spread[:, None]
    below = np.clip(fit.theta - steps, *hypothesis.bounds)
    above = np.clip(fit.theta + steps, *hypothesis.bounds)
    powers = _mean_powers(explanation, names, [*below, *above])
    changes = np.nan_to_num(powers[len(moved) :] - powers[: len(moved)])
    apart = np.sum(above - below, axis=1)
    slopes = np.divide(changes, apart, out=np.zeros(len(moved)), where=apart > 0.0)
    covariance = explanation.theta_covariance[np.ix_(moved, moved)]
    return math.sqrt(max(float(slopes @ covariance @ slopes), 0.0))


def _mean_powers(
    explanation: Explanation, names: Names, thetas: Sequence[Array]
) -> Array:
    """Return the mean power that some effects take by each of m theta [W], shape (m,).

    The mean is over the samples whose power is known by every theta; NaN without one.
    """
    fit = explanation.served_fit
    points = fit.observed.points
    system = fit.hypothesis.system
    cases = []
    for theta in thetas:
        base, effects = fit.hypothesis.case(theta)
        others = tuple(effect for effect in effects if effect.name not in names)
        cases += [(base, others), (base, effects)]
    efficiency = predict_cases(system, cases, points)[:, 0]
    lost = []
    for without, with_effects in zip(efficiency[::2], efficiency[1::2], strict=True):
        lost.append(system.lost_power(points, without, with_effects))
    known = np.isfinite(lost).all(axis=0)
    if not known.any():
        return np.full(len(lost), np.nan)
    return np.mean(np.array(lost)[:, known], axis=1)
