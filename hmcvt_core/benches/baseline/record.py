# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The baseline of a diagnosis of a change, and effects that are the same curve."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...diagnosis import Diagnosis
from ...diagnosis.design.advice import NO_GAP_WORTH_A_TEST
from ...diagnosis.fitting.refit import refit
from ...diagnosis.results.outcome import NAMING, Cause, CauseSet, keeping_base
from ...diagnosis.results.summary import is_plausible_size
from ...diagnosis.selection.classes import EffectClass
from ...diagnosis.settings import (
    CAUSE_FOUND_PROBABILITY,
    INTERVAL_DEVIATIONS,
    PRESENT_PROBABILITY,
)
from ...diagnosis.statements.members import Member
from ...diagnosis.wording import plain
from .change import SoundMachine
from .control import Control, Excess
from .growth import Growth
from .refusal import refuse_contradicted, without_absent
from .sizes import with_posterior_size

VISIBLE_DEVIATIONS = 2.0
"""Deviations of a reading about the sound prediction that a change has to make to show."""
REPORT_WIDTH = 100
"""Width of a report for a person, in columns."""


@dataclass(frozen=True)
class Baseline:
    """The sound machine of a diagnosis.

    Attributes:
        source: name of its file.
        samples: number of its samples, the control among them.
        control: sound samples that were left out of the fit.
        same_curves: effects that are the same curve on these tests, by the name of the effect that
            stands for them, itself first.
        untestable: effects that need an axis along which the tests do not vary.
        excess: how far the samples differ, against left-out samples of the baseline.
        machine: the sound machine.
        notes: on the comparison.
    """

    source: str
    samples: int
    control: Control
    same_curves: Mapping[str, tuple[Any, ...]]
    excess: Excess
    machine: SoundMachine = field(repr=False)
    untestable: tuple[Any, ...] = ()
    notes: tuple[str, ...] = ()

    def to_dict(self, diagnosis: Diagnosis) -> dict[str, Any]:
        """Return `baseline` of the JSON object.

        Args:
            diagnosis: of the change.
        """
        growth = self.growth(diagnosis)
        return {
            "source": self.source,
            "samples": self.samples,
            "control": self.control._asdict(),
            "p_value": self.excess.p_value,
            "deviation": self.excess.deviation,
            "thin": self.excess.is_thin,
            "growth": None if growth is None else growth.to_dict(),
        }

    def sentence(self) -> str:
        """Return the baseline and its control in a sentence."""
        outcome = "show no change"
        if self.control.alarms:
            outcome = "differ from the rest"
        sentence = (
            f"Compared with {self.samples} sound samples of {self.source}; "
            f"{self.control.samples} of them, left out as a control, {outcome} "
            f"(p = {self.control.p_value:.2g})."
        )
        if self.excess.is_thin:
            channel = self.machine.channels[0]
            visible = channel.factor * VISIBLE_DEVIATIONS * self.excess.deviation
            sentence += (
                f" The baseline is too thin: at these tests a change below {visible:.2g} "
                f"{channel.unit} does not show; add sound tests there."
            )
        return sentence

    def line(self) -> str:
        """Return the sentence as a line of a report."""
        return textwrap.fill(
            self.sentence(),
            width=REPORT_WIDTH,
            initial_indent=f"{'baseline':11}",
            subsequent_indent=11 * " ",
        )

    def applied_to(self, diagnosis: Diagnosis) -> Diagnosis:
        """Return a diagnosis that names no mechanism that the tests cannot show.

        The probability of an effect is shared among those that are the same curve, and a baseline
        whose control differs names no cause.

        Args:
            diagnosis: of the change, with one effect of each curve.
        """
        if diagnosis.verdict in NAMING:
            diagnosis = refuse_contradicted(without_absent(diagnosis))
            sized = [with_posterior_size(diagnosis, item) for item in diagnosis.causes]
            diagnosis = replace(diagnosis, causes=tuple(sized))
        if not self.excess.is_change:
            diagnosis = _without_gap(diagnosis, self.excess)
        causes = self._expanded_causes(diagnosis)
        sets = self._expanded_sets(diagnosis.sets)
        members = tuple(self._expanded_member(item) for item in diagnosis.members)
        classes = tuple(self._expanded_class(item) for item in diagnosis.classes)
        verdict = diagnosis.verdict
        if verdict == "cause_found" and sets[0].probability < CAUSE_FOUND_PROBABILITY:
            verdict = "ambiguous"
        warnings = diagnosis.warnings
        notes = [*self.notes]
        if self.control.alarms:
            warnings = (self._control_warning(), *warnings)
            notes.insert(0, self._control_warning())
            if verdict in NAMING:
                verdict = "unexplained"
                diagnosis = keeping_base(diagnosis)
        if diagnosis.gap.significant:
            notes += self._curve_notes(diagnosis)
        changed = replace(
            diagnosis,
            causes=causes,
            sets=sets,
            members=members,
            classes=classes,
            verdict=verdict,
            headline=self._headline(verdict),
            warnings=warnings,
            notes=(*notes, *diagnosis.notes),
        )
        return replace(changed, second_line=self._second_line(changed))

    def _second_line(self, diagnosis: Diagnosis) -> str:
        """Return how much a named loss has grown, as a sentence; empty where that is unknown."""
        growth = self.growth(diagnosis)
        if growth is None:
            return ""
        sentence = growth.sentence(diagnosis.samples.oil_temperature)
        if growth.probability < PRESENT_PROBABILITY:
            return (
                f"If it is {plain(growth.effect)}: {sentence[0].lower()}{sentence[1:]}"
            )
        return sentence

    def _headline(self, verdict: str) -> str:
        """Return the sentence for the mechanic; empty where a change is found."""
        if self.control.alarms:
            return "The sound tests differ among themselves: settle that first."
        if verdict != "no_gap":
            return ""
        if self.excess.is_thin:
            return "No change is seen, but the baseline is too thin: add sound tests."
        return "No change is seen: nothing to look for."

    def component(self, diagnosis: Diagnosis) -> str | None:
        """Return the part that holds most of the probability of a named cause, or None.

        Args:
            diagnosis: as of `applied_to`.
        """
        if diagnosis.verdict not in NAMING:
            return None
        totals: dict[str, float] = {}
        of_effects = {cause.effect: cause.component for cause in diagnosis.causes}
        for item in diagnosis.sets:
            parts = {of_effects.get(name, "") for name in item.effects}
            for part in parts - {""}:
                totals[part] = totals.get(part, 0.0) + item.probability
        listed = sum(item.probability for item in diagnosis.sets)
        if not totals:
            return None
        best = max(totals, key=totals.__getitem__)
        if totals[best] < CAUSE_FOUND_PROBABILITY * listed:
            return None
        return best

    def _control_warning(self) -> str:
        return (
            f"the control differs from the other samples of {self.source} (p = "
            f"{self.control.p_value:.2g}): the baseline is not one sound state, or too thin to "
            "predict its own samples, so no cause is named; diagnose it by itself first"
        )

    # --- effects that are the same curve ----------------------------------------------------

    def shares(self, name: str) -> dict[str, float]:
        """Return the share of each effect in the probability of the one that stands for it.

        Every component has the same share, and so have the effects of one component.
        """
        members = self.same_curves.get(name, ())
        if not members:
            return {name: 1.0}
        components: dict[str, list[str]] = {}
        for effect in members:
            components.setdefault(effect.component, []).append(effect.name)
        shares = {}
        for effect in members:
            of_component = components[effect.component]
            shares[effect.name] = 1.0 / (len(components) * len(of_component))
        return shares

    def _expanded_sets(self, sets: tuple[CauseSet, ...]) -> tuple[CauseSet, ...]:
        expanded: dict[tuple[str, ...], CauseSet] = {}
        for item in sets:
            for names, share in self._same_curve_sets(item.effects):
                probability = share * item.probability
                same = expanded.get(names, item)
                if names in expanded:
                    probability += same.probability
                expanded[names] = replace(
                    same,
                    effects=names,
                    probability=probability,
                    alternatives=tuple(map(self._with_same_curves, same.alternatives)),
                )
        # A stable sort keeps the effect that stands for others before them.
        return tuple(sorted(expanded.values(), key=lambda item: -item.probability))

    def _same_curve_sets(
        self, effects: tuple[str, ...]
    ) -> list[tuple[tuple[str, ...], float]]:
        """Return the sets that some effects stand for, each with its share."""
        sets = []
        choices = [self.shares(name).items() for name in effects]
        for choice in itertools.product(*choices):
            share = float(np.prod([part for _, part in choice]))
            names = tuple(sorted(name for name, _ in choice))
            sets.append((names, share))
        return sets

    def _with_same_curves(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return the effects of a class, each followed by those that are the same curve."""
        expanded: dict[str, None] = {}
        for name in names:
            # One effect alone is no class: its curve is shared by probability and a note.
            shares = self.shares(name) if len(names) > 1 else {}
            expanded.update(dict.fromkeys((name, *shares)))
        return tuple(expanded)

    def _expanded_member(self, member: Member) -> Member:
        names = self._with_same_curves(member.effects)
        if names == member.effects:
            return member
        return replace(member, effects=names, component=None)

    def _expanded_class(self, item: EffectClass) -> EffectClass:
        own = zip(item.members, item.forms, item.components, item.remedies, strict=True)
        of_name = {name: tuple(texts) for name, *texts in own}
        for name in item.members:
            for effect in self.same_curves.get(name, ()):
                texts = (effect.form, effect.component, effect.remedy)
                of_name.setdefault(effect.name, texts)
        names = self._with_same_curves(item.members)
        sets: dict[tuple[str, ...], None] = {}
        for of_set in item.sets:
            for names_of_set, _ in self._same_curve_sets(of_set):
                sets[names_of_set] = None
        forms, components, remedies = zip(
            *(of_name[name] for name in names), strict=True
        )
        return replace(
            item,
            members=names,
            forms=forms,
            components=components,
            remedies=remedies,
            sets=tuple(sets),
        )

    def _expanded_causes(self, diagnosis: Diagnosis) -> tuple[Cause, ...]:
        expanded = []
        for cause in diagnosis.causes:
            shares = self.shares(cause.effect)
            members = self.same_curves.get(cause.effect, ())
            if len(members) < 2:
                expanded.append(cause)
                continue
            for effect in members:
                others = [name for name in shares if name != effect.name]
                others += [
                    name for name in cause.indistinguishable_from if name not in shares
                ]
                member = _as_member(diagnosis, cause, effect)
                expanded.append(
                    replace(
                        member,
                        probability=shares[effect.name] * cause.probability,
                        indistinguishable_from=tuple(others),
                    )
                )
        return tuple(expanded)

    def growth(self, diagnosis: Diagnosis) -> Growth | None:
        """Return how much a loss of the sound machine has grown, where the verdict names that.

        Args:
            diagnosis: of the change; the growth is that of a cause in its leading set.
        """
        if diagnosis.named is None:
            return None
        for cause in diagnosis.causes:
            if cause.effect not in diagnosis.sets[0].effects:
                continue
            growth = self.machine.growth_of(cause, diagnosis.samples)
            if growth is not None:
                return growth
        return None

    def _curve_notes(self, diagnosis: Diagnosis) -> list[str]:
        """Return notes on effects that are one curve, and on what would separate them."""
        notes = []
        for cause in diagnosis.causes:
            members = self.same_curves.get(cause.effect, ())
            if len(members) < 2:
                continue
            names = ", ".join(plain(effect.name) for effect in members)
            remedies = dict.fromkeys(effect.remedy for effect in members)
            notes.append(
                f"on these tests one curve: {names}; what separates them: {'; '.join(remedies)}"
            )
        if self.untestable:
            names = ", ".join(
                dict.fromkeys(plain(effect.name) for effect in self.untestable)
            )
            notes.append(
                f"these tests vary too little to show {names} as such: each looks like leakage, "
                "friction or a constant torque"
            )
        return notes


def _as_member(diagnosis: Diagnosis, cause: Cause, effect: Any) -> Cause:
    """Return a cause as another effect of the same curve, refitted by itself.

    Args:
        diagnosis: gives the readings.
        cause: of the effect that stands for the other.
        effect: the other, at size zero.
    """
    if effect.name == cause.effect:
        return cause
    base = diagnosis.posterior.base_only.fit
    hypothesis = replace(base.hypothesis, effects=(effect,))
    fitted = refit(hypothesis, base.observed)
    (with_size,) = fitted.effects
    size = effect.sizes()[0]
    value = with_size.values()[size.name]
    first = next(entry for entry in cause.parameters.values() if "interval" in entry)
    relative = first["standard_error"] / max(abs(first["value"]), 1e-300)
    error = relative * abs(value)
    parameters: dict[str, dict[str, Any]] = {}
    for item in effect.parameters():
        entry: dict[str, Any] = {
            "value": with_size.values()[item.name],
            "unit": item.unit,
            "meaning": item.meaning,
        }
        if item.is_size:
            entry["standard_error"] = error
            entry["interval"] = [
                max(value - INTERVAL_DEVIATIONS * error, item.low),
                min(value + INTERVAL_DEVIATIONS * error, item.high),
            ]
            entry["plausible"] = is_plausible_size(item, value)
        parameters[item.name] = entry
    return replace(
        cause,
        effect=effect.name,
        form=effect.form,
        component=effect.component,
        parameters=parameters,
        summary=effect.summary,
        source=effect.source,
        remedy=effect.remedy,
    )


def _without_gap(diagnosis: Diagnosis, excess: Excess) -> Diagnosis:
    """Return a diagnosis whose difference is no larger than that of left-out baseline samples.

    Args:
        diagnosis: of the change.
        excess: of the samples; its figures stand for those of the diagnosis.
    """
    notes = diagnosis.notes
    if diagnosis.verdict != "no_gap":
        note = (
            "the samples differ by no more than left-out samples of the baseline do: that counts "
            "as no change"
        )
        notes = (note, *notes)
    gap = replace(
        diagnosis.gap,
        significant=False,
        p_value=excess.p_value,
        noise=excess.deviation,
    )
    beyond = np.sqrt(max(gap.rmse**2 - gap.noise**2, 0.0))
    return replace(
        keeping_base(diagnosis),
        verdict="no_gap",
        gap=gap,
        where=(),
        causes=(),
        sets=(),
        members=(),
        classes=(),
        unlisted=0.0,
        misfit=0.0,
        scatter=None,
        lost_power=None,
        shrinkage=replace(
            diagnosis.shrinkage,
            before=float(beyond),
            after=float(beyond),
            fraction=None,
            interval=None,
        ),
        next_tests=(),
        advice=replace(
            diagnosis.advice,
            reason=NO_GAP_WORTH_A_TEST,
            tests=(),
            measure=None,
            tests_expected=0,
        ),
        notes=notes,
    )
