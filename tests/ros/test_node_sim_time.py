# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node under a simulated clock: ages follow it, whether it runs, stands still or goes back."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD
from rosgraph_msgs.msg import Clock

pytestmark = pytest.mark.slow

STEP = 0.05
INPUTS = ("displacement_ratio", "engine_speed", "load_torque")


class Simulation:
    """A publisher of /clock, and what the node says of its inputs."""

    def __init__(self, node):
        self.node, self.player = node, node.player
        self.time = None
        self.clock = self.player.create_publisher(Clock, "/clock", 1)
        assert self.player.wait_until(
            lambda: self.clock.get_subscription_count() > 0, 10.0
        )

    def tick(self, time):
        """Publish a time once."""
        message = Clock()
        message.clock.sec, message.clock.nanosec = int(time), round(time % 1.0 * 1e9)
        self.clock.publish(message)

    def set(self, time):
        """Set the clock and give the node the time to hear of it."""
        self.time = time
        for _ in range(3):
            self.tick(time)
            self.player.spin_for(STEP)

    def answers(self):
        """Send a point while the clock stands still; return whether it is answered."""
        if self.time is not None:
            self.set(self.time)
        self.player.efficiencies.clear()
        # Best effort: one may be lost. Not sent again soon, since a busy node would hear the second
        # one when the clock is set already.
        for _ in range(3):
            self.player.send_inputs(GOOD)
            if self.player.wait_until(lambda: bool(self.player.efficiencies), 10.0):
                return True
        return False

    def tells(self, level, age):
        """Whether diagnostics that come from now on say so of all inputs."""
        self.node.forget_status()
        return self.node.comes(
            lambda: (
                self.node.status("inputs")["level"] == level
                and all(
                    self.node.value(f"{name} age [s]", "inputs") == age
                    for name in INPUTS
                )
            )
        )


@pytest.fixture(scope="module")
def simulation(sim_node):
    simulation = Simulation(sim_node)
    yield simulation
    simulation.player.destroy_publisher(simulation.clock)


def test_ages_follow_the_clock_also_when_it_stands_still(simulation):
    # Before the first message of /clock it is the time zero.
    assert simulation.answers()
    simulation.set(100.0)
    assert simulation.tells(DiagnosticStatus.WARN, "100.000")

    assert simulation.answers()
    simulation.player.spin_for(1.2)  # paused: beyond the age limit by the wall clock
    assert simulation.tells(DiagnosticStatus.OK, "0.000"), (
        "diagnostics stop with the clock"
    )
    simulation.set(100.4)
    assert simulation.tells(DiagnosticStatus.OK, "0.400")

    # Ten times faster than the wall clock.
    simulation.set(101.5)
    assert simulation.tells(DiagnosticStatus.WARN, "1.500")
    assert one_input_alone_is_not_answered(simulation)
    assert simulation.answers()


def test_clock_that_goes_back_makes_old_inputs_missing(simulation):
    simulation.set(200.0)
    assert simulation.answers() and simulation.tells(DiagnosticStatus.OK, "0.000")
    jumps = int(simulation.node.value("clock jumps", "inputs"))
    simulation.set(10.0)
    assert simulation.tells(DiagnosticStatus.WARN, "-")
    assert simulation.node.value("clock jumps", "inputs") == str(jumps + 1)
    assert {simulation.node.value(f"{name} state", "inputs") for name in INPUTS} == {
        "missing"
    }
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
    assert simulation.tells(DiagnosticStatus.WARN, "-")
    assert simulation.answers()


def one_input_alone_is_not_answered(simulation):
    simulation.set(simulation.time)
    ratio = simulation.player._inputs[0]
    simulation.player.efficiencies.clear()
    ratio.publish(ratio.msg_type(data=0.5))
    simulation.player.spin_for(0.3)
    return simulation.player.efficiencies == []
