# SPDX-License-Identifier: Apache-2.0
"""Residuals before and after the effect is added, on one scale."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import words
from ...diagnosis.result import Diagnosis
from ...transmission.ranges import RPM
from . import svg
from .svg import Panel, Scale

Array = NDArray[np.float64]

WIDTH, HEIGHT = 460.0, 330.0
_AXES = {"engine_speed": ("engine speed [r/min]", 1.0 / RPM),
         "load_torque": ("load torque [N·m]", 1.0),
         "displacement_ratio": ("displacement ratio [-]", 1.0)}
_MOST_DOTS = 1500
_TREND_SAMPLES, _TREND_BINS = 24, 8


class _Axis(NamedTuple):
    label: str
    values: Array


class Residuals(NamedTuple):
    """The figure and what is to be said about it.

    Attributes:
        drawings: one panel, or two.
        beyond: dots outside the scale, drawn at its edge.
        thinned: whether a part of the samples only is drawn.
    """

    drawings: list[str]
    beyond: int
    thinned: bool


def residual_plot(found: Diagnosis) -> Residuals:
    """Draw the residuals at samples left out (or of the holdout) before and after."""
    before, after = found.residuals_before, found.residuals_after
    panels = [("Base model, refitted", before)]
    if found.verdict != "no_gap":
        ending = ("Best listed effect added" if found.verdict == "unexplained"
                  else "With the effect added")
        panels.append((ending, after))
    reach = _reach(found, [values for _, values in panels])
    axis = _axis(found)
    drawings = [_panel(found, title, values, axis, reach, i)
                for i, (title, values) in enumerate(panels)]
    beyond = sum(int(np.sum(np.abs(values) > reach)) for _, values in panels)
    return Residuals(drawings, beyond, len(before) > _MOST_DOTS)


def _reach(found: Diagnosis, panels: list[Array]) -> float:
    """Half height of the scale [-]: a few outliers do not flatten the rest."""
    sizes = np.abs(np.concatenate(panels))
    sizes = sizes[np.isfinite(sizes)]
    most = float(sizes.max()) if len(sizes) else 0.0
    usual = float(np.quantile(sizes, 0.95)) if len(sizes) else 0.0
    return 1.1 * max(min(most, 2.0 * usual), 2.5 * found.gap.noise)


def _axis(found: Diagnosis) -> _Axis:
    """Pick the axis along which the first place is narrowest."""
    n = len(found.residuals_before)
    if found.shrinkage.on != "cross-validation" or n != len(found.samples):
        return _Axis(f"sample of the {found.shrinkage.on}, in order of the file",
                     np.arange(1.0, n + 1.0))
    name = "engine_speed"
    if found.where:
        def width(axis: str) -> float:
            low, high = getattr(found.where[0], axis)
            return float((high - low) / max(np.ptp(getattr(found.samples, axis)), 1e-12))

        name = min(_AXES, key=width)
    label, factor = _AXES[name]
    return _Axis(label, np.asarray(getattr(found.samples, name)) * factor)


def _panel(
    found: Diagnosis, title: str, values: Array, axis: _Axis, reach: float, index: int
) -> str:
    limit, noise = 100.0 * reach, 100.0 * found.gap.noise
    panel = Panel(svg.padded(axis.values.tolist(), 66.0, WIDTH - 16.0),
                  Scale(-limit, limit, HEIGHT - 52.0, 34.0))
    band = svg.element("rect", class_="band", x=panel.x.start, y=panel.y(2.0 * noise),
                       width=panel.x.end - panel.x.start,
                       height=panel.y(-2.0 * noise) - panel.y(2.0 * noise))
    known = np.flatnonzero(np.isfinite(values))
    shown = known[:: -(-len(known) // _MOST_DOTS)] if len(known) else known
    dots = [_dot(panel, float(axis.values[i]), 100.0 * float(values[i])) for i in shown]
    rms = float(np.sqrt(np.mean(values[known] ** 2))) if len(known) else float("nan")
    size = f"{words.points(rms)} rms" if len(known) else "not known"
    heading = svg.element("text", svg.text(f"{title}: {size}"), class_="heading",
                          x=panel.x.start, y=20.0)
    return svg.drawing(
        f"residuals-{index}", f"{title}: measured minus predicted efficiency over {axis.label}",
        WIDTH, HEIGHT, heading, band, svg.x_axis(panel, axis.label),
        svg.y_axis(panel, "measured minus predicted [points]", 16.0), panel.frame(),
        svg.level(panel, 0.0), *dots, _trend(panel, axis.values[known], 100.0 * values[known]))


def _dot(panel: Panel, x: float, y: float) -> str:
    if panel.inside(x, y):
        return svg.dot(panel.x(x), panel.y(y), 3.0, "sample")
    edge = panel.y.end + 7.0 if y > 0.0 else panel.y.start - 7.0
    return svg.triangle(panel.x(x), edge, 5.0, y > 0.0, "beyond")


def _trend(panel: Panel, x: Array, y: Array) -> str:
    """Means over parts of the axis with equally many samples, if there are enough."""
    if len(x) < _TREND_SAMPLES:
        return ""
    order = np.argsort(x, kind="stable")
    corners = []
    for part in np.array_split(order, _TREND_BINS):
        mean = float(np.clip(y[part].mean(), panel.y.low, panel.y.high))
        corners.append(f"{panel.x(float(x[part].mean())):.1f},{panel.y(mean):.1f}")
    return svg.element("polyline", class_="trend", points=" ".join(corners))
