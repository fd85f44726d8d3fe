# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A diagnosis told: numbers, names, sentences, plain data (the contract of the command) and text.

Nothing is computed here, and nothing is escaped.
"""

import json
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from ...files import picture, preformatted
from ..design.next_test import Advice, NextTest
from ..design.next_test import named as named
from ..settings import GAP_SIGNIFICANCE, REGION_SIGNIFICANCE
from ..system import Axis
from ..wording import AT_MOST as AT_MOST
from ..wording import MINUS as MINUS
from ..wording import NOTHING as NOTHING
from ..wording import chance as chance
from ..wording import fixed as fixed
from ..wording import listed as listed
from ..wording import number as number
from ..wording import p_is as p_is
from ..wording import percent as percent
from ..wording import plain as plain
from ..wording import probability as probability
from ..wording import wrapped as wrapped
from .outcome import Outcome, Region

_WIDE = 0.75  # part of the range from which a place is not special along an axis
_OUTSTANDING = 0.3  # a leading cause less probable than this is one among many
_MOST_WORDS = 25  # of the sentence for the mechanic
_ALIVE, _MOST_TOLD = 0.03, 4  # sets named in the verdict
_TOLD_SET, _SETS = 0.01, 5  # and in the report
_DETAILED = 3  # causes told at length; the page has all
_MARGIN = 11
_SETTLED = 2.0  # standard errors from which a drift of a base parameter is worth a line


def amount(found: Outcome, value: float, sign: bool = False) -> str:
    """Return a value of the channel in which the gap is measured, in the unit it is told in."""
    channel = found.channel
    return f"{fixed(channel.factor * value, channel.digits, sign)} {channel.unit}"


def point_of(test: NextTest, axes: Sequence[Axis]) -> str:
    """Return the point of a test."""
    point = test.point or {}
    told = [
        axis.test_format.format(
            point[axis.name], axis.second_unit_factor * point[axis.name]
        )
        for axis in axes
    ]
    return ", ".join([*told, *map(" ".join, test.setting.items())])


def advice(found: Advice) -> str:
    """Return which test to run next, or why to stop, and what is alive."""
    told = [f"{named(effects)} ({probability(p)})" for effects, p in found.alive]
    lines = [f"note: {note}" for note in found.notes]
    if found.stop:
        lines.append(f"stop: {found.reason}")
    else:
        lines += [
            f"next test: {point_of(found.tests[0], found.axes)}; "
            f"read {listed(found.channels, 'and')}",
            f"about {found.tests_expected} more until it is settled",
        ]
    if found.measure is not None:
        apart = ": tells {} from {}".format(*found.parted) if found.parted else ""
        lines.append(f"measure: {found.measure}{apart}")
    lines.append(
        f"alive: {', '.join(told)}, no gap or a base model a little off "
        f"({probability(found.no_gap)})"
    )
    return "\n".join(wrapped(line) for line in lines)


def mechanic(found: Outcome) -> str:
    """Return what is probably wrong, what it costs and what to do, without a statistic."""
    if found.warnings:
        return "The readings do not fit this machine: settle what the next lines say first."
    if found.verdict == "no_gap":
        return "Bench and model agree: nothing to look for."
    if found.merely_off:
        return "The model is slightly off, smoothly: too little to blame any part."
    watts = abs(float(f"{found.lost_power:.2g}"))
    cost = (
        f"about {watts:.0f} W {'lost' if found.lost_power > 0.0 else 'gained'} on average"
        if watts >= 1.0
        else "hardly any power"
    )
    if found.named is None:
        place = region_words(found.where[0], found) if found.where else ""
        return f"Something unlisted, {cost}: look at {place or 'the whole range'}."
    names = list(map(plain, found.sets[0].effects))
    what = f"Probably {listed(names, 'and')}"
    if found.verdict == "ambiguous":
        what = (
            f"Perhaps {listed(names, 'and')}, perhaps {named(found.sets[1].effects)}"
            if len(found.sets) > 1 and len(names) == 1
            else f"Perhaps {listed(names, 'and')}, or others"
        )
    if found.named.component == "sensor":
        cost = "a meter, not a loss"
    todo = (found.advice.measure or found.named.remedy).split("; or ")[0]
    short, whole = f"{what}, {cost}.", f"{what}, {cost}: {todo}."
    return whole if todo and len(whole.split()) <= _MOST_WORDS else short


def verdict(found: Outcome) -> str:
    """Return the outcome in a sentence or two."""
    if found.verdict == "no_gap":
        return (
            f"No gap is seen: with its base parameters refitted, the model differs from the "
            f"{found.gap.samples} samples by no more than their noise of "
            f"{amount(found, found.gap.noise)} explains."
        )
    if found.merely_off:
        return (
            f"{_lies(found)}. The model is off by {amount(found, found.shrinkage.before)}, "
            "smoothly: smaller than what a cause would need, and none is named."
        )
    if found.verdict == "unexplained" or not found.causes:
        fraction = found.shrinkage.fraction or 0.0
        best = (
            (
                f": the likeliest set removes {percent(fraction)} of the squared gap in "
                f"{plain(found.channel.name)}"
            )
            if fraction > 0.0
            else ""
        )
        return f"{_lies(found)}. No effect in the library explains it by itself{best}."
    return f"{_lies(found)}; {_explained(found)}. {_removed(found)}"


def _lies(found: Outcome) -> str:
    region = found.where[0] if found.where else None
    beyond = f"Bench and model differ by {amount(found, found.shrinkage.before)} beyond the noise"
    if region is None or region.p_value > REGION_SIGNIFICANCE:
        return f"{beyond}, and no single place stands out"
    place = region_words(region, found)
    if region.channel != found.channel.name:
        at = f" at {place}" if place else ""
        return f"{beyond}, most clearly in the {plain(region.channel)}{at}"
    side = "below" if region.mean_residual < 0.0 else "above"
    at = f", mostly at {place}" if place else " over the whole range"
    return (
        f"The bench lies {amount(found, abs(region.mean_residual))} {side} the refitted model"
        f"{at}"
    )


def region_words(region: Region, found: Outcome) -> str:
    """Return where a region lies in words such as `high engine speed and low load`."""
    told = []
    # What is low or high goes first.
    for axis in sorted(found.axes, key=lambda axis: not axis.graded):
        (low, high), (lowest, highest) = (
            region.limits[axis.name],
            found.extent[axis.name],
        )
        span = highest - lowest
        if span <= 0.0 or (high - low) / span > _WIDE:
            continue
        middle = ((low + high) / 2.0 - lowest) / span
        degree = "low" if middle < 0.4 else "high" if middle > 0.6 else "medium"
        told.append(
            f"{degree} {axis.word}"
            if axis.graded
            else f"{axis.word} {fixed(low, axis.digits)} to {fixed(high, axis.digits)}"
        )
    return listed(told, "and")


def _explained(found: Outcome) -> str:
    told = [
        f"{named(each.effects)} ({probability(each.probability)})"
        for each in found.sets
    ]
    if found.verdict == "cause_found":
        verb = "explain" if len(found.sets[0].effects) > 1 else "explains"
        return f"{told[0]} {verb} it"
    if found.sets[0].probability < _OUTSTANDING:
        return f"several sets of causes remain possible, among them {listed(told[:3], 'and')}"
    alive = [
        text
        for text, each in zip(told, found.sets, strict=True)
        if each.probability >= _ALIVE
    ][:_MOST_TOLD]
    return (
        f"{alive[0]} explains it best, but these data cannot tell it from "
        f"{listed(alive[1:]) or named(())}"
    )


def _removed(found: Outcome) -> str:
    fraction, limits = found.shrinkage.fraction, found.shrinkage.interval
    if fraction is None:
        return "How far the gap would shrink cannot be told from these samples."
    place = (
        f"On samples {'held' if found.shrinkage.on == 'holdout' else 'left'} out, with "
        f"{named(found.sets[0].effects)} added,"
    )
    if fraction <= 0.0:
        return f"{place} the gap does not shrink yet."
    span = "" if limits is None else f" ({fraction_interval(limits)})"
    return f"{place} {percent(fraction)} of the squared gap is removed{span}."


def fraction_interval(limits: Sequence[float]) -> str:
    """Return the interval of a fraction in percent; less than nothing is `below 0`."""
    low, high = ("below 0" if end < 0.0 else fixed(100.0 * end, 0) for end in limits)
    return f"{low} %" if low == high else f"{low} to {high} %"


def _where(found: Outcome) -> list[str]:
    if not found.where:
        return []
    head = [*(axis.heading for axis in found.axes), "measured - model", "samples", "p"]
    rows = [
        [
            *(
                " .. ".join(
                    f"{limit:.{axis.digits}f}" for limit in region.limits[axis.name]
                )
                for axis in found.axes
            ),
            amount(found, region.mean_residual, sign=True),
            str(region.samples),
            chance(region.p_value),
        ]
        for region in found.where
    ]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    told = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in (head, *rows)]
    lines = [f"where      {told[0]}", *(f"           {line}" for line in told[1:])]
    if found.where[0].p_value > REGION_SIGNIFICANCE:
        lines.append(
            "           no place is significant by itself: the gap shows in the samples "
            "as a whole"
        )
    return lines


def _causes(found: Outcome) -> list[str]:
    if not found.causes:
        return []
    told = [
        f"{named(each.effects)} {probability(each.probability)}"
        for each in found.sets
        if each.probability >= _TOLD_SET
    ][:_SETS]
    told.append(f"something unlisted {probability(found.unlisted)}")
    lines = [f"sets       {', '.join(told)}", "causes     each in any of the sets"]
    for cause in found.causes[:_DETAILED]:
        form = f", {cause.form}" if cause.form else ""
        lines += [
            f"  {100 * cause.probability:3.0f} %  {cause.effect}{form}  [{cause.component}]",
            f"         {cause.summary}",
        ]
        for name, entry in cause.parameters.items():
            if "interval" in entry:
                low, high = entry["interval"]
                value = f"{entry['value']:.3g} {entry['unit']}".removesuffix(" -")
                doubt = "" if entry["plausible"] else ", implausible size"
                lines.append(
                    f"         {name} = {value} (95 %: {low:.3g} to {high:.3g}){doubt}"
                )
        lines += [
            f"         without it {name} comes out as {change['without_effect']:.3g} instead "
            f"of {change['with_effect']:.3g} ({change['standard_errors']:+.1f} standard "
            "errors)"
            for name, change in cause.drift.items()
            if abs(change["standard_errors"]) > _SETTLED
        ]
    others = [
        f"{cause.effect} ({100 * cause.probability:.0f} %)"
        for cause in found.causes[_DETAILED:]
    ]
    if others:
        lines.append(f"  less probable: {', '.join(others)}")
    return lines


def _tests(found: Outcome) -> list[str]:
    lines = []
    for test in found.next_tests:
        told = f"tells {' from '.join(test.separates)}"
        lines.append(
            f"  {point_of(test, found.axes)}: {told}, gain {test.gain:.1f}"
            if test.point
            else f"  {test.measure}: {told}"
        )
    head = (
        (
            " (gain: information expected on which explanation is right, in nats; ln 2 = 0.69 "
            "halves the choice)"
        )
        if lines and found.next_tests[0].point
        else ""
    )
    return [f"next tests{head}", *lines] if lines else []


def _fields(value: Any) -> dict[str, Any]:
    """What JSON has under the name of a field; a place is told axis by axis, a model not at all."""
    return {
        item.name: getattr(value, item.name)
        for item in fields(value)
        if item.name not in ("limits", "point", "setting", "model")
    }


class Diagnosis(Outcome):
    """An outcome that can be told."""

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt diagnose --json`."""
        nowhere = {axis.name: None for axis in self.axes}
        data = {
            "gap": _fields(self.gap),
            "where": [{**region.limits, **_fields(region)} for region in self.where],
            "component": self.component,
            "verdict": self.verdict,
            "causes": [_fields(cause) for cause in self.causes],
            "sets": [_fields(each) for each in self.sets],
            "unlisted_probability": self.unlisted,
            "shrinkage": _fields(self.shrinkage),
            "delivered": _fields(self.delivered),
            "next_tests": [
                {**(test.point or nowhere), **_fields(test)} for test in self.next_tests
            ],
            "advice": self.advice.to_dict(),
            "notes": self.notes,
        }
        return dict(json.loads(json.dumps(data)))

    def plot(self) -> Any:
        """Return a matplotlib figure of the residuals before and after."""
        return picture(self)

    def _repr_html_(self) -> str:
        return preformatted(self.report())

    def report(self) -> str:
        """Return the outcome as text for a person, at most 100 columns wide."""
        gap, shrunk = self.gap, self.shrinkage
        before, after, noise, stated, error = (
            amount(self, value)
            for value in (
                shrunk.before,
                shrunk.after,
                gap.noise,
                gap.noise_stated,
                gap.rmse,
            )
        )
        lines = [
            mechanic(self),
            "",
            *self.warnings,
            verdict(self),
            "",
            f"gap        {gap.samples} samples, {before} rms beyond the noise, "
            f"{p_is(gap.p_value)} (limit {GAP_SIGNIFICANCE:g})",
            f"noise      {noise}; before the fit {stated}: {gap.noise_source}",
            f"error      {error} rms of the refitted model at samples left out",
        ]
        if shrunk.fraction is not None:
            grows = ", where it grows" if shrunk.fraction < 0.0 else ""
            lines.append(
                f"shrinkage  {before} -> {after} beyond the noise, on {shrunk.on}{grows}"
            )
        lines += [
            *_where(self),
            *_causes(self),
            *_tests(self),
            *(f"note: {note}" for note in self.notes[len(self.warnings) :]),
        ]
        return "\n".join(
            wrapped(
                line.replace(MINUS, "-").replace(AT_MOST, "<="),
                _MARGIN
                if line[:1].isalpha() and "  " in line
                else len(line) - len(line.lstrip()),
            )
            for line in lines
        )
