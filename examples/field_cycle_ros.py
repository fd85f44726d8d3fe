# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Drive the cycle of field_cycle.py by the stage and engine speed that the node recommends.

    hmcvt-node --ros-args -p model_file:=params/tractor.yaml \
        -p engine_file:=params/engine.yaml -p optimum_hold:=output_speed   # in one terminal
    python examples/field_cycle_ros.py                                     # in another

The tractor begins each part of the cycle by the engine-only rule, publishes its operating point,
and changes to the stage and engine speed of the answer. The script compares the fuel.

With `--mission ploughing` it drives the first `--seconds` of a cycle of `hmcvt mission` instead,
second by second within the limits of the machine, and compares the fuel with the strategies of
`hmcvt mission`. Give the node `vehicle_file:=params/vehicle.yaml` too, so that it answers by the
causal strategy and neither stage nor engine speed hunts.
"""

import argparse
import math
import time

import field_cycle
import rclpy
from control_stack import PERIOD, ControlStack
from std_msgs.msg import String

import hmcvt_core as hmcvt
from hmcvt_core.model.operating_point import operating_point
from hmcvt_ros import qos
from hmcvt_tools.mission import Choice, Drive, Planned, Situation, Vehicle, read_cycle

SETTLING = 1.0  # s
PATIENCE = 10.0  # s
COMPARED = ("causal", "least_fuel", "engine_line")


class FieldCycle(ControlStack):
    """A simulated tractor that follows the node."""

    def __init__(self, namespace: str) -> None:
        super().__init__(namespace, pretend=True)
        self.tractor, self.engine = field_cycle.files()
        self.keep(self.heard, ("optimal_engine_speed",), qos.OUTPUT)
        self.keep(self.heard, ("optimal_stage",), qos.OUTPUT, String)
        self._stage = self.create_publisher(String, "stage", qos.LATCHED)

    def _step(self) -> None:
        self.publish()

    def answered(self) -> bool:
        """Whether the node has recommended a stage and an engine speed."""
        return {"optimal_engine_speed", "optimal_stage"} <= self.heard.keys()

    def choice(self, output_speed: float, power: float) -> field_cycle.Choice:
        """Return stage and engine speed that the node recommends for a demand."""
        present = field_cycle.by_rule(self.tractor, self.engine, output_speed, power)
        return self.asked(present, output_speed, power)

    def next_choice(self, now: Situation) -> Choice:
        """Return what the node recommends for the next second of a mission."""
        if now.stage not in self.tractor.stages or not math.isfinite(now.engine_speed):
            # The beginning, and neutral: there is no operating point to publish.
            return now.choice(int(now.reachable.argmin()))
        present = (str(now.stage), now.engine_speed)
        try:
            answer = self.asked(present, now.output_speed, now.output_power)
        except hmcvt.InputError:  # the present stage does not hold the new demand
            return now.choice(int(now.reachable.argmin()))
        return Choice(*answer)

    def asked(
        self, present: field_cycle.Choice, output_speed: float, power: float
    ) -> field_cycle.Choice:
        """Publish the operating point of a demand, and return the answer of the node.

        Raises:
            InputError: the present stage does not hold the demand at the present engine speed.
        """
        stage, speed = present
        stroke, load = operating_point(
            self.tractor.stages[stage],
            speed,
            {"output_speed": output_speed, "output_power": power},
        )
        self.state.update(
            displacement_ratio=stroke, engine_speed=speed, load_torque=load
        )
        self._stage.publish(String(data=stage))
        settled = time.monotonic() + SETTLING
        while time.monotonic() < settled:
            rclpy.spin_once(self, timeout_sec=PERIOD)
        while not self.answered() and time.monotonic() < settled + PATIENCE:
            rclpy.spin_once(self, timeout_sec=PERIOD)
        if not self.answered():
            raise SystemExit(
                "no answer: does a node run, with all stages and the engine?"
            )
        # The last answer belongs to the present inputs.
        return self.heard["optimal_stage"], self.heard["optimal_engine_speed"]


def drive_mission(node: FieldCycle, name: str, seconds: int) -> None:
    """Drive a cycle of `hmcvt mission` by the node, and print its fuel and that of others."""
    vehicle = Vehicle()
    cycle = read_cycle(name, vehicle).first(seconds)
    planned = Planned.of(Drive(node.tractor, node.engine, vehicle), cycle)
    print(f"{name}, {len(cycle)} s")
    print("strategy          kg  % above the bound  stage changes")
    for strategy in (node.next_choice, *COMPARED):
        mission = planned.mission(strategy)
        title = strategy if isinstance(strategy, str) else "node"
        print(
            f"{title:<12} {mission.fuel:7.4f}  {100.0 * mission.above_bound:17.2f}  "
            f"{mission.shifts:13}"
        )


def main() -> None:
    """Drive and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--namespace", default="", help="of the node and its topics")
    parser.add_argument("--mission", help="cycle of `hmcvt mission`, a name or a file")
    parser.add_argument(
        "--seconds", type=int, default=120, help="of the mission that are driven (120)"
    )
    options = parser.parse_args()
    rclpy.init()
    node = FieldCycle(options.namespace)
    if options.mission is None:
        field_cycle.compare([node.tractor], node.engine, node.choice)
    else:
        drive_mission(node, options.mission, options.seconds)


if __name__ == "__main__":
    main()
