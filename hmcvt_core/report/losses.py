# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the watts go, part by part, over the displacement ratio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from operator import methodcaller
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..diagnosis import words
from ..model.model import EfficiencyModel
from ..transmission.ranges import RPM
from .style import LOSSES, Figures, few_ticks, icon, loss_style, styled, to_svg

Array = NDArray[np.float64]

STROKES = np.linspace(-1.0, 1.0, 201)
_LEAST = 1e-3  # of the largest part; what never takes more is not drawn


def lost_power(
    model: EfficiencyModel, engine_speed: float, load_torque: float,
    oil_temperature: float | None = None,
) -> dict[str, Array]:
    """Return the watts of each part at all `STROKES`; NaN where the load stalls it.

    Parts are in words, gear pairs are one.

    Args:
        model: of formulation `power_balance`.
        engine_speed: [rad/s].
        load_torque: [N m].
        oil_temperature: [deg C].
    """
    parts: dict[str, Array] = {}
    for name, watts in model.breakdown(STROKES, engine_speed, load_torque,
                                       oil_temperature).losses.items():
        part = "gear pairs" if name.startswith("gear_pair_") else name.replace("_", " ")
        parts[part] = parts.get(part, 0.0) + np.broadcast_to(watts, STROKES.shape)
    # What turns idly loses something known even where the load cannot be carried: drop it.
    stalled = np.isnan(sum(parts.values()))
    return {part: np.where(stalled, np.nan, watts) for part, watts in parts.items()}


def worth_drawing(*balances: Mapping[str, Array]) -> list[str]:
    """Return the parts that take anything to be seen, in the order of the stack."""
    most = {part: max(np.nanmax(np.abs(each.get(part, 0.0)), initial=0.0) for each in balances)
            for part in dict.fromkeys(chain(*balances))}
    order = (*(part for part in LOSSES if part in most), *sorted(most.keys() - LOSSES.keys()))
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
        axes.text(STROKES[start:end].mean(), 0.5, "no answer", rotation=90, ha="center",
                  va="center", transform=axes.get_xaxis_transform())
    axes.tick_params(pad=8.0)  # the numbers at the corner stay apart
    axes.set(xlim=STROKES[[0, -1]], xlabel="displacement ratio [-]")


def draw_losses(
    figure: Any, model: EfficiencyModel, engine_speed: float, load_torque: float,
    displacement_ratio: float | None = None,
) -> None:
    """Draw the lost part of the input power, part by part, on an empty matplotlib figure.

    Args:
        model: of formulation `power_balance`.
        engine_speed: [rad/s].
        load_torque: [N m].
        displacement_ratio: a point to mark [-].
    """
    axes = figure.subplots()
    power = model.breakdown(STROKES, engine_speed, load_torque).input_power
    balance = {part: 100.0 * watts / power for part, watts in
               lost_power(model, engine_speed, load_torque).items()}
    stack(axes, balance, worth_drawing(balance))
    if displacement_ratio is not None:
        axes.axvline(displacement_ratio, color="k", lw=1.6, ls="--")
    axes.set(ylim=scale(balance), ylabel="lost, % of engine power",
             title=f"Where the watts go: {engine_speed / RPM:.0f} r/min, {load_torque:g} N m")
    axes.legend(*(entries[::-1] for entries in axes.get_legend_handles_labels()),
                loc="center left", bbox_to_anchor=(1.0, 0.5))


def before_and_after(before: Mapping[str, Array], after: Mapping[str, Array]) -> Figures:
    """Draw two balances of `lost_power` on one scale, or one if they are the same object."""
    parts = worth_drawing(before, after)
    panels = {"Base model, refitted": before}
    if after is not before:
        panels["With the effect added"] = after
    drawings, (low, high) = [], scale(*panels.values())
    for index, (title, balance) in enumerate(panels.items()):
        kilowatts = {part: lost / 1e3 for part, lost in balance.items()}
        with styled() as figure:
            axes = figure.subplots()
            stack(axes, kilowatts, parts)
            axes.set(title=title, ylabel="power lost [kW]", ylim=(low / 1e3, high / 1e3))
            few_ticks(axes)
            tips = {part: f"{part}: {words.fixed(np.nanmin(lost), 2)} to "
                          f"{words.fixed(np.nanmax(lost), 2)} kW"
                    for part, lost in kilowatts.items() if np.any(np.isfinite(lost))}
            drawings.append(to_svg(
                figure, f"watts-{index}",
                f"{title}: power lost in each part over displacement ratio", tips))
    legend = [(part, icon(f"part-{i}", methodcaller(
        "fill_between", (0.05, 0.95), 0.05, 0.95, **loss_style(part))))
        for i, part in enumerate(parts)]
    notes = [] if after is before or after.keys() - before.keys() else [
        "The effect takes no share of its own: it acts through the parts shown, or on the "
        "readings of the bench."]
    return Figures(drawings, legend[::-1], notes)


def means(
    before: Mapping[str, Array], after: Mapping[str, Array]
) -> list[tuple[str, float, float]]:
    """Return part, mean watts before and mean watts after; the total comes last.

    Means are over the points that both models answer; NaN if there is none.
    """
    total, later = (np.sum(list(balance.values()), axis=0) for balance in (before, after))
    answered = np.isfinite(total + later)

    def mean(loss: ArrayLike) -> float:
        known = np.broadcast_to(loss, answered.shape)[answered]
        return float(known.mean()) if len(known) else float("nan")

    return [*((part, mean(before.get(part, 0.0)), mean(after.get(part, 0.0)))
              for part in worth_drawing(before, after)), ("total", mean(total), mean(later))]
