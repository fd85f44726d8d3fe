# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Measured against predicted: residuals over the working space, and before and after an effect."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis, words
from ..diagnosis.result import REGION_SIGNIFICANCE
from ..transmission.ranges import RPM
from .style import BLUE, INK, ORANGE, Figures, few_ticks, icon, styled, to_svg

Array = NDArray[np.float64]

# Label, factor to what is shown, decimals and words, for each axis of the working space.
_AXES = {"displacement_ratio": ("displacement ratio [-]", 1.0, 2, "displacement ratio {}"),
         "engine_speed": ("engine speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
         "load_torque": ("load torque [N·m]", 1.0, 0, "{} N·m"),
         "speed": ("speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
         "pressure": ("pressure [bar]", 1e-5, 0, "{} bar")}
_MAP = (6.9, 6.0)  # in
_MOST = 300  # marks and rows, the same ones
_SMALL, _LARGE, _DOT, _USUAL = 6.5, 19.5, 5.0, 14.0  # height of a mark [pt]
_MARKS = {  # marker, fill, edge
    "below": ("v", ORANGE, "w"), "above": ("^", BLUE, "w"),
    "within": ("o", "#9aa3ad", "none"), "place": ("s", "none", INK),
}
_WHOLE = 0.86  # part of a view from which a place spans it and says nothing
_ROOM, _FLAG = 0.025, 0.033  # around a place; half a flag; parts of a view
_OUTWARDS = np.array([[-1.0], [1.0]])
_TREND_SAMPLES, _TREND_BINS = 24, 8


def _shown(samples: Any, axis: str) -> Array:
    return np.asarray(getattr(samples, axis)) * _AXES[axis][1]


def _names(found: Diagnosis, samples: Any) -> list[str]:
    """What each test is called: by its row in the file, if it was read from one."""
    kind = "" if samples is found.samples else "held-out "
    return ([f"{kind}row {row}" for row in samples.rows] if getattr(samples, "rows", ()) else
            [f"{kind}test {i}" for i in range(1, len(samples) + 1)])


def _axes(found: Diagnosis) -> list[str]:
    return [axis.name for axis in found.axes]


def columns(found: Diagnosis) -> list[tuple[str, str, float, int]]:
    """Heading, axis, factor and decimals of each column that tells a place; speeds twice."""
    told = []
    for name in _axes(found):
        label, factor, digits, _ = _AXES[name]
        told.append((label, name, factor, digits))
        if label.endswith("[r/min]"):
            told.append((label.replace("r/min", "rad/s"), name, 1.0, 1))
    return told


def _in_words(found: Diagnosis, samples: Any, values: Array) -> Any:
    """Each sample and its residual, shape (n,) of text."""
    rows = zip(_names(found, samples), *(_shown(samples, axis).tolist() for axis in _axes(found)),
               values.tolist(), strict=True)
    return np.array([f"{name}: " + ", ".join(
        _AXES[axis][3].format(words.fixed(value, _AXES[axis][2]))
        for axis, value in zip(_axes(found), place, strict=True))
        + f": {words.amount(found, residual, sign=True)}" for name, *place, residual in rows])


def gap_map(found: Diagnosis) -> Figures:
    """Draw the residuals of the refitted base model at the samples diagnosed."""
    values = found.residuals
    largest = float(np.nanmax(np.abs(values), initial=2.0 * found.gap.noise))
    entries = [("bench below model", "below", _USUAL), ("bench above model", "above", _USUAL),
               (f"within twice the noise ({words.amount(found, 2.0 * found.gap.noise)})", "within",
                _DOT),
               (f"this size: {words.amount(found, largest / 2.0)}", "below",
                (_SMALL + _LARGE) / 2.0)]
    if found.where:
        entries.append(("numbered places of the table below", "place", _USUAL))
    legend = [(text, icon(f"mark-{i}", partial(_scatter, kind=kind, at=[[0.5, 0.5]],
                                               height=height)))
              for i, (text, kind, height) in enumerate(entries)]
    views = [_view(found, values, largest, *view)
             for view in itertools.combinations(_axes(found), 2)]
    return Figures(views, legend, ["Each mark is one sample: measured minus predicted "
                                   f"{words.plain(found.channel.name)}, predicted without the "
                                   "sample itself.", *_part(values)])


def _part(values: Array) -> list[str]:
    return ["A part of the samples is drawn, evenly picked."] * (len(values) > _MOST)


def _scatter(axes: Any, kind: str, at: Any, height: Any) -> None:
    marker, fill, edge = _MARKS[kind]
    axes.scatter(*np.transpose(at), s=np.square(height), marker=marker, facecolors=fill,
                 edgecolors=edge, linewidths=2.0 if kind == "place" else 0.8, gid=kind,
                 clip_on=False)


def _view(found: Diagnosis, values: Array, largest: float, across: str, up: str) -> str:
    at = np.column_stack([_shown(found.samples, across), _shown(found.samples, up)])
    with styled(_MAP) as figure:
        axes = figure.subplots()
        axes.update_datalim(at)  # of all samples, whether they have a residual or not
        axes.margins(0.07)
        axes.autoscale_view()
        axes.set(xlim=axes.get_xlim(), ylim=axes.get_ylim(), xlabel=_AXES[across][0],
                 ylabel=_AXES[up][0])
        few_ticks(axes)
        tips = _draw_marks(axes, found, values, at, largest)
        _outline(axes, found, (across, up))
        return to_svg(figure, f"map-{across}-{up}".replace("_", "-"), (
            f"Map of residuals: {_AXES[up][0]} over {_AXES[across][0]}; triangles down where the "
            "bench lies below the model, up where above"), tips)


def _draw_marks(
    axes: Any, found: Diagnosis, values: Array, at: Array, largest: float
) -> dict[str, list[str]]:
    """Draw a mark for each sample; return their texts."""
    shown, noise = _picked(values), found.gap.noise
    texts = _in_words(found, found.samples, values)[shown]
    at, values = at[shown], values[shown]
    size = np.abs(values)
    height = _SMALL + (_LARGE - _SMALL) * np.minimum(size / largest, 1.0)
    height[size <= 2.0 * noise] = _DOT
    kinds = np.select([size <= 2.0 * noise, values < 0.0], ["within", "below"], "above")
    tips = {}
    for kind in _MARKS:
        chosen = np.flatnonzero(kinds == kind)
        # Large ones first, so that small ones stay visible.
        chosen = chosen[np.argsort(-size[chosen], kind="stable")]
        if len(chosen):
            _scatter(axes, kind, at[chosen], height[chosen])
            tips[kind] = texts[chosen].tolist()
    return tips


def _picked(values: Array) -> NDArray[np.intp]:
    """Which samples are drawn: those that have a residual, or an even part of them."""
    known = np.flatnonzero(np.isfinite(values))
    return known[:: max(1, -(-len(known) // _MOST))]


def _outline(axes: Any, found: Diagnosis, view: tuple[str, str]) -> None:
    """Outline the places that do not span the whole view, each with its number."""
    low, high = np.column_stack([axes.get_xlim(), axes.get_ylim()])
    for number, region in enumerate(found.where, 1):
        ends = np.transpose([np.multiply(region.limits[axis], _AXES[axis][1]) for axis in view])
        box = (ends - low) / (high - low)
        if np.all(box[1] - box[0] > _WHOLE):
            continue
        # A mark at the edge belongs to the place.
        (left, bottom), (right, top) = box = np.clip(box + _OUTWARDS * _ROOM, 0.004, 0.996)
        axes.plot((left, right, right, left, left), (bottom, bottom, top, top, bottom), color=INK,
                  lw=2.0, ls="-" if region.p_value <= REGION_SIGNIFICANCE else (0, (3, 2)),
                  transform=axes.transAxes)
        inner = np.clip(box - _OUTWARDS * _FLAG, _FLAG, 1.0 - _FLAG)
        # Each in a corner of its own.
        at = inner[[number // 2 % 2, number % 2], [0, 1]]
        axes.text(*at, str(number), transform=axes.transAxes, ha="center", va="center", color="w",
                  weight="bold", bbox={"boxstyle": "square,pad=0.25", "fc": INK})


def _panels(found: Diagnosis) -> tuple[dict[str, Array], float]:
    """Residuals before and after by title, and how far the axis reaches."""
    panels = {"Base model, refitted": found.residuals_before}
    if found.verdict != "no_gap":
        panels["Best listed effect added" if found.verdict == "unexplained"
               else "With the effect added"] = found.residuals_after
    largest = np.nanmax(np.abs(list(panels.values())), initial=2.5 * found.gap.noise)
    return panels, 1.1 * float(largest)


def residuals(found: Diagnosis) -> Figures:
    """Draw the residuals at samples left out (or of the holdout) before and after."""
    label, across = _across(found)
    panels, reach = _panels(found)
    drawings = []
    for i, (title, values) in enumerate(panels.items()):
        with styled() as figure:
            _panel(figure.subplots(), found, title, values, reach)
            texts = _in_words(found, found.judged, values)[_picked(values)].tolist()
            drawings.append(to_svg(
                figure, f"residuals-{i}", f"{title}: measured minus predicted "
                f"{words.plain(found.channel.name)} over {label}", {"sample": texts}))
    return Figures(drawings, notes=_part(across))


def residual_table(found: Diagnosis) -> dict[str, Any]:
    """The residuals as a table: its head, its rows of text, and a note where not all are there."""
    samples, panels = found.judged, _panels(found)[0]
    shown = np.arange(len(samples))[:: max(1, -(-len(samples) // _MOST))]
    channel, axes, names = found.channel, _axes(found), _names(found, samples)
    columns = [*(_shown(samples, axis) for axis in axes), *(
        channel.factor * values for values in (getattr(samples, channel.name), *panels.values()))]
    digits = [*(_AXES[axis][2] + 1 for axis in axes), 2, 2, 2]
    unit = "%" if channel.unit == "points" else channel.unit
    return {"head": ("test", *(_AXES[axis][0] for axis in axes), f"measured [{unit}]",
                     *(f"{title} [{channel.unit}]" for title in panels)),
            "rows": [(names[i], *(words.fixed(column[i], places) for column, places in zip(
                columns, digits, strict=False))) for i in shown],
            "note": " An even part of the tests." * (len(shown) < len(samples))}


def draw_residuals(figure: Any, found: Diagnosis) -> None:
    """Draw the residuals before and after on an empty matplotlib figure."""
    panels, reach = _panels(found)
    for axes, (title, values) in zip(figure.subplots(1, len(panels), squeeze=False)[0],
                                     panels.items(), strict=True):
        _panel(axes, found, title, values, reach)


def _across(found: Diagnosis) -> tuple[str, Array]:
    """Label and values of the axis along which the first place is narrowest."""
    def width(axis: str) -> float:
        span = np.ptp(getattr(found.samples, axis))
        return float(np.ptp(found.where[0].limits[axis]) / max(span, 1e-12))

    speed, = (axis for axis in _axes(found) if axis.endswith("speed"))
    axis = min(_axes(found), key=width) if found.where else speed
    return _AXES[axis][0], _shown(found.judged, axis)


def _panel(axes: Any, found: Diagnosis, title: str, values: Array, reach: float) -> None:
    label, across = _across(found)
    known, shown = np.flatnonzero(np.isfinite(values)), _picked(values)
    rms = (f"{words.amount(found, np.sqrt(np.mean(values[known] ** 2)))} rms" if len(known)
           else "not known")
    factor = found.channel.factor
    reach, noise = factor * reach, factor * found.gap.noise
    axes.axhspan(-2.0 * noise, 2.0 * noise, color="#e9edf1", lw=0.0)
    axes.axhline(0.0, color="0.4", lw=1.0)
    axes.scatter(across[shown], factor * values[shown], s=40.0, color=BLUE, alpha=0.75,
                 edgecolors="w", linewidths=0.6, gid="sample")
    if len(known) >= _TREND_SAMPLES:
        parts = np.array_split(known[np.argsort(across[known], kind="stable")], _TREND_BINS)
        axes.plot([across[part].mean() for part in parts],
                  [factor * values[part].mean() for part in parts], color="k", lw=2.4)
    axes.update_datalim(np.column_stack([across, across]))  # one range before and after
    axes.autoscale_view()
    axes.set(ylim=(-reach, reach), xlabel=label, title=f"{title}: {rms}",
             ylabel=f"measured minus predicted [{found.channel.unit}]")
    few_ticks(axes)
