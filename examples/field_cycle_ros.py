# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The field cycle of field_cycle.py, driven by what the node says of stage and engine speed.

    hmcvt-node --ros-args -p model_file:=params/tractor.yaml \
        -p engine_file:=params/engine.yaml -p optimum_hold:=output_speed   # in one terminal
    python examples/field_cycle_ros.py                                     # in another

The tractor begins each part of the cycle as the rule of the engine alone drives it, tells the node
where it is, and changes to the stage and the engine speed of the answer. Compared is the fuel.
"""

import argparse
import time

import field_cycle
import rclpy
from control_stack import PERIOD, ControlStack
from std_msgs.msg import String

from hmcvt_core.model.agreement import operating_point
from hmcvt_ros import qos

SETTLING, PATIENCE = 1.0, 10.0  # s


class FieldCycle(ControlStack):
    """A pretended tractor that asks the node, and has the model only to be the tractor."""

    def __init__(self, namespace: str) -> None:
        super().__init__(namespace, pretend=True)
        self.tractor, self.engine = field_cycle.files()
        self.keep(self.heard, ("optimal_engine_speed",), qos.OUTPUT)
        self.keep(self.heard, ("optimal_stage",), qos.OUTPUT, String)
        self._stage = self.create_publisher(String, "stage", qos.LATCHED)

    def _step(self) -> None:
        self.publish()

    def choice(self, output_speed: float, power: float) -> field_cycle.Choice:
        """Stage and engine speed that the node says for an output speed and power."""
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
        end, wanted = (
            time.monotonic() + SETTLING,
            {"optimal_engine_speed", "optimal_stage"},
        )
        while (now := time.monotonic()) < end or (
            not wanted <= self.heard.keys() and now < end + PATIENCE
        ):
            rclpy.spin_once(self, timeout_sec=PERIOD)
        if not wanted <= self.heard.keys():
            raise SystemExit(
                "no answer: does a node run, with all stages and the engine?"
            )
        # The last answer is that of the inputs as they stand.
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
