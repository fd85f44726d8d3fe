# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Readings of the shafts in a bench message: one reader for live messages and for bags."""

import math
from typing import Any

from hmcvt_core import HmcvtError
from hmcvt_tools import Shafts

ENGINE = "engine"
OUTPUT = "output"
DISPLACEMENT = "displacement"
JOINTS = (ENGINE, OUTPUT, DISPLACEMENT)


class UnreadableError(HmcvtError):
    """A message lacks something; `reason` is a word or two to count it by."""

    def __init__(self, reason: str, text: str = "") -> None:
        super().__init__(text or reason)
        self.reason = reason


def read_shafts(message: Any, *, stroke_elsewhere: bool = False) -> Shafts:
    """Read a sensor_msgs/JointState.

    Args:
        message: joints `engine`, `output`, `displacement` in any order, others are ignored;
            `velocity` and `effort` of the shafts [rad/s, N m], `position` of `displacement` the
            displacement ratio [-].
        stroke_elsewhere: whether the joint `displacement` may be missing.

    Returns:
        The readings; a displacement ratio of NaN where the joint is missing.

    Raises:
        UnreadableError: a joint is missing or doubled, or a field lacks a value for a joint.
    """
    names = list(message.name)
    _require_joints(names, stroke_elsewhere)
    has_stroke = DISPLACEMENT in names
    fields = ["velocity", "effort"]
    if has_stroke:
        fields.append("position")
    for field in fields:
        count = len(getattr(message, field))
        if count != len(names):
            raise UnreadableError(
                "unequal arrays", f"{field} has {count} values for {len(names)} joints"
            )
    engine = names.index(ENGINE)
    output = names.index(OUTPUT)
    stroke = math.nan
    if has_stroke:
        stroke = float(message.position[names.index(DISPLACEMENT)])
    return Shafts(
        engine_speed=float(message.velocity[engine]),
        engine_torque=float(message.effort[engine]),
        output_speed=float(message.velocity[output]),
        output_torque=float(message.effort[output]),
        displacement_ratio=stroke,
    )


def _require_joints(names: list[str], stroke_elsewhere: bool) -> None:
    for joint in JOINTS:
        count = names.count(joint)
        optional = joint == DISPLACEMENT and stroke_elsewhere
        if count == 1 or (count == 0 and optional):
            continue
        raise UnreadableError(
            "wrong names",
            f"joint {joint!r} stands {count} times in name; needs {', '.join(JOINTS)}",
        )
