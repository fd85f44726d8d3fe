# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Residuals before and after the leading set of causes is added: panels and tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import BASE
from hmcvt_core.diagnosis.results.stages import (
    mean_and_rms,
    residuals_by_stage,
    stages_of,
)
from hmcvt_core.diagnosis.system import Axis
from hmcvt_core.transmission.ranges import Array

from .axes import in_words, picked, sample_names, scale_of, shown, step
from .gap_map import Figures
from .style import BLUE, few_ticks, styled, to_svg

_TREND_SAMPLES = 24  # fewer show no trend beyond their scatter
_TREND_BINS = 8


def residuals(diagnosis: Diagnosis) -> Figures:
    """Return the residuals at samples left out (or of the holdout) before and after."""
    label, _ = _across(diagnosis)
    panels = _panels(diagnosis)
    reach = _reach(diagnosis, panels)
    drawings = []
    for number, (title, values) in enumerate(panels.items()):
        with styled() as figure:
            _draw_panel(figure.subplots(), diagnosis, title, values, reach)
            tips = {
                "sample": in_words(diagnosis, diagnosis.judged, values, picked(values))
            }
            channel = words.plain(diagnosis.channel.name)
            heading = f"{title}: measured minus predicted {channel} over {label}"
            drawings.append(to_svg(figure, f"residuals-{number}", heading, tips))
    return drawings, []


def draw_residuals(figure: Any, diagnosis: Diagnosis, ax: Any = None) -> None:
    """Draw the residuals before and after.

    Args:
        figure: empty matplotlib figure.
        diagnosis: its residuals are drawn.
        ax: axes to draw the last panel into instead.
    """
    panels = _panels(diagnosis)
    reach = _reach(diagnosis, panels)
    if ax is not None:
        title, values = list(panels.items())[-1]
        _draw_panel(ax, diagnosis, title, values, reach)
        return
    all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, values) in zip(all_axes, panels.items(), strict=True):
        _draw_panel(axes, diagnosis, title, values, reach)


def residual_table(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return head and rows of the table of residuals, as text."""
    samples = diagnosis.judged
    channel = diagnosis.channel
    head = ["test"]
    columns = [sample_names(diagnosis, samples)]
    if len(stages_of(samples)) > 1:
        head.append("stage")
        columns.append([str(name) for name in samples.extra["stage"]])
    for axis in diagnosis.axes:
        scale = scale_of(axis)
        head.append(scale.label)
        columns.append(_texts(shown(samples, axis), scale.digits + 1))
    unit = "%" if channel.unit == "points" else channel.unit
    head.append(f"measured [{unit}]")
    columns.append(_texts(channel.factor * getattr(samples, channel.name), 2))
    for title, values in _panels(diagnosis).items():
        head.append(f"{title} [{channel.unit}]")
        columns.append(_texts(channel.factor * values, 2))
    rows = list(zip(*columns, strict=True))
    return {"head": tuple(head), "rows": rows[:: step(len(samples))]}


def _texts(values: Array, digits: int) -> list[str]:
    return [words.fixed(value, digits) for value in values]


def stage_rows(diagnosis: Diagnosis) -> list[tuple[Any, ...]]:
    """Return rows of the stages: samples, mean and rms of the residuals, before and after.

    Empty where the samples are of one stage.
    """
    samples = diagnosis.judged
    rows: dict[str, list[Any]] = {}
    for values in _panels(diagnosis).values():
        for stage, residuals in residuals_by_stage(samples, values).items():
            row = rows.setdefault(stage, [stage, str(len(residuals))])
            size = mean_and_rms(diagnosis, residuals)
            row += size or (words.NOTHING, words.NOTHING)
    return [tuple(row) for row in rows.values()]


def stage_head(diagnosis: Diagnosis) -> list[str]:
    """Return the head of `stage_rows`."""
    head = ["stage", "samples"]
    for title in _panels(diagnosis):
        head += [f"{title}: mean", "rms"]
    return head


def _panels(diagnosis: Diagnosis) -> dict[str, Array]:
    """Return residuals before and after by title."""
    panels = {"Base model, refitted": diagnosis.residuals_before}
    if diagnosis.delivered.kind != BASE:
        panels["Saved model"] = diagnosis.residuals_after
    return panels


def _reach(diagnosis: Diagnosis, panels: dict[str, Array]) -> float:
    """Return how far the axis of residuals reaches on either side."""
    largest = 2.5 * diagnosis.gap.noise
    for values in panels.values():
        largest = max(largest, float(np.nanmax(np.abs(values), initial=0.0)))
    return 1.1 * largest


def _across(diagnosis: Diagnosis) -> tuple[str, Array]:
    """Return label and values of the axis along which the first region is narrowest."""
    if diagnosis.where:
        axis = min(diagnosis.axes, key=lambda axis: _width(diagnosis, axis))
    else:
        speeds = [axis for axis in diagnosis.axes if axis.name.endswith("speed")]
        axis = speeds[0] if speeds else diagnosis.axes[0]
    return scale_of(axis).label, shown(diagnosis.judged, axis)


def _width(diagnosis: Diagnosis, axis: Axis) -> float:
    """Return the width of the first region along an axis, as a part of the samples' range."""
    span = float(np.ptp(getattr(diagnosis.samples, axis.name)))
    return float(np.ptp(diagnosis.where[0].limits[axis.name])) / max(span, 1e-12)


def _draw_panel(
    axes: Any, diagnosis: Diagnosis, title: str, values: Array, reach: float
) -> None:
    label, across = _across(diagnosis)
    known = np.flatnonzero(np.isfinite(values))
    rows = picked(values)
    factor = diagnosis.channel.factor
    noise = factor * diagnosis.gap.noise
    axes.axhspan(-2.0 * noise, 2.0 * noise, color="#e9edf1", lw=0.0)
    axes.axhline(0.0, color="0.4", lw=1.0)
    axes.scatter(
        across[rows],
        factor * values[rows],
        s=40.0,
        color=BLUE,
        alpha=0.75,
        edgecolors="w",
        linewidths=0.6,
        gid="sample",
    )
    if len(known) >= _TREND_SAMPLES:
        order = known[np.argsort(across[known], kind="stable")]
        bins = np.array_split(order, _TREND_BINS)
        axes.plot(
            [across[part].mean() for part in bins],
            [factor * values[part].mean() for part in bins],
            color="k",
            lw=2.4,
        )
    size = "not known"
    if len(known):
        rms = np.sqrt(np.mean(values[known] ** 2))
        size = f"{words.amount(diagnosis, rms)} rms"
    # Before and after share one range.
    axes.update_datalim(np.column_stack([across, across]))
    axes.autoscale_view()
    axes.set(
        ylim=(-factor * reach, factor * reach),
        xlabel=label,
        title=f"{title}: {size}",
        ylabel=f"measured minus predicted [{diagnosis.channel.unit}]",
    )
    few_ticks(axes)
