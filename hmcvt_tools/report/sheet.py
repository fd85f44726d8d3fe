# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A diagnosis on one sheet of paper: cause, size, doubt, next step, one map, parameters, fit."""

from __future__ import annotations

import datetime
import textwrap
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import ParameterEstimate

from .answer import (
    VERDICTS,
    how_far,
    members,
    scatter_sentence,
    sizes,
    unit_in_words,
)
from .gap_map import draw_gap_map, largest_gap_map, machine, place_in_words, views
from .style import INK, SOFT, styled, to_pdf

_PAPER = (8.27, 11.69)  # A4 [in]
_FONT = 11.0  # pt; the whole sheet has one size, the verdict alone is larger
_HEADLINE = 17.0  # pt
_COLUMNS = 84  # letters of a line of the sheet's font
_BOLD_COLUMNS = 76
_HEADLINE_COLUMNS = 46
_LINE = 0.0175  # height of a line; part of the sheet
_LEFT = 0.09
_BOTTOM = 0.04
_SMALLEST_PICTURE = 0.14  # height; part of the sheet
_LARGEST_PICTURE = 0.42
_AROUND_PICTURE = 0.125  # heading, labels and caption
_MAX_PARAMETERS = 8
"""Base parameters on the sheet; the page has all."""

CAPTION = (
    "Through the test with the largest estimated gap; hatched where the gap is less than two "
    "standard deviations of its estimate; boxes: regions that differ; triangles: tests."
)


def sheet(
    diagnosis: Diagnosis,
    date: datetime.date | None = None,
    remarks: Sequence[str] = (),
) -> bytes:
    """Return a diagnosis as PDF of one page.

    Args:
        diagnosis: with or without a gap.
        date: printed on the sheet; today when left out.
        remarks: notes that are on the sheet in any case.

    Raises:
        InputError: matplotlib is missing.
    """
    with styled(_PAPER) as figure:
        draw_sheet(figure, diagnosis, date, remarks)
        return to_pdf(figure)


def draw_sheet(
    figure: Any,
    diagnosis: Diagnosis,
    date: datetime.date | None = None,
    remarks: Sequence[str] = (),
) -> None:
    """Draw the sheet on an empty matplotlib figure of its size.

    Args:
        figure: empty matplotlib figure.
        diagnosis: with or without a gap.
        date: printed on the sheet; today when left out.
        remarks: notes that are on the sheet in any case.
    """
    if date is None:
        date = datetime.date.today()
    figure.set_layout_engine("none")
    height = _draw_answer(figure, diagnosis)
    fit = [*_fit_lines(diagnosis, date), *remarks]
    room = height - _BOTTOM - _AROUND_PICTURE - _height(fit)
    parameters = _that_fit(_parameter_lines(diagnosis), room - _SMALLEST_PICTURE)
    room -= _height(parameters)
    notes = [note for note in _notes(diagnosis) if note not in remarks]
    notes = _that_fit(notes, room - _SMALLEST_PICTURE)
    room -= _height(notes)
    picture_height = max(_SMALLEST_PICTURE, min(room, _LARGEST_PICTURE))
    height = _draw_picture(figure, diagnosis, height, picture_height)
    height = _paragraphs(figure, height, "Parameters", parameters)
    height = _paragraphs(figure, height, "Fit and files", fit)
    _paragraphs(figure, height, "Notes", notes)


def _draw_answer(figure: Any, diagnosis: Diagnosis) -> float:
    """Draw verdict, causes, size and next step; return the height below them."""
    height = _write(
        figure, 0.95, f"Model against bench: {machine(diagnosis)}", color=SOFT
    )
    height = _write(figure, height, f"Verdict: {VERDICTS[diagnosis.verdict]}")
    height -= 0.5 * _LINE
    for line in textwrap.wrap(words.mechanic(diagnosis), _HEADLINE_COLUMNS):
        figure.text(_LEFT, height, line, size=_HEADLINE, weight="bold", va="top")
        height -= 1.6 * _LINE
    height -= 0.5 * _LINE
    height = _write(figure, height, diagnosis.second_line, weight="bold")
    for sentence in (*diagnosis.warnings, scatter_sentence(diagnosis)):
        height = _write(figure, height, sentence)
    height = _paragraphs(figure, height, "Possible causes", _member_lines(diagnosis))
    size = how_far(diagnosis)
    height = _paragraphs(figure, height, "How far", [f"{size.value} {size.meaning}."])
    return _paragraphs(figure, height, "Next step", words.next_step(diagnosis))


def _member_lines(diagnosis: Diagnosis) -> list[str]:
    lines = []
    for member in members(diagnosis):
        detail = f" ({member.detail})" if member.detail else ""
        lines.append(f"{member.probability}  {member.name}{detail}")
    return lines


def _draw_picture(
    figure: Any, diagnosis: Diagnosis, height: float, picture_height: float
) -> float:
    """Draw the map where the gap is largest; return the height below it and its caption."""
    import matplotlib as mpl

    if not views(diagnosis):
        return height

    sizes_of_letters: dict[Any, Any] = {
        "font.size": _FONT,
        "axes.titlesize": _FONT,
        "axes.labelsize": _FONT,
        "xtick.labelsize": _FONT,
        "ytick.labelsize": _FONT,
    }
    entry = largest_gap_map(diagnosis)
    place = place_in_words(diagnosis, entry)
    height = _write(
        figure, height - 0.5 * _LINE, f"Map of the gap, {place}", weight="bold"
    )
    with mpl.rc_context(sizes_of_letters):
        axes = figure.add_axes(
            (_LEFT + 0.06, height - picture_height, 0.8, picture_height)
        )
        draw_gap_map(axes, diagnosis, entry, "right")
        axes.set_title("")  # it stands in the heading
    return _write(figure, height - picture_height - 0.045, CAPTION, color=SOFT)


def _parameter_lines(diagnosis: Diagnosis) -> list[str]:
    """Return the sizes of the leading cause, and the base parameters with their errors.

    Against a baseline these are the errors of the meters.
    """
    lines = []
    baseline = getattr(diagnosis, "baseline", None)
    growth = None if baseline is None else baseline.growth(diagnosis)
    if growth is not None:
        lines.append(
            f"{growth.word} of the sound machine {words.number(growth.sound)} "
            f"{unit_in_words(growth.unit)}, now {100.0 * growth.part:+.0f} %"
        )
    elif diagnosis.named is not None:
        lines += sizes(diagnosis.named)
    base = []
    for name, estimate in list(diagnosis.parameters.items())[:_MAX_PARAMETERS]:
        base.append(f"{words.plain(name)} {_estimate_in_words(estimate)}")
    if base:
        title = "Base" if baseline is None else "Meters since then"
        lines.append(f"{title}: {'; '.join(base)}")
    return lines


def _estimate_in_words(estimate: ParameterEstimate) -> str:
    unit = unit_in_words(estimate.unit)
    value = words.number(estimate.value)
    error = words.number(estimate.standard_error)
    return f"{value} \N{PLUS-MINUS SIGN} {error} {unit}".rstrip()


def _fit_lines(diagnosis: Diagnosis, date: datetime.date) -> list[str]:
    """Return the fit in one line, then date and names of files."""
    gap = diagnosis.gap
    fit = (
        f"{gap.samples} tests with a scatter of {words.amount(diagnosis, gap.noise)}; at tests "
        f"left out the model misses by {words.amount(diagnosis, diagnosis.delivered.rmse_before)} "
        f"before and {words.amount(diagnosis, diagnosis.delivered.rmse_after)} after; chance "
        f"alone makes such a gap with {words.p_is(gap.p_value)}"
    )
    files = [f"{date.isoformat()}; bench {_file_name(diagnosis.samples.source)}"]
    if diagnosis.judged is not diagnosis.samples:
        files.append(f"held out {_file_name(diagnosis.judged.source)}")
    baseline = getattr(diagnosis, "baseline", None)
    if baseline is not None:
        files.append(f"baseline {_file_name(baseline.source)}")
    lines = [fit, ", ".join(files)]
    if diagnosis.left_out:
        left_out = words.listed(diagnosis.left_out, "and")
        lines.append(f"Left out as tests that stand apart: {left_out}")
    return lines


def _file_name(source: object) -> str:
    return PurePath(str(source)).name


def _notes(diagnosis: Diagnosis) -> list[str]:
    return [note for note in diagnosis.notes if note not in diagnosis.warnings]


def _height(paragraphs: Sequence[str]) -> float:
    """Return the height of paragraphs below their heading; 0 for none."""
    if not paragraphs:
        return 0.0
    lines = 2.0
    for paragraph in paragraphs:
        lines += len(textwrap.wrap(paragraph, _COLUMNS)) + 0.4
    return _LINE * lines


def _that_fit(paragraphs: Sequence[str], room: float) -> list[str]:
    """Return the first paragraphs that fit into a height."""
    fitting: list[str] = []
    for paragraph in paragraphs:
        if _height([*fitting, paragraph]) > room:
            break
        fitting.append(paragraph)
    return fitting


def _paragraphs(
    figure: Any, height: float, heading: str, paragraphs: Sequence[str]
) -> float:
    """Write paragraphs below their heading; return the height below them."""
    if not paragraphs:
        return height
    height = _write(figure, height - 0.5 * _LINE, heading, weight="bold")
    for paragraph in paragraphs:
        height = _write(figure, height, paragraph)
    return height


def _write(figure: Any, height: float, text: str, **style: Any) -> float:
    """Write wrapped text from the height downward; return the height below it."""
    if not text:
        return height
    columns = _BOLD_COLUMNS if style.get("weight") == "bold" else _COLUMNS
    for line in textwrap.wrap(_printable(text), columns):
        look = {"color": INK, **style}
        figure.text(_LEFT, height, line, size=_FONT, va="top", **look)
        height -= _LINE
    return height - 0.4 * _LINE


def _printable(text: str) -> str:
    letters = []
    for letter in text:
        letters.append(letter if letter.isprintable() else " ")
    return "".join(letters)
