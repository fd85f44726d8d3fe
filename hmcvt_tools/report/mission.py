# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Pictures and page of a mission: its course, where the energy goes, strategies side by side."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.transmission.ranges import RPM, Array

from ..mission import Mission
from ..mission.result import DIESEL_DENSITY
from .style import BLUE, INK, ORANGE, SOFT, loss_style, render, styled, to_svg

_COURSE_SIZE = (10.5, 14.0)  # in
_FLOW_SIZE = (12.0, 8.0)
_BARS_SIZE = (9.0, 4.0)
_SMALLEST_FRACTION = 0.01  # of the engine work: smaller parts are drawn as one
_SMALLEST_LOSS = 0.02  # of the largest loss at any step
_GAP = 0.03  # of the height of the flow, between two bands at its end
_OTHERS = "others, below 1 % each"

# Losses that only a mission has; the others are filled as everywhere.
_STYLES: Mapping[str, tuple[str, str]] = {
    "final drive": ("#6b7680", ""),
    "wheel slip": ("#b7d3a8", "//"),
    "rolling resistance": ("#d6e6c8", ""),
    "brakes": ("#f7e3dd", "xx"),
    "stage changes": ("#e0825a", "\\\\"),
    "pto drive": ("#c9b8dc", ""),
    _OTHERS: ("#eeeeee", ".."),
}


def draw_mission(figure: Any, mission: Mission) -> None:
    """Draw demand, stage, engine speed, displacement ratio, losses by part and fuel over time.

    Args:
        figure: empty matplotlib figure.
        mission: what is shown.
    """
    figure.set_size_inches(*_COURSE_SIZE)
    panels = figure.subplots(
        6, 1, sharex=True, height_ratios=(1.3, 0.9, 1.0, 1.0, 1.8, 1.0)
    )
    time = mission.cycle.time
    figure.suptitle(
        f"{mission.cycle.name}, strategy {mission.strategy}: {mission.fuel:.2f} kg of fuel",
        x=0.01,
        ha="left",
    )
    _draw_demand(panels[0], mission)
    _draw_stages(panels[1], mission)
    panels[2].plot(time, mission.engine_speed / RPM, color=BLUE, lw=1.2)
    panels[2].set_ylabel("engine speed\n[r/min]")
    panels[3].plot(time, mission.displacement_ratio, color=BLUE, lw=1.2)
    panels[3].set(ylabel="displacement\nratio [-]", ylim=(-1.05, 1.05))
    _draw_losses(panels[4], mission)
    panels[5].plot(time, 3600.0 * mission.fuel_rate, color=INK, lw=1.2)
    panels[5].set(ylabel="fuel\n[kg/h]", xlabel="time [s]", xlim=(time[0], time[-1]))
    panels[5].set_ylim(bottom=0.0)
    for axes in panels:
        for complaint in mission.unmet:
            axes.axvline(complaint.time, color=ORANGE, lw=0.8, zorder=-1)
    figure.align_ylabels(panels)


def _draw_demand(axes: Any, mission: Mission) -> None:
    cycle = mission.cycle
    demands = (
        ("output", cycle.output_power, BLUE, "-"),
        ("PTO", cycle.pto_power, ORANGE, "--"),
        ("auxiliary", cycle.auxiliary_power, SOFT, ":"),
    )
    for name, watts, colour, line in demands:
        if np.nanmax(watts, initial=0.0) > 0.0:
            axes.plot(
                cycle.time, 1e-3 * watts, color=colour, ls=line, lw=1.2, label=name
            )
    axes.set_ylabel("demand [kW]")
    axes.set_ylim(bottom=0.0)
    _legend_at_side(axes)


def _legend_at_side(axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5)
    )


def _draw_stages(axes: Any, mission: Mission) -> None:
    """Draw the stage engaged as a step line; one height for each stage."""
    names = [name for name in dict.fromkeys(mission.stage) if name]
    names.sort()
    heights = np.full(len(mission.stage), np.nan)
    for i, name in enumerate(mission.stage):
        if name:
            heights[i] = names.index(name)
    axes.step(mission.cycle.time, heights, where="post", color=BLUE, lw=1.4)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylabel="stage", ylim=(-0.4, len(names) - 0.6))


def _draw_losses(axes: Any, mission: Mission) -> None:
    """Draw the losses above each other, the steadiest lowest."""
    losses = _in_words(mission.powers.losses)
    largest = max(float(np.max(watts)) for watts in losses.values())
    below = np.zeros(len(mission.cycle))
    for name in _order(losses):
        watts = losses[name]
        if np.max(watts) < _SMALLEST_LOSS * largest:
            continue
        above = below + 1e-3 * np.maximum(watts, 0.0)
        style = _style(name)
        style["linewidth"] = 0.0
        axes.fill_between(
            mission.cycle.time, below, above, step="post", label=name, **style
        )
        below = above
    axes.set_ylabel("losses [kW]")
    axes.set_ylim(bottom=0.0)
    _legend_at_side(axes)


def _in_words(powers: Mapping[str, Any]) -> dict[str, Any]:
    return {name.replace("_", " "): watts for name, watts in powers.items()}


def _order(losses: Mapping[str, Array]) -> list[str]:
    """Return the losses by their energy, largest first; small stacks on top stay readable."""
    return sorted(losses, key=lambda name: -float(np.sum(losses[name])))


def _style(name: str) -> dict[str, Any]:
    if name not in _STYLES:
        return loss_style(name)
    fill, hatch = _STYLES[name]
    return {"facecolor": fill, "hatch": hatch, "edgecolor": INK, "linewidth": 0.6}


class _Band(NamedTuple):
    """A branch of the flow of energy."""

    name: str
    kilowatt_hours: float
    is_useful: bool


def draw_flow(figure: Any, mission: Mission) -> None:
    """Draw the flow of energy of a cycle, from the engine to useful work and losses (Sankey).

    Args:
        figure: empty matplotlib figure.
        mission: what is shown.
    """
    from matplotlib.patches import PathPatch, Rectangle

    figure.set_size_inches(*_FLOW_SIZE)
    axes = figure.subplots()
    axes.set_axis_off()
    bands = _bands(mission)
    total = sum(band.kilowatt_hours for band in bands)
    gap = _GAP * total
    end = 0.5 * gap * (len(bands) - 1)
    top = total + end
    start = total
    for band in bands:
        high = (start, top)
        low = (start - band.kilowatt_hours, top - band.kilowatt_hours)
        style = {"facecolor": BLUE, "edgecolor": INK, "linewidth": 0.6}
        if not band.is_useful:
            style = _style(band.name)
        axes.add_patch(PathPatch(_branch(high, low), **style))
        share = 100.0 * band.kilowatt_hours / total
        axes.text(
            1.01,
            0.5 * (high[1] + low[1]),
            f"{band.name}: {band.kilowatt_hours:.2f} kWh, {share:.1f} %",
            va="center",
            weight="bold" if band.is_useful else "normal",
        )
        start = low[0]
        top = low[1] - gap
    axes.add_patch(Rectangle((-0.06, 0.0), 0.06, total, facecolor=INK))
    source = f"engine\n{mission.energy.engine / 3.6e6:.2f} kWh"
    axes.text(-0.08, 0.5 * total, source, ha="right", va="center")
    axes.set(xlim=(-0.3, 1.75), ylim=(-end - gap, total + end + gap))
    axes.set_title(f"Flow of energy: {mission.cycle.name}, strategy {mission.strategy}")


def _bands(mission: Mission) -> list[_Band]:
    """Return the branches: useful work first, then losses, the small ones as one."""
    smallest = _SMALLEST_FRACTION * mission.energy.engine
    losses = _in_words(mission.energy.losses)
    bands = []
    for name, joules in _in_words(mission.energy.useful).items():
        if joules >= smallest:
            bands.append(_Band(name, joules / 3.6e6, True))
    for name in sorted(losses, key=lambda name: -losses[name]):
        if losses[name] >= smallest:
            bands.append(_Band(name, losses[name] / 3.6e6, False))
    others = mission.energy.engine / 3.6e6
    others -= sum(band.kilowatt_hours for band in bands)
    # Negative where motion or height gives energy back in the end.
    if others > 0.0:
        bands.append(_Band(_OTHERS, others, False))
    return bands


def _branch(high: tuple[float, float], low: tuple[float, float]) -> Any:
    """Return the outline of a branch from x = 0 to x = 1.

    Args:
        high: upper edge at its beginning and at its end.
        low: lower edge likewise.
    """
    from matplotlib.path import Path as Outline

    corners = [
        (0.0, high[0]),
        (0.5, high[0]),
        (0.5, high[1]),
        (1.0, high[1]),
        (1.0, low[1]),
        (0.5, low[1]),
        (0.5, low[0]),
        (0.0, low[0]),
        (0.0, high[0]),
    ]
    curve = [Outline.CURVE4] * 3
    codes = [Outline.MOVETO, *curve, Outline.LINETO, *curve, Outline.CLOSEPOLY]
    return Outline(corners, codes)


def draw_strategies(figure: Any, missions: Sequence[Mission]) -> None:
    """Draw the fuel of several strategies, and the least possible where it is known.

    Args:
        figure: empty matplotlib figure.
        missions: of one cycle.
    """
    figure.set_size_inches(*_BARS_SIZE)
    axes = figure.subplots()
    names = [mission.strategy for mission in missions]
    fuels = [mission.fuel for mission in missions]
    axes.barh(names, fuels, color=BLUE, edgecolor=INK)
    for i, mission in enumerate(missions):
        text = f"{mission.fuel:.3f} kg"
        if mission.above_bound is not None:
            text += f", {100.0 * mission.above_bound:+.2f} %"
        axes.text(mission.fuel + 0.02 * max(fuels), i, text, va="center")
    least = missions[0].bound
    if least is not None:
        axes.axvline(least.fuel, color=ORANGE, lw=2.0, ls="--")
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.set(
        xlim=(0.0, 1.45 * max(fuels)),
        xlabel="fuel [kg]",
        title=f"{missions[0].cycle.name}: fuel of the strategies"
        + ("" if least is None else " (dashed: least possible)"),
    )


def mission_page(missions: Sequence[Mission]) -> str:
    """Return the page of a mission; the first one is shown in full.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
    """
    first = missions[0]
    with styled() as figure:
        draw_mission(figure, first)
        course = to_svg(figure, "course", "Course of the mission over time")
    with styled() as figure:
        draw_flow(figure, first)
        flow = to_svg(figure, "flow", "Flow of energy of the mission")
    with styled() as figure:
        draw_strategies(figure, missions)
        strategies = to_svg(figure, "strategies", "Fuel of the strategies")
    return render(
        "mission.html.j2",
        missions=missions,
        first=first,
        density=DIESEL_DENSITY,
        course=course,
        flow=flow,
        strategies=strategies,
    )


def write_mission_page(
    missions: Sequence[Mission], path: str | os.PathLike[str]
) -> None:
    """Write the page of a mission, whole or not at all.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
        OSError: the file cannot be written.
    """
    write_atomically(Path(path), mission_page(missions))
