# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The stage engaged at each message: of its `header.frame_id`, else of the topic `stage`.

The node applies the same order to live messages, for topics keep no order among themselves. It
knows the stages of its model; a bag does not, so a frame of coordinates has to be recognised.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import is_coordinate_frame

Array = NDArray[np.float64]

UNKNOWN = ""
"""Stage of a message before the first message on the topic `stage`."""


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


def _engaged(receipts: Array, messages: Sequence[StageMessage]) -> NDArray[np.str_]:
    """Return the stage that the last message before each receipt names."""
    times = np.array([message.receipt for message in messages])
    names = np.array([UNKNOWN, *(message.stage for message in messages)])
    return names[np.searchsorted(times, receipts, side="right")]
