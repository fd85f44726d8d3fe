# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node `hmcvt`: efficiency and optimal displacement ratio as topics.

It computes nothing itself. It takes messages, checks ages and ranges, asks the model of
`hmcvt_core`, and publishes the answers. A plain node and a single-threaded executor: a lookup takes
a millisecond, and the rest runs in a process of its own.
"""

import math
import os
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String

from hmcvt_core import (
    BenchSamples,
    EfficiencyMap,
    HmcvtError,
    InputError,
    Watch,
    data_path,
    load_effects,
    load_engine,
)
from hmcvt_core.files.bench import joined
from hmcvt_core.transmission.ranges import LOAD_TORQUE

from . import messages, parameters, qos
from .bench_log import INVALID, MOST_WAITING, NOT_WRITTEN, BenchLog, Recorder
from .clocks import NodeClock, SteadyClock
from .diagnostics import Activity, gap_status, inputs_status, model_status
from .guard import Guard
from .inputs import (
    INPUT_RANGES,
    NANOSECONDS,
    Inputs,
    OperatingPoint,
    State,
    Tally,
    coasting,
)
from .model_store import ModelStore
from .outputs import Outputs, Served
from .services import Services
from .state_folder import StateFolder

TICK = 0.1
STAGE_LIMIT = 200  # characters of a name
DIAGNOSTICS_EVERY = 10  # ticks: 1 Hz
WATCHED_AT_ONCE = 200  # samples: 10 ms


class EfficiencyNode(Node):
    """Serves one efficiency model; parameters: see `hmcvt_ros.parameters`.

    Inputs `engine_speed` [rad/s], `load_torque` [N m], `displacement_ratio` [-], `operating_point`,
    `stage`, `bench_sample`; outputs `efficiency` [-], `optimal_displacement_ratio` [-],
    `optimal_engine_speed` [rad/s], `optimal_stage`, `advice`, `~/model`, `~/efficiency_map`,
    `/diagnostics`; services `~/reidentify`, `~/diagnose`, `~/adopt`, `~/revert`,
    `~/clear_samples`, `~/cancel`.

    Attributes:
        guard: contains what goes wrong.
        ticks: how often the timer has run.

    Raises:
        InputError: a parameter is wrong, the model file cannot be used, or another node has the
            state folder.
    """

    def __init__(self) -> None:
        super().__init__("hmcvt")
        self.guard = Guard(self)
        self._settings = parameters.declare(self)
        self.add_on_set_parameters_callback(
            lambda changes: parameters.check_changes(self, changes)
        )
        self.add_post_set_parameters_callback(self.guard.callback(self._take_settings))
        # Ages follow the clock that is chosen at the start: no stranger may exchange it.
        simulated = bool(self.get_parameter("use_sim_time").value)
        self.set_descriptor(
            "use_sim_time",
            ParameterDescriptor(
                type=ParameterType.PARAMETER_BOOL,
                description="Whether to follow /clock.",
                read_only=True,
            ),
        )
        self._ages = NodeClock(self.get_clock()) if simulated else SteadyClock()
        home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
        folder = Path(
            self._settings.state_folder
            or home / self.get_fully_qualified_name().strip("/")
        ).absolute()
        if self._settings.effects_file:
            load_effects(self._settings.effects_file)
        self._state = StateFolder(folder)
        self._store = ModelStore(
            Path(self._settings.model_file or data_path("params/hm4.yaml")), folder
        )
        self._inputs, self._activity = Inputs(), Activity()
        self._log = Recorder(
            BenchLog(
                folder / "bench_samples.csv",
                self._settings.bench_log_limit,
                bool(self._store.in_service.model.other_stages),
            ),
            lambda text: self.guard.warn("bench_sample", text),
            self._state.gone,
        )
        if not self._state.writable:
            self._log.tally.expect(NOT_WRITTEN, self._state.complaint)
        self._last_output = -math.inf
        self._output_due = self._map_due = False
        self._served = self._store.in_service
        self._engine = (
            load_engine(self._settings.engine_file)
            if self._settings.engine_file
            else (None)
        )
        self._stage = ""  # engaged; empty before it is known
        self._points = Tally(("invalid", "stale"))
        self._unwatched: deque[BenchSamples] = deque(maxlen=MOST_WAITING)
        self.ticks = 0
        # Held on to: the callback lives as long as what is returned.
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1)),
            post_callback=lambda jump: self._inputs.clock_jumped(),
        )
        self._create_topics()
        self._service_handlers = Services(
            self,
            self._store,
            self._log,
            self._activity,
            lambda: self._settings,
            self._announce,
            self.guard.warn,
        )
        # The timer must run even when a simulated clock stands still.
        self.create_timer(
            TICK,
            self.guard.callback(self._tick),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )
        self._announce(self._settings)
        self._report_start()

    def close(self) -> bool:
        """End what runs beside the node; False when a thread still waits for the disk."""
        self._service_handlers.close()
        written = self._log.close()
        self._state.close()
        return written

    # --- set-up -------------------------------------------------------------------------------

    def _create_topics(self) -> None:
        # rclpy goes through every event of every topic before each message. The default ones warn
        # of a peer that asks for or offers too little: hardly possible with these profiles, and
        # the peer is told as well. A best-effort publisher of bench samples is another matter.
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        quiet_too = SubscriptionEventCallbacks(use_default_callbacks=False)

        def create(kind: Any, topic: str, profile: Any) -> Any:
            return self.create_publisher(
                kind, topic, **qos.overridable(profile), event_callbacks=quiet
            )

        self._outputs = Outputs(create)
        self._model_publisher = create(String, "~/model", qos.LATCHED)
        self._map_publisher = create(Float64MultiArray, "~/efficiency_map", qos.LATCHED)
        self._diagnostics_publisher = create(
            DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS
        )
        for limits in INPUT_RANGES:
            self.create_subscription(
                Float64,
                limits.name,
                self._input_callback(limits.name),
                **qos.overridable(qos.INPUT),
                event_callbacks=quiet_too,
            )
        self.create_subscription(
            String,
            "stage",
            self.guard.callback(self._on_stage),
            **qos.overridable(qos.LATCHED),
            event_callbacks=quiet_too,
        )
        # Raw: whether a message is too long is to be known before work is spent on it.
        for topic, callback, profile, events in (
            ("operating_point", self._on_operating_point, qos.INPUT, quiet_too),
            ("bench_sample", self._on_bench_sample, qos.BENCH_SAMPLE, None),
        ):
            self.create_subscription(
                JointState,
                topic,
                self.guard.callback(callback),
                raw=True,
                **qos.overridable(profile),
                event_callbacks=events,
            )

    def _report_start(self) -> None:
        logger = self.get_logger()
        # Typing errors, as a rule; ROS drops them without a word.
        for name in sorted(self._parameter_overrides):
            if not self.has_parameter(name):
                logger.warning(f"parameter {name} is unknown and has no effect")
        for complaint in filter(
            None, (self._state.complaint, self._store.complaint, self._log.complaint)
        ):
            logger.warning(complaint)
        if (
            not self._settings.model_file
            and self._store.in_service.path == self._store.base
        ):
            logger.warning(
                "parameter model_file is empty: the model that comes with hmcvt is "
                "served, an example identified from five tests of one transmission"
            )
        logger.info(
            f"serving {self._store.in_service.path}, {len(self._log.log)} bench "
            f"samples in {self._log.log.path}"
        )

    # --- parameters ---------------------------------------------------------------------------

    def _take_settings(self, changes: Sequence[Parameter]) -> None:
        before = self._settings
        self._settings = parameters.current(self)
        if self._settings.engine_speed_limits != before.engine_speed_limits:
            self._map_due = True  # not at once: one request may change them many times

    # --- inputs -> outputs --------------------------------------------------------------------

    def _input_callback(self, name: str) -> Any:
        item = self._inputs.by_name[name]

        def take(message: Float64, info: Mapping[str, int]) -> None:
            try:  # here, not in a wrapper: this is what runs at every message
                now = self._ages.now()
                if not item.take(
                    message.data, self._ages.received(info["received_timestamp"], now)
                ):
                    self.guard.warn(name, item.tally.complaint)
                self._output_due = True
                self._publish_outputs(now)
            except Exception as error:
                self.guard.contain(name, error)

        return take

    def _on_stage(self, message: String) -> None:
        self._stage = message.data[:STAGE_LIMIT]
        self._map_due = True
        if self._engaged() is None:
            self.guard.warn("stage", self._without_stage())
        self._publish_outputs(self._ages.now())

    def _engaged(self) -> Served | None:
        """What answers in the stage engaged; None where the model has several and it is none."""
        whole = self._served.model
        if not whole.other_stages:
            return Served(whole, whole, self._engine)
        model = whole.stages.get(self._stage)
        return None if model is None else Served(model, whole, self._engine)

    def _without_stage(self) -> str:
        stages = ", ".join(self._served.model.stages)
        return (
            f"stage {self._stage!r} is not known; there is {stages}"
            if self._stage
            else f"stage: nothing received, and the model has several: {stages}"
        )

    def _point(self, now: int) -> OperatingPoint | None:
        return (
            None
            if self._engaged() is None
            else self._inputs.point(now, self._settings.age_limits)
        )

    def _publish_outputs(self, now: int) -> None:
        """Answer the inputs as they stand, unless the rate limit says later."""
        rate = self._settings.max_output_rate
        if rate > 0.0 and time.monotonic() - self._last_output < 1.0 / rate:
            return
        self._output_due = False
        point = self._point(now)
        served = self._engaged()
        if point is not None and served is not None:
            self._outputs.answer(served, point, self._settings)
            if self._outputs.refusal:
                self.guard.warn("no answer", self._outputs.refusal)
        else:
            if served is not None:
                self._inputs.count_silence(now, self._settings.age_limits)
            if self._settings.invalid_output != parameters.NAN:
                return
            self._outputs.deny()
        if rate > 0.0:
            self._last_output = time.monotonic()

    def _on_operating_point(self, raw: bytes, info: Mapping[str, int]) -> None:
        now = self._ages.now()
        age = (now - self._ages.received(info["received_timestamp"], now)) * NANOSECONDS
        message, point, state, why = JointState(), None, State.INVALID, ""
        try:
            message = messages.joint_state(raw)
            point = messages.point_from_message(message, self._points)
            if age > self._settings.input_timeout:
                point, state = None, State.STALE
                raise InputError(f"it has waited for {age:.1f} s; input_timeout")
            self._points.accept()
            if why := coasting(LOAD_TORQUE, point.load_torque):
                self._inputs.coasting += 1
                point, why = None, f"operating_point: {why}"
            state = State.COASTING if why else State.FRESH
            if self._engaged() is None:
                raise InputError(self._without_stage())
        except HmcvtError as error:
            why = f"operating_point: {error}"
            self._points.refuse(state.value, why)
            self.guard.warn("operating_point", why)
        self._inputs.asked = state, why
        served = self._engaged()
        whole = self._served.model
        self._outputs.advise(
            served or Served(whole, whole, None),
            message,
            point if served else None,
            self._settings,
        )

    # --- bench samples ------------------------------------------------------------------------

    def _on_bench_sample(self, raw: bytes, info: Mapping[str, int]) -> None:
        self._log.numbers.take(info["publication_sequence_number"])
        try:
            message, model = messages.joint_state(raw), self._served.model
            sample = messages.bench_sample_from_message(
                message,
                self.get_clock().now().nanoseconds * NANOSECONDS,
                self._log.tally,
            )
            if model.other_stages:
                # Topics keep no order among them: better than `stage` is the sample's own word.
                named = message.header.frame_id
                stage = named if named in model.stages else self._stage
                if stage not in model.stages:
                    raise InputError(f"bench_sample: {self._without_stage()}")
                sample = replace(sample, extra={"stage": (stage,)})
        except InputError as error:
            self._log.refuse(INVALID, str(error))
        else:
            self._log.submit(sample)
            self._unwatched.append(sample)

    # --- model --------------------------------------------------------------------------------

    def _announce(
        self, settings: parameters.Settings, grid: EfficiencyMap | None = None
    ) -> None:
        """Tell of the model in service; its map, where there is one, is that of some settings."""
        now = self._store.in_service
        self._model_publisher.publish(
            messages.model_to_message(
                now.model,
                {
                    "file": str(now.path),
                    "since": now.since,
                    "fingerprint": now.model.fingerprint,
                },
            )
        )
        self._watch = Watch(now.model, self._settings.bench_noise or None)
        # Only now: whoever hears an answer has been sent the model that it is of.
        self._served = now
        # The limits of the map may have changed meanwhile.
        self._publish_map(grid if settings is self._settings else None)
        self._publish_outputs(self._ages.now())

    def _publish_map(self, grid: EfficiencyMap | None = None) -> None:
        self._map_due = False
        served = self._engaged()
        model = self._served.model if served is None else served.model
        grid = grid or model.efficiency_map(*self._settings.map_axes)
        self._map_publisher.publish(messages.map_to_message(grid))

    # --- time ---------------------------------------------------------------------------------

    def _tick(self) -> None:
        self._service_handlers.poll()
        # NaN is said again and again, so that whoever listens only now hears it too.
        now = self._ages.now()
        unanswered = (
            self._settings.invalid_output == parameters.NAN and self._point(now) is None
        )
        if self._output_due or unanswered:
            self._publish_outputs(now)
        if self._map_due:
            self._publish_map()
        self.ticks += 1
        if self.ticks % DIAGNOSTICS_EVERY == 0:
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        self._log.poll()
        if self._engaged() is None:
            self._inputs.apart_reason = self._without_stage()
        name, now = self.get_fully_qualified_name().strip("/"), self._ages.now()
        if count := min(len(self._unwatched), WATCHED_AT_ONCE):
            self._watch.take(joined([self._unwatched.popleft() for _ in range(count)]))
        array = DiagnosticArray(
            status=[
                inputs_status(
                    name,
                    self._inputs,
                    now,
                    self._settings,
                    {
                        "points answered": self._outputs.answered,
                        "points not answered, coasting": self._inputs.coasting,
                        "points not answered, inputs apart": self._inputs.apart,
                        **self._points.values("operating points"),
                        "clock jumps": self._inputs.clock_jumps + self._ages.jumps,
                        "requests contained": self.guard.contained,
                    },
                ),
                model_status(
                    name,
                    self._served,
                    self._store.complaint,
                    self._activity,
                    self._log,
                    self._point(now),
                    self._outputs.refusal,
                ),
                gap_status(name, self._watch.found),
            ]
        )
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(array)
        self._inputs.apart_reason, self._inputs.asked = "", None
