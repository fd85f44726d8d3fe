# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the watts go over the displacement ratio: balances of losses and their stacked areas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import RPM, Array

from .style import LOSSES, loss_style

Balance = Mapping[str, Array]
"""Power lost in each part at all `STROKES` [W]."""

STROKES = np.linspace(-1.0, 1.0, 201)
"""Displacement ratios of the pictures [-]."""

_SMALLEST_FRACTION = 1e-3
"""Of the largest loss: parts that never take more are not drawn, since no eye would see them."""


def lost_power(
    model: EfficiencyModel,
    engine_speed: float,
    load_torque: float,
    oil_temperature: float | None = None,
) -> dict[str, Array]:
    """Return the watts lost in each part at all `STROKES`; NaN where the load stalls it.

    The gear pairs are one part.

    Args:
        model: of formulation `power_balance`.
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        oil_temperature: [deg C]; None takes effects of the oil at 60 deg C, and `fan_drive` as off.
    """
    breakdown = model.breakdown(STROKES, engine_speed, load_torque, oil_temperature)
    parts: dict[str, Array] = {}
    for name, watts in breakdown.losses.items():
        part = name.replace("_", " ")
        if name.startswith("gear_pair_"):
            part = "gear pairs"
        parts[part] = parts.get(part, 0.0) + np.broadcast_to(watts, STROKES.shape)
    # Parts that turn idly have a known loss even where the load stalls the transmission.
    stalled = np.isnan(sum(parts.values()))
    return {part: np.where(stalled, np.nan, watts) for part, watts in parts.items()}


def worth_drawing(*balances: Balance) -> list[str]:
    """Return the parts large enough to be seen in any of the balances, in order of the stack."""
    largest: dict[str, float] = {}
    for balance in balances:
        for part, watts in balance.items():
            size = float(np.nanmax(np.abs(watts), initial=0.0))
            largest[part] = max(size, largest.get(part, 0.0))
    smallest = _SMALLEST_FRACTION * max(largest.values())
    parts = []
    for part in (*LOSSES, *sorted(largest.keys() - LOSSES.keys())):
        if part in largest and largest[part] >= smallest:
            parts.append(part)
    return parts


def scale(*balances: Balance) -> tuple[float, float]:
    """Return limits of an axis that holds the stacks of the balances."""
    low = 0.0
    high = 0.0
    for balance in balances:
        stacked = np.nan_to_num(np.stack(list(balance.values())))
        low = min(low, float(np.minimum(stacked, 0.0).sum(axis=0).min()))
        high = max(high, float(np.maximum(stacked, 0.0).sum(axis=0).max()))
    high = high or 1.0
    if -low <= _SMALLEST_FRACTION * high:
        low = 0.0
    return 1.05 * low, 1.05 * high


def stack(axes: Any, balance: Balance, parts: Sequence[str]) -> None:
    """Draw parts of a balance above each other, lowest first, and gains below zero.

    Args:
        axes: matplotlib Axes.
        balance: watts, or any other unit, by part.
        parts: to draw; each area has the part as its `gid`.
    """
    lost = np.zeros(len(STROKES))
    gained = np.zeros(len(STROKES))
    for part in parts:
        if part not in balance:
            continue
        above = lost + np.maximum(balance[part], 0.0)
        below = gained + np.minimum(balance[part], 0.0)
        style = loss_style(part)
        axes.fill_between(STROKES, lost, above, label=part, gid=part, **style)
        if np.any(below < gained):
            axes.fill_between(STROKES, below, gained, **style)
        lost = above
        gained = below
    _mark_stalls(axes, np.isnan(lost))
    axes.tick_params(pad=8.0)  # keeps the two numbers at the corner apart
    axes.set(xlim=STROKES[[0, -1]], xlabel="displacement ratio [-]")


def _mark_stalls(axes: Any, stalled: Any) -> None:
    """Write `no answer` over each interval of strokes at which the load stalls it."""
    padded = np.concatenate([[False], stalled, [False]])
    edges = np.flatnonzero(np.diff(padded)).reshape(-1, 2)
    for start, end in edges:
        axes.text(
            STROKES[start:end].mean(),
            0.5,
            "no answer",
            rotation=90,
            ha="center",
            va="center",
            transform=axes.get_xaxis_transform(),
        )


def draw_losses(
    figure: Any,
    model: EfficiencyModel,
    engine_speed: float,
    load_torque: float,
    displacement_ratio: float | None = None,
) -> None:
    """Draw the lost part of the input power, part by part.

    Args:
        figure: empty matplotlib figure.
        model: of formulation `power_balance`.
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        displacement_ratio: a point to mark [-].
    """
    axes = figure.subplots()
    power = model.breakdown(STROKES, engine_speed, load_torque).input_power
    balance = {}
    for part, watts in lost_power(model, engine_speed, load_torque).items():
        balance[part] = 100.0 * watts / power
    stack(axes, balance, worth_drawing(balance))
    if displacement_ratio is not None:
        axes.axvline(displacement_ratio, color="k", lw=1.6, ls="--")
    axes.set(
        ylim=scale(balance),
        ylabel="lost, % of engine power",
        title=f"Where the watts go: stage {model.stage.name}, "
        f"{engine_speed / RPM:.0f} r/min, {load_torque:g} N m",
    )
    handles, labels = axes.get_legend_handles_labels()
    # The legend lists the areas from top to bottom.
    axes.legend(
        handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5)
    )
