# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A diagnosis as plain data (the contract of the command) and as text; nothing is computed."""

from __future__ import annotations

import json
import textwrap
from dataclasses import fields
from typing import Any

from ..files import picture, preformatted
from . import words
from .advice import NextTest
from .result import GAP_SIGNIFICANCE, REGION_SIGNIFICANCE, Outcome

_TOLD_SET, _SETS = 0.01, 5
_DETAILED = 3  # causes told at length; the page has all
_WIDTH, _MARGIN = 100, 11
_SETTLED = 2.0  # standard errors from which a drift of a base parameter is worth a line


def _fields(value: Any) -> dict[str, Any]:
    """What JSON has under the name of a field; a place is told axis by axis, a model not at all."""
    return {item.name: getattr(value, item.name) for item in fields(value)
            if item.name not in ("limits", "point", "setting", "model")}


def _wrapped(line: str) -> str:
    margin = " " * (_MARGIN if line[:1].isalpha() and "  " in line else
                    len(line) - len(line.lstrip()))
    return "\n".join(textwrap.wrap(line, _WIDTH, subsequent_indent=margin,
                                   break_long_words=False, break_on_hyphens=False))


def _where(found: Outcome) -> list[str]:
    if not found.where:
        return []
    head = [*(axis.heading for axis in found.axes), "measured - model", "samples", "p"]
    rows = [[*(" .. ".join(f"{limit:.{axis.digits}f}" for limit in region.limits[axis.name])
               for axis in found.axes),
             words.amount(found, region.mean_residual, sign=True), str(region.samples),
             words.chance(region.p_value)] for region in found.where]
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    told = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in (head, *rows)]
    lines = [f"where      {told[0]}", *(f"           {line}" for line in told[1:])]
    if found.where[0].p_value > REGION_SIGNIFICANCE:
        lines.append("           no place is significant by itself: the gap shows in the samples "
                     "as a whole")
    return lines


def _causes(found: Outcome) -> list[str]:
    if not found.causes:
        return []
    told = [f"{words.named(each.effects)} {words.probability(each.probability)}"
            for each in found.sets if each.probability >= _TOLD_SET][:_SETS]
    told.append(f"something unlisted {words.probability(found.unlisted)}")
    lines = [f"sets       {', '.join(told)}",
             "causes     each in any of the sets"]
    for cause in found.causes[:_DETAILED]:
        form = f", {cause.form}" if cause.form else ""
        lines += [f"  {100 * cause.probability:3.0f} %  {cause.effect}{form}  [{cause.component}]",
                  f"         {cause.summary}"]
        for name, entry in cause.parameters.items():
            if "interval" in entry:
                low, high = entry["interval"]
                value = f"{entry['value']:.3g} {entry['unit']}".removesuffix(" -")
                doubt = "" if entry["plausible"] else ", implausible size"
                lines.append(f"         {name} = {value} (95 %: {low:.3g} to {high:.3g}){doubt}")
        lines += [f"         without it {name} comes out as {change['without_effect']:.3g} instead "
                  f"of {change['with_effect']:.3g} ({change['standard_errors']:+.1f} standard "
                  "errors)" for name, change in cause.drift.items()
                  if abs(change["standard_errors"]) > _SETTLED]
    others = [f"{cause.effect} ({100 * cause.probability:.0f} %)"
              for cause in found.causes[_DETAILED:]]
    if others:
        lines.append(f"  less probable: {', '.join(others)}")
    return lines


def _tests(found: Outcome) -> list[str]:
    if not found.next_tests:
        return []
    gain = (" (gain: information expected on which explanation is right, in nats; ln 2 = 0.69 "
            "halves the choice)") if found.next_tests[0].point else ""
    return [f"next tests{gain}", *(f"  {_test(found, test)}" for test in found.next_tests)]


def _test(found: Outcome, test: NextTest) -> str:
    told = "tells " + " from ".join(test.separates)
    if not test.point:
        return f"{test.measure}: {told}"
    return f"{words.point_of(test, found.axes)}: {told}, gain {test.gain:.1f}"


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
            "next_tests": [{**(test.point or nowhere), **_fields(test)}
                           for test in self.next_tests],
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
        before, after, noise, stated, error = (words.amount(self, value) for value in (
            shrunk.before, shrunk.after, gap.noise, gap.noise_stated, gap.rmse))
        lines = [words.mechanic(self), "", *self.warnings, words.verdict(self), "",
                 f"gap        {gap.samples} samples, {before} rms beyond the noise, "
                 f"{words.p_is(gap.p_value)} (limit {GAP_SIGNIFICANCE:g})",
                 f"noise      {noise}; before the fit {stated}: {gap.noise_source}",
                 f"error      {error} rms of the refitted model at samples left out"]
        if shrunk.fraction is not None:
            lines.append(f"shrinkage  {before} -> {after} beyond the noise, on {shrunk.on}")
        lines += [*_where(self), *_causes(self), *_tests(self),
                  *(f"note: {note}" for note in self.notes[len(self.warnings):])]
        plain = (line.replace(words.MINUS, "-").replace(words.AT_MOST, "<=") for line in lines)
        return "\n".join(map(_wrapped, plain))
