# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a bench message says of the shafts: one reader for live messages and for those in bags."""

import math
from typing import Any

from hmcvt_core import HmcvtError
from hmcvt_core.files.steady import Shafts

JOINTS = ("engine", "output", "displacement")


class UnreadableError(HmcvtError):
    """A message does not say what it should; `reason` is a word or two to count it by."""

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

    Raises:
        UnreadableError: a joint is missing or doubled, or a field has not a value for each.
    """
    names = list(message.name)
    for joint in JOINTS:
        count = names.count(joint)
        if count != 1 and not (
            count == 0 and joint == "displacement" and stroke_elsewhere
        ):
            raise UnreadableError(
                "wrong names",
                f"joint {joint!r} stands {count} times in name; "
                f"needs {', '.join(JOINTS)}",
            )
    has_stroke = "displacement" in names
    for field in ("velocity", "effort", *(("position",) if has_stroke else ())):
        count = len(getattr(message, field))
        if count != len(names):
            raise UnreadableError(
                "unequal arrays", f"{field} has {count} values for {len(names)} joints"
            )
    engine, output = names.index("engine"), names.index("output")
    stroke = (
        float(message.position[names.index("displacement")]) if has_stroke else math.nan
    )
    return Shafts(
        float(message.velocity[engine]),
        float(message.effort[engine]),
        float(message.velocity[output]),
        float(message.effort[output]),
        stroke,
    )
