# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Picture of the drive line's best working points over output speed and output power."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.drive_line import DriveOptimum
from ..transmission.ranges import RPM

Array = NDArray[np.float64]
_REGIONS = "Pastel1"
_FUEL = 3600.0  # kg/h


def draw_drive_map(
    figure: Any, output_speed: Array, output_power: Array, best: Sequence[Sequence[DriveOptimum]],
    stages: Sequence[str],
) -> None:
    """Draw stage regions, engine speed and fuel on an empty matplotlib figure.

    Args:
        figure: of matplotlib.
        output_speed, output_power: axes of shape (a,) [rad/s] and (b,) [W].
        best: the best points, a rows of b.
        stages: every stage, which keeps its colour whatever the map shows.
    """
    axes = figure.subplots()
    x, y = output_speed, 1e-3 * output_power

    def grid(name: str, factor: float) -> Any:
        return np.ma.masked_invalid(factor * np.array(
            [[getattr(each, name) for each in row] for row in best], dtype=float).T)

    number = np.array([[np.nan if each.stage is None else stages.index(each.stage)
                        for each in row] for row in best], dtype=float).T
    colours = axes.pcolormesh(
        x, y, np.ma.masked_invalid(number), cmap=_REGIONS, vmin=-0.5, vmax=8.5, shading="nearest")
    for name, factor, style, colour, form in (
            ("engine_speed", 1.0 / RPM, "-", "0.2", "%.0f r/min"),
            ("fuel_rate", _FUEL, "--", "tab:red", "%.0f kg/h")):
        values = grid(name, factor)
        if values.count() and np.ptp(values.compressed()) > 0.0:
            lines = axes.contour(x, y, values, levels=7, colors=colour, linestyles=style,
                                 linewidths=0.9)
            axes.clabel(lines, fmt=form, fontsize=10)
    for i, name in enumerate(stages):
        if (number == i).any():
            axes.plot([], [], "s", ms=12, color=colours.cmap(colours.norm(i)), label=name)
    axes.set(xlabel="output speed [rad/s]", ylabel="output power [kW]",
             title="Best stage (colour), engine speed (lines) and fuel (dashed)")
    axes.grid(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=6)
