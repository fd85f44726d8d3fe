# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Maps of the estimated gap over pairs of axes, with its uncertainty and the samples on them."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.observations import SESSION
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.stages import main_stage, stages_of
from hmcvt_core.diagnosis.settings import REGION_SIGNIFICANCE
from hmcvt_core.diagnosis.system import Axis
from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from .axes import (
    Rows,
    in_words,
    map_axes,
    picked,
    rows_of_stage,
    scale_of,
    shown,
    step,
    value_in_words,
)
from .style import (
    BLUE,
    DEVIATION_COLOURS,
    GAP_COLOURS,
    INK,
    ORANGE,
    SOFT,
    few_ticks,
    icon,
    styled,
    to_svg,
)

Legend = list[tuple[str, str]]
"""Entries of a legend: text, and SVG of a mark."""

Figures = tuple[list[str], Legend]
"""Drawings side by side (SVG), and their legend."""

View = tuple[Axis, Axis]
"""Axis across and axis up."""

_WIDTH = 6.9  # of a figure of a page, and of each pair of axes in a file [in]
_LEAD_HEIGHT = 5.7  # of the map where the gap is largest [in]
_PANEL_HEIGHTS = (6.6, 4.8)  # of the gap above its standard deviation [in]
_ROW_HEIGHT = 2.7  # of the two side by side, one row for each stage [in]
_BARS_HEIGHT = 1.4  # of the colour bars above such rows [in]
_MAX_HEIGHT = 14.5
"""Height of a file [in]: at 130 dots per inch it stays below 2000 pixels."""
_COLUMNS = 3  # pairs of axes side by side in a file
_MAX_STAGES = 6  # in a file; more rows would be too low to read
_TITLE_LETTERS = 50  # of a line above a map
_SHORT_TITLE_LETTERS = 28  # where two stand side by side
_SMALL_PANEL_MARKS = 0.6  # size of marks where two maps stand side by side
_GRID = 25
"""Points along each axis of a view: twice as many look the same and take three times as long."""
_LEVELS = 8  # colours on either side of no gap, at most
_DEVIATION_LEVELS = 6  # colours of the standard deviation, at most
_ROUND_STEPS = (1, 2, 2.5, 5, 10)  # of contour levels
_DEVIATION_LABEL = "standard deviation of the estimate"
_UNCERTAIN = 2.0
"""Standard deviations below which an estimated gap is hatched: the usual 95 % limit."""

_SMALL_MARK = 6.5  # height of the mark of the smallest residual beyond the noise [pt]
_LARGE_MARK = 19.5  # of the largest [pt]
_DOT = 5.0  # within the noise [pt]
_DOTS = 100  # on a map of the standard deviation, at most; an even part
_LEGEND_MARK = 14.0  # pt
_WHOLE = 0.86
"""Fraction of a view from which a region spans it: its outline would say nothing there."""

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


class GapMap(NamedTuple):
    """One map.

    Attributes:
        view: axis across and axis up.
        stage: the stage that it shows; None where the samples are not of several.
        held: value of each axis that the map does not show, by its name, SI.
        estimate: None where the samples have one value along an axis, or the model has no answer.
    """

    view: View
    stage: str | None
    held: dict[str, float]
    estimate: Estimate | None


class _Panel(NamedTuple):
    """Where a map is drawn.

    Attributes:
        axes: matplotlib Axes.
        bar_above: axes that share the colour bar above them; None for these axes alone, empty for
            no bar.
        suffix: of the names of the marks; empty for a map without others in its figure.
        bar_location: side on which the colour bar stands.
    """

    axes: Any
    bar_above: list[Any] | None = None
    suffix: str = ""
    bar_location: str = "top"

    @property
    def is_small(self) -> bool:
        """Whether others stand next to it."""
        return self.bar_above is not None


class _Reach(NamedTuple):
    """How far the colours of all maps reach, in the unit shown.

    Attributes:
        gap: on either side of no gap.
        deviation: from zero.
    """

    gap: float
    deviation: float


def views(diagnosis: Diagnosis) -> list[View]:
    """Return every pair of axes, those that a test can set first; none of a single axis."""
    pairs = itertools.combinations(map_axes(diagnosis), 2)
    return sorted(pairs, key=lambda pair: not (pair[0].steered and pair[1].steered))


@lru_cache(maxsize=1)  # a page and a picture of one diagnosis show the same maps
def gap_maps(diagnosis: Diagnosis) -> tuple[GapMap, ...]:
    """Return the maps of a diagnosis: each pair of axes, in each stage."""
    stages: Sequence[str | None] = stages_of(diagnosis.samples)
    if len(stages) < 2:
        stages = [None]
    maps = []
    for stage in stages:
        for view in views(diagnosis):
            maps.append(_gap_map(diagnosis, view, stage))
    return tuple(maps)


def _gap_map(
    diagnosis: Diagnosis,
    view: View,
    stage: str | None,
    held: dict[str, float] | None = None,
) -> GapMap:
    if held is None:
        held = held_values(diagnosis, view, stage)
    return GapMap(view, stage, held, estimate(diagnosis, view, stage, held))


@lru_cache(maxsize=1)
def largest_gap_map(diagnosis: Diagnosis) -> GapMap:
    """Return the map through the sample at which the estimated gap is largest.

    Of the pairs of axes it shows the one along which the estimate changes most.
    """
    point = _largest_gap_point(diagnosis)
    stage = stage_of_map(diagnosis)
    if stage is not None and "stage" in point:
        stage = list(diagnosis.base.stages)[int(point["stage"])]
    maps = []
    for view in views(diagnosis):
        held = held_values(diagnosis, view, stage)
        held |= {name: point[name] for name in held if name in point}
        maps.append(_gap_map(diagnosis, view, stage, held))
    return max(maps, key=_change)


def _largest_gap_point(diagnosis: Diagnosis) -> dict[str, float]:
    """Return the operating point with the largest gap, SI; empty where none is known.

    A gap beyond its uncertainty goes before a larger one within it.
    """
    points = diagnosis.posterior.base_only.fit.observed.points
    rows = slice(None, None, step(len(diagnosis.posterior.base_only.fit.observed)))
    known = {name: points[name][rows] for name in points if name != SESSION}
    mean, deviation = diagnosis.gap_at(**known)
    size = np.nan_to_num(np.abs(mean))
    is_clear = size >= _UNCERTAIN * deviation
    if is_clear.any():
        size = np.where(is_clear, size, 0.0)
    if not size.any():
        return {}
    row = int(size.argmax())
    return {name: float(values[row]) for name, values in known.items()}


def _change(entry: GapMap) -> float:
    """Return by how much the estimate changes over a map; 0 where there is none."""
    if entry.estimate is None:
        return 0.0
    return float(np.ptp(entry.estimate.mean.compressed()))


def lead_map(diagnosis: Diagnosis) -> str:
    """Return the map where the gap is largest as SVG, for the head of the page."""
    entry = largest_gap_map(diagnosis)
    tips = _tips(diagnosis, entry, "")
    title = (
        f"Map of the estimated gap where it is largest: {_in_words(diagnosis, entry)}"
    )
    with styled((_WIDTH, _LEAD_HEIGHT)) as figure:
        draw_gap_map(figure.subplots(), diagnosis, entry)
        return to_svg(figure, "lead-map", title, tips)


def draw_gap_map(
    axes: Any, diagnosis: Diagnosis, entry: GapMap, bar_location: str = "top"
) -> None:
    """Draw one map with its colour bar.

    Args:
        axes: matplotlib Axes.
        diagnosis: estimates the gap.
        entry: the map.
        bar_location: side of the map on which the colour bar stands.
    """
    panel = _Panel(axes, bar_location=bar_location)
    _draw(panel, diagnosis, entry, _reach(diagnosis, [entry]))


def place_in_words(diagnosis: Diagnosis, entry: GapMap) -> str:
    """Return stage and values of the axes that a map does not show; may be empty."""
    return _held_in_words(diagnosis, entry).removeprefix(", ")


def page_maps(diagnosis: Diagnosis) -> tuple[list[str], Legend]:
    """Return a figure for each pair of axes, all stages in it, and the legend of all."""
    maps = gap_maps(diagnosis)
    reach = _reach(diagnosis, maps)
    drawings = []
    for group in _by_view(maps):
        drawings.append(_page_map(diagnosis, group, reach))
    return drawings, _legend(diagnosis)


def _by_view(maps: Iterable[GapMap]) -> list[list[GapMap]]:
    """Return the maps of each pair of axes, one for each stage."""
    groups: dict[View, list[GapMap]] = {}
    for entry in maps:
        groups.setdefault(entry.view, []).append(entry)
    return list(groups.values())


def _page_map(diagnosis: Diagnosis, group: list[GapMap], reach: _Reach) -> str:
    """Return the maps of a pair of axes with their standard deviations as SVG.

    Args:
        diagnosis: with or without a gap.
        group: a map for each stage.
        reach: of all maps.
    """
    across, up = group[0].view
    tips: dict[str, list[str]] = {}
    descriptions = []
    for number, entry in enumerate(group):
        tips |= _tips(diagnosis, entry, _suffix(group, number))
        descriptions.append(_in_words(diagnosis, entry))
    title = (
        f"Map of the estimated gap: {'; '.join(descriptions)}; triangles down "
        "where the bench lies below the model, up where above. With it, the standard "
        "deviation of the estimate"
    )
    name = f"map-{across.name}-{up.name}".replace("_", "-")
    with styled((_WIDTH, _height(len(group)))) as figure:
        _draw_group(figure, diagnosis, group, reach)
        return to_svg(figure, name, title, tips)


def _tips(diagnosis: Diagnosis, entry: GapMap, suffix: str) -> dict[str, list[str]]:
    """Return a sentence for each sample on a map, by the name of its marks."""
    tips = {}
    for kind, group in _marks(diagnosis, entry.stage).items():
        tips[f"{kind}{suffix}"] = in_words(
            diagnosis, diagnosis.samples, diagnosis.residuals, group.rows
        )
    return tips


def _in_words(diagnosis: Diagnosis, entry: GapMap) -> str:
    """Return what a map shows, in words."""
    across, up = entry.view
    return (
        f"{scale_of(up).label} over {scale_of(across).label}"
        f"{_held_in_words(diagnosis, entry)}"
    )


def _suffix(group: Sequence[GapMap], number: int) -> str:
    """Return what distinguishes the marks of a map from those of the other stages."""
    return f"-{number}" if len(group) > 1 else ""


def _height(stages: int) -> float:
    """Return the height of the maps of a pair of axes on a page [in]."""
    if stages == 1:
        return sum(_PANEL_HEIGHTS)
    return _BARS_HEIGHT + _ROW_HEIGHT * stages


def _draw_group(
    figure: Any, diagnosis: Diagnosis, group: list[GapMap], reach: _Reach
) -> None:
    """Draw the maps of a pair of axes: the gap above its deviation, or a row for each stage."""
    if len(group) > 1:
        _draw_rows(figure, diagnosis, group, reach)
        return
    above, below = figure.subplots(2, 1, height_ratios=_PANEL_HEIGHTS)
    _draw(_Panel(above), diagnosis, group[0], reach)
    _draw_deviation(_Panel(below), diagnosis, group[0], reach)


def _draw_rows(
    figure: Any,
    diagnosis: Diagnosis,
    group: list[GapMap],
    reach: _Reach,
    has_deviation: bool = True,
) -> None:
    """Draw a row for each stage: the gap, and next to it its standard deviation.

    Args:
        figure: empty matplotlib figure, or a part of one.
        diagnosis: estimates the gap.
        group: a map of the same pair of axes for each stage.
        reach: of all maps.
        has_deviation: whether the standard deviation is drawn.
    """
    columns = 2 if has_deviation else 1
    grid = figure.subplots(len(group), columns, sharex=True, sharey=True, squeeze=False)
    known = [entry.estimate is not None for entry in group]
    for number, (entry, row) in enumerate(zip(group, grid, strict=True)):
        # The first map that has colours draws the bars for its whole column.
        has_bars = known[number] and not any(known[:number])
        suffix = _suffix(group, number)
        gap_bar = list(grid[:, 0]) if has_bars else []
        _draw(_Panel(row[0], gap_bar, suffix), diagnosis, entry, reach)
        if has_deviation:
            deviation_bar = list(grid[:, 1]) if has_bars else []
            _draw_deviation(_Panel(row[1], deviation_bar), diagnosis, entry, reach)
    for axes in grid.flat:
        axes.label_outer()


def draw_gap(figure: Any, diagnosis: Diagnosis, ax: Any = None) -> None:
    """Draw the maps of the estimated gap with its standard deviation, or one into axes.

    Pairs of axes stand side by side; of several stages each is a row. Of more pairs than fit with
    several stages the gap alone is drawn; its hatches show where it is uncertain.

    Args:
        figure: empty matplotlib figure.
        diagnosis: with or without a gap.
        ax: axes to draw the first map into instead.

    Raises:
        InputError: there is only one axis.
    """
    if not views(diagnosis):
        raise InputError(
            "a map of the gap needs two axes: plot residuals, or use gap_at"
        )
    if ax is not None:
        draw_view(ax, diagnosis, views(diagnosis)[0])
        return
    maps = gap_maps(diagnosis)
    reach = _reach(diagnosis, maps)
    groups = _by_view(maps)
    shown_stages = _largest_gaps(maps)
    stages = len(groups[0])
    title = _title(diagnosis)
    if len(shown_stages) < stages:
        title += (
            f" ({len(shown_stages)} of {stages} stages, those with the largest gap)"
        )
        groups = [
            [item for item in group if item.stage in shown_stages] for group in groups
        ]
    stages = len(groups[0])
    is_crowded = len(groups) > _COLUMNS
    columns = len(groups)
    width = _WIDTH * columns
    height = _height(stages)
    if is_crowded and stages == 1:
        columns = _COLUMNS
        width = _WIDTH * columns
        height = (_BARS_HEIGHT + _ROW_HEIGHT) * math.ceil(len(groups) / columns)
    elif is_crowded:
        width = _WIDTH * columns / 2.0
    figure.set_size_inches(width, min(height, _MAX_HEIGHT) + 0.8)
    lines = textwrap.wrap(title, int(_TITLE_LETTERS * width / _WIDTH))
    figure.suptitle("\n".join(lines), x=0.01, ha="left")
    parts = figure.subfigures(math.ceil(len(groups) / columns), columns, squeeze=False)
    for part, group in zip(parts.flat, groups, strict=False):
        if is_crowded:
            _draw_rows(part, diagnosis, group, reach, has_deviation=stages == 1)
        else:
            _draw_group(part, diagnosis, group, reach)


def _largest_gaps(maps: Iterable[GapMap]) -> list[str | None]:
    """Return the stages that a file shows: all, or those with the largest estimated gap."""
    largest: dict[str | None, float] = {}
    for entry in maps:
        size = 0.0
        if entry.estimate is not None:
            size = float(np.abs(entry.estimate.mean).max())
        largest[entry.stage] = max(size, largest.get(entry.stage, 0.0))
    return sorted(largest, key=lambda stage: -largest[stage])[:_MAX_STAGES]


def _title(diagnosis: Diagnosis) -> str:
    return f"{machine(diagnosis)}: {words.mechanic(diagnosis)}"


def machine(diagnosis: Diagnosis) -> str:
    """Return the name of the bench file and the stages of its samples."""
    source = str(diagnosis.samples.source).rsplit("/", 1)[-1]
    stages = stages_of(diagnosis.samples)
    if not stages:
        return source
    noun = "stage" if len(stages) == 1 else "stages"
    return f"{source}, {noun} {', '.join(stages)}"


def draw_view(axes: Any, diagnosis: Diagnosis, view: View) -> None:
    """Draw the map of the estimated gap over two axes, of several stages in the main one.

    Args:
        axes: matplotlib Axes.
        diagnosis: estimates the gap.
        view: axis across and axis up.
    """
    draw_gap_map(axes, diagnosis, _gap_map(diagnosis, view, stage_of_map(diagnosis)))


def stage_of_map(diagnosis: Diagnosis) -> str | None:
    """Return the stage of a single map, where the samples are of several."""
    if len(stages_of(diagnosis.samples)) < 2:
        return None
    return main_stage(diagnosis.samples)


# --- the estimate --------------------------------------------------------------------------


def held_values(
    diagnosis: Diagnosis, view: View, stage: str | None = None
) -> dict[str, float]:
    """Return the values at which a map holds the other axes: the median of the samples.

    Args:
        diagnosis: of the samples.
        view: axis across and axis up.
        stage: whose samples count; None for all.
    """
    rows = rows_of_stage(diagnosis.samples, stage)
    held = {}
    for axis in map_axes(diagnosis):
        if axis not in view:
            values = getattr(diagnosis.samples, axis.name)[rows]
            held[axis.name] = float(np.median(values))
    return held


def estimate(
    diagnosis: Diagnosis,
    view: View,
    stage: str | None = None,
    held: dict[str, float] | None = None,
) -> Estimate | None:
    """Return the estimated gap over two axes, within the samples, the others as held.

    Args:
        diagnosis: estimates the gap.
        view: axis across and axis up.
        stage: in which it is estimated; None for the main one of several.
        held: values of the other axes, SI; None for the medians of the samples.

    Returns:
        None where the samples have one value along an axis, or the model has no answer.
    """
    if stage is None:
        stage = stage_of_map(diagnosis)
    rows = rows_of_stage(diagnosis.samples, stage)
    lines = []
    for axis in view:
        values = getattr(diagnosis.samples, axis.name)[rows]
        low, high = _extent(diagnosis, axis)
        # Samples that were set aside reach further than what was diagnosed.
        low = max(low, float(values.min()))
        high = min(high, float(values.max()))
        if not high > low:
            return None
        lines.append(np.linspace(low, high, _GRID))
    grid = np.meshgrid(*lines)
    if held is None:
        held = held_values(diagnosis, view, stage)
    coordinates: dict[str, Any] = dict(held)
    for axis in map_axes(diagnosis):
        if axis.name in coordinates:
            low, high = _extent(diagnosis, axis)
            coordinates[axis.name] = np.clip(coordinates[axis.name], low, high)
    shown_grid = []
    for axis, values in zip(view, grid, strict=True):
        coordinates[axis.name] = values
        shown_grid.append(values * scale_of(axis).factor)
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


def _extent(diagnosis: Diagnosis, axis: Axis) -> tuple[float, float]:
    """Return the lowest and highest value along an axis of what was diagnosed, SI."""
    if axis.name in diagnosis.extent:
        return diagnosis.extent[axis.name]
    values = diagnosis.posterior.base_only.fit.observed.points[axis.name]
    return float(values.min()), float(values.max())


def _reach(diagnosis: Diagnosis, maps: Iterable[GapMap]) -> _Reach:
    """Return how far the colours of several maps reach."""
    twice_noise = 2.0 * diagnosis.channel.factor * diagnosis.gap.noise
    gap = twice_noise
    deviation = 0.0
    for entry in maps:
        if entry.estimate is not None:
            gap = max(gap, float(np.abs(entry.estimate.mean).max()))
            deviation = max(deviation, float(entry.estimate.deviation.max()))
    return _Reach(gap, deviation or twice_noise)


# --- drawing -------------------------------------------------------------------------------


def _draw(panel: _Panel, diagnosis: Diagnosis, entry: GapMap, reach: _Reach) -> None:
    """Draw a map with its samples and regions."""
    axes = panel.axes
    points = _framed(axes, diagnosis, entry)
    if entry.estimate is not None:
        _draw_estimate(panel, diagnosis, entry.estimate, reach.gap)
    title = place_in_words(diagnosis, entry)
    letters = _SHORT_TITLE_LETTERS if panel.is_small else _TITLE_LETTERS
    lines = textwrap.wrap(title, letters, break_long_words=False)
    axes.set_title("\n".join(lines))
    scale = _SMALL_PANEL_MARKS if panel.is_small else 1.0
    for kind, group in _marks(diagnosis, entry.stage).items():
        name = f"{kind}{panel.suffix}"
        _scatter(axes, kind, points[group.rows], scale * group.heights, name)
    drawn = _drawn_rows(diagnosis, entry.stage)
    _outline_regions(axes, diagnosis, entry.view, points[drawn])


def _draw_deviation(
    panel: _Panel, diagnosis: Diagnosis, entry: GapMap, reach: _Reach
) -> None:
    """Draw the standard deviation of an estimate, with a dot for each sample."""
    axes = panel.axes
    if entry.estimate is None:
        axes.set_visible(False)
        return
    from matplotlib.colors import LinearSegmentedColormap

    points = _framed(axes, diagnosis, entry)
    gap = entry.estimate
    levels = _round_levels(0.0, reach.deviation, _DEVIATION_LEVELS)
    filled = axes.contourf(
        gap.across,
        gap.up,
        gap.deviation,
        levels=levels,
        cmap=LinearSegmentedColormap.from_list("deviation", DEVIATION_COLOURS),
    )
    _draw_lines(axes, gap, gap.deviation, levels)
    label = "standard deviation" if panel.is_small else _DEVIATION_LABEL
    _draw_bar(panel, filled, levels, f"{label} [{diagnosis.channel.unit}]", "%.3g")
    rows = _drawn_rows(diagnosis, entry.stage)
    across, up = points[rows[:: -(-len(rows) // _DOTS) or 1]].T
    scale = _SMALL_PANEL_MARKS if panel.is_small else 1.0
    axes.scatter(across, up, s=(scale * _DOT) ** 2, color=INK, clip_on=False, zorder=3)


def _draw_bar(
    panel: _Panel, filled: Any, levels: Array, label: str, ticks: Any
) -> None:
    """Draw the colour bar of a panel above it, or above all that share it."""
    if panel.bar_above is not None and not panel.bar_above:
        return
    axes = panel.bar_above or panel.axes
    bar = panel.axes.figure.colorbar(
        filled,
        ax=axes,
        location=panel.bar_location,
        pad=0.03,
        aspect=20 if panel.is_small else 40,
        format=ticks,
    )
    bar.set_ticks(_few(levels))
    bar.set_label(label, labelpad=10.0)


def _framed(axes: Any, diagnosis: Diagnosis, entry: GapMap) -> Array:
    """Set the limits and labels of axes; return the samples in them, shape (n, 2)."""
    across, up = entry.view
    points = np.column_stack(
        [shown(diagnosis.samples, across), shown(diagnosis.samples, up)]
    )
    axes.set_visible(True)
    # Of all samples, with and without a residual, so that the maps of all stages compare.
    axes.update_datalim(points)
    axes.margins(0.07)
    axes.autoscale_view()
    axes.set(
        xlabel=scale_of(across).label,
        ylabel=scale_of(up).label,
        xlim=axes.get_xlim(),
        ylim=axes.get_ylim(),
    )
    few_ticks(axes)
    return points


def _held_in_words(diagnosis: Diagnosis, entry: GapMap) -> str:
    """Return at which values of the other axes a map holds, with a comma before it."""
    parts = []
    for axis in map_axes(diagnosis):
        if axis.name in entry.held:
            part = value_in_words(axis, entry.held[axis.name])
            # A line does not end between a value and its unit.
            parts.append(part.replace(" ", "\N{NO-BREAK SPACE}"))
    text = f", at {', '.join(parts)}" if parts else ""
    if entry.stage is not None:
        text = f", stage {entry.stage}{text}"
    return text


def _draw_estimate(
    panel: _Panel, diagnosis: Diagnosis, gap: Estimate, reach: float
) -> None:
    """Colour the estimated gap; hatch it where it is less than its uncertainty allows."""
    from matplotlib.colors import LinearSegmentedColormap

    axes = panel.axes
    levels = _round_levels(-reach, reach, 2 * _LEVELS)
    filled = axes.contourf(
        gap.across,
        gap.up,
        gap.mean,
        levels=levels,
        cmap=LinearSegmentedColormap.from_list("gap", GAP_COLOURS),
    )
    _draw_lines(axes, gap, gap.mean, levels)
    axes.contourf(
        gap.across,
        gap.up,
        np.abs(gap.mean) / np.maximum(gap.deviation, 1e-12),
        levels=[0.0, _UNCERTAIN],
        colors="none",
        hatches=["///"],
    )
    label = f"estimated gap [{diagnosis.channel.unit}]"
    _draw_bar(panel, filled, levels, label, _signed)


def _draw_lines(axes: Any, gap: Estimate, values: Any, levels: Array) -> None:
    """Draw contour lines, dashed below zero, and a thick one at zero."""
    widths = np.where(np.abs(levels) < 1e-9, 2.0, 0.8)
    styles = np.where(levels < -1e-9, "dashed", "solid").tolist()
    axes.contour(
        gap.across,
        gap.up,
        values,
        levels=levels,
        colors=SOFT,
        linewidths=widths,
        linestyles=styles,
    )


def _round_levels(low: float, high: float, most: int) -> Array:
    """Return round levels that cover a range, symmetric about zero where the range is."""
    from matplotlib.ticker import MaxNLocator

    locator = MaxNLocator(most, steps=_ROUND_STEPS, symmetric=low < 0.0)
    return np.asarray(locator.tick_values(low, high))


def _few(levels: Array) -> Array:
    """Return the levels that a colour bar names: about four, zero among them."""
    zero = int(np.abs(levels).argmin())
    step = max(1, -(-len(levels) // 5))
    return np.asarray(levels[zero % step :: step])


def _signed(value: float, _: int) -> str:
    """Return a value of the colour bar with its sign; matplotlib adds its position."""
    if abs(value) < 1e-9:
        return "0"
    return f"{value:+.3g}".replace("-", words.MINUS)


# --- samples and regions -------------------------------------------------------------------


def _drawn_rows(diagnosis: Diagnosis, stage: str | None) -> Rows:
    """Return the samples of a stage that are drawn."""
    rows = picked(diagnosis.residuals)
    return rows[np.isin(rows, rows_of_stage(diagnosis.samples, stage))]


def _marks(diagnosis: Diagnosis, stage: str | None = None) -> dict[str, _Marks]:
    """Return the marks of the samples by kind, large ones first so that small ones show."""
    values = diagnosis.residuals
    twice_noise = 2.0 * diagnosis.gap.noise
    rows = _drawn_rows(diagnosis, stage)
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


def _legend(diagnosis: Diagnosis) -> Legend:
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
    line = icon("mark-line", _draw_dashes)
    legend.append(("dashed contours: bench below model; thick: no gap", line))
    return legend


def _draw_hatch(axes: Any) -> None:
    axes.fill_between(
        (0.05, 0.95), 0.05, 0.95, facecolor="w", edgecolor=INK, hatch="///", lw=0.6
    )


def _draw_dashes(axes: Any) -> None:
    axes.plot((0.0, 1.0), (0.65, 0.65), color=SOFT, lw=0.8, ls="dashed")
    axes.plot((0.0, 1.0), (0.25, 0.25), color=SOFT, lw=2.0)


def _scatter(axes: Any, kind: str, points: Any, heights: Any, name: str = "") -> None:
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
        gid=name or kind,
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
            # Regions have no limits along an axis that is only recorded.
            limits = region.limits.get(axis.name, _extent(diagnosis, axis))
            ends.append(np.multiply(limits, scale_of(axis).factor))
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
