# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Between ROS messages and values of the core.

Every number goes through `float`: the generated message classes send a NumPy scalar or an int as
garbage without a word.
"""

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
from hmcvt_core.files.steady import Shafts
from hmcvt_core.transmission.ranges import DISPLACEMENT_RATIO

from .inputs import INPUT_RANGES, OperatingPoint, Tally, coasting, tolerated
from .shafts import read_shafts

MAP_AXES = ("displacement_ratio", "engine_speed", "load_torque")
RAW_LIMIT = 16_384
"""Most bytes of a bench sample or operating point; three joints take 200."""

_SOURCE = "bench_sample"
_OF_SHAFTS = (
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "efficiency",
    "output_speed",
)


def joint_state(raw: bytes) -> JointState:
    """Read a message as it came; what is too long is not even looked at.

    Raises:
        InputError: it is too long, or no JointState.
    """
    if len(raw) > RAW_LIMIT:
        raise InputError(f"a message of {len(raw)} bytes; allowed are {RAW_LIMIT}")
    try:
        return deserialize_message(raw, JointState)
    except Exception as error:  # of a kind that depends on the middleware
        raise InputError(f"no sensor_msgs/JointState ({error})") from None


def point_from_message(message: JointState, tally: Tally) -> OperatingPoint:
    """Read an operating point; the engine's torque is not needed. `tally` as in `tolerated`.

    Raises:
        HmcvtError: a joint or field is missing or doubled, or a value is wrong; coasting is not.
    """
    shafts = _running(message, tally)
    point = OperatingPoint(*(getattr(shafts, limits.name) for limits in INPUT_RANGES))
    for limits, value in zip(INPUT_RANGES, point, strict=True):
        if not coasting(limits, value):
            limits.check(value)
    return point


def bench_sample_from_message(
    message: JointState, now: float, tally: Tally
) -> BenchSamples:
    """Read one bench sample.

    Args:
        message: see `read_shafts`.
        now: time of the sample when the header has none [s].
        tally: counts a stroke that is taken as the limit, as in `tolerated`.

    Raises:
        InputError: a joint or field is missing or doubled, or a value is out of range.
    """
    try:
        shafts = _running(message, tally)
        if not shafts.engine_power > 0.0:
            raise InputError(f"engine power {shafts.engine_power:g} W must be positive")
    except HmcvtError as error:
        raise InputError(f"{_SOURCE}: {error}") from None
    stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
    columns: dict[str, Any] = {
        name: np.array(getattr(shafts, name)) for name in _OF_SHAFTS
    }
    return BenchSamples(
        **columns, stamp=np.array(stamp if stamp > 0.0 else now), source=_SOURCE
    )


def _running(message: JointState, tally: Tally) -> Shafts:
    shafts = read_shafts(message)
    if not shafts.engine_speed > 0.0:  # a load torque is a power for each unit of it
        raise InputError(f"engine speed {shafts.engine_speed:g} rad/s must be positive")
    return shafts._replace(
        displacement_ratio=tolerated(
            DISPLACEMENT_RATIO, shafts.displacement_ratio, tally
        )
    )


def model_to_message(model: EfficiencyModel, served: Mapping[str, Any]) -> String:
    """Return a model as YAML; a file with this text is a parameter file.

    Args:
        model: the model in service.
        served: what the node adds, under the key `served`.
    """
    data = {**model.to_mapping(), "served": dict(served)}
    dumper = getattr(
        yaml, "CSafeDumper", yaml.SafeDumper
    )  # libyaml, where PyYAML has it
    return String(data=yaml.dump(data, Dumper=dumper, sort_keys=False))


def map_to_message(grid: EfficiencyMap) -> Float64MultiArray:
    """Return an efficiency map as a message.

    `data` holds the three axes one after the other, then, from `layout.data_offset` on, the
    efficiencies in the order of `layout.dim`; NaN where the model has no answer.
    """
    axes = [getattr(grid, name) for name in MAP_AXES]
    message = Float64MultiArray()
    strides = np.cumprod([len(axis) for axis in reversed(axes)])[::-1]
    message.layout.dim = [
        MultiArrayDimension(label=name, size=len(axis), stride=int(stride))
        for name, axis, stride in zip(MAP_AXES, axes, strides, strict=True)
    ]
    message.layout.data_offset = sum(len(axis) for axis in axes)
    # As an array of the kind that the message holds; it would look at every item of a list.
    message.data = array(
        "d", np.concatenate([*axes, grid.efficiency.ravel()]).tobytes()
    )
    return message
