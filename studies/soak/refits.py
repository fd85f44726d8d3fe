# SPDX-License-Identifier: Apache-2.0
"""Refits back to back while the node serves."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from hmcvt_core import EfficiencyModel
from hmcvt_ros import qos
from hmcvt_ros.messages import bench_sample_to_message

from .load import Target
from .points import ORDINARY

_BATCH = 80  # fewer than the node's subscription holds
_NOISE = 0.004  # of the efficiency


class Refits:
    """Calls `~/reidentify` again and again.

    Attributes:
        replies: what was answered, as JSON objects.
    """

    def __init__(self, client: Node, target: Target, namespace: str) -> None:
        self._target = target
        self._client = client.create_client(Trigger, f"{namespace}/hmcvt/reidentify")
        self._samples = client.create_publisher(
            JointState, f"{namespace}/bench_sample", qos.BENCH_SAMPLE)
        self._waiting = False
        self.replies: list[dict[str, Any]] = []

    def log_samples(self, model: EfficiencyModel, count: int, seed: int) -> None:
        """Have the node log bench samples: what a model gives, with noise.

        Raises:
            TimeoutError: it does not log them.
        """
        random = np.random.default_rng(seed)
        for number in range(1, count + 1):
            point = random.uniform(*np.transpose(ORDINARY))
            efficiency = float(model.efficiency(*point)) * (1 + _NOISE * random.standard_normal())
            self._samples.publish(_message(model, point, efficiency))
            if number % _BATCH and number < count:
                continue
            if not self._target.ear.listen_until(lambda logged=number: (
                    self._target.statuses.sum("model", "logged") == logged), 30.0):
                raise TimeoutError(f"bench samples are not logged:\n{self._target.process.log}")

    def poll(self) -> None:
        """Take the reply to the running refit, if it is there, and start the next."""
        self._take()
        if not self._waiting:
            self._waiting = True
            self._client.call_async(Trigger.Request())

    def finish(self, timeout: float = 120.0) -> dict[str, Any]:
        """Wait for the running refit; return its reply.

        Raises:
            TimeoutError: there is none.
            RuntimeError: it failed.
        """
        def ended() -> bool:
            self._take()
            return not self._waiting

        if not self._target.ear.listen_until(ended, timeout):
            raise TimeoutError(f"a refit does not end:\n{self._target.process.log}")
        return self.replies[-1]

    def _take(self) -> None:
        header, response = self._client.handle.take_response(Trigger.Response)
        if header is None:
            return
        self._waiting = False
        reply = json.loads(response.message)
        if not response.success:
            raise RuntimeError(f"~/reidentify: {reply['error']}")
        self.replies.append(reply)


def _message(model: EfficiencyModel, point: Any, efficiency: float) -> JointState:
    displacement_ratio, engine_speed, load_torque = map(float, point)
    output_power = load_torque * engine_speed
    output_speed = float(model.output_speed(displacement_ratio, engine_speed, load_torque))
    return bench_sample_to_message(
        displacement_ratio, engine_speed, output_power / efficiency / engine_speed,
        output_speed, output_power / output_speed)
