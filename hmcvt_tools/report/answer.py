# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The answer of a diagnosis as page and sheet lead with it: causes, size, next step."""

from __future__ import annotations

from typing import NamedTuple

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import Cause
from hmcvt_core.diagnosis.settings import INTERVAL_DEVIATIONS
from hmcvt_core.diagnosis.statements.members import Member

VERDICTS = {
    "no_gap": "No gap",
    "excess_scatter": "Scatter above its statement",
    "cause_found": "Cause found",
    "class_found": "One of a class",
    "other_form": "Cause found, form unknown",
    "ambiguous": "Ambiguous",
    "unexplained": "Unexplained",
}
"""Words of the verdicts on a badge."""

MAX_MEMBERS = 4
"""Causes that the answer lists; the details have all. Chosen so that they fit on one screen."""
_UNLISTED = "an effect that is not listed"

_PRINTED_UNITS = (
    ("m3", "m\N{SUPERSCRIPT THREE}"),
    ("N m", "N\N{MIDDLE DOT}m"),
    ("deg C", "\N{DEGREE SIGN}C"),
    ("s Pa", "s\N{MIDDLE DOT}Pa"),
)


class MemberLine(NamedTuple):
    """A possible cause in one line.

    Attributes:
        name: effects in words.
        probability: in words.
        share: the probability itself, for a bar.
        detail: part, power and doubt about the form, in words; may be empty.
    """

    name: str
    probability: str
    share: float
    detail: str = ""


class Measure(NamedTuple):
    """How far the gap shrinks.

    Attributes:
        value: the one figure, in words.
        meaning: of the figure.
    """

    value: str
    meaning: str


def members(diagnosis: Diagnosis) -> list[MemberLine]:
    """Return the possible causes, most probable first; of scatter what may have varied."""
    if diagnosis.verdict == "no_gap":
        return []
    if diagnosis.verdict == "excess_scatter":
        return _varied(diagnosis)
    known = diagnosis.members or _members_of_causes(diagnosis)
    lines = []
    for member in known[:MAX_MEMBERS]:
        if member.probability >= words.REPORTED_PROBABILITY:
            lines.append(_line(member))
    if diagnosis.unlisted >= words.REPORTED_PROBABILITY:
        probability = words.probability(diagnosis.unlisted)
        lines.append(MemberLine(_UNLISTED, probability, diagnosis.unlisted))
    return sorted(lines, key=lambda line: -line.share)


def _varied(diagnosis: Diagnosis) -> list[MemberLine]:
    """Return the quantities that may have varied without being recorded."""
    if diagnosis.scatter is None:
        return []
    lines = []
    for quantity, probability in diagnosis.scatter.quantities[:MAX_MEMBERS]:
        text = words.probability(probability)
        lines.append(MemberLine(words.plain(quantity), text, probability))
    return lines


def _members_of_causes(diagnosis: Diagnosis) -> tuple[Member, ...]:
    """Return a member for each cause, and one for all causes of a class."""
    result: list[Member] = []
    classes = []
    for cause in diagnosis.causes:
        effect_class = diagnosis.class_of(cause)
        if effect_class is None:
            result.append(Member((cause.effect,), cause.component, cause.probability))
        elif effect_class not in classes:
            classes.append(effect_class)
            result.append(
                Member(
                    effect_class.members,
                    _common_component(diagnosis, effect_class.members),
                    effect_class.probability,
                )
            )
    return tuple(result)


def _common_component(diagnosis: Diagnosis, effects: tuple[str, ...]) -> str | None:
    """Return the part that all effects of a class belong to, or None."""
    components = {
        cause.component for cause in diagnosis.causes if cause.effect in effects
    }
    return components.pop() if len(components) == 1 else None


def _line(member: Member) -> MemberLine:
    details = []
    if member.component is not None:
        details.append(words.plain(member.component))
    if member.is_class:
        details.append("one of them; no test distinguishes them")
    if member.condition:
        details.append("a condition and no damage")
    if member.lost_power is not None:
        details.append(_power(member, member.lost_power))
    if not member.form_fits:
        details.append("in a form that is not in the library")
    return MemberLine(
        words.listed([words.plain(name) for name in member.effects]),
        words.probability(member.probability),
        member.probability,
        ", ".join(details),
    )


def _power(member: Member, power: float) -> str:
    """Return the mean power that a member takes [W] in words, with its interval."""
    if abs(power) < 1.0:
        return "barely any power"
    in_words = words.power_in_words(power, member.condition)
    if member.lost_power_error is None:
        return in_words
    reach = INTERVAL_DEVIATIONS * member.lost_power_error
    sense = 1.0 if power > 0.0 else -1.0
    low, high = (f"{sense * power + change:.0f}" for change in (-reach, reach))
    return f"{in_words}, 95 %: {low} to {high} W"


def how_far(diagnosis: Diagnosis) -> Measure:
    """Return by how much the saved model comes nearer to the bench."""
    gap = diagnosis.gap
    if diagnosis.verdict in ("no_gap", "excess_scatter"):
        return Measure(
            words.amount(diagnosis, gap.rmse),
            "rms error of the refitted model at held-out samples; the noise is "
            f"{words.amount(diagnosis, gap.noise)}",
        )
    shrinkage = diagnosis.shrinkage
    if shrinkage.fraction is None:
        delivered = diagnosis.delivered
        before = words.amount(diagnosis, delivered.rmse_before)
        after = words.amount(diagnosis, delivered.rmse_after)
        return Measure(
            f"{before} \N{RIGHTWARDS ARROW} {after}",
            "rms error at held-out samples: of the refitted model, and of the saved "
            "model",
        )
    before = words.amount(diagnosis, shrinkage.before)
    after = words.amount(diagnosis, shrinkage.after)
    interval = ""
    if shrinkage.interval is not None:
        interval = f"95 % interval {words.fraction_interval(shrinkage.interval)}; "
    value = "none"
    if shrinkage.fraction > 0.0:
        value = words.percent(shrinkage.fraction)
    return Measure(
        value,
        f"of the squared gap removed, on {shrinkage.on} ({interval}{before} "
        f"\N{RIGHTWARDS ARROW} {after} beyond the noise)",
    )


def scatter_sentence(diagnosis: Diagnosis) -> str:
    """Return the sentence on scatter above its statement, unless the headline holds it."""
    if diagnosis.scatter is None:
        return ""
    sentence = diagnosis.scatter.sentence
    if sentence.rstrip(".") in words.mechanic(diagnosis):
        return ""
    return sentence


def sizes(cause: Cause) -> list[str]:
    """Return the fitted sizes of a cause with their intervals, in words."""
    lines = []
    for name, size in cause.parameters.items():
        interval = size.get("interval")
        if interval is None:
            continue
        unit = unit_in_words(size["unit"])
        low, high = (words.number(end) for end in interval)
        value = f"{words.number(size['value'])} {unit}".rstrip()
        limits = f"{low} to {high} {unit}".rstrip()
        lines.append(
            f"{words.plain(cause.effect)}, {words.plain(name)}: {value} "
            f"({cause.coverage}: {limits})"
        )
    return lines


def unit_in_words(unit: str) -> str:
    """Return a unit as pages print it; nothing for a plain number."""
    if unit == "-":
        return ""
    for plain_text, printed in _PRINTED_UNITS:
        unit = unit.replace(plain_text, printed)
    return unit
