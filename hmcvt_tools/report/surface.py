# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency of one stage at one output power, over engine speed and speed ratio."""

from __future__ import annotations

from typing import Any

import numpy as np

from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.model.domain import Domain, EfficiencyMap
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import (
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    RPM,
    Array,
)
from hmcvt_core.transmission.stage import speed_ratio

from .style import EFFICIENCY_COLOURS, INK, ORANGE

_STROKES = 161  # points of the grid
_SPEEDS = 121
_LINE_POINTS = 60  # of the lines of best points
LEVELS = np.array([30, 40, 50, 60, 65, 70, 75, 80, 85, 90, 95])
"""Limits of the colours of an efficiency [%]."""

_JUMP = 0.003
"""Of the range of engine speeds: a line of best points that falls back by more is broken there."""

SAME_POWER = 0.15
"""Tests within this part of the power of the picture are marked in it."""

_MAX_NUMBERS = 30
"""Tests with their residual written at them; more numbers than that would overlap."""


def draw_surface(
    figure: Any,
    model: EfficiencyModel,
    power: float,
    engine_speeds: tuple[float, float] = ENGINE_SPEED_LIMITS,
    samples: BenchSamples | None = None,
    ax: Any = None,
) -> None:
    """Draw the efficiency at a load power over engine speed and transmission ratio.

    Args:
        figure: empty matplotlib figure.
        model: to draw, with its best points where it has an optimum.
        power: output power [W].
        engine_speeds: lowest and highest [rad/s].
        samples: bench tests to mark, each with measured - predicted in points.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    stroke, speed = np.meshgrid(
        np.linspace(-1.0, 1.0, _STROKES),
        np.linspace(*engine_speeds, _SPEEDS),
        indexing="ij",
    )
    torque = np.clip(power / speed, LOAD_TORQUE.low, LOAD_TORQUE.high)
    served = model.without_meters()
    efficiency = np.ma.masked_invalid(100.0 * served.efficiency(stroke, speed, torque))
    ratio = served.output_speed(stroke, speed, torque) / speed
    # A stalled point has no output speed; it stays blank at its ratio without slip.
    height = np.where(np.isnan(ratio), speed_ratio(model.stage, stroke), ratio)
    filled = axes.contourf(
        speed / RPM,
        height,
        efficiency,
        levels=LEVELS,
        extend="both",
        cmap=EFFICIENCY_COLOURS,
    )
    axes.contour(
        speed / RPM, height, efficiency, levels=LEVELS, colors="0.15", linewidths=0.6
    )
    if model.formulation == "power_balance":  # `published` has no optimum to draw
        _draw_best(axes, model, power, engine_speeds, height)
    if model.domain is not None:
        _draw_domain(axes, served, model.domain, power, engine_speeds)
    if samples is not None:
        _draw_samples(axes, model, samples, power)
    axes.set(
        xlabel="engine speed [r/min]",
        ylabel="output speed / engine speed [-]",
        title=f"Efficiency at {1e-3 * power:g} kW, stage {model.stage.name}",
    )
    axes.grid(False)
    axes.figure.colorbar(filled, ax=axes, label="efficiency [%]", pad=0.02)
    if ax is None:
        figure.legend(loc="outside lower center", ncols=2)
    else:
        axes.legend()


def _cased(width: float) -> list[Any]:
    """Return the effect that puts a white edge around a line, so that it shows on any colour."""
    from matplotlib import patheffects

    return [patheffects.withStroke(linewidth=width, foreground="w")]


def _draw_best(
    axes: Any,
    model: EfficiencyModel,
    power: float,
    limits: tuple[float, float],
    height: Array,
) -> None:
    """Draw the best points at every engine speed, and at every output speed."""
    speed = np.linspace(*limits, _LINE_POINTS)
    best = model.optimal_displacement_ratio(speed, power / speed)
    axes.plot(
        speed / RPM,
        best.output_speed / speed,
        color=INK,
        lw=2.6,
        ls="--",
        path_effects=_cased(5.0),
        label="best at an engine speed",
    )
    lowest = min(0.0, np.nanmin(height)) * limits[1]
    target = np.linspace(lowest, np.nanmax(height) * limits[1], 3 * _LINE_POINTS)
    target = target[OUTPUT_SPEED.contains(np.abs(target))]
    pair = model.optimal_displacement_ratio(
        speed[0],
        power / speed[0],
        hold="output_speed",
        output_speed=target,
        engine_speed_limits=limits,
    )
    line = np.stack([pair.engine_speed / RPM, target / pair.engine_speed])
    steps = np.diff(pair.engine_speed)
    jumps = np.flatnonzero(steps < -_JUMP * np.ptp(limits)) + 1
    across, up = np.insert(line, jumps, np.nan, axis=1)
    axes.plot(
        across,
        up,
        color=ORANGE,
        lw=3.0,
        path_effects=_cased(5.4),
        label="best at an output speed",
    )


def _draw_domain(
    axes: Any,
    model: EfficiencyModel,
    domain: Domain,
    power: float,
    limits: tuple[float, float],
) -> None:
    """Outline how far the data of the identification reach at this power, if they do."""
    low = max(domain.engine_speed[0], power / domain.load_torque[1], limits[0])
    high = min(domain.engine_speed[1], power / domain.load_torque[0], limits[1])
    if low > high:
        axes.plot([], [], " ", label="no data at this power")
        return
    speed = np.linspace(low, high, _LINE_POINTS)
    lower, upper = domain.displacement_ratio
    bottom = model.output_speed(lower, speed, power / speed) / speed
    top = model.output_speed(upper, speed, power / speed) / speed
    axes.plot(
        np.concatenate([speed, speed[::-1], speed[:1]]) / RPM,
        np.concatenate([bottom, top[::-1], bottom[:1]]),
        color="0.1",
        lw=2.2,
        ls=":",
        path_effects=_cased(4.4),
        label="data of the identification",
    )


def _draw_samples(
    axes: Any, model: EfficiencyModel, samples: BenchSamples, power: float
) -> None:
    """Mark the tests of this stage and power."""
    deviation = samples.load_torque * samples.engine_speed / power - 1.0
    shown = np.abs(deviation) <= SAME_POWER
    if samples.points.stage is not None:
        shown &= samples.points.stage == model.stage.name
    which = f"of this power (\u00b1 {100.0 * SAME_POWER:g} %)"
    if not shown.any():
        axes.plot([], [], " ", label=f"no test {which}")
        return
    samples = samples.select(shown)
    residual = 100.0 * (samples.efficiency - model.efficiency(*samples.points))
    ratio = model.output_speed(*samples.points) / samples.engine_speed
    has_numbers = len(samples) <= _MAX_NUMBERS
    axes.plot(
        samples.engine_speed / RPM,
        ratio,
        "o",
        ms=9,
        mfc="w",
        mec="k",
        mew=1.8,
        ls="none",
        clip_on=False,
        label=f"bench - model, tests {which}" if has_numbers else f"tests {which}",
    )
    if not has_numbers:
        return
    for across, up, gap in zip(
        samples.engine_speed / RPM, ratio, residual, strict=True
    ):
        axes.annotate(
            f"{gap:+.1f}",
            (across, up),
            xytext=(8, 6),
            textcoords="offset points",
            bbox={"boxstyle": "round,pad=0.15", "fc": "w", "ec": "none", "alpha": 0.85},
        )


def draw_map(
    figure: Any,
    shown: EfficiencyMap,
    load_torque: float | None = None,
    ax: Any = None,
) -> None:
    """Draw a map of the efficiency over engine speed and displacement ratio.

    Args:
        figure: empty matplotlib figure.
        shown: the map.
        load_torque: the nearest of its axis is drawn [N m]; the middle one when left out.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    index = len(shown.load_torque) // 2
    if load_torque is not None:
        index = int(np.abs(shown.load_torque - load_torque).argmin())
    colours = axes.pcolormesh(
        shown.engine_speed / RPM,
        shown.displacement_ratio,
        np.ma.masked_invalid(100.0 * shown.efficiency[:, :, index]),
        cmap=EFFICIENCY_COLOURS,
        shading="nearest",
    )
    axes.set(
        xlabel="engine speed [r/min]",
        ylabel="displacement ratio [-]",
        title=f"Efficiency at {shown.load_torque[index]:g} N m",
    )
    axes.grid(False)
    figure.colorbar(colours, ax=axes, label="efficiency [%]", pad=0.02)
