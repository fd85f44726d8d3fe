# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The load: three inputs at a rate, every answer recognised, its latency taken from the stamps.

An arrival begins when this process is about to publish it and ends when the middleware of this
process has received the answer; that stamp is set by a thread of the middleware, so that what
Python does here meanwhile does not count.
"""

import gc
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from std_msgs.msg import Float64

from hmcvt_ros import qos
from hmcvt_ros.inputs import INPUT_RANGES
from studies.page import busy_seconds

from .points import TOPICS, Answer, Cycle, match
from .processes import Process

# Of this side only: a listener that is late must not lose what the node has sent.
_DEEP = QoSProfile(depth=20_000)
_REST = 0.7  # seconds before each stretch, longer than inputs stay fresh: it begins from silence
_SETTLE = 0.3  # seconds after the last arrival in which answers may still come
_TICK = 0.1
Handler = Callable[[Any, int], None]
"""Takes a message and when the middleware received it [ns since 1970]."""


@dataclass(frozen=True)
class Segment:
    """What one stretch of load showed.

    Attributes:
        rate: aimed at, of each input [Hz].
        seconds: that it took to send.
        sent: arrivals sent.
        answers, optima: messages on `efficiency` and on `optimal_displacement_ratio`.
        right: answers that are exactly what must be said to one arrival, on both outputs.
        repeats: answers that say again what was said before, as a new model does.
        efficiency_latency, optimum_latency: of the right answers [ms].
        cpu: share of one core used by the process under test, 1 = all of it.
        generator_cpu, other_cpu: the same of this process and of all others on the machine.
        memory: bytes held by the process under test, ten times a second.
        accepted, answered: arrivals that the node has heard and answered, by its own count.
    """

    rate: float
    seconds: float
    sent: int
    answers: int
    optima: int
    right: int
    repeats: int
    efficiency_latency: NDArray[np.float64]
    optimum_latency: NDArray[np.float64]
    cpu: float
    generator_cpu: float
    other_cpu: float
    memory: tuple[int, ...]
    accepted: int = 0
    answered: int = 0


@contextmanager
def client() -> Iterator[Node]:
    """Make the ROS node through which this process sends and hears."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("soak", context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


def unused(message: object) -> None:
    """The callback of a subscription that no executor serves."""


class Ear:
    """Takes the messages of some subscriptions of a node.

    An executor of rclpy would cost this process more than the node under test spends on an
    answer; the way around it is the one of `rclpy.wait_for_message`.
    """

    def __init__(self, node: Node, handlers: Mapping[Subscription, Handler]) -> None:
        self._handlers = dict(handlers)
        self._wait_set = rclpy_implementation.WaitSet(
            len(handlers), 0, 0, 0, 0, 0, node.context.handle
        )

    def listen(self, timeout: float) -> None:
        """Wait until there is something or the time [s] is over, and hand out all there is."""
        self._wait_set.clear_entities()
        for subscription in self._handlers:
            self._wait_set.add_subscription(subscription.handle)
        self._wait_set.wait(max(0, int(timeout * 1e9)))
        ready = self._wait_set.get_ready_entities("subscription")
        for subscription, handle in self._handlers.items():
            if subscription.handle.pointer not in ready:
                continue
            while taken := subscription.handle.take_message(
                subscription.msg_type, False
            ):
                handle(taken[0], taken[1]["received_timestamp"])

    def listen_for(self, seconds: float) -> None:
        """Hand out what comes during a while."""
        self.listen_until(lambda: False, seconds)

    def listen_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Hand out what comes until a condition holds; False when it does not in time [s]."""
        end = time.monotonic() + timeout
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.listen(min(left, 0.1))
        return True


class Statuses:
    """The last diagnostics of the node `hmcvt` in a namespace.

    Attributes:
        values: by the last word of the name of the status (`inputs`, `model`), then by key; the
            last value of every key so far.
        stamp: when the node wrote them [ns since 1970], 0 before the first.
    """

    def __init__(self, namespace: str) -> None:
        self._mine = f"{namespace.lstrip('/')}/hmcvt: "
        self.values: dict[str, dict[str, str]] = {}
        self.stamp = 0

    def take(self, message: DiagnosticArray, received: int) -> None:
        for status in message.status:
            if status.name.startswith(self._mine):
                values = self.values.setdefault(
                    status.name.removeprefix(self._mine), {}
                )
                values.update((pair.key, pair.value) for pair in status.values)
                stamp = message.header.stamp
                self.stamp = stamp.sec * 1_000_000_000 + stamp.nanosec

    def sum(self, status: str, words: str) -> int:
        """Add up the counts whose key has these words."""
        return sum(
            int(value) for key, value in self.values[status].items() if words in key
        )


@dataclass
class Answers:
    """Values and times of reception of one output."""

    values: list[float] = field(default_factory=list)
    received: list[int] = field(default_factory=list)

    def take(self, message: Float64, received: int) -> None:
        self.values.append(message.data)
        self.received.append(received)


class Target:
    """A process under test, as seen from here.

    Args:
        patience: how long after a stretch to wait for a node that loses nothing but is late [s].

    Attributes:
        process: it.
        ear: hears its outputs, and its diagnostics.
        statuses: its last diagnostics, when it has any.
        inputs: publishers on the three inputs, in the order of `INPUT_RANGES`.
        efficiency, optimum: what came on its outputs since `forget`.
    """

    def __init__(
        self,
        client: Node,
        process: Process,
        namespace: str,
        profile: QoSProfile = qos.INPUT,
        patience: float = 0.0,
    ) -> None:
        self.process, self._patience = process, patience
        self.statuses = Statuses(namespace)
        self.efficiency, self.optimum = Answers(), Answers()
        self.inputs = [
            client.create_publisher(Float64, f"{namespace}/{limits.name}", profile)
            for limits in INPUT_RANGES
        ]
        outputs = {
            "efficiency": self.efficiency,
            "optimal_displacement_ratio": self.optimum,
        }
        self._outputs = {
            client.create_subscription(
                Float64, f"{namespace}/{topic}", unused, _DEEP
            ): answers
            for topic, answers in outputs.items()
        }
        diagnostics = client.create_subscription(
            DiagnosticArray, "/diagnostics", unused, 100
        )
        self.ear = Ear(
            client,
            {
                **{
                    subscription: answers.take
                    for subscription, answers in self._outputs.items()
                },
                diagnostics: self.statuses.take,
            },
        )

    def wait(self) -> None:
        """Wait until the process is connected.

        Raises:
            TimeoutError: it is not.
        """

        def connected() -> bool:
            return all(
                publisher.get_subscription_count() for publisher in self.inputs
            ) and all(output.get_publisher_count() for output in self._outputs)

        if (
            not self.ear.listen_until(
                lambda: connected() or not self.process.running, 20.0 + self._patience
            )
            or not connected()
        ):
            raise TimeoutError(
                f"a process under test did not come up:\n{self.process.log}"
            )
        self.ear.listen_for(0.5)  # the other side connects a little later

    def counts(self) -> tuple[int, int]:
        """Return how many arrivals the node says it has accepted and answered, up to now.

        Raises:
            TimeoutError: it says nothing.
        """
        now = time.time_ns()
        if not self.ear.listen_until(
            lambda: self.statuses.stamp > now, 5.0 + self._patience
        ):
            raise TimeoutError(f"no diagnostics:\n{self.process.log}")
        return self._accepted(), self.statuses.sum("inputs", "points answered")

    def _accepted(self) -> int:
        return self.statuses.sum("inputs", " accepted")

    def counted(
        self,
        cycle: Cycle,
        rate: float,
        seconds: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> Segment:
        """Load, and ask the node what it counted."""
        accepted, answers = self.counts()
        accepted += (
            TOPICS  # the load begins with a set of three, of which the last is answered
        )
        answers += 1
        segment = self.load(
            cycle,
            rate,
            seconds,
            meanwhile,
            lambda sent: self._accepted() == accepted + sent,
        )
        accepted_after, answers_after = self.counts()
        return replace(
            segment,
            accepted=accepted_after - accepted,
            answered=answers_after - answers,
        )

    def load(
        self,
        cycle: Cycle,
        rate: float,
        seconds: float,
        meanwhile: Callable[[], None] = lambda: None,
        settled: Callable[[int], bool] = lambda sent: True,
    ) -> Segment:
        """Be silent, then send arrivals, one topic after the other at even distances.

        Args:
            cycle: what to send and what to expect.
            rate: of each input [Hz].
            seconds: for how long.
            meanwhile: is called ten times a second.
            settled: says whether so many arrivals have been heard.

        Raises:
            TimeoutError: not even a single point is answered.
        """
        self.ear.listen_for(_REST)
        self._prime(cycle)
        before, start = self._usage(), time.monotonic()
        memory: list[int] = []

        def tick() -> None:
            memory.append(self.process.memory())
            meanwhile()

        gc.collect()
        gc.disable()
        try:
            sent = self._send(
                cycle, rate * TOPICS, round(seconds * rate * TOPICS), tick
            )
        finally:
            gc.enable()
        spent = time.monotonic() - start
        self.ear.listen_until(
            lambda: settled(len(sent)) and len(self.optimum.values) >= len(sent),
            self._patience,
        )
        self.ear.listen_for(_SETTLE)
        # Not between the two of an answer: a new model may come just then.
        self.ear.listen_until(
            lambda: len(self.efficiency.values) == len(self.optimum.values), _SETTLE
        )
        used = (self._usage() - before) / spent  # late answers have been worked for too
        return Segment(
            rate=rate,
            seconds=spent,
            sent=len(sent),
            cpu=used[0],
            generator_cpu=used[1],
            other_cpu=used[2] - used[0] - used[1],
            memory=tuple(memory),
            **self._matched(cycle, sent),
        )

    def _usage(self) -> NDArray[np.float64]:
        return np.array(
            [self.process.cpu_seconds(), time.process_time(), busy_seconds()]
        )

    def _prime(self, cycle: Cycle) -> None:
        """Send the last three arrivals of the cycle, so that the first one completes a set."""
        self.forget()
        for i in range(-TOPICS, 0):
            self.inputs[i].publish(Float64(data=cycle.values[i]))
            self.ear.listen_for(0.02)
        last = cycle.answers[-1]
        if not self.ear.listen_until(
            lambda: (
                (self.efficiency.values[-1:], self.optimum.values[-1:])
                == ([last[0]], [last[1]])
            ),
            5.0 + self._patience,
        ):
            raise TimeoutError(
                f"the first point was not answered with {last}, but with "
                f"{self.efficiency.values}:\n{self.process.log}"
            )
        self.forget()

    def forget(self) -> None:
        """Leave out what has come so far."""
        for answers in (self.efficiency, self.optimum):
            answers.values.clear()
            answers.received.clear()

    def _send(
        self, cycle: Cycle, rate: float, count: int, tick: Callable[[], None]
    ) -> list[int]:
        """Publish `count` arrivals; return when each began [ns since 1970]."""
        sent: list[int] = []
        due = next_tick = time.monotonic()
        while len(sent) < count:
            now = time.monotonic()
            if now >= next_tick:
                next_tick += _TICK
                tick()
            if now < due:
                self.ear.listen(due - now)
                continue
            i = len(sent) % len(cycle.values)
            sent.append(time.time_ns())
            self.inputs[i % TOPICS].publish(Float64(data=cycle.values[i]))
            # A load that was held up goes on later; it does not make up for it with a burst.
            due = max(due + 1.0 / rate, now)
            if i % TOPICS == 0:
                self.ear.listen(0.0)  # also when there is no time to wait
        return sent

    def _matched(self, cycle: Cycle, sent: list[int]) -> dict[str, Any]:
        """Say which answers are right, and how long they took."""
        answers = self.efficiency.values
        found = match(cycle, len(sent), list(map(Answer, answers, self.optimum.values)))
        numbers = [number for number, _ in found.pairs]
        began = np.array([sent[arrival] for _, arrival in found.pairs], dtype=np.int64)
        return {
            "answers": len(answers),
            "optima": len(self.optimum.values),
            "right": len(found.pairs),
            "repeats": found.repeats,
            "efficiency_latency": (np.array(self.efficiency.received)[numbers] - began)
            * 1e-6,
            "optimum_latency": (np.array(self.optimum.received)[numbers] - began)
            * 1e-6,
        }
