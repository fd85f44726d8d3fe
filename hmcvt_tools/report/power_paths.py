# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Sketch of the power paths of a transmission, one panel per stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from hmcvt_core.transmission.check import TransmissionCheck
from hmcvt_core.transmission.stage import Path, Stage

from .style import BLUE, INK, ORANGE

_PANEL_HEIGHT = 3.4  # in
_WIDTH = 11.0  # in
_BOXES = {
    "engine": (0.07, 0.70),
    "planetary row": (0.56, 0.70),
    "output": (0.93, 0.70),
    "pump": (0.30, 0.20),
    "motor": (0.50, 0.20),
}
"""Centres of the boxes; parts of a panel."""

_LABEL_GAP = 0.03
"""Between a steep arrow and its words, part of a panel."""


_GAP_OF_FLAT = (26.0, 30.0)
_GAP_OF_STEEP = (14.0, 16.0)
"""From the centres of the boxes to the ends of an arrow: half a box wide or high [pt]."""


def draw_power_paths(
    figure: Any, stages: Sequence[Stage], check: TransmissionCheck
) -> None:
    """Draw each stage as boxes and arrows, gear pairs at the arrows.

    Args:
        figure: empty matplotlib figure.
        stages: of one transmission.
        check: its speed ratios are in the titles.
    """
    figure.set_size_inches(_WIDTH, _PANEL_HEIGHT * len(stages))
    panels = figure.subplots(len(stages), 1, squeeze=False)[:, 0]
    for axes, stage, speeds in zip(panels, stages, check.stages, strict=True):
        axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.set_axis_off()
        low, middle, high = speeds.ratios
        axes.set_title(
            f"{stage.name} ({stage.layout.replace('_', '-')}): output speed / engine speed "
            f"{low:.3f}, {middle:.3f}, {high:.3f} at stroke -1, 0, 1"
        )
        _draw_stage(axes, stage)


def _draw_stage(axes: Any, stage: Stage) -> None:
    if stage.layout == "hydrostatic":
        _arrow(axes, "engine", "pump", stage.pump, "", ORANGE)
        _arrow(axes, "motor", "output", stage.output, "", ORANGE, stage.motor)
    elif stage.layout == "output_coupled":
        _arrow(
            axes, "engine", "planetary row", stage.mechanical, stage.mechanical_member
        )
        _arrow(axes, "planetary row", "pump", stage.pump, stage.motor_member, ORANGE)
        _arrow(axes, "motor", "output", stage.motor, "", ORANGE)
        _arrow(axes, "planetary row", "output", stage.output, stage.output_member)
    else:
        _arrow(
            axes, "engine", "planetary row", stage.mechanical, stage.mechanical_member
        )
        _arrow(axes, "engine", "pump", stage.pump, "", ORANGE)
        _arrow(axes, "motor", "planetary row", stage.motor, stage.motor_member, ORANGE)
        _arrow(axes, "planetary row", "output", stage.output, stage.output_member)
    _connect(axes, "pump", "motor", ORANGE)
    for name, (across, up) in _BOXES.items():
        if name == "planetary row" and not stage.has_row:
            continue
        label = name
        if name == "planetary row":
            label = f"row k = {stage.planetary_constant:g}"
        axes.text(
            across,
            up,
            label,
            ha="center",
            va="center",
            zorder=3,
            bbox={"boxstyle": "round,pad=0.4", "fc": "w", "ec": INK},
        )


def _arrow(
    axes: Any,
    start: str,
    end: str,
    path: Path,
    member: str,
    colour: str = BLUE,
    first: Path | None = None,
) -> None:
    """Draw a path with its gear pairs, the member of the row, and a minus where it reverses."""
    _connect(axes, start, end, colour)
    pairs = list(path.gear_pairs)
    direction = path.direction
    if first is not None:
        pairs = [*first.gear_pairs, *pairs]
        direction *= first.direction
    words = ["direct"]
    if pairs:
        names = " x ".join(pair.name for pair in pairs)
        words = [f"{names} = {math.prod(pair.ratio for pair in pairs):.4g}"]
    if member:
        words.append(member)
    if direction < 0:
        words.append("reversed")
    across = _BOXES[end][0] - _BOXES[start][0]
    x = _BOXES[start][0] + 0.5 * across
    y = 0.5 * (_BOXES[start][1] + _BOXES[end][1])
    # A steep arrow is too short for words on it: they stand to its right.
    is_steep = _is_steep(start, end)
    axes.text(
        x + _LABEL_GAP * is_steep,
        y,
        "\n".join(words),
        ha="left" if is_steep else "center",
        va="center",
        fontsize=12,
        zorder=2,
        bbox={"boxstyle": "square,pad=0.15", "fc": "w", "ec": "none"},
    )


def _is_steep(start: str, end: str) -> bool:
    """Return whether an arrow leaves its boxes at the top or bottom."""
    across = _WIDTH * (_BOXES[end][0] - _BOXES[start][0])
    up = _PANEL_HEIGHT * (_BOXES[end][1] - _BOXES[start][1])
    return abs(up) > abs(across)


def _connect(axes: Any, start: str, end: str, colour: str) -> None:
    distances = _GAP_OF_STEEP if _is_steep(start, end) else _GAP_OF_FLAT
    axes.annotate(
        "",
        xy=_BOXES[end],
        xytext=_BOXES[start],
        zorder=1,
        arrowprops={
            "arrowstyle": "-|>",
            "color": colour,
            "lw": 2.4,
            "shrinkA": distances[0],
            "shrinkB": distances[1],
        },
    )
