# SPDX-License-Identifier: Apache-2.0
"""The candidates ranked, those that the data cannot tell apart in one bracket."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ...diagnosis import words
from ...diagnosis.result import Cause, Diagnosis
from ...transmission.parameters import PARAMETER_UNITS
from . import svg

_SETTLED = 2.0  # standard errors from which a drift is named


class Group(NamedTuple):
    """Causes under one heading.

    Attributes:
        heading: plain text.
        causes: at least one.
        bracket: whether the data cannot tell them apart.
    """

    heading: str
    causes: tuple[Cause, ...]
    bracket: bool


def groups(found: Diagnosis) -> list[Group]:
    """Share the causes among groups, the leading ones first."""
    left = list(found.causes)
    if not left:
        return []
    if found.verdict == "unexplained":
        return [Group("The best of the listed effects; none removes enough of the gap, so none "
                      "is named as its cause", tuple(left), False)]
    made = []
    leading = [left[0].effect, left[0].together_with]
    for name in leading:
        first = next((cause for cause in left if cause.effect == name), None)
        if first is None:
            continue
        members = tuple(cause for cause in left if cause is first
                        or (cause.effect in first.indistinguishable_from
                            and cause.effect not in leading))
        left = [cause for cause in left if cause not in members]
        made.append(_leading(found, first, members))
    if left:
        made.append(Group("Less probable", tuple(left), False))
    return made


def _leading(found: Diagnosis, first: Cause, members: tuple[Cause, ...]) -> Group:
    beside = [words.plain(name) for name in first.indistinguishable_from
              if name not in {cause.effect for cause in members}]
    extra = f"; nor from {words.listed(beside)}" if beside and len(members) > 1 else (
        f"; these data cannot tell it from {words.listed(beside)}" if beside else "")
    if len(members) > 1:
        return Group(f"These data cannot tell these {len(members)} apart{extra}", members, True)
    lone = "Cause found" if found.verdict == "cause_found" else "Leading cause"
    return Group(f"{lone}{extra}", members, bool(beside))


def ranked(found: Diagnosis) -> str:
    """Return the groups with one card for each cause, and the share of unlisted effects."""
    parts = [svg.element(
        "div", svg.element("h3", svg.text(group.heading)),
        *(_card(cause) for cause in group.causes),
        class_="group bracket" if group.bracket else "group") for group in groups(found)]
    parts.append(svg.element(
        "div", svg.element("h3", "Not in the library"), svg.element(
            "div", _bar("an effect that nobody listed", found.unlisted), class_="cause"),
        class_="group"))
    return "".join(parts)


def _bar(name: str, probability: float, form: str = "") -> str:
    width = 100.0 * min(max(probability, 0.0), 1.0)
    bar = svg.element(
        "svg", svg.element("rect", class_="track", x=0, y=0, width=100, height=10),
        svg.element("rect", class_="fill", x=0, y=0, width=width, height=10),
        viewBox="0 0 100 10", preserveAspectRatio="none", class_="bar", aria_hidden="true")
    suffix = svg.element("span", svg.text(f", {form}"), class_="form") if form else ""
    return svg.element(
        "div", svg.element("h4", svg.text(name), suffix), bar,
        svg.element("span", svg.text(words.probability(probability)), class_="share"),
        class_="bar-row")


def _card(cause: Cause) -> str:
    facts = [("What it does", svg.text(_sentence(cause.summary))),
             ("Fitted size", _sizes(cause.parameters)),
             ("Gap once it is added", svg.text(_left(cause)))]
    if cause.drift:
        facts.append(("Drift of the base", _drift(cause.drift)))
    if cause.remedy:
        facts.append(("How to settle it", svg.text(_sentence(cause.remedy))))
    if cause.source:
        facts.append(("Form taken from", svg.text(cause.source)))
    listing = svg.element("dl", *(svg.element("dt", svg.text(term)) + svg.element("dd", body)
                                  for term, body in facts))
    return svg.element("article", _bar(words.plain(cause.effect), cause.probability, cause.form),
                       _tags(cause), listing, class_="cause")


def _sentence(words_: str) -> str:
    return words_[:1].upper() + words_[1:] + ("" if words_.endswith(".") else ".")


def _tags(cause: Cause) -> str:
    tags = [f"part: {cause.component}"]
    if cause.together_with:
        tags.append(f"together with {words.plain(cause.together_with)}")
    sizes = [entry["plausible"] for entry in cause.parameters.values() if "plausible" in entry]
    if sizes:
        tags.append("plausible size" if all(sizes) else "implausible size")
    return svg.element("p", *(svg.element(
        "span", svg.text(tag), class_="tag doubt" if tag.startswith("implausible") else "tag")
        for tag in tags), class_="tags")


def _sizes(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    lines = []
    for name, entry in parameters.items():
        unit = words.unit(str(entry.get("unit", "-")))
        value = f"{words.number(float(entry['value']))} {unit}".strip()
        limits = entry.get("interval")
        meaning = str(entry.get("meaning") or words.plain(name))
        if limits is not None:
            span = f"{words.interval(limits)} {unit}".strip()
            line = svg.element("strong", svg.text(value)) + svg.text(
                f" (95 %: {span}): {meaning}")
        else:
            line = svg.text(f"{value}: {meaning} (form, best of those tried)")
        lines.append(svg.element("li", line))
    return svg.element("ul", *lines) if lines else words.NOTHING


def _left(cause: Cause) -> str:
    left = f"{words.points(cause.gap_after)} above the noise"
    if cause.shrinkage is None:
        return f"{left}."
    if cause.shrinkage <= 0.0:
        return f"{left}; on samples left out, the squared gap does not shrink."
    return f"{left}; {words.percent(cause.shrinkage)} of the squared gap is gone."


def _drift(drift: Mapping[str, Mapping[str, float]]) -> str:
    """Base parameters that cover for the effect while it is left out."""
    moved = [name for name, change in drift.items()
             if abs(change["standard_errors"]) > _SETTLED]
    lines = []
    for name in moved:
        change, unit = drift[name], words.unit(PARAMETER_UNITS.get(name, "-"))
        lines.append(
            f"{words.plain(name)}: {words.number(change['without_effect'])} {unit} without it, "
            f"{words.number(change['with_effect'])} {unit} with it "
            f"({words.fixed(change['standard_errors'], 1, sign=True)} standard errors)")
    settled = [words.plain(name) for name in drift if name not in moved]
    if settled:
        lines.append(f"{words.listed(settled, 'and')}: within two standard errors")
    return svg.element("ul", *(svg.element("li", svg.text(line)) for line in lines))
