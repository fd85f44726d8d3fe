# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A client of the node: publishes inputs and bench samples, and calls services.

It serves the demonstration and the tests, and as a short example of a client.
"""

import json
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from std_srvs.srv import Trigger

import hmcvt_core as hmcvt
from hmcvt_core.transmission.stage import speed_ratio
from hmcvt_ros import qos
from hmcvt_ros.inputs import INPUT_RANGES, OperatingPoint
from hmcvt_ros.shafts import JOINTS

ROUND = 0.05
"""Time between two rounds of the three inputs [s]."""


class Answer(NamedTuple):
    """The last answer of the node; None where it was silent."""

    efficiency: float | None
    optimal_displacement_ratio: float | None


class Reply(NamedTuple):
    """Reply of a service: success, and the JSON object of `message`."""

    success: bool
    data: dict[str, Any]


def bench_message(samples: hmcvt.BenchSamples, i: int) -> JointState:
    """Return a bench message with the shaft powers of sample i.

    Table 2 has no output speed. A bench sample needs one; without slip it is eq. (5).
    """
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    ratio, speed, load, efficiency = (
        float(column[i])
        for column in (
            samples.displacement_ratio,
            samples.engine_speed,
            samples.load_torque,
            samples.efficiency,
        )
    )
    output_speed = speed * float(speed_ratio(stage, samples.displacement_ratio[i]))
    return bench_sample_to_message(
        ratio, speed, load / efficiency, output_speed, load * speed / output_speed
    )


def bench_sample_to_message(
    displacement_ratio: float,
    engine_speed: float,
    engine_torque: float,
    output_speed: float,
    output_torque: float,
) -> JointState:
    """Return what a bench measures [-, rad/s, N m] as a message without a stamp."""
    return JointState(
        name=list(JOINTS),
        position=[math.nan, math.nan, float(displacement_ratio)],
        velocity=[float(engine_speed), float(output_speed), math.nan],
        effort=[float(engine_torque), float(output_torque), math.nan],
    )


class BenchPlayer(Node):
    """Client of a node `hmcvt` in the same namespace.

    Attributes:
        efficiencies, optima: values received since the last `hold`.
        model_text: last YAML of `~/model`, None before the first.
        map: last message of `~/efficiency_map`, None before the first.
        statuses: last diagnostics by the last word of the name (`inputs`, `model`, `gap`), each
            with `level`, `message` and `values`, the last value of every key so far.
    """

    def __init__(self, context: Context | None = None, namespace: str = "") -> None:
        super().__init__("bench_player", context=context, namespace=namespace)
        self.efficiencies: list[float] = []
        self.optima: list[float] = []
        self.model_text: str | None = None
        self.map: Float64MultiArray | None = None
        self.statuses: dict[str, Any] = {}
        self._values: dict[str, dict[str, str]] = {}
        self._spinner = SingleThreadedExecutor(context=context)
        self._spinner.add_node(self)
        self._inputs = [
            self.create_publisher(Float64, limits.name, qos.INPUT)
            for limits in INPUT_RANGES
        ]
        self._samples = self.create_publisher(
            JointState, "bench_sample", qos.BENCH_SAMPLE
        )
        for kind, topic, take, profile in (
            (
                Float64,
                "efficiency",
                lambda m: self.efficiencies.append(m.data),
                qos.OUTPUT,
            ),
            (
                Float64,
                "optimal_displacement_ratio",
                lambda m: self.optima.append(m.data),
                qos.OUTPUT,
            ),
            # A value comes in the message in which it has changed, so that none may be missed.
            (DiagnosticArray, "/diagnostics", self._on_diagnostics, 100),
            # Last: their messages show that the node knows the earlier subscriptions.
            (
                String,
                "hmcvt/model",
                lambda m: setattr(self, "model_text", m.data),
                qos.LATCHED,
            ),
            (
                Float64MultiArray,
                "hmcvt/efficiency_map",
                lambda m: setattr(self, "map", m),
                qos.LATCHED,
            ),
        ):
            self.create_subscription(kind, topic, take, profile)
        self._triggers = {
            name: self.create_client(Trigger, f"hmcvt/{name}")
            for name in (
                "reidentify",
                "diagnose",
                "adopt",
                "revert",
                "clear_samples",
                "cancel",
            )
        }

    def close(self) -> None:
        """End the client."""
        self._spinner.shutdown()
        self.destroy_node()

    # --- waiting ------------------------------------------------------------------------------

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Take messages until a condition holds; False when it does not in time [s]."""
        end = time.monotonic() + timeout
        while not condition() and (left := end - time.monotonic()) > 0.0:
            self._spinner.spin_once(timeout_sec=min(left, ROUND))
        return condition()

    def spin_for(self, seconds: float) -> None:
        """Take messages for a while."""
        self.wait_until(lambda: False, seconds)

    def wait_for_node(
        self, timeout: float = 20.0, running: Callable[[], bool] = lambda: True
    ) -> bool:
        """Wait until everything is connected and the latched messages have arrived."""

        def connected() -> bool:
            return (
                all(
                    end.get_subscription_count()
                    for end in (*self._inputs, self._samples)
                )
                and all(client.service_is_ready() for client in self._triggers.values())
                and all(map(self.count_publishers, Answer._fields))
                and self.model_text is not None
                and self.map is not None
            )

        self.wait_until(lambda: connected() or not running(), timeout)
        return connected()

    # --- talking ------------------------------------------------------------------------------

    def send_inputs(self, point: OperatingPoint) -> None:
        """Publish the three inputs once."""
        for publisher, value in zip(self._inputs, point, strict=True):
            publisher.publish(Float64(data=float(value)))

    def hold(
        self, point: OperatingPoint, rounds: int = 3, patience: float = 20.0
    ) -> Answer:
        """Send the three inputs some rounds, as a bench would, and return the last answer.

        `patience` is how much longer to wait for an answer [s]. Where there is none, a warning in
        the log states why.
        """
        # In its first round the node sees mixtures of this point and the previous one.
        self.send_inputs(point)
        self._settle()
        self.efficiencies.clear()
        self.optima.clear()
        end = time.monotonic() + rounds * ROUND + patience
        while rounds > 0 or (
            not (self.efficiencies and self.optima) and time.monotonic() < end
        ):
            self.send_inputs(point)
            self.spin_for(ROUND)
            rounds -= 1
        self._settle()
        answer = Answer(
            *(
                values[-1] if values else None
                for values in (self.efficiencies, self.optima)
            )
        )
        if None in answer:
            self.get_logger().warning(f"no answer: {self._reason_of_silence()}")
        return answer

    def _reason_of_silence(self) -> str:
        """Return what the last diagnostics say of the inputs, and of the model if it complains."""
        if not {"inputs", "model"} <= self.statuses.keys():
            return "no diagnostics come from the node hmcvt; does it run in this namespace?"
        reason = f"inputs: {self.statuses['inputs']['message']}"
        if self.statuses["model"]["level"] != DiagnosticStatus.OK:
            reason = f"{reason}; model: {self.statuses['model']['message']}"
        return reason

    def _settle(self) -> None:
        """Take messages until the outputs pause; a busy machine lags behind."""
        count = -1
        while count != len(self.optima):
            count = len(self.optima)
            self.spin_for(1.5 * ROUND)

    def send_sample(self, message: JointState) -> None:
        """Publish one bench sample."""
        self._samples.publish(message)

    def wait_for_logged(self, count: int, timeout: float = 20.0) -> bool:
        """Wait until diagnostics say that the log holds at least `count` samples."""
        return self.wait_until(
            lambda: (
                "model" in self.statuses
                and int(self.statuses["model"]["values"]["bench samples logged"])
                >= count
            ),
            timeout,
        )

    def request(self, service: str) -> Any:
        """Call a service and return the future of its reply."""
        return self._triggers[service].call_async(Trigger.Request())

    def call(self, service: str, timeout: float = 120.0) -> Reply:
        """Call a service and wait for its reply.

        Raises:
            TimeoutError: it did not come.
        """
        future = self.request(service)
        if not self.wait_until(future.done, timeout):
            raise TimeoutError(f"~/{service} did not reply within {timeout:g} s")
        response = future.result()
        return Reply(response.success, json.loads(response.message))

    # --- callbacks ----------------------------------------------------------------------------

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        mine = f"{self.get_namespace()}/hmcvt: ".replace("//", "/").lstrip("/")
        for status in message.status:
            if status.name.startswith(mine):
                part = status.name.removeprefix(mine)
                values = self._values.setdefault(part, {})
                values.update((pair.key, pair.value) for pair in status.values)
                self.statuses[part] = {
                    "level": status.level,
                    "message": status.message,
                    "values": dict(values),
                }
