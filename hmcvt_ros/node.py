# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node `hmcvt`: efficiency and optimal displacement ratio as topics.

It computes nothing itself: it takes messages, checks ages and ranges, asks the model of
`hmcvt_core`, and publishes the answers. It is a plain node with a single-threaded executor: a
lookup takes a millisecond, and everything longer runs in another process.
"""

import itertools
import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, Int32, String

from hmcvt_core import (
    BenchSamples,
    EfficiencyModel,
    HmcvtError,
    InputError,
    Watch,
    data_path,
    load_engine,
)
from hmcvt_core.interface import LOAD_TORQUE, OIL_TEMPERATURE, joined
from hmcvt_tools import load_vehicle

from . import interfaces, messages, parameters, qos
from .actions import Actions
from .bench_log import BenchLog
from .clocks import CLOCK_TOPIC, AgeClock, Arrival, SimulatedClock, SteadyClock
from .diagnostics import Activity, ChangeFilter, gap_status, inputs_status, model_status
from .frames import is_coordinate_frame
from .guard import Guard, Log
from .inputs import (
    INPUT_RANGES,
    NANOSECONDS,
    Inputs,
    OperatingPoint,
    State,
    Tally,
    coasting,
)
from .jobs import loaded_effects
from .maps import Maps
from .model_store import ModelStore
from .numbering import Numbers
from .outputs import ADVICE, ASSUMED_OIL, Outputs, Served, depends_on_oil
from .public_text import PublicText
from .recorder import INVALID, NOT_WRITTEN, Recorder
from .services import Services
from .state_folder import StateFolder, require_regular, working_directory_trouble

TICK = 0.1
"""Period of the timer [s]."""
DIAGNOSTICS_EVERY = 10
"""Ticks between two diagnostics: 1 Hz."""
STAGE_LIMIT = 200
"""Most characters of the name of a stage."""
JOINT_SHOWN = 100
"""Most characters of the name of a joint that a message shows."""
WATCHED_AT_ONCE = 200
"""Samples that the watch takes between two diagnostics; they take 10 ms."""

_ONE_PUBLISHER = (
    *(limits.name for limits in INPUT_RANGES),
    OIL_TEMPERATURE.name,
    "stage",
    messages.SESSION,
    "efficiency",
    "optimal_displacement_ratio",
    "optimal_engine_speed",
    "optimal_stage",
    "advice",
)
"""Topics on which a second publisher is a mistake."""

_REFUSED_OPTIONS = (
    "allow_undeclared_parameters",
    "automatically_declare_parameters_from_overrides",
)
"""Options of `rclpy.node.Node` with which everyone could add parameters, without end."""

POINT_INVALID = "invalid"
POINT_STALE = "stale"
POINT_WITHOUT_STAGE = "no stage"
POINT_REASONS = (POINT_INVALID, POINT_STALE, POINT_WITHOUT_STAGE)
"""Why an operating point may be refused."""


class _PointError(HmcvtError):
    """A message on `operating_point` that gets no answer; `reason` is one of `POINT_REASONS`."""

    def __init__(self, reason: str, state: State, text: str) -> None:
        super().__init__(f"operating_point: {text}")
        self.reason = reason
        self.state = state


@contextmanager
def _invalid_point() -> Iterator[None]:
    """Turn errors of reading a message into those of an operating point."""
    try:
        yield
    except HmcvtError as error:
        raise _PointError(POINT_INVALID, State.INVALID, str(error)) from None


def _require_own_program() -> None:
    """Refuse to be created while Python imports the main module for another process.

    Raises:
        InputError: it does, and the node would be there twice.
    """
    # The flag by which multiprocessing itself finds this mistake.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError(
            "a process of refits imports the main module, which creates the node again: put the "
            'main module under if __name__ == "__main__"'
        )


def _columns(samples: BenchSamples) -> tuple[str, ...]:
    """Return the names of the columns that samples have."""
    return (*samples.columns, *samples.extra)


class EfficiencyNode(Node):
    """Serves one efficiency model; parameters: see `hmcvt_ros.parameters`.

    Inputs `engine_speed` [rad/s], `load_torque` [N m], `displacement_ratio` [-],
    `oil_temperature` [deg C], `operating_point`, `stage`, `session`, `bench_sample`; outputs
    `efficiency` [-], `optimal_displacement_ratio` [-], `optimal_engine_speed` [rad/s],
    `optimal_stage`, `advice`,
    `~/model`, `~/efficiency_map`,
    `~/progress`, `/diagnostics`; services `~/reidentify`, `~/diagnose`, `~/adopt`, `~/revert`,
    `~/clear_samples`, `~/cancel`.

    It runs in a `SingleThreadedExecutor`, together with other nodes, and refuses others. `close`
    or `destroy_node` ends what it has started.

    Attributes:
        guard: contains errors of callbacks.
        ticks: how often the timer has run.
        start_warnings: what had no effect at the start; /diagnostics states it for good.

    Raises:
        InputError: a parameter is wrong, the model file cannot be used, or another node has the
            state folder.
    """

    def __init__(self, **options: Any) -> None:
        """Create the node.

        Args:
            options: keyword arguments of `rclpy.node.Node`, such as `context`, `namespace` and
                `parameter_overrides`.
        """
        _require_own_program()
        for name in _REFUSED_OPTIONS:
            if options.get(name):
                raise InputError(
                    f"{name}: the node declares its parameters itself, and has no others"
                )
        super().__init__("hmcvt", **{"enable_logger_service": True, **options})
        self._resources = ExitStack()
        self._process_id = os.getpid()
        self.start_warnings: list[str] = []
        self._written = True  # what waited for the disk
        self._actions: Actions | None = None  # where hmcvt_msgs is installed
        try:
            self._start()
        except BaseException:
            self.destroy_node()
            raise

    @property
    def executor(self) -> Executor | None:
        """The executor that the node belongs to, or None."""
        return super().executor

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        """Enter an executor.

        Raises:
            InputError: it is not single-threaded. A `MultiThreadedExecutor` would run two callbacks
                at once, and leaves most inputs unanswered.
        """
        if new_executor is not None and not isinstance(
            new_executor, SingleThreadedExecutor
        ):
            new_executor.remove_node(self)
            raise InputError(
                f"the node hmcvt does not run in a {type(new_executor).__name__}; add it to a "
                "SingleThreadedExecutor, with other nodes or alone in a thread"
            )
        Node.executor.fset(self, new_executor)

    def close(self) -> bool:
        """End the threads and the process of the node; False when the disk does not answer.

        Samples that wait for the disk are written first. A second call does nothing, and neither
        does one in a forked process, which shares the node's process but has no such threads.
        """
        if os.getpid() != self._process_id:
            return True
        self._resources.close()
        return self._written

    def destroy_node(self) -> None:
        """Close the node and remove it from ROS."""
        self.close()
        if self._actions is not None:
            self._actions.destroy()
        if self.executor is not None:
            # It would resume requests that wait for a job, and they could not be answered.
            self.executor.remove_node(self)
        super().destroy_node()

    # --- set-up -------------------------------------------------------------------------------

    def _start(self) -> None:
        """Take the parameters, lock the state folder, load the model, create the topics."""
        self._inputs = Inputs()
        self._ages = self._clock_of_ages()
        self._settings = parameters.declare(self)
        self._first_settings = self._settings
        folder = self._state_path()
        self._public = PublicText(folder, parameters.files(self._settings))
        self._lines = Log(self, self._public)
        self.guard = Guard(self, self._lines)
        self._follow_parameters()
        effects_checksum = loaded_effects(self._settings.effects_file)
        self._state = StateFolder(folder)
        self._resources.callback(self._state.close)
        model_file = self._settings.model_file or data_path("params/hm4.yaml")
        self._store = ModelStore(Path(model_file), folder, effects_checksum)
        self._activity = Activity()
        self._change_filter = ChangeFilter()
        self._log = self._recorder(folder)
        self._resources.callback(self._close_log)
        self._last_output = -math.inf
        self._output_due = False
        self._served = self._store.in_service
        self._engine = None
        for path in (self._settings.engine_file, self._settings.vehicle_file):
            require_regular(Path(path))
        if self._settings.engine_file:
            self._engine = load_engine(self._settings.engine_file)
        self._vehicle = None
        if self._settings.vehicle_file:
            self._vehicle = load_vehicle(self._settings.vehicle_file)
        self._stage = ""  # the stage engaged; empty before it is known
        self._session: int | None = None  # of the bench; None before it is known
        self._points = Tally(POINT_REASONS)
        self._point_numbers = Numbers()
        self.ticks = 0
        # The callback lives as long as the handle is held.
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
            self._lines,
            self._public,
            effects_checksum,
        )
        self._resources.callback(self._service_handlers.close)
        kinds = interfaces.find("action", "Refit")
        if kinds is not None:
            self._actions = Actions(self, kinds, self._service_handlers, self._lines)
        self._require_distinct_names()
        # The timer must run even when a simulated clock stands still.
        timer = self.create_timer(
            TICK,
            self.guard.callback(self._tick),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )
        self._resources.callback(timer.cancel)
        self._announce()
        self._report_start()

    def _close_log(self) -> None:
        self._written = self._log.close()

    def _clock_of_ages(self) -> AgeClock:
        """Return the clock that ages follow; it is chosen at the start for good."""
        if not self.get_parameter("use_sim_time").value:
            return SteadyClock()
        clock = SimulatedClock(self.get_clock(), self._inputs.change_clock)
        clock.listen(self)
        return clock

    def _follow_parameters(self) -> None:
        self.add_on_set_parameters_callback(
            lambda changes: parameters.check_changes(self, changes)
        )
        self.add_post_set_parameters_callback(self.guard.callback(self._take_settings))
        # A client must not exchange the clock of the ages.
        self.set_descriptor(
            "use_sim_time",
            ParameterDescriptor(
                type=ParameterType.PARAMETER_BOOL,
                description="Whether to follow /clock.",
                read_only=True,
            ),
        )

    def _state_path(self) -> Path:
        if self._settings.state_folder:
            # A link given at the start is followed; one that takes its place later is not.
            return Path(self._settings.state_folder).resolve()
        home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
        return (home / self.get_fully_qualified_name().strip("/")).resolve()

    def _recorder(self, folder: Path) -> Recorder:
        log = BenchLog(
            folder / "bench_samples.csv",
            self._settings.bench_log_limit,
            stages=bool(self._store.in_service.model.other_stages),
        )
        recorder = Recorder(
            log,
            lambda text: self.guard.warn("bench_sample", text),
            lambda: self._state.trouble() or working_directory_trouble(),
        )
        if not self._state.writable:
            recorder.tally.expect(NOT_WRITTEN, self._state.complaint)
        return recorder

    def _create_topics(self) -> None:
        # rclpy checks every event of every topic before each message. The default events warn of a
        # peer whose quality of service does not fit, which these profiles hardly allow, and the
        # peer is warned as well. A best-effort publisher of bench samples is another matter.
        no_publisher_events = PublisherEventCallbacks(use_default_callbacks=False)
        no_events = SubscriptionEventCallbacks(use_default_callbacks=False)

        def publisher(kind: Any, topic: str, profile: Any) -> Any:
            return self.create_publisher(
                kind,
                topic,
                **qos.overridable(profile),
                event_callbacks=no_publisher_events,
            )

        self._outputs = Outputs(publisher)
        self._model_publisher = publisher(String, "~/model", qos.LATCHED)
        self._maps = Maps(
            publisher(Float64MultiArray, "~/efficiency_map", qos.LATCHED).publish
        )
        self._resources.callback(self._maps.close)
        self._diagnostics_publisher = publisher(
            DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS
        )
        for limits in INPUT_RANGES:
            self.create_subscription(
                Float64,
                limits.name,
                self._input_callback(limits.name),
                **qos.overridable(qos.INPUT),
                event_callbacks=no_events,
            )
        self.create_subscription(
            Float64,
            OIL_TEMPERATURE.name,
            self.guard.callback(self._on_oil_temperature),
            **qos.overridable(qos.INPUT),
            event_callbacks=no_events,
        )
        self.create_subscription(
            String,
            "stage",
            self.guard.callback(self._on_stage),
            **qos.overridable(qos.LATCHED),
            event_callbacks=no_events,
        )
        self.create_subscription(
            Int32,
            messages.SESSION,
            self.guard.callback(self._on_session),
            **qos.overridable(qos.LATCHED),
            event_callbacks=no_events,
        )
        self._subscribe_raw(
            JointState,
            "operating_point",
            self._on_operating_point,
            qos.INPUT,
            no_events,
        )
        self._subscribe_raw(
            JointState, "bench_sample", self._on_bench_sample, qos.BENCH_SAMPLE, None
        )
        self._typed: Any = interfaces.find("msg", "Advice")
        if self._typed is not None:
            self._advice_publisher = publisher(
                self._typed.Advice, "~/advice", qos.OUTPUT
            )
            self._subscribe_raw(
                self._typed.OperatingPoint,
                "~/operating_point",
                self._on_typed_point,
                qos.INPUT,
                no_events,
            )
            self._subscribe_raw(
                self._typed.BenchSample,
                "~/bench_sample",
                self._on_typed_sample,
                qos.BENCH_SAMPLE,
                None,
            )

    def _require_distinct_names(self) -> None:
        """Refuse remappings by which the node would answer itself, or take one input for two.

        Raises:
            InputError: two of its topics or services have the same name.
        """
        services = [service.service_name for service in self.services]
        for name in services:
            if services.count(name) > 1:
                raise InputError(
                    f"{name} is the name of {services.count(name)} services of the node; remap "
                    "each to another name"
                )
        used = [publisher.topic_name for publisher in self.publishers]
        used += [subscription.topic_name for subscription in self.subscriptions]
        for name in used:
            if used.count(name) > 1:
                raise InputError(
                    f"{name} is the name of {used.count(name)} topics of the node, which would "
                    "answer itself or take one message for two; remap each to another name"
                )

    def _subscribe_raw(
        self,
        kind: Any,
        topic: str,
        callback: Callable[..., None],
        profile: Any,
        events: Any,
    ) -> None:
        """Subscribe to the bytes of messages: one that is too long is refused unread."""
        self.create_subscription(
            kind,
            topic,
            self.guard.callback(callback),
            raw=True,
            **qos.overridable(profile),
            event_callbacks=events,
        )

    def _graph_warnings(self) -> list[str]:
        """Return what the peers of the node show to be wrong."""
        warnings = []
        for name, item in self._inputs.by_name.items():
            publishers = self.count_publishers(self.resolve_topic_name(name))
            # A client that sends operating points alone lacks nothing.
            if item.stamp is None and publishers and self._inputs.asked is None:
                warnings.append(f"{name}: nothing comes from {publishers} publisher(s)")
        warnings += self._unheard()
        for name in _ONE_PUBLISHER:
            publishers = self.count_publishers(self.resolve_topic_name(name))
            if publishers > 1:
                warnings.append(f"{name}: {publishers} publishers, which may disagree")
        itself = (self.get_name(), self.get_namespace())
        if self.get_node_names_and_namespaces().count(itself) > 1:
            warnings.append(
                f"another node has the name {self.get_fully_qualified_name()} too: clients cannot "
                "tell the two apart"
            )
        if self.get_parameter("use_sim_time").value:
            clocks = self.count_publishers(self.resolve_topic_name(CLOCK_TOPIC))
            if clocks > 1:
                warnings.append(
                    f"{clocks} publishers on {CLOCK_TOPIC}: time may jump to and fro"
                )
        return warnings

    def _unheard(self) -> list[str]:
        """Return why the node does not hear a publisher, of each topic the first one."""
        reasons = []
        for subscription in self.subscriptions:
            topic = subscription.topic_name
            for publisher in self.get_publishers_info_by_topic(topic):
                reason = qos.misfit(publisher, subscription)
                if reason:
                    reasons.append(
                        f"{topic}: {publisher.node_name} is not heard: {reason}"
                    )
                    break
        return reasons

    def warn_of_start(self, text: str) -> None:
        """State in the log, and in /diagnostics for good, what had no effect at the start."""
        self.start_warnings.append(text)
        self._lines.warning(text)

    def _report_start(self) -> None:
        # ROS ignores misspelt names without a warning.
        for name in sorted(self._parameter_overrides):
            if not self.has_parameter(name):
                self.warn_of_start(f"parameter {name} is unknown and has no effect")
        if self._settings.vehicle_file and not self._settings.engine_file:
            self.warn_of_start(
                "parameter vehicle_file has no effect without engine_file"
            )
        for complaint in (
            self._state.complaint,
            self._store.complaint,
            self._log.complaint,
        ):
            if complaint:
                self._lines.warning(complaint)
        path = self._store.in_service.path
        if not self._settings.model_file and path == self._store.base:
            self._lines.warning(
                "parameter model_file is empty: the model that comes with hmcvt is "
                "served, an example identified from five tests of one transmission"
            )
        self._lines.info(
            f"serving {path}, {len(self._log.log)} bench samples in {self._log.log.path}"
        )

    # --- parameters ---------------------------------------------------------------------------

    def _take_settings(self, changes: Sequence[Parameter]) -> None:
        before = self._settings
        self._settings = parameters.after(before, self)
        if self._settings.engine_speed_limits != before.engine_speed_limits:
            self._want_map()
        limits = parameters.changes(before, self._settings, limits_only=True)
        if limits:
            self._lines.warn("limits", f"limits changed: {limits}")

    # --- stages -------------------------------------------------------------------------------

    def _on_stage(self, message: String) -> None:
        self._stage = message.data[:STAGE_LIMIT]
        self._want_map()
        if self._engaged() is None:
            self.guard.warn("stage", self._without_stage())
        self._publish_outputs(self._ages.now())

    def _engaged(self, stage: str = "") -> Served | None:
        """Return what answers; None where the model has several stages and none is engaged.

        Args:
            stage: the stage engaged; empty for that of the topic `stage`.
        """
        transmission = self._served.model
        if not transmission.other_stages:
            return Served(transmission, transmission, self._engine, self._vehicle)
        model = transmission.stages.get(stage or self._stage)
        if model is None:
            return None
        return Served(model, transmission, self._engine, self._vehicle)

    def _without_stage(self, stage: str = "") -> str:
        """Return why no stage is engaged; `stage` as of `_engaged`."""
        stages = ", ".join(self._served.model.stages)
        engaged = stage or self._stage
        if engaged:
            return f"stage {engaged!r} is not known; there is {stages}"
        return f"stage: nothing received, and the model has several: {stages}"

    # --- inputs and outputs -------------------------------------------------------------------

    def _input_callback(self, name: str) -> Any:
        item = self._inputs.by_name[name]

        def take(message: Float64, info: Mapping[str, int]) -> None:
            # Guarded here rather than by a wrapper: this runs at every message.
            try:
                arrival = self._ages.arrival(info["received_timestamp"])
                item.numbers.take(info["publication_sequence_number"])
                if not item.take(message.data, arrival):
                    self.guard.warn(name, item.tally.complaint)
                self._output_due = True
                self._publish_outputs(arrival.now)
            except Exception as error:
                self.guard.contain(name, error)

        return take

    def _point(self, now: int) -> OperatingPoint | None:
        """Return the present operating point, None without one or without a stage."""
        if self._engaged() is None:
            return None
        return self._inputs.point(now, self._settings.age_limits)

    def _publish_outputs(self, now: int) -> None:
        """Answer the inputs as they are, unless the rate limit says later."""
        rate = self._settings.max_output_rate
        if rate > 0.0 and time.monotonic() - self._last_output < 1.0 / rate:
            return
        self._output_due = False
        point = self._point(now)
        served = self._engaged()
        if point is not None and served is not None:
            self._outputs.answer(served, point, self._settings, self._oil(now))
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

    def _oil(self, now: int, stage: str = "") -> float | None:
        """Return the oil temperature [deg C]; None where it is unknown or does not matter."""
        if not self._needs_oil(stage):
            return None
        return self._inputs.oil_temperature(now, self._settings.oil_age_limit)

    def _needs_oil(self, stage: str = "") -> bool:
        served = self._engaged(stage)
        return served is not None and depends_on_oil(served.model)

    def _on_oil_temperature(self, message: Float64, info: Mapping[str, int]) -> None:
        arrival = self._ages.arrival(info["received_timestamp"])
        oil = self._inputs.oil
        if not oil.take(message.data, arrival):
            self.guard.warn("oil_temperature", oil.tally.complaint)

    def _on_operating_point(self, raw: bytes, info: Mapping[str, int]) -> None:
        arrival = self._ages.arrival(info["received_timestamp"])
        self._point_numbers.take(info["publication_sequence_number"])
        message: JointState | None = None

        def read() -> interfaces.Question:
            nonlocal message
            message = messages.joint_state(raw)
            point = messages.point_from_message(message, self._points)
            return interfaces.Question(point, messages.oil_temperature_of(message))

        point, oil = self._asked(arrival, read)
        served = self._engaged()
        transmission = self._served.model
        self._outputs.advise(
            served or Served(transmission, transmission, None),
            message or JointState(),
            point,
            self._settings,
            stage_known=served is not None,
            oil_temperature=oil,
        )

    def _on_typed_point(self, raw: bytes, info: Mapping[str, int]) -> None:
        """Answer an OperatingPoint of hmcvt_msgs."""
        arrival = self._ages.arrival(info["received_timestamp"])
        message = self._typed.OperatingPoint()
        stage = ""

        def read() -> interfaces.Question:
            nonlocal message, stage
            message = interfaces.read(raw, self._typed.OperatingPoint)
            stage = message.stage
            return interfaces.question_of(message, self._points)

        point, oil = self._asked(arrival, read, lambda: stage)
        served = self._engaged(stage)
        advice = self._typed.Advice(header=message.header, id=message.id)
        advice.model = self._served.model.fingerprint
        advice.stage = "" if served is None else served.model.stage.name
        advice.hold = self._settings.optimum_hold
        values = dict.fromkeys(ADVICE, math.nan)
        if point is not None and served is not None:
            numbers = self._outputs.advice_values(served, point, self._settings, oil)
            values = dict(zip(ADVICE, numbers, strict=True))
            advice.optimal_stage = self._outputs.optimal_stage(
                served, point, self._settings, oil
            )
            if math.isnan(values["efficiency"]):
                advice.refusal = served.model.refusal(*point, oil) or ""
        elif self._inputs.asked is not None:
            advice.refusal = self._inputs.asked[1]
        # Not known counts as outside: a consumer must not trust it more.
        advice.extrapolated = values.pop("extrapolated") != 0.0
        del values["hold"]
        for name, value in values.items():
            setattr(advice, name, float(value))
        self._advice_publisher.publish(advice)

    def _asked(
        self,
        arrival: Arrival,
        read: Callable[[], interfaces.Question],
        stage_of_message: Callable[[], str] = str,
    ) -> tuple[OperatingPoint | None, float | None]:
        """Take a message with an operating point, count it, and keep its state for diagnostics.

        Args:
            arrival: when it came.
            read: reads it.
            stage_of_message: returns the stage that it states, once it is read; empty for none.

        Returns:
            Operating point, None where there is no answer, and the oil temperature [deg C], None
            where it is not known or does not matter.
        """
        age = (arrival.now - arrival.received) * NANOSECONDS
        point = None
        oil = None
        try:
            with _invalid_point():
                point, stated = read()
                if stated is not None:
                    self._inputs.oil.take(stated, arrival)
            stage = stage_of_message()
            oil = self._oil(arrival.now, stage) if stated is None else stated
            if not self._needs_oil(stage):
                oil = None
            self._require_answerable(age, stage)
        except _PointError as error:
            point = None
            self._points.refuse(error.reason, str(error))
            self.guard.warn("operating_point", str(error))
            self._inputs.asked = (error.state, str(error))
        else:
            self._points.accept()
            reason = coasting(LOAD_TORQUE, point.load_torque)
            self._inputs.asked = (State.FRESH, "")
            if reason:
                point = None
                self._inputs.coasting += 1
                self._inputs.asked = (State.COASTING, f"operating_point: {reason}")
        return point, oil

    def _require_answerable(self, age: float, stage: str = "") -> None:
        """Refuse an operating point that waited too long [s], or whose stage is not known."""
        if age > self._settings.input_timeout:
            raise _PointError(
                POINT_STALE,
                State.STALE,
                f"it has waited for {age:.1f} s; input_timeout",
            )
        if self._engaged(stage) is None:
            raise _PointError(
                POINT_WITHOUT_STAGE, State.MISSING, self._without_stage(stage)
            )

    # --- bench samples ------------------------------------------------------------------------

    def _on_session(self, message: Int32) -> None:
        self._session = message.data

    def _on_bench_sample(self, raw: bytes, info: Mapping[str, int]) -> None:
        self._log.numbers.take(info["publication_sequence_number"])
        self._take_sample(lambda: messages.joint_state(raw))

    def _on_typed_sample(self, raw: bytes, info: Mapping[str, int]) -> None:
        """Take a BenchSample of hmcvt_msgs."""
        self._log.numbers.take(info["publication_sequence_number"])
        kind = self._typed.BenchSample
        self._take_sample(lambda: interfaces.joint_state_of(interfaces.read(raw, kind)))

    def _take_sample(self, read: Callable[[], JointState]) -> None:
        """Read a bench sample and log it, or count it as refused."""
        try:
            message = read()
            # Zero before the first message on /clock: then, as for the ages, the wall clock.
            now = self.get_clock().now().nanoseconds * NANOSECONDS or time.time()
            oil = self._inputs.oil_temperature(
                self._ages.now(), self._settings.oil_age_limit
            )
            sample = messages.bench_sample_from_message(
                message, now, self._log.tally, oil, self._session
            )
            if self._served.model.other_stages:
                stage = self._stage_of_sample(message.header.frame_id)
                sample = replace(sample, extra={**sample.extra, "stage": (stage,)})
            self._log.submit(sample)
        except InputError as error:
            self._log.refuse(INVALID, str(error))
            return
        for joint in messages.unused_joints(message):
            name = repr(joint[:JOINT_SHOWN])
            self.guard.warn("joint", f"bench_sample: joint {name} is not used")

    def _stage_of_sample(self, frame: str) -> str:
        """Return the stage of a bench sample: of its `frame_id`, else the one engaged.

        The sample's word comes first because topics keep no order among themselves.

        Raises:
            InputError: neither is a stage of the model.
        """
        stages = self._served.model.stages
        if frame in stages:
            self._activity.sample_stage = f"{frame}, from header.frame_id"
            return frame
        # Any text may come in a frame_id, so its length is limited.
        stranger = ""
        if frame:
            stranger = (
                f"header.frame_id {frame[:STAGE_LIMIT]!r} is no stage of the model"
            )
        if self._stage not in stages:
            parts = [stranger, self._without_stage()]
            raise InputError(f"bench_sample: {'; '.join(filter(None, parts))}")
        source = "from topic stage"
        if stranger:
            source = f"{source}: {stranger}"
        if not is_coordinate_frame(frame):
            # It may be the name of a stage with a mistake in it.
            self.guard.warn(
                "frame_id", f"bench_sample: {stranger}; taken as {self._stage}"
            )
        self._activity.sample_stage = f"{self._stage}, {source}"
        return self._stage

    # --- model --------------------------------------------------------------------------------

    def _announce(self) -> None:
        """Publish the model in service, and answer with it from here on."""
        in_service = self._store.in_service
        self._model_publisher.publish(
            messages.model_to_message(
                in_service.model,
                {
                    "file": self._public(str(in_service.path)),
                    "since": in_service.since,
                    "fingerprint": in_service.model.fingerprint,
                },
            )
        )
        self._watch = Watch(in_service.model, self._settings.bench_noise or None)
        # Only after publication: a client that hears an answer has been sent its model.
        self._served = in_service
        self._want_map()
        self._publish_outputs(self._ages.now())

    def _want_map(self) -> None:
        """Ask for the map of the stage engaged, else of the first one."""
        served = self._engaged()
        model: EfficiencyModel = self._served.model
        if served is not None:
            model = served.model
        self._maps.want(model, self._settings)

    # --- time ---------------------------------------------------------------------------------

    def _tick(self) -> None:
        self._service_handlers.poll()
        now = self._ages.now()
        # NaN is repeated, so that a client that has just begun to listen receives it too.
        unanswered = (
            self._settings.invalid_output == parameters.NAN and self._point(now) is None
        )
        if self._output_due or unanswered:
            self._publish_outputs(now)
        self._maps.poll()
        if warning := self._ages.warning():
            self._lines.warning(warning)
        self.ticks += 1
        if self.ticks % DIAGNOSTICS_EVERY == 0:
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        self._log.poll()
        self._watch_samples()
        name = self.get_fully_qualified_name().strip("/")
        now = self._ages.now()
        warnings = [
            self._ages.complaint,
            self._inputs.apart_reason,
            *self.start_warnings,
            *self._graph_warnings(),
        ]
        state, complaint = self._inputs.oil.state(now, self._settings.oil_age_limit)
        if state is State.INVALID:
            warnings.append(complaint)
        if self._engaged() is None:
            warnings.append(self._without_stage())
        if self._needs_oil() and self._oil(now) is None:
            warnings.append(
                "oil_temperature: unknown, and the model depends on it; answers are for "
                f"{ASSUMED_OIL:g} deg C"
            )
        counts = {
            "points answered": self._outputs.answered,
            "points not answered, coasting": self._inputs.coasting,
            "points not answered, inputs apart": self._inputs.apart,
            **self._points.values("operating points"),
            "operating points lost": self._point_numbers.missing,
            "oil temperature [deg C]": self._oil_in_words(now),
            "session": "unknown" if self._session is None else self._session,
            "clock jumps": self._inputs.clock_jumps + self._ages.jumps,
            "requests contained": self.guard.contained,
        }
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        statuses = (
            inputs_status(
                name,
                self._public,
                self._inputs,
                now,
                self._settings,
                counts,
                [warning for warning in warnings if warning],
            ),
            model_status(
                name,
                self._public,
                self._served,
                self._store.complaint,
                self._activity,
                self._log,
                self._point(now),
                self._oil(now),
                self._outputs.refusal,
                self._first_settings,
                self._settings,
            ),
            gap_status(name, self._public, self._watch.found),
        )
        array.status = self._change_filter.reduce(
            statuses,
            time.monotonic(),
            self._diagnostics_publisher.get_subscription_count(),
        )
        self._diagnostics_publisher.publish(array)
        self._inputs.apart_reason = ""
        self._inputs.asked = None

    def _oil_in_words(self, now: int) -> str:
        oil = self._inputs.oil_temperature(now, self._settings.oil_age_limit)
        return "unknown" if oil is None else f"{oil:.1f}"

    def _watch_samples(self) -> None:
        """Give the watch on the gap some of the samples that came."""
        news = self._log.news
        samples = []
        for _ in range(min(len(news), WATCHED_AT_ONCE)):
            # The watch has one noise for all samples.
            samples.append(replace(news.popleft(), efficiency_std=None))
        for _, alike in itertools.groupby(samples, _columns):
            self._watch.take(joined(list(alike)))
