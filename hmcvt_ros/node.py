# SPDX-License-Identifier: Apache-2.0
"""The node `hmcvt`: efficiency and optimal displacement ratio as topics.

It computes nothing itself. It takes messages, checks ages and ranges, asks the model of
`hmcvt_core`, and publishes the answers. A plain node and a single-threaded executor: a lookup takes
a millisecond, and the rest runs in a process of its own.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String

from hmcvt_core import EfficiencyMap, InputError, data_path

from . import messages, parameters, qos
from .bench_log import BenchLog
from .diagnostics import NOT_WRITTEN, Activity, inputs_status, model_status
from .inputs import INPUT_RANGES, NANOSECONDS, Inputs, OperatingPoint
from .model_store import ModelStore
from .outputs import Outputs
from .services import Services
from .state_folder import StateFolder

TICK = 0.1
DIAGNOSTICS_EVERY = 10  # ticks: 1 Hz
QUIET = 5.0  # seconds between two warnings of one kind


class EfficiencyNode(Node):
    """Serves one efficiency model; parameters: see `hmcvt_ros.parameters`.

    Inputs `engine_speed` [rad/s], `load_torque` [N m], `displacement_ratio` [-], `bench_sample`;
    outputs `efficiency` [-], `optimal_displacement_ratio` [-], `~/model`, `~/efficiency_map`,
    `/diagnostics`; services `~/reidentify`, `~/diagnose`, `~/revert`, `~/clear_samples`.

    Raises:
        InputError: a parameter is wrong, the model file cannot be used, or another node has the
            state folder.
    """

    def __init__(self) -> None:
        super().__init__("hmcvt")
        self._settings = parameters.declare(self)
        self.add_on_set_parameters_callback(
            lambda changes: parameters.check_changes(self, changes))
        self.add_post_set_parameters_callback(self._guarded(self._take_settings))
        home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
        folder = Path(self._settings.state_folder
                      or home / self.get_fully_qualified_name().strip("/"))
        self._state = StateFolder(folder)
        self._store = ModelStore(
            Path(self._settings.model_file or data_path("params/hm4.yaml")), folder)
        self._log = BenchLog(folder / "bench_samples.csv", self._settings.bench_log_limit)
        self._inputs, self._activity = Inputs(), Activity()
        if not self._state.writable:
            self._activity.bench.expect(NOT_WRITTEN, self._state.complaint)
        self._warned: dict[str, float] = {}
        self._last_output = -math.inf
        self._output_due = False
        self._ticks = 0
        # Held on to: the callback lives as long as what is returned.
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1)),
            post_callback=lambda jump: self._inputs.clock_jumped())
        self._create_topics()
        self._service_handlers = Services(self, self._store, self._log, self._activity,
                                          lambda: self._settings, self._announce)
        # Ages follow the node's clock, which a simulation may drive; the timer must run even when
        # a simulated clock stands still.
        self.create_timer(TICK, self._guarded(self._tick),
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._announce(self._settings)
        self._report_start()

    def close(self) -> None:
        """End what runs beside the node."""
        self._service_handlers.close()
        self._state.close()

    # --- set-up -------------------------------------------------------------------------------

    def _create_topics(self) -> None:
        def create(kind: Any, topic: str, profile: Any, **options: Any) -> Any:
            return self.create_publisher(kind, topic, **qos.overridable(profile), **options)

        self._outputs = Outputs(create)
        # rclpy goes through every event of every topic before each message. The default ones warn
        # of subscribers that ask for more than is offered, which is hardly possible here.
        rare = {"event_callbacks": PublisherEventCallbacks(use_default_callbacks=False)}
        self._model_publisher = create(String, "~/model", qos.LATCHED, **rare)
        self._map_publisher = create(Float64MultiArray, "~/efficiency_map", qos.LATCHED, **rare)
        self._diagnostics_publisher = create(
            DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS, **rare)
        for kind, topic, callback, profile in (
                *((Float64, limits.name, self._input_callback(limits.name), qos.INPUT)
                  for limits in INPUT_RANGES),
                (JointState, "bench_sample", self._on_bench_sample, qos.BENCH_SAMPLE)):
            self.create_subscription(
                kind, topic, callback=self._guarded(callback), **qos.overridable(profile))

    def _report_start(self) -> None:
        logger = self.get_logger()
        # Typing errors, as a rule; ROS drops them without a word.
        for name in sorted(self._parameter_overrides):
            if not self.has_parameter(name):
                logger.warning(f"parameter {name} is unknown and has no effect")
        for complaint in filter(None, (self._state.complaint, self._store.complaint,
                                       self._log.recovered)):
            logger.warning(complaint)
        if not self._settings.model_file and self._store.in_service.path == self._store.base:
            logger.warning("parameter model_file is empty: the model that comes with hmcvt is "
                           "served, an example identified from five tests of one transmission")
        logger.info(f"serving {self._store.in_service.path}, {len(self._log)} bench samples in "
                    f"{self._log.path}")

    def _guarded(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Keep an exception of a callback, which would end the node, to a line in the log."""
        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self._warn(type(error).__name__, f"{type(error).__name__}: {error}")
        return guarded

    def _warn(self, about: str, text: str) -> None:
        # The throttle of the logger is one for each line of code, not one for each input.
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) >= QUIET:
            self._warned[about] = now
            self.get_logger().warning(text)

    # --- parameters ---------------------------------------------------------------------------

    def _take_settings(self, changes: Sequence[Parameter]) -> None:
        before = self._settings
        self._settings = parameters.current(self)
        if self._settings.engine_speed_limits != before.engine_speed_limits:
            self._publish_map()

    # --- inputs -> outputs --------------------------------------------------------------------

    def _input_callback(self, name: str) -> Callable[[Float64], None]:
        def take(message: Float64) -> None:
            item, now = self._inputs.by_name[name], self._now()
            if not item.take(float(message.data), now):
                self._warn(name, item.tally.complaint)
            self._output_due = True
            self._publish_outputs(now)
        return take

    def _point(self, now: int) -> OperatingPoint | None:
        return self._inputs.point(now, self._settings.input_timeouts)

    def _publish_outputs(self, now: int) -> None:
        """Answer the inputs as they stand, unless the rate limit says later."""
        rate = self._settings.max_output_rate
        if rate > 0.0 and time.monotonic() - self._last_output < 1.0 / rate:
            return
        self._output_due = False
        point = self._point(now)
        if point is not None:
            self._outputs.answer(self._store.in_service.model, point, self._settings)
            if self._outputs.refusal:
                self._warn("no answer", self._outputs.refusal)
        elif self._settings.invalid_output == parameters.NAN:
            self._outputs.deny()
        else:
            return
        if rate > 0.0:
            self._last_output = time.monotonic()

    # --- bench samples ------------------------------------------------------------------------

    def _on_bench_sample(self, message: JointState) -> None:
        bench, reason = self._activity.bench, "invalid"
        try:
            sample = messages.bench_sample_from_message(message, self._now() * NANOSECONDS)
            reason = "log full"
            self._log.append(sample)
            bench.accept()
        except InputError as error:
            bench.refuse(reason, str(error))
        except OSError as error:
            bench.refuse(NOT_WRITTEN, f"bench log: {error}")
        if bench.complaint:
            self._warn("bench_sample", bench.complaint)

    # --- model --------------------------------------------------------------------------------

    def _announce(self, settings: parameters.Settings, grid: EfficiencyMap | None = None) -> None:
        """Tell of the model in service; its map, where there is one, is that of some settings."""
        now = self._store.in_service
        self._model_publisher.publish(messages.model_to_message(now.model, {
            "file": str(now.path), "since": now.since, "fingerprint": now.model.fingerprint}))
        # The limits of the map may have changed meanwhile.
        self._publish_map(grid if settings is self._settings else None)
        self._publish_outputs(self._now())

    def _publish_map(self, grid: EfficiencyMap | None = None) -> None:
        grid = grid or self._store.in_service.model.efficiency_map(*self._settings.map_axes)
        self._map_publisher.publish(messages.map_to_message(grid))

    # --- time ---------------------------------------------------------------------------------

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _tick(self) -> None:
        self._service_handlers.poll()
        # NaN is said again and again, so that whoever listens only now hears it too.
        now = self._now()
        unanswered = self._settings.invalid_output == parameters.NAN and self._point(now) is None
        if self._output_due or unanswered:
            self._publish_outputs(now)
        self._ticks += 1
        if self._ticks % DIAGNOSTICS_EVERY == 0:
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        name, now = self.get_fully_qualified_name().strip("/"), self._now()
        array = DiagnosticArray(status=[
            inputs_status(name, self._inputs, now, self._settings.input_timeouts,
                          self._outputs.answered),
            model_status(name, self._store.in_service, self._activity, len(self._log),
                         self._point(now), self._outputs.refusal),
        ])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(array)
