# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Maps of the estimated gap over pairs of axes, with the regions and the samples on them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..diagnosis import Diagnosis
from ..diagnosis.results import text as words
from ..diagnosis.results.stages import main_stage, stages_of
from ..diagnosis.settings import REGION_SIGNIFICANCE
from ..diagnosis.system import Axis
from ..transmission.ranges import Array
from .axes import Rows, in_words, picked, scale_of, shown
from .style import BLUE, GAP_COLOURS, INK, ORANGE, few_ticks, icon, styled, to_svg

Figures = tuple[list[str], list[tuple[str, str]]]
"""Drawings side by side (SVG), and their legend: text, and SVG of a mark."""

View = tuple[Axis, Axis]
"""Axis across and axis up."""

_PAGE_SIZE = (6.9, 6.6)  # in
_GRID = 41  # points along each axis of a view
_LEVELS = 8  # colours on either side of no gap
_UNCERTAIN = 2.0
"""Standard deviations below which an estimated gap is hatched: the usual 95 % limit."""

_SMALL_MARK = 6.5  # height of the mark of the smallest residual beyond the noise [pt]
_LARGE_MARK = 19.5  # of the largest [pt]
_DOT = 5.0  # within the noise [pt]
_LEGEND_MARK = 14.0  # pt
_WHOLE = 0.86
"""Part of a view from which a region spans it: its outline would say nothing there."""

_MARGIN = 0.025  # around a region; part of a view
_HALF_FLAG = 0.033  # half the size of the number of a region; part of a view
_OUTWARDS = np.array([[-1.0], [1.0]])


class _Mark(NamedTuple):
    """Look of a kind of mark."""

    marker: str
    fill: str
    edge: str


_MARKS = {
    "below": _Mark("v", ORANGE, "w"),
    "above": _Mark("^", BLUE, "w"),
    "within": _Mark("o", "#6f7a85", "w"),
    "place": _Mark("s", "none", INK),
}


class _Marks(NamedTuple):
    """Samples of one kind: which they are, and the height of their marks [pt]."""

    rows: Rows
    heights: Array


class Estimate(NamedTuple):
    """Estimated gap on a grid of two axes, in the units shown.

    Attributes:
        across: coordinate across, shape (n, n).
        up: coordinate up, shape (n, n).
        mean: measured minus refitted base, shape (n, n).
        deviation: standard deviation of the estimate, shape (n, n).
    """

    across: Array
    up: Array
    mean: Any
    deviation: Any


def views(diagnosis: Diagnosis) -> list[View]:
    """Return every pair of axes."""
    return list(itertools.combinations(diagnosis.axes, 2))


def gap_map(diagnosis: Diagnosis) -> Figures:
    """Return the maps of the page, one per pair of axes, and their legend."""
    tips = {}
    for kind, group in _marks(diagnosis).items():
        tips[kind] = in_words(
            diagnosis, diagnosis.samples, diagnosis.residuals, group.rows
        )
    pairs = views(diagnosis)
    estimates = [estimate(diagnosis, view) for view in pairs]
    reach = _reach(diagnosis, estimates)
    drawings = []
    for view, gap in zip(pairs, estimates, strict=True):
        across, up = view
        with styled(_PAGE_SIZE) as figure:
            _draw(figure.subplots(), diagnosis, view, gap, reach)
            title = (
                f"Map of the estimated gap: {scale_of(up).label} over "
                f"{scale_of(across).label}; triangles down where the bench lies below the "
                "model, up where above"
            )
            name = f"map-{across.name}-{up.name}".replace("_", "-")
            drawings.append(to_svg(figure, name, title, tips))
    return drawings, _legend(diagnosis)


def draw_gap(figure: Any, diagnosis: Diagnosis, ax: Any = None) -> None:
    """Draw the maps of the estimated gap side by side, or the first one into axes.

    Args:
        figure: empty matplotlib figure.
        diagnosis: with or without a gap.
        ax: axes to draw into instead.
    """
    pairs = views(diagnosis)
    if ax is not None:
        draw_view(ax, diagnosis, pairs[0])
        return
    figure.set_size_inches(_PAGE_SIZE[0] * len(pairs), _PAGE_SIZE[1])
    figure.suptitle(_title(diagnosis), x=0.01, ha="left")
    estimates = [estimate(diagnosis, view) for view in pairs]
    reach = _reach(diagnosis, estimates)
    all_axes = figure.subplots(1, len(pairs), squeeze=False)[0]
    for axes, view, gap in zip(all_axes, pairs, estimates, strict=True):
        _draw(axes, diagnosis, view, gap, reach)


def _title(diagnosis: Diagnosis) -> str:
    source = str(diagnosis.samples.source).rsplit("/", 1)[-1]
    stages = stages_of(diagnosis.samples)
    machine = source
    if len(stages) == 1:
        machine = f"{source}, stage {stages[0]}"
    elif stages:
        machine = f"{source}, stages {', '.join(stages)}"
    return f"{machine}: {words.mechanic(diagnosis)}"


def draw_view(axes: Any, diagnosis: Diagnosis, view: View) -> None:
    """Draw the map of the estimated gap over two axes.

    Args:
        axes: matplotlib Axes.
        diagnosis: estimates the gap.
        view: axis across and axis up.
    """
    gap = estimate(diagnosis, view)
    _draw(axes, diagnosis, view, gap, _reach(diagnosis, [gap]))


def _draw(
    axes: Any, diagnosis: Diagnosis, view: View, gap: Estimate | None, reach: float
) -> None:
    across, up = view
    points = np.column_stack(
        [shown(diagnosis.samples, across), shown(diagnosis.samples, up)]
    )
    axes.update_datalim(points)  # of all samples, with and without a residual
    axes.margins(0.07)
    axes.autoscale_view()
    limits = {"xlim": axes.get_xlim(), "ylim": axes.get_ylim()}
    if gap is not None:
        _draw_estimate(axes, diagnosis, gap, reach)
    axes.set(xlabel=scale_of(across).label, ylabel=scale_of(up).label, **limits)
    few_ticks(axes)
    for kind, group in _marks(diagnosis).items():
        _scatter(axes, kind, points[group.rows], group.heights)
    _outline_regions(axes, diagnosis, view, points[picked(diagnosis.residuals)])


def estimate(diagnosis: Diagnosis, view: View) -> Estimate | None:
    """Return the estimated gap over two axes, at the median of the samples along the others.

    Of several stages, it holds in the one with most samples.
    None where the samples have one value along an axis, or the model has no answer.
    """
    lines = []
    for axis in view:
        low, high = diagnosis.extent[axis.name]
        spread = float(np.ptp(getattr(diagnosis.samples, axis.name)))
        if not high > low or spread == 0.0:
            return None
        lines.append(np.linspace(low, high, _GRID))
    grid = np.meshgrid(*lines)
    coordinates: dict[str, Any] = {}
    for axis in diagnosis.axes:
        low, high = diagnosis.extent[axis.name]
        usual = np.median(getattr(diagnosis.samples, axis.name))
        coordinates[axis.name] = np.clip(usual, low, high)
    shown_grid = []
    for axis, values in zip(view, grid, strict=True):
        coordinates[axis.name] = values
        shown_grid.append(values * scale_of(axis).factor)
    stage = stage_of_map(diagnosis)
    if stage is not None:
        coordinates["stage"] = list(diagnosis.base.stages).index(stage)
    mean, deviation = diagnosis.gap_at(**coordinates)
    if not np.isfinite(mean).any():
        return None
    factor = diagnosis.channel.factor
    return Estimate(
        shown_grid[0],
        shown_grid[1],
        np.ma.masked_invalid(factor * mean),
        np.ma.masked_invalid(factor * deviation),
    )


def stage_of_map(diagnosis: Diagnosis) -> str | None:
    """Return the stage that the maps show, where the samples are of several."""
    if len(stages_of(diagnosis.samples)) < 2:
        return None
    return main_stage(diagnosis.samples)


def _reach(diagnosis: Diagnosis, estimates: Sequence[Estimate | None]) -> float:
    """Return how far the colours of several maps reach on either side of no gap."""
    reach = 2.0 * diagnosis.channel.factor * diagnosis.gap.noise
    for entry in estimates:
        if entry is not None:
            reach = max(reach, float(np.abs(entry.mean).max()))
    return reach


def _draw_estimate(
    axes: Any, diagnosis: Diagnosis, gap: Estimate, reach: float
) -> None:
    """Colour the estimated gap; hatch it where it is less than its uncertainty allows."""
    from matplotlib.colors import LinearSegmentedColormap

    filled = axes.contourf(
        gap.across,
        gap.up,
        gap.mean,
        levels=np.linspace(-reach, reach, 2 * _LEVELS + 1),
        cmap=LinearSegmentedColormap.from_list("gap", GAP_COLOURS),
    )
    axes.contourf(
        gap.across,
        gap.up,
        np.abs(gap.mean) / np.maximum(gap.deviation, 1e-12),
        levels=[0.0, _UNCERTAIN],
        colors="none",
        hatches=["///"],
    )
    bar = axes.figure.colorbar(
        filled, ax=axes, location="top", pad=0.03, aspect=40, format=_signed
    )
    bar.locator = _few_values()
    bar.update_ticks()
    bar.set_label(f"estimated gap [{diagnosis.channel.unit}]", labelpad=10.0)


def _signed(value: float, _: int) -> str:
    """Return a value of the colour bar with its sign; matplotlib adds its position."""
    if abs(value) < 1e-9:
        return "0"
    return f"{value:+.3g}".replace("-", words.MINUS)


def _few_values() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(nbins=4, symmetric=True)


def _marks(diagnosis: Diagnosis) -> dict[str, _Marks]:
    """Return the marks of the samples by kind, large ones first so that small ones show."""
    values = diagnosis.residuals
    twice_noise = 2.0 * diagnosis.gap.noise
    rows = picked(values)
    rows = rows[np.argsort(-np.abs(values[rows]), kind="stable")]
    sizes = np.abs(values[rows])
    within = sizes <= twice_noise
    grown = _SMALL_MARK + (_LARGE_MARK - _SMALL_MARK) * np.minimum(
        sizes / _largest(diagnosis), 1.0
    )
    heights = np.where(within, _DOT, grown)
    is_below = values[rows] < 0.0
    chosen = {
        "below": ~within & is_below,
        "above": ~within & ~is_below,
        "within": within,
    }
    marks = {}
    for kind, which in chosen.items():
        if which.any():
            marks[kind] = _Marks(rows[which], heights[which])
    return marks


def _largest(diagnosis: Diagnosis) -> float:
    twice_noise = 2.0 * diagnosis.gap.noise
    return float(np.nanmax(np.abs(diagnosis.residuals), initial=twice_noise))


def _legend(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    twice_noise = words.amount(diagnosis, 2.0 * diagnosis.gap.noise)
    half = words.amount(diagnosis, _largest(diagnosis) / 2.0)
    entries = [
        ("bench below model", "below", _LEGEND_MARK),
        ("bench above model", "above", _LEGEND_MARK),
        (f"within twice the noise ({twice_noise})", "within", _DOT),
        (f"this size: {half}", "below", (_SMALL_MARK + _LARGE_MARK) / 2.0),
    ]
    if diagnosis.where:
        entries.append(("numbered regions of the table below", "place", _LEGEND_MARK))
    legend = []
    for number, (text, kind, height) in enumerate(entries):
        draw = partial(_scatter, kind=kind, points=[[0.5, 0.5]], heights=height)
        legend.append((text, icon(f"mark-{number}", draw)))
    hatch = icon("mark-hatch", _draw_hatch)
    legend.append(("hatched: less than two standard deviations of the estimate", hatch))
    return legend


def _draw_hatch(axes: Any) -> None:
    axes.fill_between(
        (0.05, 0.95), 0.05, 0.95, facecolor="w", edgecolor=INK, hatch="///", lw=0.6
    )


def _scatter(axes: Any, kind: str, points: Any, heights: Any) -> None:
    mark = _MARKS[kind]
    across, up = np.transpose(points)
    axes.scatter(
        across,
        up,
        s=np.square(heights),
        marker=mark.marker,
        facecolors=mark.fill,
        edgecolors=mark.edge,
        linewidths=2.0 if kind == "place" else 0.8,
        gid=kind,
        clip_on=False,
        zorder=3,
    )


def _outline_regions(
    axes: Any, diagnosis: Diagnosis, view: View, points: Array
) -> None:
    """Outline the regions that do not span the view, each with its number clear of the marks."""
    low, high = np.column_stack([axes.get_xlim(), axes.get_ylim()])
    taken = (points - low) / (high - low)
    for number, region in enumerate(diagnosis.where, 1):
        ends = []
        for axis in view:
            ends.append(np.multiply(region.limits[axis.name], scale_of(axis).factor))
        box = (np.transpose(ends) - low) / (high - low)
        if np.all(box[1] - box[0] > _WHOLE):
            continue
        # A mark at the edge belongs to the region.
        box = np.clip(box + _OUTWARDS * _MARGIN, 0.004, 0.996)
        (left, bottom), (right, top) = box
        is_significant = region.p_value <= REGION_SIGNIFICANCE
        axes.plot(
            (left, right, right, left, left),
            (bottom, bottom, top, top, bottom),
            color=INK,
            lw=2.0,
            ls="-" if is_significant else (0, (3, 2)),
            transform=axes.transAxes,
        )
        position = _free_position(box, taken)
        taken = np.vstack([taken, position])
        axes.text(
            *position,
            str(number),
            transform=axes.transAxes,
            ha="center",
            va="center",
            color="w",
            weight="bold",
            zorder=4,
            bbox={"boxstyle": "square,pad=0.25", "fc": INK},
        )


def _edge_positions() -> Array:
    """Return positions along the edge of a unit square, its corners first, shape (k, 2)."""
    corners = []
    others = []
    for position in itertools.product(np.linspace(0.0, 1.0, 9), repeat=2):
        ends = [value in (0.0, 1.0) for value in position]
        if all(ends):
            corners.append(position)
        elif any(ends):
            others.append(position)
    return np.array(corners + others)


def _free_position(box: Array, taken: Array) -> Array:
    """Return where a flag is clear of what is taken: at the edge of a box, inside or outside."""
    edge = _edge_positions()
    candidates = []
    for low, high in (box - _OUTWARDS * _HALF_FLAG, box + _OUTWARDS * _HALF_FLAG):
        positions = low + edge * (high - low)
        candidates.append(np.clip(positions, _HALF_FLAG, 1.0 - _HALF_FLAG))
    flags = np.vstack(candidates)
    distance = np.abs(flags[:, None] - taken).max(axis=-1)
    # Beyond one flag's width nothing is gained, so that corners win.
    clearance = distance.min(axis=-1, initial=2.0 * _HALF_FLAG)
    return np.asarray(flags[clearance.argmax()])
