# SPDX-License-Identifier: Apache-2.0
"""Numbers out of messages, and why a message is refused."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from hmcvt_core.transmission.ranges import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    OUTPUT_SPEED,
)

_NANOSECONDS = 1e-9
_OVERSHOOT = 0.05
"""A stroke reading at full stroke, with its noise, may exceed 1 by this much."""

UNREADABLE = "unreadable"
WRONG_NAMES = "wrong names"
UNEQUAL_ARRAYS = "unequal arrays"
NOT_FINITE = "not finite"
OUT_OF_RANGE = "out of range"


class RefusedError(Exception):
    """A message cannot be used; the text is the reason, one of the constants above."""


class Shafts(NamedTuple):
    """What one message says: rad/s, N m; `displacement_ratio` is NaN when it is not in it."""

    engine_speed: float
    engine_torque: float
    output_speed: float
    output_torque: float
    displacement_ratio: float


def header_stamp(message: Any) -> float:
    """Return the time in the header [s], 0 when there is none."""
    header = getattr(message, "header", None)
    if header is None:
        return 0.0
    return float(header.stamp.sec) + float(header.stamp.nanosec) * _NANOSECONDS


def read_shafts(message: Any, displacement_elsewhere: bool) -> Shafts:
    """Read speeds and torques of the shafts and the displacement ratio.

    One message is a momentary reading: only what no sensor can rightly show is refused. What the
    average has to satisfy is checked when there is one.

    Args:
        message: joints `engine`, `output`, `displacement` in any order, others are ignored.
        displacement_elsewhere: whether the joint `displacement` may be missing.

    Raises:
        RefusedError: with the reason.
    """
    if message is None:
        raise RefusedError(UNREADABLE)
    names = list(message.name)
    stroke = names.count("displacement")
    if (names.count("engine") != 1 or names.count("output") != 1 or stroke > 1
            or not (stroke or displacement_elsewhere)):
        raise RefusedError(WRONG_NAMES)
    fields = [message.velocity, message.effort] + [message.position] * stroke
    if any(len(values) != len(names) for values in fields):
        raise RefusedError(UNEQUAL_ARRAYS)
    engine, output = names.index("engine"), names.index("output")
    found = Shafts(
        float(message.velocity[engine]), float(message.effort[engine]),
        float(message.velocity[output]), float(message.effort[output]),
        float(message.position[names.index("displacement")]) if stroke else math.nan)
    if not all(map(math.isfinite, found[:4 + stroke])):
        raise RefusedError(NOT_FINITE)
    if not _plausible(found):
        raise RefusedError(OUT_OF_RANGE)
    return found


def read_displacement(message: Any) -> float:
    """Read a displacement ratio.

    Raises:
        RefusedError: with the reason.
    """
    value = _finite(message, "data")
    if abs(value) > DISPLACEMENT_RATIO.high + _OVERSHOOT:
        raise RefusedError(OUT_OF_RANGE)
    return value


def read_temperature(message: Any) -> float:
    """Read a temperature [deg C].

    Raises:
        RefusedError: with the reason.
    """
    value = _finite(message, "temperature")
    if not OIL_TEMPERATURE.contains(value):
        raise RefusedError(OUT_OF_RANGE)
    return value


def _finite(message: Any, field: str) -> float:
    if message is None:
        raise RefusedError(UNREADABLE)
    value = float(getattr(message, field))
    if not math.isfinite(value):
        raise RefusedError(NOT_FINITE)
    return value


def _plausible(found: Shafts) -> bool:
    if not ENGINE_SPEED.low <= found.engine_speed <= ENGINE_SPEED.high:
        return False
    # Either sign: in a transient the output may drive, and noise straddles zero.
    load = abs(found.output_torque * found.output_speed) / found.engine_speed
    return (load <= LOAD_TORQUE.high and abs(found.engine_torque) <= LOAD_TORQUE.high
            and abs(found.output_speed) <= OUTPUT_SPEED.high
            and not abs(found.displacement_ratio) > DISPLACEMENT_RATIO.high + _OVERSHOOT)
