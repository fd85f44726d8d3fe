# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A diagnosis on one sheet of paper: verdict, map of the gap, next step."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

from ..diagnosis import Diagnosis
from ..diagnosis.design.classes import EffectClass
from ..diagnosis.results import text as words
from ..diagnosis.results.outcome import Cause
from .gap_map import View, draw_view, machine, views
from .style import INK, SOFT, styled, to_pdf

_PAPER = (8.27, 11.69)  # A4 [in]
_FONT = 11.0  # pt; the whole sheet has one size, the verdict alone is larger
_HEADLINE = 17.0  # pt
_COLUMNS = 84  # letters of a line of the sheet's font
_HEADLINE_COLUMNS = 46
_LINE = 0.0175  # height of a line; part of the sheet
_LEFT = 0.09
_LEAST_PICTURE = 0.14  # height; part of the sheet
_CAUSES = 3  # listed on the sheet; the page has all

VERDICTS = {
    "no_gap": "No gap",
    "cause_found": "Cause found",
    "ambiguous": "Ambiguous",
    "unexplained": "Unexplained",
}


def sheet(diagnosis: Diagnosis) -> bytes:
    """Return a diagnosis as PDF of one page.

    Raises:
        InputError: matplotlib is missing.
    """
    with styled(_PAPER) as figure:
        draw_sheet(figure, diagnosis)
        return to_pdf(figure)


def draw_sheet(figure: Any, diagnosis: Diagnosis) -> None:
    """Draw the sheet on an empty matplotlib figure of its size."""
    import matplotlib as mpl

    figure.set_layout_engine("none")
    height = 0.95
    height = _write(
        figure, height, f"Model against bench: {machine(diagnosis)}", color=SOFT
    )
    height = _write(figure, height, f"Verdict: {VERDICTS[diagnosis.verdict]}")
    height -= 0.5 * _LINE
    headline = textwrap.wrap(words.mechanic(diagnosis), _HEADLINE_COLUMNS)
    for line in headline:
        figure.text(_LEFT, height, line, size=_HEADLINE, weight="bold", va="top")
        height -= 1.6 * _LINE
    height -= 0.5 * _LINE
    for warning in diagnosis.warnings:
        height = _write(figure, height, warning)
    height = _write(figure, height, words.verdict(diagnosis))
    for line in _cause_lines(diagnosis):
        height = _write(figure, height, line)
    next_step = _next_step(diagnosis)
    room = height - 0.06 - 0.135 - _height(next_step)
    notes = _notes_that_fit(diagnosis, room - _LEAST_PICTURE)
    picture_height = min(room - _height(notes), 0.42)
    sizes: dict[Any, Any] = {
        "font.size": _FONT,
        "axes.titlesize": _FONT,
        "axes.labelsize": _FONT,
        "xtick.labelsize": _FONT,
        "ytick.labelsize": _FONT,
    }
    with mpl.rc_context(sizes):
        axes = figure.add_axes(
            (_LEFT + 0.06, height - picture_height - 0.035, 0.74, picture_height)
        )
        draw_view(axes, diagnosis, _best_view(diagnosis))
    height = height - picture_height - 0.105
    height = _write(
        figure,
        height,
        "Colour: estimated gap at the median of the other axes, hatched where it is less "
        "than two standard deviations; boxes: regions that differ; triangles: samples.",
        color=SOFT,
    )
    height = _write(figure, height - 0.5 * _LINE, "Next step", weight="bold")
    for paragraph in next_step:
        height = _write(figure, height, paragraph)
    if notes:
        height = _write(figure, height - 0.5 * _LINE, "Notes", weight="bold")
    for note in notes:
        height = _write(figure, height, note)


def _height(paragraphs: Sequence[str]) -> float:
    """Return the height of paragraphs below their heading; 0 for none."""
    if not paragraphs:
        return 0.0
    lines = 2.0
    for paragraph in paragraphs:
        lines += len(textwrap.wrap(paragraph, _COLUMNS)) + 0.4
    return _LINE * lines


def _notes_that_fit(diagnosis: Diagnosis, room: float) -> list[str]:
    """Return the first notes that leave the picture its least height."""
    notes: list[str] = []
    for note in diagnosis.notes:
        if note in diagnosis.warnings:
            continue
        if _height([*notes, note]) > room:
            break
        notes.append(note)
    return notes


def _write(figure: Any, height: float, text: str, **style: Any) -> float:
    """Write wrapped text from the height downward; return the height below it."""
    for line in textwrap.wrap(_printable(text), _COLUMNS):
        look = {"color": INK, **style}
        figure.text(_LEFT, height, line, size=_FONT, va="top", **look)
        height -= _LINE
    return height - 0.4 * _LINE


def _printable(text: str) -> str:
    letters = []
    for letter in text:
        letters.append(letter if letter.isprintable() else " ")
    return "".join(letters)


def _cause_lines(diagnosis: Diagnosis) -> list[str]:
    lines: list[str] = []
    classes = []
    for cause in diagnosis.causes:
        effect_class = diagnosis.class_of(cause)
        if effect_class is None:
            probability = words.probability(cause.probability)
            lines.append(
                f"{probability}  {words.plain(cause.effect)} ({cause.component}): "
                f"{cause.summary}"
            )
        elif effect_class not in classes:
            classes.append(effect_class)
            lines.append(_class_line(effect_class, cause))
    return lines[:_CAUSES]


def _class_line(effect_class: EffectClass, cause: Cause) -> str:
    """Return a line for a class, described by its most probable member."""
    probability = words.probability(effect_class.probability)
    members = words.listed([words.plain(name) for name in effect_class.members])
    return f"{probability}  {members}: {cause.summary}"


def _next_step(diagnosis: Diagnosis) -> list[str]:
    """Return what to do next, one paragraph an entry."""
    if diagnosis.verdict == "no_gap":
        return ["No test is needed: there is no gap to explain."]
    named = diagnosis.named
    if not diagnosis.next_tests and named is not None and named.remedy:
        return [f"To settle it: {named.remedy}."]
    return diagnosis.advice.steps()


def _best_view(diagnosis: Diagnosis) -> View:
    """Return the pair of axes in which the first region is smallest."""
    pairs = views(diagnosis)
    if not diagnosis.where:
        return pairs[0]
    limits = diagnosis.where[0].limits

    def area(view: View) -> float:
        product = 1.0
        for axis in view:
            low, high = limits[axis.name]
            first, last = diagnosis.extent[axis.name]
            product *= (high - low) / max(last - first, 1e-12)
        return product

    return min(pairs, key=area)
