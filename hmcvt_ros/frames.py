# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a `frame_id` names: a frame of coordinates by the conventions of ROS, or a stage."""

# Frames of REP 105 and REP 120; others end in _link or _frame by convention.
_COORDINATE_FRAMES = ("base_link", "base_footprint", "odom", "map", "earth", "world")
_COORDINATE_ENDINGS = ("_link", "_frame")


def is_coordinate_frame(frame: str) -> bool:
    """Whether a `frame_id` is empty or names a frame of coordinates."""
    name = frame.strip("/")
    return not name or name in _COORDINATE_FRAMES or name.endswith(_COORDINATE_ENDINGS)
