# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Classes of effects that no test distinguishes.

Some effects change every reading alike: a charge pump, a bearing and the zero of a torque meter
are one constant torque. More tests never separate them, so a diagnosis treats them as one class.

Let d_a be the change of the readings by effect a at its fitted size, over all tests that can be
run, without what a refit of the base parameters absorbs. Another effect b, at its best size and
shape, leaves

.. math:: L_{ab} = \min_{s, \mathrm{shape}} \|d_a - s\, d_b\|^2

b belongs to the class of the more probable a if L_ab cannot be seen in many tests, and is a small
part of the square of d_a. The second condition matters for effects too small to be seen at all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..fitting.hypothesis import Hypothesis
from ..fitting.refit import Fit, linearise
from ..settings import (
    DECISIVE_SQUARED_DEVIATIONS,
    MANY_TESTS,
    RELEVANT_PROBABILITY,
)
from ..system import Array, Effect, forms_of
from ..wording import listed, plain, probability
from .posterior import Posterior
from .search import Names

CLASS_FRACTION = 0.01
"""Fraction of its squared change that an effect may keep against another one of its class.

Source: the changes then differ by at most a tenth. Of the pairs of effects on the shipped layouts
those that are alike differ by at most 0.05 of the change, the next ones by 0.13.
"""
METER = "sensor"
"""Component of the errors of a bench: the first to check, because no part is taken out."""


@dataclass(frozen=True)
class EffectClass:
    """Effects that no test distinguishes; the first to check comes first.

    Attributes:
        members: names of the effects.
        forms: name of the form of each.
        components: part that each belongs to.
        remedies: measurement that settles each.
        component: part of the most probable member.
        probability: of all sets that contain a member.
        sets: names of these sets, most probable first.
    """

    members: Names
    forms: tuple[str, ...]
    components: tuple[str, ...]
    remedies: tuple[str, ...]
    component: str
    probability: float
    sets: tuple[Names, ...]

    @property
    def sentence(self) -> str:
        """What no test distinguishes, and what to check first."""
        names = []
        for name, form in zip(self.members, self.forms, strict=True):
            in_words = plain(name)
            names.append(f"{in_words} ({form})" if form else in_words)
        sentence = (
            f"No test distinguishes {listed(names, 'and')}: they change the readings alike "
            f"(one of them: {probability(self.probability)})."
        )
        remedies = [remedy for remedy in self.remedies if remedy]
        if remedies:
            sentence += f" First {remedies[0]}."
        return sentence

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {**vars(self), "sentence": self.sentence}


@dataclass(frozen=True)
class ClassSet:
    """Sets of effects that differ only by members of a class.

    Attributes:
        alternatives: for each effect of a set the members of its class, or its name alone; none
            for an unlisted loss.
        probability: of all the sets together.
        sets: names of these sets, most probable first.
    """

    alternatives: tuple[Names, ...]
    probability: float
    sets: tuple[Names, ...]

    def __str__(self) -> str:
        return self.in_words()

    def in_words(self, known: Collection[Names] = ()) -> str:
        """Return the set in words.

        Args:
            known: members of classes that need not be named again.
        """
        parts = []
        for members in self.alternatives:
            part = listed([plain(name) for name in members])
            if members in known:
                part = "one of them"
            elif len(members) > 1 and len(self.alternatives) > 1:
                part = f"({part})"
            parts.append(part)
        # The class follows what it is added to.
        parts.sort(key=lambda part: part == "one of them")
        return " + ".join(parts) or "something unlisted"


def with_probabilities(sets: Sequence[ClassSet], form: str) -> list[str]:
    """Return sets in words with their probabilities; only the first names a class in full.

    Args:
        sets: in the order in which they are named.
        form: of a set `{0}` and its probability `{1}`.
    """
    known: tuple[Names, ...] = ()
    texts = []
    for item in sets:
        texts.append(form.format(item.in_words(known), probability(item.probability)))
        if not known:
            known = tuple(part for part in item.alternatives if len(part) > 1)
    return texts


def merge_sets(
    sets: Iterable[tuple[Names, float]], classes: Sequence[EffectClass]
) -> tuple[ClassSet, ...]:
    """Return sets merged where they differ only by members of a class, most probable first.

    Args:
        sets: names and probability of each set, most probable first.
        classes: of the effects.
    """
    alone = []
    merged: dict[tuple[Names, ...], ClassSet] = {}
    for names, p in sets:
        alternatives = [_alternatives(name, names, classes) for name in names]
        if all(len(members) == 1 for members in alternatives):
            alone.append(ClassSet(tuple(alternatives), p, (names,)))
            continue
        key = tuple(sorted(set(alternatives)))
        before = merged.get(key, ClassSet(key, 0.0, ()))
        merged[key] = ClassSet(key, before.probability + p, (*before.sets, names))
    if not merged:
        return tuple(alone)
    both = [*alone, *merged.values()]
    return tuple(sorted(both, key=lambda item: -item.probability))


def _alternatives(name: str, names: Names, classes: Sequence[EffectClass]) -> Names:
    """Return the members of the class of an effect in a set, or its name alone."""
    for effect_class in classes:
        if name in effect_class.members and names in effect_class.sets:
            return effect_class.members
    return (name,)


# --- which effects form a class -------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A form of an effect, as fitted in the most probable set that contains it.

    Attributes:
        effect: as fitted.
        size: in typical sizes.
        probability: of the sets that contain it.
        sets: their names, most probable first.
    """

    effect: Effect
    size: float
    probability: float
    sets: tuple[Names, ...]


def find_classes(posterior: Posterior) -> tuple[EffectClass, ...]:
    """Return the classes of two and more effects among the probable ones, most probable first.

    Args:
        posterior: over the explanations of a gap.
    """
    fitted = _fitted_forms(posterior)
    if len(fitted) < 2:
        return ()
    tests = _every_test(posterior.base_only.fit)
    if tests is None:
        return ()
    groups = _connected(fitted, tests)
    classes = []
    for group in groups:
        effect_class = _class_of(group, posterior)
        if len(effect_class.members) > 1:
            classes.append(effect_class)
    return tuple(sorted(classes, key=lambda item: -item.probability))


def _fitted_forms(posterior: Posterior) -> list[_Fitted]:
    """Return the forms in the probable sets, most probable first."""
    forms: dict[tuple[str, str, bool], _Fitted] = {}
    for names, (explanation, p) in posterior.present.items():
        fit = explanation.fit
        for effect, size in zip(fit.effects, fit.sizes.tolist(), strict=True):
            if effect.name not in names:
                continue
            form = (effect.name, effect.form, size < 0.0)
            before = forms.get(form, _Fitted(effect, size, 0.0, ()))
            forms[form] = replace(
                before,
                probability=before.probability + p,
                sets=(*before.sets, names),
            )
    probable = [
        item for item in forms.values() if item.probability >= RELEVANT_PROBABILITY
    ]
    return sorted(probable, key=lambda item: -item.probability)


def _every_test(base: Fit) -> Fit | None:
    """Return the base model at every test that can be run; None if there is none.

    Its noise is such that all of them together count as many tests, evenly spread.
    """
    system = base.hypothesis.system
    possible = system.candidates(base.observed.points, base.base)
    tests = base.observations_at(possible)
    if not len(tests):
        return None
    # `observations_at` has the noise of the campaign in its deviations.
    noise = np.full(len(tests.channels), len(tests) / MANY_TESTS)
    return linearise(Hypothesis(system), tests, base.base, noise)


def _connected(fitted: Sequence[_Fitted], tests: Fit) -> list[list[_Fitted]]:
    """Return groups of forms that are connected by imitation, each most probable first."""
    changes: list[Array] = []
    group_of = list(range(len(fitted)))
    for j, imitator in enumerate(fitted):
        effect = imitator.effect
        ways = _changes(tests, [effect, *forms_of(effect)])
        for i, change in enumerate(changes):
            if _imitates(change, ways, imitator):
                joined = group_of[j]
                kept = group_of[i]
                group_of = [kept if group == joined else group for group in group_of]
        changes.append(imitator.size * ways[0])
    groups: dict[int, list[_Fitted]] = {}
    for item, group in zip(fitted, group_of, strict=True):
        groups.setdefault(group, []).append(item)
    return list(groups.values())


def _changes(tests: Fit, forms: Sequence[Effect]) -> Array:
    """Return what a refit leaves of one typical size of each form, in deviations, shape (k, m)."""
    signatures = tests.signatures_of(forms)
    return tests.project_out(signatures / np.sqrt(tests.noise)[:, None])


def _imitates(change: Array, ways: Array, imitator: _Fitted) -> bool:
    """Whether an effect, with the sign it is fitted with, reproduces the change by another one.

    Args:
        change: by the other effect at its fitted size, shape (m,).
        ways: changes by one typical size of the effect in different shapes, shape (k, m).
        imitator: the effect.
    """
    size = imitator.effect.sizes()[0]
    low = size.low / size.typical
    high = size.high / size.typical
    if imitator.size < 0.0:
        high = 0.0
    else:
        low = max(low, 0.0)
    squares = np.maximum(np.sum(ways**2, axis=1), np.finfo(float).tiny)
    within = (ways @ change / squares).clip(low, high)
    left = np.sum((change - within[:, None] * ways) ** 2, axis=1).min()
    limit = min(DECISIVE_SQUARED_DEVIATIONS, CLASS_FRACTION * np.sum(change**2))
    return bool(left < limit)


def _class_of(group: Sequence[_Fitted], posterior: Posterior) -> EffectClass:
    """Return the class of forms, most probable first."""
    by_name: dict[str, Effect] = {}
    for item in group:
        by_name.setdefault(item.effect.name, item.effect)
    # The sort is stable: meters first, then the more probable effects.
    effects = sorted(by_name.values(), key=lambda effect: effect.component != METER)
    sets = {names for item in group for names in item.sets}
    probabilities = {
        names: p for names, (_, p) in posterior.present.items() if names in sets
    }
    return EffectClass(
        members=tuple(effect.name for effect in effects),
        forms=tuple(effect.form for effect in effects),
        components=tuple(effect.component for effect in effects),
        remedies=tuple(effect.remedy for effect in effects),
        component=group[0].effect.component,
        probability=sum(probabilities.values()),
        sets=tuple(probabilities),
    )
