# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node under a simulated clock: ages follow it, whether it runs, stands still or goes back."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros_bench import GOOD
from rosgraph_msgs.msg import Clock

from hmcvt_ros import qos

STEP = 0.05
INPUTS = ("displacement_ratio", "engine_speed", "load_torque")


class Simulation:
    """A publisher of /clock, and what the node says of its inputs.

    Attributes:
        status: the last status of the inputs; `stamp` is the node's time of it.
        arrays: how many came.
    """

    def __init__(self, node):
        self.node, self.player = node, node.player
        self.now, self.stamp, self.arrays, self.status = 0.0, None, 0, None
        self.clock = self.player.create_publisher(Clock, "/clock", 1)
        self._heard = self.player.create_subscription(
            DiagnosticArray, "/diagnostics", self._keep, qos.DIAGNOSTICS)
        assert self.player.wait_until(lambda: self.clock.get_subscription_count() > 0, 10.0)

    def close(self):
        """Leave the client as it was."""
        self.player.destroy_publisher(self.clock)
        self.player.destroy_subscription(self._heard)

    def _keep(self, array):
        if array.status[0].name == f"{self.node.namespace.strip('/')}/hmcvt: inputs":
            self.arrays += 1
            self.status = array.status[0]
            self.stamp = array.header.stamp.sec + array.header.stamp.nanosec * 1e-9

    def tick(self, time):
        """Publish a time once."""
        self.now = time
        message = Clock()
        message.clock.sec, message.clock.nanosec = int(time), round(time % 1.0 * 1e9)
        self.clock.publish(message)

    def set(self, time):
        """Set the clock and give the node the time to hear of it."""
        for _ in range(3):
            self.tick(time)
            self.player.spin_for(STEP)

    def answers(self):
        """Send a point and tell whether it is answered."""
        self.player.efficiencies.clear()
        # Best effort: one may be lost. Not sent again soon, since a busy node would hear the second
        # one when the clock is set already.
        for _ in range(3):
            self.player.send_inputs(GOOD)
            if self.player.wait_until(lambda: bool(self.player.efficiencies), 10.0):
                return True
        return False

    def inputs(self):
        """Level, ages and values that the node tells at the time set, not those before."""
        self.stamp = None
        here = self.player.wait_until(
            lambda: self.stamp is not None and abs(self.stamp - self.now) < 1e-6, 5.0)
        assert here, f"no diagnostics at {self.now}, the last is of {self.stamp}"
        values = {pair.key: pair.value for pair in self.status.values}
        return self.status.level, {values[f"{name} age [s]"] for name in INPUTS}, values


@pytest.fixture(scope="module")
def simulation(sim_node):
    simulation = Simulation(sim_node)
    yield simulation
    simulation.close()


def test_ages_follow_the_clock_also_when_it_stands_still(simulation):
    # Before the first message of /clock it is the time zero.
    assert simulation.answers()
    simulation.set(100.0)
    assert simulation.inputs()[:2] == (DiagnosticStatus.STALE, {"100.000"})

    assert simulation.answers()
    before = simulation.arrays
    simulation.player.spin_for(1.2)  # paused: beyond the age limit by the wall clock
    assert simulation.arrays > before, "diagnostics stop with the clock"
    assert simulation.inputs()[:2] == (DiagnosticStatus.OK, {"0.000"})
    simulation.set(100.4)
    assert simulation.inputs()[:2] == (DiagnosticStatus.OK, {"0.400"})

    # Ten times faster than the wall clock.
    simulation.set(101.5)
    assert simulation.inputs()[:2] == (DiagnosticStatus.STALE, {"1.500"})
    assert one_input_alone_is_not_answered(simulation)
    assert simulation.answers()


def test_clock_that_goes_back_makes_old_inputs_missing(simulation):
    simulation.set(200.0)
    assert simulation.answers()
    jumps = int(simulation.inputs()[2]["clock jumps"])
    simulation.set(10.0)
    level, ages, values = simulation.inputs()
    assert (level, ages) == (DiagnosticStatus.WARN, {"-"})
    assert {values[f"{name} state"] for name in INPUTS} == {"missing"}
    assert values["clock jumps"] == str(jumps + 1)
    # One input of the new time and two of the old are no operating point.
    assert one_input_alone_is_not_answered(simulation)
    assert simulation.answers() and simulation.answers()


def test_input_from_before_the_jump_does_not_come_back_to_life(simulation):
    simulation.set(100.0)
    assert simulation.answers()
    # Back and past the old stamps again, faster than anything asks for an age.
    for time in (99.0, 100.1):
        simulation.tick(time)
        simulation.player.spin_for(0.01)
    simulation.set(100.1)
    assert simulation.inputs()[:2] == (DiagnosticStatus.WARN, {"-"})
    assert simulation.answers()


def one_input_alone_is_not_answered(simulation):
    ratio = simulation.player._inputs[0]
    simulation.player.efficiencies.clear()
    ratio.publish(ratio.msg_type(data=0.5))
    simulation.player.spin_for(0.3)
    return simulation.player.efficiencies == []
