# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A node with use_sim_time for which nobody publishes /clock, or for which it falls silent."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, send_table
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

import hmcvt_core as hmcvt

pytestmark = pytest.mark.slow

COMPLAINT = "use_sim_time is set but nothing came on /clock"
SILENCE = 2.0  # s without /clock while inputs come


@pytest.fixture(scope="module")
def node(start_node, paper_file):
    return start_node(paper_file, use_sim_time=True, input_timeout=0.5)


@pytest.fixture
def clock(node):
    publisher = node.player.create_publisher(Clock, "/clock", 1)
    assert node.comes(publisher.get_subscription_count)
    yield publisher
    node.player.destroy_publisher(publisher)


def run_clock(node, clock, start, seconds):
    """Publish a clock that runs with the wall clock; return its last time."""
    begin = time.monotonic()
    while (passed := time.monotonic() - begin) < seconds:
        message = Clock()
        now = start + passed
        message.clock.sec, message.clock.nanosec = int(now), round(now % 1.0 * 1e9)
        clock.publish(message)
        node.player.spin_for(0.02)
    return start + passed


def send(node, *names):
    values = GOOD._asdict()
    for publisher in node.player._inputs:
        name = publisher.topic_name.rpartition("/")[2]
        if name in names:
            publisher.publish(Float64(data=values[name]))


def answers_to_old_inputs(node, wait):
    """Send two inputs, wait, and count the answers to the third."""
    send(node, "load_torque", "displacement_ratio")
    node.player.spin_for(wait)
    node.player.efficiencies.clear()
    for _ in range(5):
        send(node, "engine_speed")
        node.player.spin_for(0.1)
    return len(node.player.efficiencies)


def warns(node, *words):
    return node.reports(DiagnosticStatus.WARN, *words, part="inputs", send=GOOD)


def log_lines(node):
    return sum(COMPLAINT in line for line in node.log.splitlines())


def test_missing_clock_is_a_warning_from_the_start(node):
    node.forget_status()
    assert node.comes(lambda: COMPLAINT in node.status("inputs")["message"])
    assert node.status("inputs")["level"] >= DiagnosticStatus.WARN
    assert node.says(COMPLAINT)
    node.player.spin_for(2.5)
    assert log_lines(node) == 1


def test_ages_follow_the_wall_clock_without_a_clock(node):
    assert answers_to_old_inputs(node, 1.5) == 0
    assert node.reports(
        DiagnosticStatus.WARN, COMPLAINT, "nothing received for", part="inputs"
    )
    assert node.player.hold(GOOD).efficiency is not None
    assert warns(node, COMPLAINT)


def test_sample_without_a_stamp_has_the_time_of_the_wall_clock(node, table2):
    send_table(node, table2)
    stamps = hmcvt.read_bench(node.bench_file).stamp
    assert stamps.min() > time.time() - 60.0


def test_first_clock_ends_the_warning(node, clock):
    run_clock(node, clock, 100.0, 0.5)
    assert node.reports(DiagnosticStatus.OK, "three fresh", part="inputs", send=GOOD)
    assert node.player.hold(GOOD).efficiency is not None


def test_clock_that_falls_silent_while_inputs_come(node, clock):
    last = run_clock(node, clock, 200.0, 0.5)
    lines = log_lines(node)
    assert answers_to_old_inputs(node, SILENCE + 1.0) == 0
    assert warns(node, COMPLAINT, "s while inputs came")
    assert node.player.hold(GOOD).efficiency is not None
    assert node.comes(lambda: log_lines(node) == lines + 1)

    run_clock(node, clock, last + 0.01, 0.5)
    assert node.reports(DiagnosticStatus.OK, "three fresh", part="inputs", send=GOOD)


def test_old_inputs_are_not_used_after_the_clock_fell_silent(node, clock):
    run_clock(node, clock, 250.0, 0.3)
    send(node, "load_torque", "displacement_ratio")
    run_clock(node, clock, 250.4, 0.1)
    node.player.spin_for(SILENCE + 0.5)
    node.player.efficiencies.clear()
    for _ in range(5):
        send(node, "engine_speed")
        node.player.spin_for(0.1)
    assert node.player.efficiencies == []


def test_pause_without_inputs_is_no_fault(node, clock):
    run_clock(node, clock, 300.0, 0.3)
    assert node.player.hold(GOOD, rounds=1).efficiency is not None
    lines = log_lines(node)
    node.player.spin_for(SILENCE + 1.0)
    assert node.status("inputs")["level"] == DiagnosticStatus.OK
    assert log_lines(node) == lines
