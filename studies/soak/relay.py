# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The least that a node in rclpy can do: what ROS itself costs, for comparison.

The inputs, outputs, qualities of service and executor of the node `hmcvt`, and one line of work:
every value that arrives is published twice, every operating point is answered with an advice of
zeros. Run as a module, with ROS arguments.
"""

import contextlib

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from hmcvt_ros import qos
from hmcvt_ros.inputs import INPUT_RANGES
from hmcvt_ros.outputs import ADVICE


class Relay(Node):
    """Answers each arrival on one of three topics with two messages."""

    def __init__(self) -> None:
        super().__init__("relay")
        self._outputs = [
            self.create_publisher(Float64, topic, qos.OUTPUT)
            for topic in ("efficiency", "optimal_displacement_ratio")
        ]
        for limits in INPUT_RANGES:
            self.create_subscription(Float64, limits.name, self._answer, qos.INPUT)
        self._advice = self.create_publisher(JointState, "advice", qos.OUTPUT)
        self.create_subscription(JointState, "operating_point", self._advise, qos.INPUT)

    def _answer(self, message: Float64) -> None:
        for output in self._outputs:
            output.publish(Float64(data=message.data))

    def _advise(self, message: JointState) -> None:
        zeros = [0.0] * len(ADVICE)
        self._advice.publish(
            JointState(header=message.header, name=list(ADVICE), position=zeros)
        )


def main() -> None:
    rclpy.init()
    executor = SingleThreadedExecutor()
    executor.add_node(Relay())
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
