# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of a diagnosis in sentences; nothing is computed here, and nothing is escaped."""

from __future__ import annotations

from collections.abc import Sequence

from ..design.advice import named
from ..selection.classes import with_probabilities
from ..settings import CAUSE_FOUND_PROBABILITY, LIKELY
from ..statements.agreement import METERS, Look
from ..statements.members import Member
from ..system import Axis
from ..wording import fixed, listed, percent, plain, probability
from .notes import meters_far_off, noise_decides, parameters_far_off
from .outcome import BASE, Outcome, Region

WIDE_FRACTION = 0.75
"""Fraction of an axis from which a region is not special along it. Chosen for reading."""
LOW_FRACTION = 0.4
HIGH_FRACTION = 0.6
"""Fraction of the range up to which the middle of a region is low, and from which it is high."""
OUTSTANDING_PROBABILITY = 0.3
"""Probability below which a leading set is one among many. Chosen for reading."""
MENTIONED_PROBABILITY = 0.03
MAX_MENTIONED_SETS = 4
"""Sets that the verdict mentions: how probable at least, and how many at most."""
_WITH_PROBABILITY = "{0} ({1})"
NO_STEPS = ("note: ", "stop: ")
"""Beginnings of sentences of the advice that ask for nothing."""
WHERE_NO_EFFECT_EXPLAINS = (
    "No test between listed effects helps while none of them explains the gap. Repeat the points "
    "at which the gap is large and measure more points there, closer together."
)
LONGEST_HEADLINE = 25
"""Words of the sentence for the mechanic, beyond which it leaves out what to do."""


def amount(outcome: Outcome, value: float, sign: bool = False) -> str:
    """Return a value of the channel in which the gap is measured, in the unit of its reports."""
    channel = outcome.channel
    return f"{fixed(channel.factor * value, channel.digits, sign)} {channel.unit}"


def mechanic(outcome: Outcome) -> str:
    """Return what is probably wrong, what it costs and what to do, without statistics."""
    if outcome.headline:
        return outcome.headline
    if outcome.warnings:
        return "The readings do not fit this machine: resolve the points below first."
    if outcome.verdict == "no_gap":
        return _no_gap_headline(outcome)
    if outcome.verdict == "excess_scatter":
        return _scatter_headline(outcome)
    if outcome.merely_off:
        return "The model is slightly off, smoothly: too little to blame any part."
    if outcome.named is None:
        return f"A loss that is not in the library{_at_largest_gap(outcome)}."
    statement = f"{_suspects(outcome)}{_cost(outcome)}"
    if outcome.verdict == "other_form":
        return (
            f"{statement}, in a form that is not in the library or with another loss."
        )
    return _with_remedy(statement, _remedy(outcome).split("; or ")[0])


def _with_remedy(statement: str, remedy: str) -> str:
    """Return a sentence with a remedy, or the first clause of it, as far as there is room."""
    for clause in (remedy, remedy.split(";")[0]):
        sentence = f"{statement}: {clause}."
        if clause and len(sentence.split()) <= LONGEST_HEADLINE:
            return sentence
    return f"{statement}."


def _remedy(outcome: Outcome) -> str:
    """Return the measurement that comes next; empty where that is a test at an operating point."""
    if outcome.advice.tests or outcome.named is None:
        return ""
    return outcome.advice.measure or outcome.named.remedy


def needs_no_test(outcome: Outcome) -> bool:
    """Whether there is no gap, as surely as a cause would be named."""
    if outcome.verdict != "no_gap":
        return False
    sure = outcome.posterior.no_gap >= CAUSE_FOUND_PROBABILITY
    return sure or not outcome.advice.tests


def next_step(outcome: Outcome) -> list[str]:
    """Return what to do next, one paragraph an entry; all reports say this and nothing else."""
    if needs_no_test(outcome):
        if noise_decides(outcome.posterior.base_only.fit.observed):
            return [
                "State the noise, or repeat some points: then the samples decide it."
            ]
        return ["No test is needed: there is no gap to explain."]
    if outcome.verdict == "excess_scatter" and outcome.scatter is not None:
        sensor = outcome.scatter.sensor or "what may have varied"
        checked = "the stated noise"
        if outcome.agreement.of_meters_alone:
            checked = "that meter"
        return [f"Check {checked}, or record {sensor} with each test."]
    if outcome.verdict == "unexplained" and not outcome.next_tests:
        return [WHERE_NO_EFFECT_EXPLAINS]
    steps = []
    for step in outcome.advice.steps():
        if not step.startswith(NO_STEPS):
            steps.append(step)
    remedy = _remedy(outcome)
    if not steps and remedy:
        return [f"To settle it: {remedy}."]
    return steps or ["No further test is known that would distinguish the causes."]


def _no_gap_headline(outcome: Outcome) -> str:
    if outcome.left_out:
        count = len(outcome.left_out)
        tests = "1 test stands" if count == 1 else f"{count} tests stand"
        return (
            f"Bench and model agree, but {tests} apart: repeat before you rely on it."
        )
    far_off = meters_far_off(outcome.posterior.base_only)
    if far_off:
        name = max(far_off, key=far_off.__getitem__)
        return (
            f"The {plain(name)} scatters {far_off[name]:.2g} times as much as its meter should: "
            "check that meter."
        )
    moved = parameters_far_off(outcome.posterior.base_only.fit)
    if moved:
        name = max(moved, key=moved.__getitem__)
        return (
            f"Bench and model agree, but only with {plain(name)} {moved[name]:.2g} standard "
            "deviations from what was expected: check it."
        )
    no_gap = outcome.posterior.no_gap
    if no_gap < CAUSE_FOUND_PROBABILITY:
        return f"Bench and model agree with only {percent(no_gap)}: more tests would decide."
    if noise_decides(outcome.posterior.base_only.fit.observed):
        samples = f"{outcome.gap.samples} samples"
        return f"No gap shown; {samples} and an assumed noise cannot rule one out."
    return "Bench and model agree: nothing to look for."


def _scatter_headline(outcome: Outcome) -> str:
    agreement = outcome.agreement
    sensor = "what may have varied"
    if outcome.scatter is not None and outcome.scatter.sensor:
        sensor = outcome.scatter.sensor
    if agreement.holds:
        name, ratio = _noisiest(outcome)
        return (
            f"The {name} scatters {ratio:.1f} times as much as it should: check its noise, or "
            f"record {sensor}."
        )
    if not agreement.of_meters_alone:
        ratio_words = f"up to {agreement.ratio:.1f} times their stated noise"
        return f"The readings scatter {ratio_words}: check that statement, or record {sensor}."
    of_one_error = [look for look in agreement.looks if look.part != METERS]
    if not of_one_error:
        return (
            f"The errors of the meters are {agreement.ratio:.1f} times as large as their class "
            f"allows: check the meters, or record {sensor}."
        )
    look = max(of_one_error, key=lambda look: look.ratio)
    changed = f"{look.part} changed {look.ratio:.1f} times as much as its class allows"
    return f"{changed[0].upper()}{changed[1:]}: check that meter, or record {sensor}."


def _noisiest(outcome: Outcome) -> tuple[str, float]:
    """Return the channel whose scatter exceeds its statement most, and by how much."""
    explanations = [item for item, _ in outcome.posterior.entries]
    explanation = next(
        (item for item in explanations if item.has_excess_noise),
        outcome.posterior.base_only,
    )
    noise = explanation.model.noise
    largest = int(noise.argmax())
    name = explanation.fit.observed.channels[largest].name
    return plain(name), float(noise[largest] ** 0.5)


def _at_largest_gap(outcome: Outcome) -> str:
    if not outcome.where:
        return ""
    words = region_words(outcome.where[0], outcome)
    return f", mostly at {words}" if words else ""


def _cost(outcome: Outcome) -> str:
    """Return what the named members cost; nothing where that is not known."""
    named = outcome.named
    if named is not None and named.component == "sensor":
        # A class may hold a meter and a loss that no test distinguishes from it.
        of_class = [item for item in outcome.members if named.effect in item.effects]
        is_meter = all(item.component == "sensor" for item in of_class)
        return ", a meter, not a loss" if is_meter else ""
    if outcome.lost_power is None:
        return ""
    watts = abs(float(f"{outcome.lost_power:.2g}"))
    if watts < 1.0:
        return ", hardly any power"
    condition = _condition(outcome)
    power = power_in_words(outcome.lost_power, condition)
    no_damage = ", a condition and no damage" if condition else ""
    return f"{no_damage}, about {power}"


def power_in_words(power: float, condition: str = "") -> str:
    """Return a mean power lost [W] in words.

    Args:
        power: negative where less is lost.
        condition: with which the loss is compared; empty for a loss by damage.
    """
    watts = f"{abs(float(f'{power:.2g}')):.0f} W"
    if condition:
        more = "more" if power > 0.0 else "less"
        return f"{watts} {more} loss on average than with {condition}"
    return (
        f"{watts} lost on average" if power > 0.0 else f"{watts} less loss on average"
    )


def _condition(outcome: Outcome) -> str:
    """Return the condition at which the named causes are off; empty where one may be a damage."""
    named: Sequence[Member] = outcome.present
    if outcome.verdict == "ambiguous" or outcome.set_is_settled:
        leading = set(outcome.sets[0].effects)
        named = [item for item in outcome.members if leading & set(item.effects)]
    conditions = {item.condition for item in named}
    return conditions.pop() if len(conditions) == 1 else ""


def _suspects(outcome: Outcome) -> str:
    """Return the members that are sure; the likeliest sets where none is."""
    leading, *others = outcome.class_sets
    if outcome.verdict == "other_form" or (
        outcome.verdict != "ambiguous" and not outcome.set_is_settled
    ):
        parts = [_one_of(item.effects) for item in outcome.present]
        return f"Probably {listed(parts, 'and')}"
    parts = [_one_of(part) for part in leading.alternatives]
    together = listed(parts, "and")
    if outcome.verdict != "ambiguous":
        return f"Probably {together}"
    if len(leading.sets) > 1:
        return f"Perhaps {together}"
    if others and len(parts) == 1:
        return f"Perhaps {together}, perhaps {others[0]}"
    return f"Perhaps {together}, or others"


def _one_of(names: Sequence[str]) -> str:
    return listed([plain(name) for name in names])


def verdict(outcome: Outcome) -> str:
    """Return the outcome in a few sentences."""
    if outcome.verdict == "no_gap":
        return _no_gap(outcome)
    if outcome.verdict == "excess_scatter":
        return _excess_scatter(outcome)
    difference = _difference(outcome)
    if outcome.merely_off:
        return (
            f"{difference}. The model is off by {amount(outcome, outcome.shrinkage.before)}, "
            "smoothly: less than a cause would need, and none is named."
        )
    if outcome.verdict == "unexplained" or not outcome.causes:
        sentence = f"{difference}. No effect in the library explains it by itself."
        return f"{sentence} {_removed(outcome)}"
    sentences = [f"{difference}; {_explanation(outcome)}.", *_classes(outcome)]
    sentences.append(_removed(outcome))
    return " ".join(sentences)


def _no_gap(outcome: Outcome) -> str:
    sentence = (
        f"No gap is seen: with its base parameters refitted, the model differs from the "
        f"{outcome.gap.samples} samples by no more than their noise of "
        f"{amount(outcome, outcome.gap.noise)} explains."
    )
    rivals = 1.0 - outcome.posterior.no_gap
    if rivals > LIKELY:
        sentence += f" Even so, a gap fits them better ({probability(rivals)}): it is not decided."
    if outcome.left_out:
        sentence += (
            f" Left out as single tests that stand apart: {listed(outcome.left_out, 'and')}. If "
            "they repeat, an effect may begin there."
        )
    return sentence


def _excess_scatter(outcome: Outcome) -> str:
    agreement = outcome.agreement
    meters = [look for look in agreement.looks if look.of_meters]
    if agreement.of_meters_alone:
        of_meters = listed(list(map(_times, meters)), "and")
        sentence = (
            "Bench and model agree, but only if errors of meters are larger than their class "
            f"allows: {of_meters}"
        )
    elif agreement.holds:
        name, ratio = _noisiest(outcome)
        sentence = (
            f"No cause is seen along the axes that were recorded, but the {name} scatters "
            f"{ratio:.2g} times as much as its noise should"
        )
    else:
        sentence = (
            "No cause is seen along the axes that were recorded, but the readings scatter up to "
            f"{agreement.ratio:.2g} times as much as the noise that was stated "
            f"({outcome.gap.noise_source})"
        )
        parts = [look for look in agreement.readings if look.part]
        if parts:
            sentence += f", most clearly in {_largest_two(parts)}"
        if meters:
            sentence += (
                "; errors of meters are larger than their class allows, most clearly "
                f"{_largest_two(meters)}"
            )
    if outcome.scatter is None:
        return f"{sentence}."
    return f"{sentence}. {outcome.scatter.sentence}"


def _largest_two(looks: Sequence[Look]) -> str:
    descending = sorted(looks, key=lambda look: -round(look.ratio, 1))
    return listed(list(map(_times, descending[:2])), "and")


def _times(look: Look) -> str:
    return f"{look.part} ({look.ratio:.2g} times)"


def _difference(outcome: Outcome) -> str:
    """Return how far bench and model differ, and where most."""
    size = amount(outcome, outcome.shrinkage.before)
    beyond = f"Bench and model differ by {size} beyond the noise"
    region = outcome.significant_region
    if region is None:
        return beyond
    words = region_words(region, outcome)
    if region.channel != outcome.channel.name:
        at = f" at {words}" if words else ""
        return f"{beyond}, most clearly in the {plain(region.channel)}{at}"
    side = "below" if region.mean_residual < 0.0 else "above"
    at = f", mostly at {words}" if words else " over the whole range"
    return (
        f"The bench lies {amount(outcome, abs(region.mean_residual))} {side} the refitted "
        f"model{at}"
    )


def region_words(region: Region, outcome: Outcome) -> str:
    """Return where a region lies in words such as `high engine speed and low load`."""
    graded = [axis for axis in outcome.axes if axis.graded]
    with_limits = [axis for axis in outcome.axes if not axis.graded]
    words = []
    for axis in (*graded, *with_limits):
        part = _part_of_range(axis, region, outcome)
        if part:
            words.append(part)
    words += [f"{name} {label}" for name, label in region.setting.items()]
    return listed(words, "and")


def _part_of_range(axis: Axis, region: Region, outcome: Outcome) -> str:
    """Return where a region lies along an axis; nothing where it spans most of the range."""
    low, high = region.limits[axis.name]
    lowest, highest = outcome.extent[axis.name]
    span = highest - lowest
    if span <= 0.0 or (high - low) / span > WIDE_FRACTION:
        return ""
    if not axis.graded:
        limits = f"{fixed(low, axis.digits)} to {fixed(high, axis.digits)}"
        return f"{axis.word} {limits}"
    middle = ((low + high) / 2.0 - lowest) / span
    degree = "medium"
    if middle < LOW_FRACTION:
        degree = "low"
    elif middle > HIGH_FRACTION:
        degree = "high"
    return f"{degree} {axis.word}"


def _explanation(outcome: Outcome) -> str:
    """Return the sets that explain the gap, or the members while their company is open."""
    class_sets = outcome.class_sets
    leading = class_sets[0]
    if outcome.verdict == "other_form":
        members = [_with_probability(item) for item in outcome.present]
        return (
            f"{listed(members, 'and')} makes most of it; the rest needs a form that is not in the "
            "library, or is another loss"
        )
    if outcome.verdict != "ambiguous" and outcome.set_is_settled:
        verb = "explain" if len(leading.alternatives) > 1 else "explains"
        (first,) = with_probabilities([leading], _WITH_PROBABILITY)
        return f"{first} {verb} it"
    mentioned = [
        item for item in class_sets if item.probability >= MENTIONED_PROBABILITY
    ]
    sets = with_probabilities(mentioned[:MAX_MENTIONED_SETS], _WITH_PROBABILITY)
    if outcome.verdict != "ambiguous":
        members = [_with_probability(item) for item in outcome.present]
        verb = "are" if len(members) > 1 else "is"
        among = f": {listed(sets)}" if sets else ""
        return (
            f"{listed(members, 'and')} {verb} part of the cause; whether others join is open"
            f"{among}"
        )
    if leading.probability < OUTSTANDING_PROBABILITY:
        among = f", among them {listed(sets[:3], 'and')}" if sets else ""
        return f"several sets of causes remain possible{among}"
    best, *others = sets
    rivals = listed(others) or named(())
    return (
        f"{best} explains it best, but these data cannot distinguish it from {rivals}"
    )


def _with_probability(member: Member) -> str:
    return f"{_one_of(member.effects)} ({probability(member.probability)})"


def _classes(outcome: Outcome) -> list[str]:
    """Return sentences on effects of the leading set that no test distinguishes from others."""
    leading = outcome.class_sets[0].alternatives
    return [item.sentence for item in outcome.classes if item.members in leading]


def _removed(outcome: Outcome) -> str:
    """Return how far the gap shrinks with the model that is handed over."""
    shrinkage = outcome.shrinkage
    if shrinkage.fraction is None:
        return "These samples do not show how far the gap would shrink."
    samples = "the holdout" if shrinkage.on == "holdout" else "held-out samples"
    added = handed_over(outcome)
    if not added:
        return (
            "No model with more in it predicts held-out samples better by more than chance: the "
            "refitted base model is kept."
        )
    on_samples = f"On {samples}, with {added} added,"
    if shrinkage.fraction <= 0.0:
        return f"{on_samples} the gap does not shrink yet."
    interval = ""
    if shrinkage.interval is not None:
        interval = f" ({fraction_interval(shrinkage.interval)})"
    return f"{on_samples} {percent(shrinkage.fraction)} of the squared gap is removed{interval}."


def handed_over(outcome: Outcome) -> str:
    """Return what the model that is handed over adds to the base model; empty for nothing."""
    delivered = outcome.delivered
    if delivered.kind == BASE:
        return ""
    parts = []
    if outcome.named is not None:
        parts.append(named(outcome.sets[0].effects))
    if delivered.bumps:
        parts.append("an empirical remainder that names no cause")
    return listed(parts, "and")


def fraction_interval(limits: Sequence[float]) -> str:
    """Return the interval of a fraction in percent; a negative end is `below 0`."""
    ends = ["below 0" if end < 0.0 else fixed(100.0 * end, 0) for end in limits]
    low, high = ends
    return f"{low} %" if low == high else f"{low} to {high} %"
