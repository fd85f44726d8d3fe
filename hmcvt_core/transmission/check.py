# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Check of a transmission: what its gear ratios make of the speeds, and how stages meet.

Everything here is kinematic: hydraulic units without slip, eq. (5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from .stage import Stage, speed_ratio

STROKES = (-1.0, 0.0, 1.0)
"""Displacement ratios at which a check states the speed ratio [-]."""

WIDE_GAP = 0.01
"""Ratio gap between stages from which a check warns, as a part of the ratio: the best reading of
Table 1 meets within 0.3 %, so three times as much is no rounding of teeth."""

SLIP_DIGITS = 12
"""Decimals of a slip: what remains of two equal speeds is below."""


@dataclass(frozen=True)
class StageSpeeds:
    """Speeds of one stage.

    Attributes:
        name: of the stage.
        layout: `input_coupled`, `output_coupled` or `hydrostatic`.
        ratios: output speed / engine speed at `STROKES` [-]; NaN where the stage has no
            finite speed.
        direction: `forward`, `reverse`, or `both` where the output passes standstill.
        rising: whether a larger displacement ratio raises the output speed.
    """

    name: str
    layout: str
    ratios: tuple[float, ...]
    direction: str
    rising: bool


@dataclass(frozen=True)
class ClutchSlip:
    """Slip of a clutch that is open in a stage.

    Attributes:
        stage: that is engaged.
        name: of the clutch.
        slips: speed of its first side less that of its second / engine speed at `STROKES` [-]; NaN
            where the stage has no finite speed.
    """

    stage: str
    name: str
    slips: tuple[float, ...]


@dataclass(frozen=True)
class Overlap:
    """How two stages that follow each other meet at full stroke.

    Attributes:
        lower: name of the slower stage.
        upper: name of the faster stage.
        lower_end: highest speed ratio of the slower stage [-].
        upper_end: lowest speed ratio of the faster stage [-].
        overlap: (lower_end - upper_end) / lower_end [-]; negative where ratios are missing between
            the stages.
    """

    lower: str
    upper: str
    lower_end: float
    upper_end: float
    overlap: float


@dataclass(frozen=True)
class TransmissionCheck:
    """Result of `check_stages`.

    Attributes:
        stages: one entry per stage.
        overlaps: one entry per pair of neighbours of one direction, slowest first.
        remarks: what looks wrong, in plain sentences.
        clutches: one entry per open clutch of each stage.
    """

    stages: tuple[StageSpeeds, ...]
    overlaps: tuple[Overlap, ...]
    remarks: tuple[str, ...]
    clutches: tuple[ClutchSlip, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data."""
        return asdict(self)


def check_stages(stages: Sequence[Stage]) -> TransmissionCheck:
    """Check the speed ratios of the stages of one transmission.

    Args:
        stages: in any order.
    """
    speeds = tuple(_speeds(stage) for stage in stages)
    overlaps = _overlaps(stages, speeds)
    remarks = []
    for entry in speeds:
        if not np.isfinite(entry.ratios).all():
            remarks.append(
                f"{entry.name}: the speed ratio is not finite over the whole stroke"
            )
    for stage, entry in zip(stages, speeds, strict=True):
        remarks += _standstill_remarks(stage, entry)
    for meeting in overlaps:
        if meeting.overlap < -WIDE_GAP:
            remarks.append(
                f"{meeting.lower} ends at {meeting.lower_end:.4f}, {meeting.upper} begins "
                f"at {meeting.upper_end:.4f}: no stage drives the ratios between"
            )
    clutches = []
    for stage, entry in zip(stages, speeds, strict=True):
        clutches += _clutch_slips(stage, entry)
    return TransmissionCheck(speeds, tuple(overlaps), tuple(remarks), tuple(clutches))


def _clutch_slips(stage: Stage, speeds: StageSpeeds) -> list[ClutchSlip]:
    """Return the slips of the clutches that are open in a stage."""
    clutches = []
    for name, per_engine, per_output in stage.open_clutches:
        slips = per_engine + per_output * np.array(speeds.ratios)
        # Adding zero makes a negative zero positive.
        rounded = np.round(slips, SLIP_DIGITS) + 0.0
        clutches.append(ClutchSlip(stage.name, name, tuple(rounded.tolist())))
    return clutches


def _standstill_remarks(stage: Stage, speeds: StageSpeeds) -> list[str]:
    """Return a sentence where a stage with a row passes standstill within its stroke."""
    if not stage.has_row or speeds.direction != "both":
        return []
    usual, other = "forward", "backward"
    if stage.reverse:
        usual, other = other, usual
    end = 0 if speeds.rising != stage.reverse else -1
    return [
        f"{stage.name} drives {usual}, but {other} next to stroke {STROKES[end]:+g}, at a "
        f"ratio of up to {speeds.ratios[end]:+.4f}: the sign of the output speed says which"
    ]


def _speeds(stage: Stage) -> StageSpeeds:
    with np.errstate(divide="ignore"):
        ratios = speed_ratio(stage, np.array(STROKES))
    ratios = np.where(np.isfinite(ratios), ratios, np.nan)
    direction = "both"
    if np.nanmin(ratios) >= 0.0:
        direction = "forward"
    elif np.nanmax(ratios) <= 0.0:
        direction = "reverse"
    return StageSpeeds(
        name=stage.name,
        layout=stage.layout,
        ratios=tuple(ratios.tolist()),
        direction=direction,
        rising=bool(ratios[-1] > ratios[0]),
    )


def _overlaps(stages: Sequence[Stage], speeds: Sequence[StageSpeeds]) -> list[Overlap]:
    """Compare neighbours; reverse stages are compared by the size of their ratios."""
    overlaps = []
    for backward in (False, True):
        chain = []
        for stage, entry in zip(stages, speeds, strict=True):
            if _drives_backward(stage, entry) == backward:
                chain.append((*_range(entry, backward), entry.name))
        for (_, end, lower), (start, _, upper) in pairwise(sorted(chain)):
            overlaps.append(Overlap(lower, upper, end, start, (end - start) / end))
    return overlaps


def _drives_backward(stage: Stage, speeds: StageSpeeds) -> bool:
    """Whether a stage belongs to the reverse ranges, also where its output passes standstill."""
    return stage.reverse or speeds.direction == "reverse"


def _range(speeds: StageSpeeds, backward: bool) -> tuple[float, float]:
    """Return lowest and highest ratio of a stage, as sizes in its main direction."""
    finite = [ratio for ratio in speeds.ratios if math.isfinite(ratio)]
    if backward:
        return -max(finite), -min(finite)
    return min(finite), max(finite)
