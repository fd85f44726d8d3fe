# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Figures and tables of the page, as its templates name them."""

from __future__ import annotations

from typing import Any

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.settings import REGION_SIGNIFICANCE
from hmcvt_core.errors import InputError

from .answer import (
    VERDICTS,
    how_far,
    members,
    scatter_sentence,
    unit_in_words,
)
from .axes import MOST, columns
from .gap_map import draw_gap, lead_map, machine, page_maps, views
from .pictures import drawn
from .residuals import draw_residuals, residual_table, residuals, stage_head, stage_rows
from .watts import stage_watts, watts

__all__ = [
    "MOST",
    "VERDICTS",
    "columns",
    "how_far",
    "lead_map",
    "look_rows",
    "machine",
    "members",
    "page_maps",
    "place_rows",
    "plot_diagnosis",
    "residual_table",
    "residuals",
    "scatter_sentence",
    "stage_head",
    "stage_rows",
    "stage_watts",
    "test_labels",
    "test_rows",
    "unit_in_words",
    "views",
    "watts",
]


_PICTURES = {"residuals": draw_residuals, "gap": draw_gap}
"""What `Diagnosis.plot` draws, by its name."""


def plot_diagnosis(diagnosis: Diagnosis, *, of: str, ax: Any = None) -> Any:
    """Return the matplotlib figure of `Diagnosis.plot`.

    Raises:
        InputError: `of` names no picture, or matplotlib is missing.
    """
    if of not in _PICTURES:
        raise InputError(f"of: {of!r} is none of {', '.join(_PICTURES)}")
    return drawn(_PICTURES[of], diagnosis, ax=ax)


def place_rows(diagnosis: Diagnosis) -> list[tuple[Any, ...]]:
    """Return rows of the regions in which the bench differs from the model."""
    rows = []
    for number, region in enumerate(diagnosis.where, 1):
        limits = []
        for column in columns(diagnosis):
            low, high = region.limits[column.axis]
            low_text = words.fixed(column.factor * low, column.digits)
            high_text = words.fixed(column.factor * high, column.digits)
            limits.append(f"{low_text} to {high_text}")
        chance = words.chance(region.p_value)
        if region.p_value > REGION_SIGNIFICANCE:
            chance += " (may be chance)"
        rows.append(
            (
                number,
                words.amount(diagnosis, region.mean_residual, sign=True),
                *limits,
                region.samples,
                chance,
                words.plain(region.channel),
            )
        )
    return rows


def test_labels(diagnosis: Diagnosis) -> list[str]:
    """Return what names an operating point to measure next, in addition to its axes, as `stage`."""
    labels: dict[str, None] = {}
    for test in diagnosis.next_tests:
        labels |= dict.fromkeys(test.setting)
    return list(labels)


def test_rows(diagnosis: Diagnosis) -> list[tuple[Any, ...]]:
    """Return rows of the operating points to measure next."""
    labels = test_labels(diagnosis)
    rows: list[tuple[Any, ...]] = []
    for test in diagnosis.next_tests:
        if test.point is None:
            continue
        coordinates = []
        for column in columns(diagnosis):
            value = column.factor * test.point[column.axis]
            coordinates.append(words.fixed(value, column.digits))
        rows.append(
            (
                len(rows) + 1,
                " | ".join(map(words.plain, test.separates)),
                *(test.setting.get(label, words.NOTHING) for label in labels),
                *coordinates,
                words.number(test.gain),
                words.plain(test.measure or words.NOTHING),
            )
        )
    return rows


def look_rows(diagnosis: Diagnosis) -> list[tuple[Any, ...]]:
    """Return rows of the readings and meter errors beyond what was stated for them."""
    rows = []
    for look in diagnosis.agreement.looks:
        # The rows of a meter error are sessions, and no reading.
        rows.append(
            (
                "meters" if look.of_meters else words.plain(look.channel),
                look.part or "all samples",
                words.NOTHING if look.of_meters else look.samples,
                words.number(look.ratio),
                words.chance(look.p_value),
            )
        )
    return rows
