# SPDX-License-Identifier: Apache-2.0
"""Where the watts go, part by part, over the displacement ratio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.model import EfficiencyModel
from ..transmission.ranges import RPM
from .style import LOSSES, loss_style

Array = NDArray[np.float64]

_STROKES = 201
_LEAST = 1e-3  # of the largest part; what never takes more is not drawn


def lost_power(
    model: EfficiencyModel, displacement_ratio: Array, engine_speed: float, load_torque: float,
    oil_temperature: float | None = None,
) -> dict[str, Array]:
    """Return the watts of each part in words, gear pairs as one; NaN where the load stalls it.

    Args:
        model: of formulation `power_balance`.
        displacement_ratio: shape (k,) [-].
        engine_speed: [rad/s].
        load_torque: [N m].
        oil_temperature: [deg C].
    """
    parts: dict[str, Array] = {}
    for name, watts in model.breakdown(displacement_ratio, engine_speed, load_torque,
                                       oil_temperature).losses.items():
        part = "gear pairs" if name.startswith("gear_pair_") else name.replace("_", " ")
        parts[part] = parts.get(part, 0.0) + np.broadcast_to(watts, displacement_ratio.shape)
    # What turns idly loses something known even where the load cannot be carried: drop it.
    stalled = np.isnan(sum(parts.values()))
    return {part: np.where(stalled, np.nan, watts) for part, watts in parts.items()}


def worth_drawing(*balances: Mapping[str, Array]) -> list[str]:
    """Return the parts that take anything to be seen, in the order of the stack."""
    most: dict[str, float] = {}
    for part, watts in (entry for balance in balances for entry in balance.items()):
        most[part] = max(most.get(part, 0.0), float(np.max(np.abs(np.nan_to_num(watts)))))
    order = [*LOSSES, *(part for part in most if part not in LOSSES)]
    least = _LEAST * max(most.values())
    return [part for part in order if most.get(part, -1.0) >= least]


def stack(
    axes: Any, displacement_ratio: Array, balance: Mapping[str, Array], parts: Sequence[str]
) -> None:
    """Draw parts of a balance above each other, gains below zero; the `gid` is the part.

    Args:
        axes: matplotlib's.
        displacement_ratio: shape (k,) [-], ascending.
        balance: each part of shape (k,), in any unit.
        parts: lowest first.
    """
    lost = gained = np.zeros(len(displacement_ratio))
    for part in (part for part in parts if part in balance):
        above = lost + np.maximum(balance[part], 0.0)
        below = gained + np.minimum(balance[part], 0.0)
        style = loss_style(part)
        axes.fill_between(displacement_ratio, lost, above, label=part, gid=part, **style)
        if np.any(below < gained):
            axes.fill_between(displacement_ratio, below, gained, **style)
        lost, gained = above, below
    missing = np.concatenate([[False], np.isnan(lost), [False]])
    for start, end in np.flatnonzero(np.diff(missing)).reshape(-1, 2):
        axes.text(displacement_ratio[start:end].mean(), 0.5, "no answer", rotation=90, ha="center",
                  va="center", transform=axes.get_xaxis_transform())
    axes.set(xlim=displacement_ratio[[0, -1]], xlabel="displacement ratio [-]")


def draw_losses(
    figure: Any,
    model: EfficiencyModel,
    engine_speed: float,
    load_torque: float,
    displacement_ratio: float | None = None,
) -> None:
    """Draw the lost part of the input power, part by part, on a matplotlib figure.

    Args:
        figure: empty.
        model: of formulation `power_balance`.
        engine_speed: [rad/s].
        load_torque: [N m].
        displacement_ratio: a point to mark [-].
    """
    axes = figure.subplots()
    strokes = np.linspace(-1.0, 1.0, _STROKES)
    power = model.breakdown(strokes, engine_speed, load_torque).input_power
    balance = {part: 100.0 * watts / power for part, watts in
               lost_power(model, strokes, engine_speed, load_torque).items()}
    stack(axes, strokes, balance, worth_drawing(balance))
    if displacement_ratio is not None:
        axes.axvline(displacement_ratio, color="k", lw=1.6, ls="--")
    axes.set(ylabel="lost, % of engine power",
             title=f"Where the watts go: {engine_speed / RPM:.0f} r/min, {load_torque:g} N m")
    if not any(np.any(watts < 0.0) for watts in balance.values()):
        axes.set_ylim(0.0, None)
    axes.legend(*(entries[::-1] for entries in axes.get_legend_handles_labels()),
                loc="center left", bbox_to_anchor=(1.0, 0.5))
