# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A subscriber of the answers, reliable, as control stacks have one; run by the tests."""

import contextlib

import rclpy
from rclpy.executors import ExternalShutdownException
from std_msgs.msg import Float64

from hmcvt_ros import qos

rclpy.init()
node = rclpy.create_node("subscriber")
for topic in ("efficiency", "optimal_displacement_ratio"):
    node.create_subscription(Float64, topic, lambda message: None, qos.OUTPUT)
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(node)
