# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The stage engaged at each message: of its `header.frame_id`, else of the topic `stage`.

The node applies the same order to live messages, for topics keep no order among themselves. It
knows the stages of its model; a bag does not, so a frame of coordinates has to be recognised.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UNKNOWN = ""
"""Stage of a message before the first message on the topic `stage`."""

# Frames of REP 105 and REP 120; others end in _link or _frame by convention.
_COORDINATE_FRAMES = ("base_link", "base_footprint", "odom", "map", "earth", "world")
_COORDINATE_ENDINGS = ("_link", "_frame")


class StageMessage(NamedTuple):
    """A message on the topic `stage`: when it was received [s], and the stage."""

    receipt: float
    stage: str


class Stages(NamedTuple):
    """Stages of the messages.

    Attributes:
        names: stage of each message, `UNKNOWN` where it is not known, shape (n,); None where the
            bag does not name stages.
        note: where the stages come from, as a sentence; empty without stages.
    """

    names: NDArray[np.str_] | None
    note: str = ""


def stages_of(
    frames: Sequence[str], receipts: Array, messages: Sequence[StageMessage]
) -> Stages:
    """Return the stage engaged at each message with the shafts.

    Args:
        frames: `header.frame_id` of each message, length n.
        receipts: time of receipt of each message [s], shape (n,).
        messages: messages on the topic `stage` in order of receipt; empty without the topic.
    """
    candidates = {frame for frame in frames if not is_coordinate_frame(frame)}
    announced = {message.stage for message in messages}
    if not messages and not candidates:
        return Stages(None)
    note = ""
    if messages and len(candidates) == 1 and candidates.isdisjoint(announced):
        (frame,) = candidates
        note = f"header.frame_id {frame!r} is no stage named on the topic stage; "
        candidates = set()
    engaged = _engaged(receipts, messages)
    named = np.array(frames, dtype=str)
    is_named = np.isin(named, list(candidates))
    names = np.where(is_named, named, engaged)
    if not messages or is_named.all():
        source = "header.frame_id"
    elif is_named.any():
        source = "header.frame_id, else the topic stage"
    else:
        source = "the topic stage"
    listed = ", ".join(sorted(set(names.tolist()) - {UNKNOWN})) or "none"
    return Stages(names, f"{note}stages from {source}: {listed}")


def is_coordinate_frame(frame: str) -> bool:
    """Whether a `frame_id` is empty or names a frame of coordinates by the conventions of ROS."""
    name = frame.strip("/")
    return not name or name in _COORDINATE_FRAMES or name.endswith(_COORDINATE_ENDINGS)


def _engaged(receipts: Array, messages: Sequence[StageMessage]) -> NDArray[np.str_]:
    """Return the stage that the last message before each receipt names."""
    times = np.array([message.receipt for message in messages])
    names = np.array([UNKNOWN, *(message.stage for message in messages)])
    return names[np.searchsorted(times, receipts, side="right")]
