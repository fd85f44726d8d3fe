# SPDX-License-Identifier: Apache-2.0
"""Measured against predicted: residuals over the working space, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import words
from ..diagnosis.result import REGION_SIGNIFICANCE, Diagnosis, Region
from ..model.model import EfficiencyModel
from ..transmission.ranges import RPM
from .style import BLUE, INK, ORANGE, icon, styled, to_svg

Array = NDArray[np.float64]


class Axis(NamedTuple):
    """An axis of the working space: `factor` times its SI values are shown."""

    label: str
    factor: float


AXES = {"displacement_ratio": Axis("displacement ratio [-]", 1.0),
        "engine_speed": Axis("engine speed [r/min]", 1.0 / RPM),
        "load_torque": Axis("load torque [N·m]", 1.0)}
_MAP = (6.9, 6.0)  # in
_MOST_MARKS, _MOST_DOTS = 400, 1500
_CELLS = 18  # cells along an axis when there are more samples than marks
_SMALL, _LARGE = 6.5, 19.5  # height of a triangle [pt]
_WITHIN = {"marker": "o", "color": "#9aa3ad", "linewidths": 0.0}
_BELOW = {"marker": "v", "facecolors": ORANGE, "edgecolors": "w", "linewidths": 0.8}
_ABOVE = {"marker": "^", "facecolors": BLUE, "edgecolors": "w", "linewidths": 0.8}
_PALE_BELOW = {**_BELOW, "facecolors": "#f6d3b8", "edgecolors": ORANGE}
_PALE_ABOVE = {**_ABOVE, "facecolors": "#cfe1f2", "edgecolors": BLUE}
_DOT = 26.0  # pt2
_WHOLE = 0.86  # part of a view from which a place spans it and says nothing
_ROOM, _FLAG = 0.025, 0.033  # around a place; half a flag; parts of a view
_TREND_SAMPLES, _TREND_BINS = 24, 8


def limits(region: Region, axis: str) -> tuple[float, float]:
    """Return between what a place lies, SI."""
    found: tuple[float, float] = getattr(region, axis)
    return found


def shared(found: Diagnosis, model: EfficiencyModel) -> float:
    """Return the mean of measured - predicted over the samples diagnosed [-]."""
    errors = _errors(found, model)
    known = errors[np.isfinite(errors)]
    return float(np.mean(known)) if len(known) else 0.0


def _errors(found: Diagnosis, model: EfficiencyModel) -> Array:
    samples = found.samples
    return np.asarray(samples.efficiency - model.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque,
        samples.oil_temperature))


def _of_samples(found: Diagnosis) -> bool:
    """Whether the residuals of the diagnosis are those of the samples diagnosed."""
    return (found.shrinkage.on == "cross-validation"
            and len(found.residuals_before) == len(found.samples))


def _points(found: Diagnosis, values: Array) -> list[str]:
    """Each sample in words."""
    samples = found.samples
    return [f"displacement ratio {words.fixed(stroke, 2)}, {words.rpm(speed)} r/min, "
            f"{words.fixed(load, 0)} N·m: {words.points(value, sign=True)}"
            for stroke, speed, load, value in zip(
                samples.displacement_ratio.tolist(), samples.engine_speed.tolist(),
                samples.load_torque.tolist(), values.tolist(), strict=True)]


# --- the map --------------------------------------------------------------------------------------


class GapMap(NamedTuple):
    """The map of residuals and what is to be said about it.

    Attributes:
        drawings: SVG, one for each pair of axes.
        legend: text and mark.
        note: how the residuals came about.
        condensed: whether marks are means over cells, there being too many samples.
    """

    drawings: list[str]
    legend: list[tuple[str, str]]
    note: str
    condensed: bool


def gap_map(found: Diagnosis) -> GapMap:
    """Draw the residuals of the refitted base model at the samples diagnosed."""
    values, note = found.residuals_before, "predicted without the sample itself"
    if not _of_samples(found):
        # A part that all samples share is booked as calibration of the meters, as in the diagnosis.
        offset = shared(found, found.base)
        values = _errors(found, found.base) - offset
        note = f"less the part that all samples share, {words.points(offset, sign=True)}"
    known = np.isfinite(values)
    sizes = np.abs(values[known])
    top = float(np.quantile(sizes, 0.98)) if len(sizes) else 0.0
    largest = max(top, 2.0 * found.gap.noise, 1e-9)
    drawings = [_view(found, values, largest, view, i)
                for i, view in enumerate(combinations(AXES, 2))]
    return GapMap(drawings, _legend(found, largest), note, len(values) > _MOST_MARKS)


def _view(
    found: Diagnosis, values: Array, largest: float, view: tuple[str, str], index: int
) -> str:
    place = np.column_stack([np.asarray(getattr(found.samples, axis)) * AXES[axis].factor
                             for axis in view])
    with styled(_MAP) as figure:
        axes = figure.subplots()
        # The range is that of the samples, whether they have a residual or not.
        axes.update_datalim(place)
        place, shown, noise, texts = _marks(found, values, place)
        tips = _draw_marks(axes, place, shown, noise, texts, largest)
        axes.margins(0.07)
        axes.set(xlabel=AXES[view[0]].label, ylabel=AXES[view[1]].label)
        if view[1] == "engine_speed":
            axes.secondary_yaxis(
                "right", functions=(lambda speed: speed * RPM, lambda speed: speed / RPM),
            ).set_ylabel("engine speed [rad/s]")
        axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim())  # held from here on
        _outline(axes, found, view, place)
        return to_svg(figure, f"map-{index}", (
            f"Map of residuals: {AXES[view[1]].label} over {AXES[view[0]].label}; triangles down "
            "where the bench lies below the model, up where above"), tips)


def _marks(
    found: Diagnosis, values: Array, place: Array
) -> tuple[Array, Array, Array, list[str]]:
    """Place, residual, noise and words of each mark: of a sample, or the mean over a cell."""
    known = np.isfinite(values)
    if len(values) <= _MOST_MARKS:
        texts = np.array(_points(found, values), dtype=object)[known].tolist()
        return place[known], values[known], np.full(known.sum(), found.gap.noise), texts
    place, values = place[known], values[known]
    span = np.maximum(np.ptp(place, axis=0), 1e-12)
    cells = np.minimum((place - place.min(axis=0)) / span * _CELLS, _CELLS - 1).astype(int)
    _, group, count = np.unique(cells @ (_CELLS, 1), return_inverse=True, return_counts=True)
    means = [np.bincount(group, column) / count for column in (*place.T, values)]
    texts = [f"mean of {n} samples: {words.points(value, sign=True)}"
             for n, value in zip(count.tolist(), means[2].tolist(), strict=True)]
    return np.column_stack(means[:2]), means[2], found.gap.noise / np.sqrt(count), texts


def _draw_marks(
    axes: Any, place: Array, values: Array, noise: Array, texts: Sequence[str], largest: float
) -> dict[str, list[str]]:
    """Draw the marks, large ones first, so that small ones stay visible."""
    size = np.abs(values)
    level = (size > noise).astype(int) + (size > 2.0 * noise)
    areas = np.where(level == 0, _DOT, _area(size, largest))
    kinds = {"below": (_BELOW, (level == 2) & (values < 0.0)),
             "above": (_ABOVE, (level == 2) & (values > 0.0)),
             "pale-below": (_PALE_BELOW, (level == 1) & (values < 0.0)),
             "pale-above": (_PALE_ABOVE, (level == 1) & (values > 0.0)),
             "within": (_WITHIN, level == 0)}
    tips = {}
    for name, (style, of_kind) in kinds.items():
        chosen = np.flatnonzero(of_kind)
        chosen = chosen[np.argsort(-size[chosen], kind="stable")]
        axes.scatter(*place[chosen].T, s=areas[chosen], gid=name, clip_on=False, **style)
        tips[name] = [texts[i] for i in chosen]
    return tips


def _area(size: Any, largest: float) -> Any:
    return (_SMALL + (_LARGE - _SMALL) * np.minimum(size / largest, 1.0)) ** 2


def _outline(axes: Any, found: Diagnosis, view: tuple[str, str], marks: Array) -> None:
    """Outline the places that do not span the whole view, each with its number."""
    from matplotlib.patches import Rectangle

    low, high = np.column_stack([axes.get_xlim(), axes.get_ylim()])
    seen, flags = (marks - low) / (high - low), np.empty((0, 2))
    for number, region in enumerate(found.where, 1):
        ends = np.array([limits(region, axis) for axis in view]).T
        box = (ends * [AXES[axis].factor for axis in view] - low) / (high - low)
        if np.all(box[1] - box[0] > _WHOLE):
            continue
        # A mark at the edge belongs to the place.
        box = np.clip(box + [[-_ROOM], [_ROOM]], 0.004, 0.996)
        sure = region.p_value <= REGION_SIGNIFICANCE
        axes.add_patch(Rectangle(box[0], *(box[1] - box[0]), fill=False, ec=INK, lw=2.0,
                                 ls="-" if sure else (0, (3, 2)), transform=axes.transAxes))
        at = _corner(box, flags, seen)
        flags = np.vstack([flags, at])
        axes.text(*at, str(number), transform=axes.transAxes, ha="center", va="center",
                  color="w", weight="bold", size=13, zorder=9,
                  bbox={"boxstyle": "square,pad=0.25", "fc": INK, "ec": "none"})


def _corner(box: Array, flags: Array, marks: Array) -> Array:
    """Place of a flag at the edge of a box, hiding no other flag and fewest marks."""
    steps = np.linspace(0.0, 1.0, 9)
    edge = np.array([(x, y) for y in steps[::-1] for x in steps if x in (0, 1) or y in (0, 1)])
    inner = box + [[_FLAG], [-_FLAG]]
    places = np.clip(inner[0] + edge * (inner[1] - inner[0]), _FLAG, 1.0 - _FLAG)

    def hidden(place: Array) -> tuple[int, int]:
        return (int(np.all(np.abs(flags - place) < 2.2 * _FLAG, axis=1).sum()),
                int(np.all(np.abs(marks - place) < 1.5 * _FLAG, axis=1).sum()))

    return min(places, key=hidden)


def _legend(found: Diagnosis, largest: float) -> list[tuple[str, str]]:
    middle = largest / 2.0
    entries = [
        ("bench below model", _BELOW, 200.0), ("bench above model", _ABOVE, 200.0),
        ("less than twice the noise", _PALE_BELOW, 200.0),
        (f"within the noise ({words.points(found.gap.noise)})", _WITHIN, _DOT),
        (f"this size: {words.points(middle)}", _BELOW, float(_area(middle, largest)))]
    if found.where:
        entries.append(("numbered places of the table below", {
            "marker": "s", "facecolors": "none", "edgecolors": INK, "linewidths": 2.0}, 200.0))
    return [(text, icon(f"mark-{i}", lambda axes, style=style, area=area: axes.scatter(
        0.5, 0.5, s=area, **style))) for i, (text, style, area) in enumerate(entries)]


# --- before and after -----------------------------------------------------------------------------


class Residuals(NamedTuple):
    """The residuals on one scale and what is to be said about them.

    Attributes:
        drawings: SVG, one panel or two.
        beyond: dots outside the scale, drawn at its edge.
        thinned: whether a part of the samples only is drawn.
    """

    drawings: list[str]
    beyond: int
    thinned: bool


def residuals(found: Diagnosis) -> Residuals:
    """Draw the residuals at samples left out (or of the holdout) before and after."""
    panels = [("Base model, refitted", found.residuals_before)]
    if found.verdict != "no_gap":
        ending = ("Best listed effect added" if found.verdict == "unexplained"
                  else "With the effect added")
        panels.append((ending, found.residuals_after))
    sizes = np.abs(np.concatenate([values for _, values in panels]))
    sizes = sizes[np.isfinite(sizes)]
    # A few outliers do not flatten the rest.
    usual = min(sizes.max(), 2.0 * np.quantile(sizes, 0.95)) if len(sizes) else 0.0
    reach = 1.1 * max(usual, 2.5 * found.gap.noise)
    label, across = _across(found)
    drawings = [_panel(found, title, values, label, across, reach, i)
                for i, (title, values) in enumerate(panels)]
    return Residuals(drawings, int(np.sum(sizes > reach)), len(across) > _MOST_DOTS)


def _across(found: Diagnosis) -> tuple[str, Array]:
    """Label and values of the axis along which the first place is narrowest."""
    if not _of_samples(found):
        return (f"sample of the {found.shrinkage.on}, in order of the file",
                np.arange(1.0, len(found.residuals_before) + 1.0))

    def width(axis: str) -> float:
        low, high = limits(found.where[0], axis)
        return float((high - low) / max(np.ptp(getattr(found.samples, axis)), 1e-12))

    name = min(("engine_speed", "load_torque", "displacement_ratio"), key=width
               ) if found.where else "engine_speed"
    return AXES[name].label, np.asarray(getattr(found.samples, name)) * AXES[name].factor


def _panel(
    found: Diagnosis, title: str, values: Array, label: str, across: Array, reach: float,
    index: int,
) -> str:
    known = np.flatnonzero(np.isfinite(values))
    shown = known[:: max(1, -(-len(known) // _MOST_DOTS))]
    inside, outside = (shown[(np.abs(values[shown]) > reach) == far] for far in (False, True))
    rms = f"{words.points(np.sqrt(np.mean(values[known] ** 2)))} rms" if len(known) else "not known"
    noise = 100.0 * found.gap.noise
    with styled() as figure:
        axes = figure.subplots()
        axes.axhspan(-2.0 * noise, 2.0 * noise, color="#e9edf1", lw=0.0, zorder=0.5)
        axes.axhline(0.0, color="0.4", lw=1.0)
        axes.update_datalim(np.column_stack([across, across]))  # one range before and after
        axes.scatter(across[inside], 100.0 * values[inside], s=40.0, color=BLUE, alpha=0.75,
                     edgecolors="w", linewidths=0.6, gid="sample")
        for sign, marker in ((1.0, "^"), (-1.0, "v")):
            beyond = outside[sign * values[outside] > 0.0]
            axes.scatter(across[beyond], np.full(len(beyond), sign * 97.0 * reach), s=90.0,
                         marker=marker, facecolors="w", edgecolors=BLUE, linewidths=1.4)
        if len(known) >= _TREND_SAMPLES:
            parts = np.array_split(known[np.argsort(across[known], kind="stable")], _TREND_BINS)
            axes.plot([across[part].mean() for part in parts],
                      [100.0 * values[part].mean() for part in parts], color="k", lw=2.4)
        axes.set(ylim=(-100.0 * reach, 100.0 * reach), xlabel=label, title=f"{title}: {rms}",
                 ylabel="measured minus predicted [points]")
        tips = {}
        if _of_samples(found) and len(shown) <= _MOST_MARKS:
            texts = _points(found, values)
            tips = {"sample": [texts[i] for i in inside]}
        return to_svg(figure, f"residuals-{index}",
                      f"{title}: measured minus predicted efficiency over {label}", tips)
