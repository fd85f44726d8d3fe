# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the tests send: the command that starts a node, operating points, bench samples."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from typing import Any

import hmcvt_core as hmcvt
from examples.bench_player import bench_message as message
from hmcvt_ros.inputs import OperatingPoint
from hmcvt_ros.model_store import ModelStore

__all__ = ["GOOD", "STALLED", "adopted", "command", "message", "points", "send_table"]

GOOD = OperatingPoint(displacement_ratio=0.5, engine_speed=100.0, load_torque=200.0)
STALLED = OperatingPoint(displacement_ratio=-1.0, engine_speed=20.0, load_torque=5000.0)


def command(*parameters: str, arguments: tuple[str, ...] = ()) -> list[str]:
    """The command line of a node with parameters `name:=value` and more ROS arguments."""
    given = itertools.chain.from_iterable(("-p", parameter) for parameter in parameters)
    return [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args", *given, *arguments]


def adopted(store: ModelStore, leakage: float) -> hmcvt.EfficiencyModel:
    """Write and adopt a refit of another leakage."""
    model, path = store.in_service.model, store.new_path()
    hmcvt.save_model(replace(model, parameters=replace(model.parameters, leakage=leakage)), path)
    return store.adopt(path)


def points(samples: hmcvt.BenchSamples) -> list[OperatingPoint]:
    """The operating points of bench samples."""
    return [OperatingPoint(*map(float, values)) for values in zip(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque, strict=True)]


def send_table(node: Any, samples: hmcvt.BenchSamples) -> None:
    """Publish all samples and wait until they are on disk."""
    before = node.logged()
    for i in range(len(samples)):
        node.player.send_sample(message(samples, i))
    assert node.player.wait_until(
        lambda: node.logged() == before + len(samples), 10.0), (node.logged(), node.log)
