# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A control stack that uses the node.

    hmcvt-node                                                # in one terminal
    python examples/control_stack.py --seconds 10 --pretend   # in another

The node answers with the best displacement ratio at the present engine speed. Choosing the engine
speed as well is better: among all pairs of engine speed and displacement ratio with the same
ground speed and power, one has the least loss. This program finds it with `hmcvt_core`, from the
model that the node serves and latches on `~/model`, so that a refit of the node takes effect at
once. It sends `cvt_command`: velocity of joint `engine` [rad/s], position of joint `displacement`
[-]. With `--pretend`, it also simulates the tractor: it publishes the inputs of the node and
follows the command at once. `examples/field_cycle_ros.py` drives a field cycle in this way, stages
included.
"""

import argparse
import math
import signal
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

import hmcvt_core as hmcvt
from hmcvt_ros import qos

PERIOD = 0.1  # s
START = {"displacement_ratio": -0.8, "engine_speed": 209.4, "load_torque": 200.0}


class ControlStack(Node):
    """Finds the pair with the least loss at the present ground speed and power."""

    def __init__(self, namespace: str = "", pretend: bool = False) -> None:
        super().__init__("control_stack", namespace=namespace)
        self.model: hmcvt.EfficiencyModel | None = None
        self.state: dict[str, float] = dict(START) if pretend else {}
        self.heard: dict[str, Any] = {}  # last answers of the node
        self.command: hmcvt.Optimum | None = None
        self._senders = {
            name: self.create_publisher(Float64, name, qos.INPUT)
            for name in START
            if pretend
        }
        if not pretend:
            self.keep(self.state, START, qos.INPUT)
        self.keep(self.heard, ("efficiency", "optimal_displacement_ratio"), qos.OUTPUT)
        self.create_subscription(String, "hmcvt/model", self._on_model, qos.LATCHED)
        self._commands = self.create_publisher(JointState, "cvt_command", 10)
        self.create_timer(PERIOD, self._step)

    def keep(
        self,
        values: dict[str, Any],
        names: Iterable[str],
        profile: QoSProfile,
        kind: Any = Float64,
    ) -> None:
        """Keep the last value of some topics."""
        for name in names:
            self.create_subscription(
                kind, name, lambda m, name=name: values.update({name: m.data}), profile
            )

    def _on_model(self, message: String) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.yaml"
            path.write_text(message.data, encoding="utf-8")
            self.model = hmcvt.load_model(path)
        self.get_logger().info(f"model {self.model.fingerprint}")

    def _step(self) -> None:
        if self.model is None or len(self.state) < len(START):
            return
        try:
            best = self.model.optimal_displacement_ratio(
                self.state["engine_speed"],
                self.state["load_torque"],
                hold="output_speed",
                displacement_ratio=self.state["displacement_ratio"],
            )
        except hmcvt.InputError as error:  # out of range: keep the last command
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return
        if math.isnan(best.efficiency):
            return  # no pair holds this speed and power: keep the last command
        self.command = best
        self._commands.publish(
            JointState(
                name=["engine", "displacement"],
                velocity=[float(best.engine_speed), 0.0],
                position=[0.0, float(best.displacement_ratio)],
            )
        )
        self.publish()
        self.state.update((name, float(getattr(best, name))) for name in self._senders)

    def publish(self) -> None:
        """Publish the operating point of the simulated tractor."""
        for name, sender in self._senders.items():
            sender.publish(Float64(data=float(self.state[name])))


def main() -> None:
    """Run for a while, then print the last command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="how long to run (10)"
    )
    parser.add_argument("--namespace", default="", help="of the node and its topics")
    parser.add_argument(
        "--pretend", action="store_true", help="simulate the tractor as well"
    )
    options = parser.parse_args()
    # rclpy would end the program in the middle of a step.
    interrupts: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: interrupts.append(number))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = ControlStack(options.namespace, options.pretend)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + options.seconds
    while time.monotonic() < end and not interrupts:
        executor.spin_once(timeout_sec=PERIOD)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()
    if node.command is None:
        raise SystemExit("no command: model or inputs did not come; does the node run?")
    print(
        f"command: engine {node.command.engine_speed:.1f} rad/s, displacement ratio "
        f"{node.command.displacement_ratio:+.3f}, efficiency {node.command.efficiency:.3f}"
    )
    print(
        "the node: "
        + ", ".join(f"{name} {value:.3f}" for name, value in node.heard.items())
    )


if __name__ == "__main__":
    main()
