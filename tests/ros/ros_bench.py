# SPDX-License-Identifier: Apache-2.0
"""What the tests send: the command that starts a node, operating points, bench samples."""

from __future__ import annotations

import itertools
import sys
from typing import Any

import hmcvt_core as hmcvt
from hmcvt_core.transmission.stage import speed_ratio
from hmcvt_ros.inputs import OperatingPoint
from hmcvt_ros.messages import bench_sample_to_message

GOOD = OperatingPoint(displacement_ratio=0.5, engine_speed=100.0, load_torque=200.0)


def command(*parameters: str, arguments: tuple[str, ...] = ()) -> list[str]:
    """The command line of a node with parameters `name:=value` and more ROS arguments."""
    given = itertools.chain.from_iterable(("-p", parameter) for parameter in parameters)
    return [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args", *given, *arguments]


def points(samples: hmcvt.BenchSamples) -> list[OperatingPoint]:
    """The operating points of bench samples."""
    return [OperatingPoint(*map(float, values)) for values in zip(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque, strict=True)]


def message(samples: hmcvt.BenchSamples, i: int) -> Any:
    """A bench message whose shaft powers are those of sample i; its output does not slip."""
    point = points(samples)[i]
    power = point.load_torque * point.engine_speed
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    output_speed = point.engine_speed * float(speed_ratio(stage, samples.displacement_ratio[i]))
    return bench_sample_to_message(
        point.displacement_ratio, point.engine_speed,
        power / float(samples.efficiency[i]) / point.engine_speed, output_speed,
        power / output_speed)


def send_table(player: Any, samples: hmcvt.BenchSamples) -> None:
    """Publish all samples and wait until the node says that they are on disk."""
    for i in range(len(samples)):
        player.send_sample(message(samples, i))
    assert player.wait_for_logged(len(samples)), player.statuses
