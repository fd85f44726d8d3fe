# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The report of a diagnosis: its verdict and the grounds, as text for a person.

Pages take their words from this module too.
"""

from __future__ import annotations

from typing import Any

from ..design.advice import Advice, NextTest, test_in_words
from ..design.advice import named as named
from ..selection.classes import with_probabilities
from ..settings import GAP_SIGNIFICANCE
from ..statements.members import Member
from ..system import Array
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
from .outcome import BASE, Cause, Outcome, Region, SharedErrorEstimate
from .sentences import amount as amount
from .sentences import fraction_interval as fraction_interval
from .sentences import handed_over as handed_over
from .sentences import mechanic as mechanic
from .sentences import needs_no_test
from .sentences import next_step as next_step
from .sentences import power_in_words as power_in_words
from .sentences import region_words as region_words
from .sentences import verdict as verdict
from .stages import mean_and_rms, residuals_by_stage

REPORTED_PROBABILITY = 0.01
REPORTED_SETS = 5
"""Sets in the report: how probable at least, and how many at most."""
DETAILED_CAUSES = 3
"""Causes that are described in full; the page has all."""
REPORTED_DRIFT = 2.0
"""Standard errors from which a drift of a base parameter is worth a line."""
REPORTED_ERROR = 2.0
"""Standard deviations from which an error of a meter is worth a line."""
MARGIN = 11
"""Columns of the titles of a report, by which wrapped lines are indented."""


def report(outcome: Outcome) -> str:
    """Return the outcome as text, at most 100 columns wide."""
    lines = [
        mechanic(outcome),
        *([outcome.second_line] if outcome.second_line else []),
        "",
        *outcome.warnings,
        verdict(outcome),
        "",
        *_gap_lines(outcome),
        *_region_lines(outcome),
        *_stage_lines(outcome),
        *_cause_lines(outcome),
        *_meter_lines(outcome),
        *_step_lines(outcome),
        *_test_lines(outcome),
    ]
    notes = outcome.notes[len(outcome.warnings) :]
    lines += [f"note: {note}" for note in notes]
    plain_lines = [line.replace(MINUS, "-").replace(AT_MOST, "<=") for line in lines]
    return "\n".join(wrapped(line, _margin(line)) for line in plain_lines)


def _margin(line: str) -> int:
    """Return the indent of the further lines of one that is wrapped."""
    has_title = line[:1].isalpha() and "  " in line
    if has_title:
        return MARGIN
    return len(line) - len(line.lstrip())


def _gap_lines(outcome: Outcome) -> list[str]:
    gap = outcome.gap
    shrinkage = outcome.shrinkage
    before = amount(outcome, shrinkage.before)
    after = amount(outcome, shrinkage.after)
    without = ""
    if outcome.shared_errors:
        without = ", without the errors of the meters"
    limit = f"limit {GAP_SIGNIFICANCE:g}"
    if gap.significant and gap.p_value > GAP_SIGNIFICANCE:
        limit += ", but an explanation of all tests leaves no doubt"
    size = "beyond the noise" if gap.significant else "that noise may explain"
    lines = [
        f"verdict    {outcome.verdict}",
        f"gap        {gap.samples} samples, {before} rms {size}, "
        f"{p_is(gap.p_value)} ({limit})",
        f"noise      {amount(outcome, gap.noise)}; before the fit "
        f"{amount(outcome, gap.noise_stated)}: {gap.noise_source}",
        f"error      {amount(outcome, gap.rmse)} rms of the refitted model at held-out "
        f"samples{without}",
        *_handed_over_lines(outcome),
    ]
    if outcome.scatter is not None and outcome.verdict != "excess_scatter":
        ratio = f"{outcome.scatter.ratio:.2g} times the stated noise is left"
        lines.append(f"scatter    {ratio}. {outcome.scatter.sentence}")
    if shrinkage.fraction is not None and outcome.delivered.kind != BASE:
        grows = ", where it grows" if shrinkage.fraction < 0.0 else ""
        lines.append(
            f"shrinkage  {before} -> {after} beyond the noise, on {shrinkage.on}{grows}"
        )
    return lines


def _handed_over_lines(outcome: Outcome) -> list[str]:
    """Return a line on the model that is saved and served, where it is not the base model."""
    delivered = outcome.delivered
    added = handed_over(outcome)
    if not added:
        return []
    before = amount(outcome, delivered.rmse_before)
    after = amount(outcome, delivered.rmse_after)
    return [
        f"model      handed over with {added}: {before} -> {after} rms at held-out samples"
    ]


def _region_lines(outcome: Outcome) -> list[str]:
    if not outcome.where:
        return []
    head = [axis.heading for axis in outcome.axes]
    head += ["measured - model", "samples", "p", ""]
    rows = [head, *(_region_row(region, outcome) for region in outcome.where)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = []
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=True)]
        table.append("  ".join(cells).rstrip())
    first, *others = table
    lines = [f"where      {first}"]
    lines += [f"           {line}" for line in others]
    return lines


def _region_row(region: Region, outcome: Outcome) -> list[str]:
    cells = []
    for axis in outcome.axes:
        low, high = region.limits[axis.name]
        cells.append(f"{low:.{axis.digits}f} .. {high:.{axis.digits}f}")
    stage = ", ".join(f"{name} {label}" for name, label in region.setting.items())
    return [
        *cells,
        amount(outcome, region.mean_residual, sign=True),
        str(region.samples),
        chance(region.p_value),
        stage,
    ]


def _stage_lines(outcome: Outcome) -> list[str]:
    """Return a line for the residuals of each stage; none where all samples are of one."""
    before = residuals_by_stage(outcome.judged, outcome.residuals_before)
    after = residuals_by_stage(outcome.judged, outcome.residuals_after)
    lines: list[str] = []
    for stage, residuals in before.items():
        title = "" if lines else "stages"
        size = _residuals(outcome, residuals)
        line = f"{title:<{MARGIN}}{stage}: {len(residuals)} samples, {size}"
        if outcome.verdict != "no_gap":
            line += f"; with the model handed over {_residuals(outcome, after[stage])}"
        lines.append(line)
    return lines


def _residuals(outcome: Outcome, residuals: Array) -> str:
    """Return mean and rms of residuals in words."""
    size = mean_and_rms(outcome, residuals)
    if size is None:
        return "no answer of the model"
    mean, rms = size
    return f"mean {mean}, rms {rms}"


def _cause_lines(outcome: Outcome) -> list[str]:
    if not outcome.causes:
        return []
    reported = [
        item for item in outcome.class_sets if item.probability >= REPORTED_PROBABILITY
    ][:REPORTED_SETS]
    sets = with_probabilities(reported, "{0} {1}")
    sets.append(f"something unlisted {probability(outcome.unlisted)}")
    members = [_member_in_words(item) for item in outcome.members]
    lines = [f"members    {'; '.join(members)}"] if members else []
    lines += [
        f"sets       {', '.join(sets)}",
        "causes     probability over all sets",
    ]
    for cause in outcome.causes[:DETAILED_CAUSES]:
        lines += _one_cause(cause)
    others = [
        f"{cause.effect} ({100 * cause.probability:.0f} %)"
        for cause in outcome.causes[DETAILED_CAUSES:]
    ]
    if others:
        lines.append(f"  less probable: {', '.join(others)}")
    return lines


def _member_in_words(member: Member) -> str:
    """Return a member with its probability and its power."""
    names = listed([plain(name) for name in member.effects])
    words = f"{names} {probability(member.probability)}"
    if not member.form_fits:
        return f"{words}, in no form of the library"
    if member.lost_power is None:
        return words
    watts = float(f"{member.lost_power:.2g}")
    return f"{words}, {fixed(watts, 0)} W"


def _meter_lines(outcome: Outcome) -> list[str]:
    """Return a line for each error of a meter that the readings show."""
    lines: list[str] = []
    for estimate in outcome.shared_errors:
        if abs(estimate.value) > REPORTED_ERROR * estimate.standard_deviation:
            title = "" if lines else "meters"
            session = f", session {estimate.session}" if estimate.session else ""
            value, deviation, unit = error_in_words(estimate)
            lines.append(
                f"{title:<{MARGIN}}{estimate.error}{session}: {value} +- {deviation} {unit}"
            )
    return lines


def error_in_words(estimate: SharedErrorEstimate) -> tuple[str, str, str]:
    """Return value, standard deviation and unit of an error of a meter, a part in percent."""
    factor, unit = _printed_unit(estimate)
    value = f"{factor * estimate.value:+.2g}"
    return value, f"{factor * estimate.standard_deviation:.2g}", unit


def expected_in_words(estimate: SharedErrorEstimate) -> str:
    """Return the deviation of an error of a meter before any reading."""
    factor, unit = _printed_unit(estimate)
    return f"{factor * estimate.expected:.2g} {unit}"


def _printed_unit(estimate: SharedErrorEstimate) -> tuple[float, str]:
    """Return the factor to the printed number and its unit: parts are percent."""
    if estimate.unit == "-":
        return 100.0, "%"
    return 1.0, estimate.unit


def _one_cause(cause: Cause) -> list[str]:
    form = f", {cause.form}" if cause.form else ""
    lines = [
        f"  {100 * cause.probability:3.0f} %  {cause.effect}{form}  [{cause.component}]",
        f"         {cause.summary}",
    ]
    for name, entry in cause.parameters.items():
        lines.append(f"         {name} = {_parameter_in_words(entry, cause.coverage)}")
    for name, change in cause.drift.items():
        errors = change["standard_errors"]
        if abs(errors) > REPORTED_DRIFT:
            lines.append(
                f"         without it {name} would be {change['without_effect']:.3g} "
                f"instead of {change['with_effect']:.3g} ({errors:+.1f} standard errors)"
            )
    return lines


def _parameter_in_words(entry: dict[str, Any], coverage: str) -> str:
    """Return a size with its interval and what that covers, or a fitted shape."""
    value = f"{entry['value']:.3g} {entry['unit']}".removesuffix(" -")
    if "interval" not in entry:
        return f"{value} (shape: {entry['meaning']})"
    low, high = entry["interval"]
    doubt = "" if entry["plausible"] else ", implausible size"
    return f"{value} ({coverage}: {low:.3g} to {high:.3g}){doubt}"


def _step_lines(outcome: Outcome) -> list[str]:
    lines: list[str] = []
    for step in next_step(outcome):
        title = "" if lines else "next step"
        lines.append(f"{title:<{MARGIN}}{step}")
    return lines


def _test_lines(outcome: Outcome) -> list[str]:
    """Return a line for each test at an operating point; a measurement is the next step itself."""
    tests = [test for test in outcome.next_tests if test.point]
    if not tests or needs_no_test(outcome):
        return []
    head = (
        "next tests (gain: information expected on which explanation is right, in nats; ln 2 = "
        "0.69 halves the choice)"
    )
    return [head, *(_test_line(test, outcome) for test in tests)]


def _test_line(test: NextTest, outcome: Outcome) -> str:
    separates = f"distinguishes {' from '.join(test.separates)}"
    words = test_in_words(test, outcome.axes)
    return f"  {words}: {separates}, gain {test.gain:.2g}"


def advice(what_next: Advice) -> str:
    """Return `what_next.report()`; an earlier name."""
    return what_next.report()
