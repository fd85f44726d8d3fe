# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
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
    ("load_torque", -9000.0, "1 to 5000 N m"),
]


def test_before_all_three_are_there_and_when_they_are_wrong(start_node, paper_file):
    """A node of its own: its first messages, and the warnings in its log."""
    node = start_node(paper_file)
    assert node.reports(DiagnosticStatus.WARN, "engine_speed: nothing received", part="inputs")
    for publisher, value in zip(node.player._inputs[:2], GOOD, strict=False):
        for _ in range(5):
            publisher.publish(publisher.msg_type(data=value))
            node.player.spin_for(0.02)
    assert node.player.efficiencies == [] and node.player.optima == []

    bad = GOOD._replace(engine_speed=2000.0, load_torque=math.nan)
    node.player.hold(bad, rounds=20, patience=0.0)  # 40 refused messages
    assert node.says("engine_speed = 2000 is outside 10 to 320 rad/s (is it in r/min?)")
    assert node.says("load_torque = nan is not finite")
    assert node.log.count("[WARN]") == 2


@pytest.mark.parametrize(("name", "value", "word"), BAD)
def test_bad_value_silences_the_node_until_a_good_one_comes(node, name, value, word):
    assert node.player.hold(GOOD).efficiency is not None
    bad = GOOD._replace(**{name: value})
    # On a busy machine it may lag behind for a while.
    assert any(node.player.hold(bad, patience=0.0) == (None, None) for _ in range(3))
    assert node.reports(DiagnosticStatus.ERROR, name, word, part="inputs", send=bad)
    reason = "out of range" if math.isfinite(value) else "not finite"
    assert int(node.value(f"{name} refused, {reason}", "inputs")) > 0
    assert node.player.hold(GOOD).efficiency is not None


def test_stale_input_silences_the_node(node):
    node.set(input_timeout=0.3)
    assert node.player.hold(GOOD).efficiency is not None
    node.player.spin_for(0.4)
    node.player.efficiencies.clear()
    for _ in range(8):
        for publisher, value in zip(node.player._inputs[:2], GOOD, strict=False):
            publisher.publish(publisher.msg_type(data=value))
        node.player.spin_for(0.05)
    assert node.player.efficiencies == []
    assert node.reports(
        DiagnosticStatus.STALE, "load_torque: nothing received for", part="inputs")
    assert node.player.hold(GOOD).efficiency is not None
