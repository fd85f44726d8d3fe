# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Drive the cycle of field_cycle.py by the stage and engine speed that the node recommends.

    hmcvt-node --ros-args -p model_file:=params/tractor.yaml \
        -p engine_file:=params/engine.yaml -p optimum_hold:=output_speed   # in one terminal
    python examples/field_cycle_ros.py                                     # in another

The tractor begins each part of the cycle by the engine-only rule, publishes its operating point,
and changes to the stage and engine speed of the answer. The script compares the fuel.
"""

import argparse
import time

import field_cycle
import rclpy
from control_stack import PERIOD, ControlStack
from std_msgs.msg import String

from hmcvt_core.model.agreement import operating_point
from hmcvt_ros import qos

SETTLING = 1.0  # s
PATIENCE = 10.0  # s


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
        stage, speed = field_cycle.by_rule(
            self.tractor, self.engine, output_speed, power
        )
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


def main() -> None:
    """Drive and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--namespace", default="", help="of the node and its topics")
    namespace = parser.parse_args().namespace
    rclpy.init()
    node = FieldCycle(namespace)
    field_cycle.compare([node.tractor], node.engine, node.choice)


if __name__ == "__main__":
    main()
