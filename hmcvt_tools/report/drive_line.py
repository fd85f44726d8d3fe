# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The best working points of the drive line, one panel per quantity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.optimum import DriveOptimum
from hmcvt_core.transmission.ranges import RPM, Array

from .style import EFFICIENCY_COLOURS
from .surface import LEVELS

_SIZE = (13.0, 9.6)  # in
_STAGE_COLOURS = "Set3"  # light, so that the names of the stages are readable on it
_LEVELS = 12
_OTHER_COLOURS = "cividis"

Grid = Sequence[Sequence[DriveOptimum]]


def draw_drive_line(
    figure: Any,
    output_speeds: Array,
    output_powers: Array,
    best: Grid,
    model: EfficiencyModel,
    engine: Engine | None = None,
) -> None:
    """Draw stage, engine speed, efficiency and fuel rate over output speed and power.

    Without an engine there is no fuel rate; the last panel shows the displacement ratio.

    Args:
        figure: empty matplotlib figure.
        output_speeds: axis, shape (a,) [rad/s].
        output_powers: axis, shape (b,) [W].
        best: b rows of a best points.
        model: of the transmission.
        engine: of the drive line.
    """
    figure.set_size_inches(*_SIZE)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    kilowatts = 1e-3 * output_powers
    stages = [name for name in model.stages if name in _stages_in(best)]
    goal = "least engine power" if engine is None else "least fuel"
    figure.suptitle(
        f"Best working points for {goal}: stages {', '.join(stages) or 'none'}",
        x=0.01,
        ha="left",
    )
    _draw_stages(panels[0, 0], output_speeds, kilowatts, best, stages)
    quantities = [
        (panels[0, 1], "engine_speed", 1.0 / RPM, "engine speed [r/min]"),
        (panels[1, 0], "efficiency", 100.0, "efficiency [%]"),
    ]
    if engine is None:
        quantities.append(
            (panels[1, 1], "displacement_ratio", 1.0, "displacement ratio [-]")
        )
    else:
        quantities.append((panels[1, 1], "fuel_rate", 3600.0, "fuel rate [kg/h]"))
    for axes, name, factor, label in quantities:
        values = factor * _values(best, name)
        look: dict[str, Any] = {"cmap": _OTHER_COLOURS, "levels": _LEVELS}
        if name == "efficiency":
            look = {"cmap": EFFICIENCY_COLOURS, "levels": LEVELS, "extend": "both"}
        _draw_quantity(axes, output_speeds, kilowatts, values, label, look)
    for axes in panels[1]:
        axes.set_xlabel("output speed [rad/s]")
    for axes in panels[:, 0]:
        axes.set_ylabel("output power [kW]")
    for axes in panels.flat:
        axes.grid(False)


def _stages_in(best: Grid) -> set[str]:
    names = set()
    for row in best:
        for point in row:
            if point.stage is not None:
                names.add(point.stage)
    return names


def _values(best: Grid, name: str) -> Array:
    rows = []
    for row in best:
        rows.append([getattr(point, name) for point in row])
    return np.array(rows, dtype=float)


def _draw_stages(
    axes: Any, speeds: Array, kilowatts: Array, best: Grid, stages: Sequence[str]
) -> None:
    """Colour the region of each stage, and name the colours below."""
    numbers = np.full((len(kilowatts), len(speeds)), np.nan)
    for i, row in enumerate(best):
        for j, point in enumerate(row):
            if point.stage is not None:
                numbers[i, j] = stages.index(point.stage)
    regions = axes.pcolormesh(
        speeds,
        kilowatts,
        np.ma.masked_invalid(numbers),
        cmap=_STAGE_COLOURS,
        vmin=-0.5,
        vmax=11.5,  # the map has twelve colours
        shading="nearest",
    )
    axes.set_title("stage")
    for number, stage in enumerate(stages):
        colour = regions.cmap(regions.norm(number))
        axes.plot([], [], "s", ms=12, color=colour, mec="0.4", label=stage)
    if stages:
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.03),
            ncols=len(stages),
            handletextpad=0.2,
            columnspacing=1.0,
        )


def _draw_quantity(
    axes: Any,
    speeds: Array,
    kilowatts: Array,
    values: Array,
    label: str,
    look: dict[str, Any],
) -> None:
    axes.set_title(label)
    if min(values.shape) < 2 or not np.isfinite(values).any():
        axes.text(
            0.5,
            0.5,
            "too few points",
            ha="center",
            va="center",
            transform=axes.transAxes,
        )
        return
    filled = axes.contourf(speeds, kilowatts, np.ma.masked_invalid(values), **look)
    axes.figure.colorbar(filled, ax=axes, pad=0.02)
