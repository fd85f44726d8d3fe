# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages of the optional package hmcvt_msgs, as values of the node.

The node takes them on topics of their own, beside the standard messages, where the package is
installed.
"""

import importlib
import math
from types import ModuleType
from typing import Any, NamedTuple

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from hmcvt_core import InputError
from hmcvt_core.interface import OIL_TEMPERATURE

from .inputs import INPUT_RANGES, OperatingPoint, Tally, coasting, tolerated
from .messages import CHANNELS, RAW_LIMIT, SESSION
from .shafts import DISPLACEMENT, ENGINE, OUTPUT

_STATED = (*(column.name for column in CHANNELS), SESSION)
"""Fields of a BenchSample of at most one value that are joints of the standard message."""


class Question(NamedTuple):
    """An operating point and what belongs to it.

    Attributes:
        point: operating point.
        oil_temperature: [deg C]; None where it is not stated.
    """

    point: OperatingPoint
    oil_temperature: float | None


def find(part: str, member: str) -> ModuleType | None:
    """Return a module of hmcvt_msgs; None where the package is not installed.

    Args:
        part: msg or action.
        member: something that the module holds. In a checkout the folder of the package can be
            imported, and holds nothing.
    """
    try:
        module = importlib.import_module(f"hmcvt_msgs.{part}")
    except ImportError:
        return None
    return module if hasattr(module, member) else None


def read(raw: bytes, kind: Any) -> Any:
    """Read a message from its bytes; one that is too long is refused unread.

    Raises:
        InputError: the bytes are too many, or no message of this kind.
    """
    if len(raw) > RAW_LIMIT:
        raise InputError(f"a message of {len(raw)} bytes; allowed are {RAW_LIMIT}")
    try:
        return deserialize_message(raw, kind)
    except Exception as error:  # its kind depends on the middleware
        raise InputError(f"no hmcvt_msgs/{kind.__name__} ({error})") from None


def question_of(message: Any, tally: Tally) -> Question:
    """Read an OperatingPoint.

    Args:
        message: hmcvt_msgs/OperatingPoint.
        tally: counts a stroke that is taken as the limit, as in `tolerated`.

    Raises:
        InputError: a value is out of range; coasting is not.
    """
    values = []
    for limits in INPUT_RANGES:
        value = tolerated(limits, float(getattr(message, limits.name)), tally)
        if not coasting(limits, value):
            limits.check(value)
        values.append(value)
    oil = None
    for value in message.oil_temperature:  # at most one
        oil = float(OIL_TEMPERATURE.check(value))
    return Question(OperatingPoint(*values), oil)


def joint_state_of(message: Any) -> JointState:
    """Return a BenchSample as the standard message of the same test.

    Args:
        message: hmcvt_msgs/BenchSample.
    """
    standard = JointState(header=message.header)
    standard.header.frame_id = message.stage
    columns = [
        (ENGINE, message.engine_speed, message.engine_torque, math.nan),
        (OUTPUT, message.output_speed, message.output_torque, math.nan),
        (DISPLACEMENT, math.nan, math.nan, message.displacement_ratio),
    ]
    for name in _STATED:
        # The messages may have been built before the column was known.
        for value in getattr(message, name, ()):
            columns.append((name, math.nan, math.nan, float(value)))
    for name, velocity, effort, position in columns:
        standard.name.append(name)
        standard.velocity.append(velocity)
        standard.effort.append(effort)
        standard.position.append(position)
    return standard
