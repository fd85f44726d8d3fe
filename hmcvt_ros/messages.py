# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Conversion between ROS messages and values of the core.

Every number goes through `float`: the generated message classes send a NumPy scalar or an int as
garbage without an error.
"""

import math
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from hmcvt_core import (
    BenchSamples,
    EfficiencyMap,
    EfficiencyModel,
    HmcvtError,
    InputError,
)
from hmcvt_core.interface import (
    BENCH_COLUMNS,
    DISPLACEMENT_RATIO,
    OIL_TEMPERATURE,
    Range,
)
from hmcvt_tools import Shafts

from .bench_log import FROM_SHAFTS
from .inputs import (
    INPUT_RANGES,
    NANOSECONDS,
    OperatingPoint,
    Tally,
    coasting,
    tolerated,
)
from .shafts import JOINTS, read_shafts

MAP_AXES = ("displacement_ratio", "engine_speed", "load_torque")
RAW_LIMIT = 16_384
"""Largest size of a bench sample or operating point [bytes]; three joints take 200."""

CHANNELS = tuple(column for column in BENCH_COLUMNS if column.joint)
"""What a bench sample may state in addition, each by the `position` of a joint of that name."""
SESSION = "session"
"""Joint whose `position` is the number of the session of a bench sample."""
_JOINTS = frozenset((*JOINTS, *(column.name for column in CHANNELS), SESSION))
"""Joints of a bench sample that are used."""
_SESSION_LIMIT = 2**31
"""Largest number of a session, as on the topic."""

_SOURCE = "bench_sample"


def joint_state(raw: bytes) -> JointState:
    """Read a message from its bytes; one that is too long is refused unread.

    Raises:
        InputError: the bytes are too many, or no JointState.
    """
    if len(raw) > RAW_LIMIT:
        raise InputError(f"a message of {len(raw)} bytes; allowed are {RAW_LIMIT}")
    try:
        return deserialize_message(raw, JointState)
    except Exception as error:  # its kind depends on the middleware
        raise InputError(f"no sensor_msgs/JointState ({error})") from None


def point_from_message(message: JointState, tally: Tally) -> OperatingPoint:
    """Read an operating point; the engine's torque is not needed.

    Args:
        message: see `read_shafts`.
        tally: counts a stroke that is taken as the limit, as in `tolerated`.

    Raises:
        HmcvtError: a joint or field is missing or doubled, or a value is wrong; coasting is not.
    """
    shafts = _running_shafts(message, tally)
    point = OperatingPoint(
        shafts.displacement_ratio, shafts.engine_speed, shafts.load_torque
    )
    for limits, value in zip(INPUT_RANGES, point, strict=True):
        if not coasting(limits, value):
            limits.check(value)
    return point


def oil_temperature_of(message: JointState) -> float | None:
    """Return the oil temperature that a message states [deg C]; None without one.

    Raises:
        InputError: it is out of range.
    """
    return _stated(message, OIL_TEMPERATURE, "operating_point")


def bench_sample_from_message(
    message: JointState,
    now: float,
    tally: Tally,
    oil_temperature: float | None = None,
    session: int | None = None,
) -> BenchSamples:
    """Read one bench sample.

    Args:
        message: see `read_shafts`; further joints state `CHANNELS` and `SESSION`.
        now: time of the sample when the header has none [s].
        tally: counts a stroke that is taken as the limit, as in `tolerated`.
        oil_temperature: temperature where the message states none [deg C]; None for none.
        session: number of the session where the message states none; None for none.

    Raises:
        InputError: a joint or field is missing or doubled, or a value is out of range.
    """
    try:
        shafts = _running_shafts(message, tally)
        if not shafts.engine_power > 0.0:
            raise InputError(f"engine power {shafts.engine_power:g} W must be positive")
    except HmcvtError as error:
        raise InputError(f"{_SOURCE}: {error}") from None
    stamp = message.header.stamp.sec + message.header.stamp.nanosec * NANOSECONDS
    if stamp <= 0.0:
        stamp = now
    columns: dict[str, Any] = {
        name: np.array(getattr(shafts, name)) for name in FROM_SHAFTS
    }
    stated = {limits.name: _stated(message, limits, _SOURCE) for limits in CHANNELS}
    if stated[OIL_TEMPERATURE.name] is None:
        stated[OIL_TEMPERATURE.name] = oil_temperature
    for name, value in stated.items():
        if value is not None:
            columns[name] = np.array(value)
    return BenchSamples(
        **columns,
        stamp=np.array(stamp),
        extra=_session(message, session),
        source=_SOURCE,
    )


def unused_joints(message: JointState) -> list[str]:
    """Return the joints of a bench sample that are not used, such as ones with a misspelt name."""
    return [name for name in message.name if name not in _JOINTS]


def _stated(message: JointState, limits: Range, source: str) -> float | None:
    """Return what the joint of a quantity states by its `position`; None without one or for NaN.

    Raises:
        InputError: it is out of range.
    """
    value = _position(message, limits.name, source)
    if math.isnan(value):
        return None
    limits.check(value, source)
    return value


def _session(message: JointState, otherwise: int | None) -> dict[str, tuple[str, ...]]:
    """Return the session that a message states, else another, as a column; empty without one."""
    value = _position(message, SESSION, _SOURCE)
    if math.isnan(value):
        return {} if otherwise is None else {SESSION: (str(otherwise),)}
    if not value.is_integer():
        raise InputError(f"{_SOURCE}: {SESSION} = {value:g} is no whole number")
    if abs(value) > _SESSION_LIMIT:
        raise InputError(f"{_SOURCE}: {SESSION} = {value:g} is no 32-bit number")
    return {SESSION: (f"{value:.0f}",)}


def _position(message: JointState, joint: str, source: str) -> float:
    """Return the `position` of a joint; NaN where there is none.

    Raises:
        InputError: there are several of its name.
    """
    names = list(message.name)
    if joint not in names:
        return math.nan
    if names.count(joint) > 1:
        times = names.count(joint)
        raise InputError(f"{source}: joint {joint!r} stands {times} times in name")
    return float(message.position[names.index(joint)])


def model_to_message(model: EfficiencyModel, served: Mapping[str, Any]) -> String:
    """Return a model as YAML; a file with this text is a parameter file.

    Args:
        model: model in service.
        served: what the node adds under the key `served`.
    """
    data = {**model.to_mapping(), "served": dict(served)}
    # libyaml is faster, where PyYAML has it.
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    return String(data=yaml.dump(data, Dumper=dumper, sort_keys=False))


def map_to_message(grid: EfficiencyMap) -> Float64MultiArray:
    """Return an efficiency map as a message.

    `data` holds the three axes one after the other, then, from `layout.data_offset` on, the
    efficiencies in the order of `layout.dim`; NaN where the model has no answer.
    """
    axes = [getattr(grid, name) for name in MAP_AXES]
    sizes = [len(axis) for axis in axes]
    message = Float64MultiArray()
    strides = np.cumprod(sizes[::-1])[::-1]
    message.layout.dim = [
        MultiArrayDimension(label=name, size=size, stride=int(stride))
        for name, size, stride in zip(MAP_AXES, sizes, strides, strict=True)
    ]
    message.layout.data_offset = sum(sizes)
    # An array of the message's kind is taken as it is; a list is checked item by item.
    values = np.concatenate([*axes, grid.efficiency.ravel()])
    message.data = array("d", values.tobytes())
    return message


def _running_shafts(message: JointState, tally: Tally) -> Shafts:
    """Read the shafts of a running engine: a load torque is power divided by its speed."""
    shafts = read_shafts(message)
    if not shafts.engine_speed > 0.0:
        raise InputError(f"engine speed {shafts.engine_speed:g} rad/s must be positive")
    stroke = tolerated(DISPLACEMENT_RATIO, shafts.displacement_ratio, tally)
    return shafts._replace(displacement_ratio=stroke)
