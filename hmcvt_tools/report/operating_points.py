# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where a machine works, by its log: hours over engine speed and load torque, and by stage."""

from __future__ import annotations

from typing import Any

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import RPM

from ..estimation import Estimate
from ..estimation.totals import SPEED_WIDTH, TORQUE_WIDTH
from .style import BLUE

_SIZE = (12.0, 5.4)  # in
_COLOURS = "viridis"
_HOUR = 3600.0


def draw_operating_points(figure: Any, estimate: Estimate, ax: Any = None) -> None:
    """Draw the hours at each engine speed and load torque, and the hours by stage.

    Args:
        figure: empty matplotlib figure.
        estimate: of one log or several.
        ax: axes for the first panel; the second one is left out then.

    Raises:
        InputError: no row of the log has an operating point.
    """
    rows = estimate.totals.map_rows()
    if not rows:
        raise InputError(f"{estimate.source}: no operating point to draw")
    if ax is None:
        figure.set_size_inches(*_SIZE)
        axes, bars = figure.subplots(1, 2, width_ratios=(3, 2))
        _draw_stages(bars, estimate)
    else:
        axes = ax
    speed = np.array([row["engine_speed"] for row in rows]) / RPM
    torque = np.array([row["load_torque"] for row in rows])
    hours = np.array([row["seconds"] for row in rows]) / _HOUR
    edges = [_edges(speed, SPEED_WIDTH / RPM), _edges(torque, TORQUE_WIDTH)]
    counts, _, _ = np.histogram2d(speed, torque, edges, weights=hours)
    shown = np.where(counts > 0.0, counts, np.nan)
    mesh = axes.pcolormesh(edges[0], edges[1], shown.T, cmap=_COLOURS)
    axes.set(
        xlabel="engine speed [r/min]",
        ylabel="load torque [N m]",
        title="Where the machine works",
    )
    figure.colorbar(mesh, ax=axes, label="hours", pad=0.02)


def _edges(middles: Any, width: float) -> Any:
    low = middles.min() - 0.5 * width
    count = round((middles.max() - middles.min()) / width) + 1
    return low + width * np.arange(count + 1)


def _draw_stages(axes: Any, estimate: Estimate) -> None:
    stages = sorted(estimate.totals.stages)
    hours = [estimate.totals.stages[name] / _HOUR for name in stages]
    axes.barh(stages, hours, color=BLUE)
    axes.invert_yaxis()
    axes.set(xlabel="hours", title="Hours by stage")
