# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of an engine and of the lost power at operating points."""

from typing import Any

import numpy as np

from hmcvt_core.model.breakdown import Breakdown
from hmcvt_core.model.engine import Engine
from hmcvt_core.transmission.ranges import RPM

from .style import EFFICIENCY_COLOURS

_LEVELS = 12
_MAX_SPECIFIC = 400.0
"""Most that a map distinguishes [g/kWh]: close to no load the specific fuel has no bound."""


def draw_engine(figure: Any, engine: Engine, ax: Any = None) -> None:
    """Draw specific fuel over engine speed and torque, and the full-load curve.

    Args:
        figure: empty matplotlib figure.
        engine: to draw.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    specific = engine.specific_fuel
    # No torque has no specific fuel: it is drawn as the most.
    shown = np.fmin(specific, _MAX_SPECIFIC)
    speed = np.repeat(engine.speed[:, None] / RPM, len(engine.load), axis=1)
    torque = engine.full_load[:, None] * engine.load
    colours = f"{EFFICIENCY_COLOURS}_r"
    filled = axes.contourf(speed, torque, shown, levels=_LEVELS, cmap=colours)
    axes.plot(engine.speed / RPM, engine.full_load, color="black", label="full load")
    axes.set(
        xlabel="engine speed [r/min]",
        ylabel="torque [N m]",
        title="Specific fuel of the engine",
    )
    axes.legend()
    figure.colorbar(filled, ax=axes, label="fuel [g/kWh]", pad=0.02)


def draw_breakdown(figure: Any, breakdown: Breakdown, ax: Any = None) -> None:
    """Draw the lost power of each part, the mean over the points with an answer.

    Args:
        figure: empty matplotlib figure.
        breakdown: to draw.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    means = breakdown.mean_losses()
    names = [name.replace("_", " ") for name in means]
    axes.barh(names, list(means.values()))
    axes.invert_yaxis()
    title = "Where the power goes"
    if breakdown.stage:
        title = f"{title}, stage {breakdown.stage}"
    axes.set(xlabel="lost power [W]", title=title)
