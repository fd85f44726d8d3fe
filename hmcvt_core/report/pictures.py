# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of fits, losses and efficiency maps, and the files that hold them."""

import os
from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import write_atomically
from ..files.bench import BenchSamples
from ..identification import Identification
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..model.optimum import DriveOptimum
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from ..transmission.ranges import (
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    RPM,
    Array,
)
from ..transmission.stage import speed_ratio
from .style import (
    BLUE,
    LOSSES,
    ORANGE,
    loss_style,
    picture_format,
    render,
    styled,
    to_png,
    to_svg,
)

STROKES = np.linspace(-1.0, 1.0, 201)

_SIZE = (10.0, 6.4)
_STROKES, _SPEEDS, _BEST = 161, 121, 60
_LEVELS = np.array([30, 40, 50, 60, 65, 70, 75, 80, 85, 90, 95])
_GREYS = np.linspace(
    0.2, 0.92, len(_LEVELS) + 1
)  # white is kept for what has no efficiency
_BACK = 0.003  # of the speeds: a line that rises goes back so far only where the best point jumps
_SAME_POWER = 0.15
_LEAST = 1e-3  # of the largest loss; what never takes more is not drawn


def save(draw: Callable[..., None], path: str | os.PathLike[str], *shown: Any) -> None:
    """Draw on an empty matplotlib figure and write it, whole or not at all.

    Args:
        draw: takes the figure, and what is shown.
        path: ends in one of `FORMATS`; an HTML page holds the picture in itself.

    Raises:
        InputError: see `picture_format`.
        OSError: the file cannot be written.
    """
    ending = picture_format(os.fspath(path))
    content: str | bytes
    with styled(_SIZE) as figure:
        draw(figure, *shown)
        if ending == ".png":
            content = to_png(figure)
        else:
            title = figure.axes[0].get_title(loc="left").splitlines()[0]
            content = to_svg(figure, "picture", title)
            if ending == ".html":
                content = render("picture.html.j2", title=title, picture=content)
    write_atomically(Path(path), content)


def drawn(
    draw: Callable[..., None], *shown: Any, ax: Any = None, **options: Any
) -> Any:
    """Return a matplotlib figure that a notebook shows.

    Args:
        draw: takes an empty figure, what is shown, and the axes as `ax` where there are some.
        shown: what is shown.
        ax: matplotlib Axes to draw into; None makes a figure.
        options: of `draw`.
    """
    if ax is not None:
        draw(ax.figure, *shown, ax=ax, **options)
        return ax.figure
    with styled(_SIZE) as figure:
        draw(figure, *shown, **options)
    figure._repr_png_ = lambda: to_png(figure, 80)
    return figure


def draw_fit(
    figure: Any, found: Identification, held_back: BenchSamples | None = None
) -> None:
    """Draw measured over predicted efficiency on an empty matplotlib figure.

    Both with their uncertainty; `held_back` are samples that the identification did not see.
    """
    figure.set_size_inches(7.6, 8.2)
    axes = figure.subplots()
    sets = [("fitted", found.samples, "o", BLUE)]
    if held_back is not None:
        sets.append(("held back", held_back, "s", ORANGE))
    seen: list[Array] = []
    for name, samples, marker, colour in sets:
        predicted = found.model.predict(*samples.points)
        deviation = (
            PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency
            if samples.efficiency_std is None
            else samples.efficiency_std
        )
        axes.errorbar(
            100.0 * predicted.efficiency,
            100.0 * samples.efficiency,
            xerr=100.0 * np.nan_to_num(predicted.standard_error),
            yerr=100.0 * deviation,
            fmt=marker,
            ms=10,
            color=colour,
            capsize=4,
            lw=1.6,
            label=f"{name} ({len(samples)})",
        )
        seen += [predicted.efficiency, samples.efficiency]
    low, high = np.nanmin(np.concatenate(seen)), np.nanmax(np.concatenate(seen))
    margin = max(0.15 * (high - low), 0.01)
    line = 100.0 * np.array([low - margin, high + margin])
    axes.plot(line, line, color="0.35", lw=1.4, zorder=0)
    axes.fill_between(
        line,
        line * 0.98,
        line * 1.02,
        color="0.9",
        lw=0,
        zorder=-1,
        label="2 % of measured",
    )
    held = (
        ""
        if found.prediction_error is None
        else (f", {100.0 * found.prediction_error:.2f} % held back")
    )
    axes.set(
        xlim=line,
        ylim=line,
        aspect="equal",
        xlabel="predicted efficiency [%]",
        ylabel="measured efficiency [%]",
        title=f"Measured against predicted\nmean error {100.0 * found.fit_error:.2f} % "
        f"fitted{held}",
    )
    axes.legend(loc="upper left")


def draw_surface(
    figure: Any,
    model: EfficiencyModel,
    power: float,
    engine_speeds: tuple[float, float] = ENGINE_SPEED_LIMITS,
    samples: BenchSamples | None = None,
) -> None:
    """Draw the efficiency at a load power over engine speed and transmission ratio.

    Args:
        figure: of matplotlib, empty.
        model: to draw, with its best points where it has an optimum.
        power: output power [W].
        engine_speeds: lowest and highest [rad/s].
        samples: bench tests to mark, each with measured - predicted in points.
    """
    axes = figure.subplots()
    stroke, speed = np.meshgrid(
        np.linspace(-1.0, 1.0, _STROKES),
        np.linspace(*engine_speeds, _SPEEDS),
        indexing="ij",
    )
    torque = np.clip(power / speed, LOAD_TORQUE.low, LOAD_TORQUE.high)
    served = model.without_meters()
    efficiency = np.ma.masked_invalid(100.0 * served.efficiency(stroke, speed, torque))
    ratio = served.output_speed(stroke, speed, torque) / speed
    # A stalled point has no output speed to be drawn at; it stays blank where it would be.
    at = np.where(np.isnan(ratio), speed_ratio(model.stage, stroke), ratio)
    filled = axes.contourf(
        speed / RPM,
        at,
        efficiency,
        levels=_LEVELS,
        extend="both",
        colors=[f"{shade:.3f}" for shade in _GREYS],
    )
    lines = axes.contour(
        speed / RPM, at, efficiency, levels=_LEVELS, colors="0.15", linewidths=0.9
    )
    for text in axes.clabel(lines, fmt="%g %%", fontsize=12):
        text.set_bbox(
            {"boxstyle": "round,pad=0.1", "fc": "w", "ec": "none", "alpha": 0.85}
        )
    if model.formulation == "power_balance":  # the other has no optimum to draw
        _draw_best(axes, model, power, engine_speeds, at)
    if model.domain is not None:
        _draw_domain(axes, served, model.domain, power, engine_speeds)
    if samples is not None:
        _draw_samples(axes, model, samples, power)
    axes.set(
        xlabel="engine speed [r/min]",
        ylabel="output speed / engine speed [-]",
        title=f"Efficiency at {1e-3 * power:g} kW",
    )
    axes.grid(False)
    figure.colorbar(filled, ax=axes, label="efficiency [%]", pad=0.02)
    axes.legend(loc="upper center", bbox_to_anchor=(0.55, -0.14), ncols=2)


def draw_drive_line(
    figure: Any,
    output_speeds: Array,
    output_powers: Array,
    best: Sequence[Sequence[DriveOptimum]],
) -> None:
    """Draw stage regions, engine speed and fuel of the drive line's best points.

    Args:
        figure: of matplotlib, empty.
        output_speeds, output_powers: axes, shape (a,), (b,) [rad/s, W].
        best: b rows of a points.
    """
    axes, kilowatts = figure.subplots(), 1e-3 * output_powers
    stages = list(
        dict.fromkeys(point.stage for row in best for point in row if point.stage)
    )
    number = np.array(
        [
            [stages.index(point.stage) if point.stage else np.nan for point in row]
            for row in best
        ]
    )
    colours = axes.pcolormesh(
        output_speeds,
        kilowatts,
        np.ma.masked_invalid(number),
        cmap="Pastel1",
        vmin=-0.5,
        vmax=8.5,
        shading="nearest",
    )
    for name, factor, style, colour, form in (
        ("engine_speed", 1.0 / RPM, "-", "0.2", "%.0f r/min"),
        ("fuel_rate", 3600.0, "--", ORANGE, "%.3g kg/h"),
    ):
        values = factor * np.array(
            [[getattr(point, name) for point in row] for row in best]
        )
        if min(values.shape) > 1 and np.isfinite(values).any():
            lines = axes.contour(
                output_speeds,
                kilowatts,
                np.ma.masked_invalid(values),
                levels=7,
                colors=colour,
                linestyles=style,
                linewidths=0.9,
            )
            axes.clabel(lines, fmt=form, fontsize=10)
    for i, stage in enumerate(stages):
        axes.plot([], [], "s", ms=12, color=colours.cmap(colours.norm(i)), label=stage)
    axes.set(
        xlabel="output speed [rad/s]",
        ylabel="output power [kW]",
        title="Best stage (colour), engine speed (lines), fuel (dashed)",
    )
    axes.grid(False)
    if stages:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(stages))


def _draw_best(
    axes: Any,
    model: EfficiencyModel,
    power: float,
    limits: tuple[float, float],
    ratio: Array,
) -> None:
    speed = np.linspace(*limits, _BEST)
    best = model.optimal_displacement_ratio(speed, power / speed)
    axes.plot(
        speed / RPM,
        best.output_speed / speed,
        color=BLUE,
        lw=2.6,
        ls="--",
        label="best at an engine speed",
    )
    target = np.linspace(
        min(0.0, np.nanmin(ratio)) * limits[1], np.nanmax(ratio) * limits[1], 3 * _BEST
    )
    target = target[OUTPUT_SPEED.contains(np.abs(target))]
    pair = model.optimal_displacement_ratio(
        speed[0],
        power / speed[0],
        hold="output_speed",
        output_speed=target,
        engine_speed_limits=limits,
    )
    at = np.stack([pair.engine_speed / RPM, target / pair.engine_speed])
    jumps = np.flatnonzero(np.diff(pair.engine_speed) < -_BACK * np.ptp(limits)) + 1
    broken = np.insert(at, jumps, np.nan, axis=1)
    axes.plot(*broken, color=ORANGE, lw=3.0, label="best at an output speed")


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
    speed = np.linspace(low, high, _BEST)
    ends = [
        model.output_speed(stroke, speed, power / speed) / speed
        for stroke in domain.displacement_ratio
    ]
    axes.plot(
        np.concatenate([speed, speed[::-1], speed[:1]]) / RPM,
        np.concatenate([ends[0], ends[1][::-1], ends[0][:1]]),
        color="0.1",
        lw=2.2,
        ls=":",
        label="data of the identification",
    )


def _draw_samples(
    axes: Any, model: EfficiencyModel, samples: BenchSamples, power: float
) -> None:
    """Mark the tests of this power; others have no place in the picture."""
    near = (
        np.abs(samples.load_torque * samples.engine_speed / power - 1.0) <= _SAME_POWER
    )
    if samples.points.stage is not None:
        near &= samples.points.stage == model.stage.name
    told = f"of this power (\u00b1 {100.0 * _SAME_POWER:g} %)"
    if not near.any():
        axes.plot([], [], " ", label=f"no test {told}")
        return
    samples = samples.select(near)
    residual = 100.0 * (samples.efficiency - model.efficiency(*samples.points))
    ratio = model.output_speed(*samples.points) / samples.engine_speed
    numbered = len(samples) <= 30  # more numbers than that the eye cannot part
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
        label=f"bench - model, tests {told}" if numbered else f"tests {told}",
    )
    marks = zip(samples.engine_speed / RPM, ratio, residual, strict=True)
    for x, y, gap in marks if numbered else ():
        axes.annotate(
            f"{gap:+.1f}",
            (x, y),
            xytext=(8, 6),
            textcoords="offset points",
            fontsize=12,
            bbox={"boxstyle": "round,pad=0.15", "fc": "w", "ec": "none", "alpha": 0.85},
        )


def lost_power(
    model: EfficiencyModel,
    engine_speed: float,
    load_torque: float,
    oil_temperature: float | None = None,
) -> dict[str, Array]:
    """Return the watts of each part at all `STROKES`; NaN where the load stalls it.

    Parts are in words, gear pairs are one.

    Args:
        model: of formulation `power_balance`.
        engine_speed, load_torque, oil_temperature: [rad/s], [N m], [deg C].
    """
    parts: dict[str, Array] = {}
    for name, watts in model.breakdown(
        STROKES, engine_speed, load_torque, oil_temperature
    ).losses.items():
        part = "gear pairs" if name.startswith("gear_pair_") else name.replace("_", " ")
        parts[part] = parts.get(part, 0.0) + np.broadcast_to(watts, STROKES.shape)
    # What turns idly loses something known even where the load cannot be carried: drop it.
    stalled = np.isnan(sum(parts.values()))
    return {part: np.where(stalled, np.nan, watts) for part, watts in parts.items()}


def worth_drawing(*balances: Mapping[str, Array]) -> list[str]:
    """Return the parts that take anything to be seen, in the order of the stack."""
    most = {
        part: max(
            np.nanmax(np.abs(each.get(part, 0.0)), initial=0.0) for each in balances
        )
        for part in dict.fromkeys(chain(*balances))
    }
    order = (
        *(part for part in LOSSES if part in most),
        *sorted(most.keys() - LOSSES.keys()),
    )
    return [part for part in order if most[part] >= _LEAST * max(most.values())]


def scale(*balances: Mapping[str, Array]) -> tuple[float, float]:
    """Return limits of an axis that holds the stacks of balances."""
    stacks = [np.nan_to_num(np.stack(list(balance.values()))) for balance in balances]
    low = min(float(np.minimum(each, 0.0).sum(axis=0).min()) for each in stacks)
    high = max(float(np.maximum(each, 0.0).sum(axis=0).max()) for each in stacks) or 1.0
    return (1.05 * low if -low > _LEAST * high else 0.0), 1.05 * high


def stack(axes: Any, balance: Mapping[str, Array], parts: Sequence[str]) -> None:
    """Draw parts of a balance above each other, lowest first and gains below zero.

    The `gid` is the part.
    """
    lost = gained = np.zeros(len(STROKES))
    for part in (part for part in parts if part in balance):
        above = lost + np.maximum(balance[part], 0.0)
        below = gained + np.minimum(balance[part], 0.0)
        style = loss_style(part)
        axes.fill_between(STROKES, lost, above, label=part, gid=part, **style)
        if np.any(below < gained):
            axes.fill_between(STROKES, below, gained, **style)
        lost, gained = above, below
    missing = np.concatenate([[False], np.isnan(lost), [False]])
    for start, end in np.flatnonzero(np.diff(missing)).reshape(-1, 2):
        axes.text(
            STROKES[start:end].mean(),
            0.5,
            "no answer",
            rotation=90,
            ha="center",
            va="center",
            transform=axes.get_xaxis_transform(),
        )
    axes.tick_params(pad=8.0)  # the numbers at the corner stay apart
    axes.set(xlim=STROKES[[0, -1]], xlabel="displacement ratio [-]")


def draw_losses(
    figure: Any,
    model: EfficiencyModel,
    engine_speed: float,
    load_torque: float,
    displacement_ratio: float | None = None,
) -> None:
    """Draw the lost part of the input power, part by part, on an empty matplotlib figure.

    Args:
        model: of formulation `power_balance`.
        engine_speed, load_torque: [rad/s], [N m].
        displacement_ratio: a point to mark [-].
    """
    axes = figure.subplots()
    power = model.breakdown(STROKES, engine_speed, load_torque).input_power
    balance = {
        part: 100.0 * watts / power
        for part, watts in lost_power(model, engine_speed, load_torque).items()
    }
    stack(axes, balance, worth_drawing(balance))
    if displacement_ratio is not None:
        axes.axvline(displacement_ratio, color="k", lw=1.6, ls="--")
    axes.set(
        ylim=scale(balance),
        ylabel="lost, % of engine power",
        title=f"Where the watts go: {engine_speed / RPM:.0f} r/min, {load_torque:g} N m",
    )
    axes.legend(
        *(entries[::-1] for entries in axes.get_legend_handles_labels()),
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
