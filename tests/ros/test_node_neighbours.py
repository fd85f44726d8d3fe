# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node among others: of its own kind, and strangers on the same domain."""

from __future__ import annotations

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_bench import GOOD
from std_msgs.msg import Float64, Float64MultiArray, String

import hmcvt_core as hmcvt
from hmcvt_ros import qos


@pytest.fixture
def stranger(environment):
    """A node of a participant of its own: within one, a topic has one type."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("stranger", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def test_stranger_on_the_domain_does_no_harm(node, paper_file, stranger: Node):
    def counts():
        return [node.value(f"{name} refused, {reason}", "inputs") for name in GOOD._fields
                for reason in ("not finite", "out of range")] + [
                node.value("bench samples received")]

    node.forget_status()
    assert node.comes(lambda: all(counts()))
    before = counts()
    space = node.namespace
    model = hmcvt.load_model(paper_file)
    # Other types on the topics of the node, its own outputs among them.
    wrong = [(stranger.create_publisher(kind, f"{space}/{topic}", profile), kind())
             for kind, topic, profile in [
                 (String, "engine_speed", qos.INPUT), (Float64MultiArray, "load_torque", 10),
                 (String, "bench_sample", qos.BENCH_SAMPLE), (String, "efficiency", qos.OUTPUT),
                 (Float64, "hmcvt/model", qos.LATCHED), (Float64, "hmcvt/efficiency_map", 10)]]
    # The diagnostics of someone else, in good shape and in bad.
    other = stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
    status = DiagnosticStatus(name="camera: frames", level=DiagnosticStatus.ERROR)
    arrays = [DiagnosticArray(), DiagnosticArray(status=[status] * 50)]
    flood = stranger.create_publisher(String, f"{space}/unrelated", 10)
    noise = String(data="x" * 10_000)

    for _ in range(50):
        for publisher, message in wrong:
            publisher.publish(message)
        for array in arrays:
            other.publish(array)
        for _ in range(20):
            flood.publish(noise)
        node.player.spin_for(0.005)

    assert node.player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    node.forget_status()
    assert node.comes(lambda: all(counts()))
    assert counts() == before
    late = node.connect(space)
    assert late.wait_until(lambda: late.model_text is not None and late.map is not None, 10.0)
    assert node.process.poll() is None and "Traceback" not in node.log
