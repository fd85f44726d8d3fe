# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as one self-contained HTML page; it loads nothing and needs no script."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import words
from ..diagnosis.result import (
    GAP_SIGNIFICANCE,
    REGION_SIGNIFICANCE,
    Cause,
    Diagnosis,
    NextTest,
)
from ..files.atomic import write_atomically
from ..transmission.parameters import PARAMETER_UNITS
from .gap import gap_map, limits, residuals, shared
from .losses import lost_power, stack, worth_drawing
from .style import PANEL, icon, loss_style, styled, to_svg
from .template import render

Array = NDArray[np.float64]

_STROKES = 41


def write_html(diagnosis: Diagnosis, path: str | os.PathLike[str]) -> None:
    """Write the page of a diagnosis, whole or not at all.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
        OSError: the folder cannot be written or is full; an old file is untouched.
    """
    write_atomically(Path(path), html(diagnosis))


def html(found: Diagnosis) -> str:
    """Return the page of a diagnosis; the same diagnosis gives the same text.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
    """
    places = [(region, {axis: limits(region, axis) for axis in _AXES}) for region in found.where]
    return render(
        "diagnosis.html.j2", found=found, words=words, groups=groups(found), places=places,
        tests=next_tests(found), map=gap_map(found), residuals=residuals(found),
        watts=watts(found), units=PARAMETER_UNITS, gap_significance=GAP_SIGNIFICANCE,
        region_significance=REGION_SIGNIFICANCE,
        offsets=[shared(found, model) for model in (found.base, found.model)])


_AXES = ("displacement_ratio", "engine_speed", "load_torque")


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


class Tests(NamedTuple):
    """What to measure next.

    Attributes:
        points: each test with its operating point, SI by axis.
        measures: what no operating point replaces, with the pairs that it tells apart.
    """

    points: list[tuple[NextTest, dict[str, float]]]
    measures: dict[str, list[str]]


def next_tests(found: Diagnosis) -> Tests:
    """Part the tests at operating points from the measurements to make besides."""
    points, measures = [], {}
    for test in found.next_tests:
        if test.engine_speed is not None:
            points.append((test, {axis: getattr(test, axis) for axis in _AXES}))
            continue
        told = measures.setdefault(test.measure or "a channel that is not logged yet", {})
        told[f"{words.plain(test.separates[0])} from {words.plain(test.separates[1])}"] = None
    return Tests(points, {measure: list(told) for measure, told in measures.items()})


class Watts(NamedTuple):
    """Losses at the median speed and load over the displacement ratio.

    Attributes:
        engine_speed, load_torque: [rad/s], [N m].
        drawings: SVG, before and, if an effect was added, after.
        legend: text and mark of each part, the topmost of the stack first.
        means: part, mean watts before and after, over the strokes that both models answer; NaN if
            there is none. The total comes last.
        own_share: whether the effect takes a part of its own.
    """

    engine_speed: float
    load_torque: float
    drawings: list[str]
    legend: list[tuple[str, str]]
    means: list[tuple[str, float, float]]
    own_share: bool


def watts(found: Diagnosis) -> Watts:
    """Break the losses of both models down at the median speed, load and oil temperature."""
    samples = found.samples
    low, high = samples.displacement_ratio.min(), samples.displacement_ratio.max()
    if high == low:  # an area needs a width
        low, high = max(low - 0.05, -1.0), min(high + 0.05, 1.0)
    strokes = np.linspace(low, high, _STROKES)
    speed, load = float(np.median(samples.engine_speed)), float(np.median(samples.load_torque))
    heat = (None if samples.oil_temperature is None
            else float(np.median(samples.oil_temperature)))
    before, after = (lost_power(model, strokes, speed, load, heat)
                     for model in (found.base, found.model))
    parts = worth_drawing(before, after)
    panels = [("Base model, refitted", before)]
    if found.model is not found.base:
        panels.append(("With the effect added", after))
    ends = np.array([_reach(balance) for _, balance in panels]) / 1e3
    drawings = []
    for index, (title, balance) in enumerate(panels):
        with styled(PANEL) as figure:
            axes = figure.subplots()
            stack(axes, strokes, {part: watts / 1e3 for part, watts in balance.items()}, parts)
            axes.set(title=title, ylabel="power lost [kW]",
                     ylim=(1.05 * ends.min(), 1.05 * ends.max() or 1.0))
            drawings.append(to_svg(
                figure, f"watts-{index}",
                f"{title}: power lost in each part over displacement ratio",
                {part: _range(part, balance[part]) for part in parts if part in balance}))
    return Watts(speed, load, drawings, _legend(parts), _means(before, after, parts),
                 bool(set(after) - set(before)))


def _reach(balance: dict[str, Array]) -> tuple[float, float]:
    """Lowest and highest end of a stack [W]."""
    parts = np.nan_to_num(np.stack(list(balance.values())))
    return (float(np.minimum(parts, 0.0).sum(axis=0).min()),
            float(np.maximum(parts, 0.0).sum(axis=0).max()))


def _range(part: str, lost: Array) -> str:
    known = lost[np.isfinite(lost)] / 1e3
    return part if not len(known) else (
        f"{part}: {words.fixed(known.min(), 2)} to {words.fixed(known.max(), 2)} kW")


def _legend(parts: list[str]) -> list[tuple[str, str]]:
    return [(part, icon(f"part-{place}", lambda axes, part=part: axes.fill_between(
        (0.05, 0.95), 0.05, 0.95, **loss_style(part))))
        for place, part in reversed(list(enumerate(parts)))]


def _means(
    before: dict[str, Array], after: dict[str, Array], parts: list[str]
) -> list[tuple[str, float, float]]:
    answered = np.isfinite(sum(before.values()) + sum(after.values()))

    def mean(loss: Array) -> float:
        return float(loss[answered].mean()) if answered.any() else float("nan")

    nothing = np.zeros(len(answered))
    rows = [(part, mean(before.get(part, nothing)), mean(after.get(part, nothing)))
            for part in parts]
    return [*rows, ("total", mean(sum(before.values(), nothing)),
                    mean(sum(after.values(), nothing)))]
