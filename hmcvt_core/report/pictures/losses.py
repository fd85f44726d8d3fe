# SPDX-License-Identifier: Apache-2.0
"""Where the watts go, over the displacement ratio."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...model.model import EfficiencyModel
from ...transmission.ranges import RPM

_STROKES = 201
_SHOWN = 7  # largest parts; the rest is one
_COLOURS = ("#0b5394", "#b45f06", "#6aa84f", "#999999", "#674ea7", "#cc9900", "#45818e", "#dddddd")
_HATCHES = ("", "//", "", "\\\\", "..", "", "xx", "")


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
    stroke = np.linspace(-1.0, 1.0, _STROKES)
    found = model.breakdown(stroke, engine_speed, load_torque)
    share = {name: 100.0 * np.asarray(watts) / found.input_power
             for name, watts in _gathered(found.losses).items()}
    names = sorted(share, key=lambda name: -float(np.nanmean(np.abs(share[name]))))
    rest = np.sum([share.pop(name) for name in names[_SHOWN:]], axis=0)
    if names[_SHOWN:]:
        share["other"] = rest
    shown = [*names[:_SHOWN], *(("other",) if "other" in share else ())]
    stack = axes.stackplot(stroke, [share[name] for name in shown], colors=_COLOURS,
                           edgecolor="0.2", linewidth=0.6, labels=[_words(name) for name in shown])
    for area, hatch in zip(stack, _HATCHES, strict=False):
        area.set_hatch(hatch)
    if displacement_ratio is not None:
        axes.axvline(displacement_ratio, color="k", lw=1.6, ls="--")
    axes.set(xlim=(-1.0, 1.0), xlabel="displacement ratio [-]", ylabel="lost, % of engine power")
    axes.set_ylim(0.0, None)
    axes.set_title(f"Where the watts go: {engine_speed / RPM:.0f} r/min, {load_torque:g} N m")
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5),
                frameon=False)


def _gathered(losses: Any) -> dict[str, Any]:
    """Losses with the gear pairs as one part."""
    parts: dict[str, Any] = {}
    for name, watts in losses.items():
        part = "gear pairs" if name.startswith("gear_pair_") else name
        parts[part] = parts.get(part, 0.0) + np.asarray(watts)
    return {name: watts for name, watts in parts.items() if np.any(np.nan_to_num(watts) != 0.0)}


def _words(name: str) -> str:
    return name.replace("_", " ")
