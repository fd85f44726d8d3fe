# SPDX-License-Identifier: Apache-2.0
"""Bad, stale and missing inputs: silence, and the reason in diagnostics."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD

BAD = [
    ("engine_speed", math.nan, "not finite"),
    ("load_torque", math.inf, "not finite"),
    ("engine_speed", 750.0, "r/min"),
    ("displacement_ratio", 1.3, "-1 to 1"),
    ("displacement_ratio", 5e-324 - 73.0, "percent"),
    ("load_torque", -20.0, "1 to 5000 N m"),
]


@pytest.fixture(scope="module")
def node(start_node, paper_file):
    return start_node(paper_file, input_timeout=0.4)


def falls_silent(node, point):
    """Whether the node stops to answer; on a busy machine it may lag behind for a while."""
    return any(node.player.hold(point, patience=0.0) == (None, None) for _ in range(3))


def reported(node, level, *words, send=None):
    """Wait for a status of the inputs with a level and words, sending a point meanwhile."""
    def found():
        if send is not None:
            node.player.send_inputs(send)
        status = node.player.statuses.get("inputs", {"level": None, "message": ""})
        return status["level"] == level and all(word in status["message"] for word in words)

    return node.player.wait_until(found, 5.0)


def test_nothing_is_published_before_all_three_are_there(start_node, paper_file):
    node = start_node(paper_file)
    assert reported(node, DiagnosticStatus.WARN, "engine_speed: nothing received")
    for publisher in node.player._inputs[:2]:
        for _ in range(5):
            publisher.publish(publisher.msg_type(data=0.5 if publisher is node.player._inputs[0]
                                                 else 100.0))
            node.player.spin_for(0.05)
    assert node.player.efficiencies == [] and node.player.optima == []


@pytest.mark.parametrize(("name", "value", "word"), BAD)
def test_bad_value_silences_the_node_until_a_good_one_comes(node, name, value, word):
    assert node.player.hold(GOOD).efficiency is not None
    bad = GOOD._replace(**{name: value})
    assert falls_silent(node, bad)
    assert reported(node, DiagnosticStatus.ERROR, name, word, send=bad), node.player.statuses
    reason = "out of range" if math.isfinite(value) else "not finite"
    assert int(node.player.statuses["inputs"]["values"][f"{name} refused, {reason}"]) > 0
    assert node.player.hold(GOOD).efficiency is not None


def test_warning_is_written_for_each_input_and_throttled(start_node, paper_file):
    node = start_node(paper_file)
    bad = GOOD._replace(engine_speed=2000.0, load_torque=math.nan)
    node.player.hold(bad, rounds=40, patience=0.0)  # 2 s, 80 refused messages
    assert node.says("engine_speed = 2000 is outside 10 to 320 rad/s (is it in r/min?)")
    assert node.says("load_torque = nan is not finite")
    assert node.log.count("[WARN]") == 2


def test_stale_input_silences_the_node(node):
    assert node.player.hold(GOOD).efficiency is not None
    node.player.spin_for(0.5)  # longer than input_timeout
    ratio, speed, _ = node.player._inputs
    node.player.efficiencies.clear()
    for _ in range(10):
        ratio.publish(ratio.msg_type(data=GOOD.displacement_ratio))
        speed.publish(speed.msg_type(data=GOOD.engine_speed))
        node.player.spin_for(0.05)
    assert node.player.efficiencies == []
    assert reported(node, DiagnosticStatus.STALE, "load_torque: nothing received for")
    assert node.player.hold(GOOD).efficiency is not None


def test_parameter_changes_are_checked(node):
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    client = AsyncParameterClient(node.player, f"{node.namespace}/hmcvt")
    assert client.wait_for_services(10.0)

    def change(name, value):
        future = client.set_parameters([Parameter(name, value=value)])
        assert node.player.wait_until(future.done, 10.0)
        return future.result().results[0]

    assert change("max_output_rate", 100.0).successful
    for name, value, word in [
        ("input_timeout", 0.0, "0.01"),
        ("input_timeout", math.nan, ""),
        ("optimum_hold", "ground speed", "output_speed"),
        ("engine_speed_limits", [230.0, 80.0], "rising"),
        ("engine_speed_limits", [750.0, 2200.0], "320"),
        ("model_file", "/etc/passwd", "read-only"),
        ("state_folder", "/tmp", "read-only"),
    ]:
        result = change(name, value)
        assert not result.successful, (name, value)
        assert word in result.reason
    assert change("max_output_rate", 0.0).successful
    assert change("engine_speed_limits", [80.0, 200.0]).successful
    assert node.player.wait_until(lambda: node.player.map.engine_speed[0] == 80.0, 5.0)
