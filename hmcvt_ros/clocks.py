# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""When a message arrived, on a clock by which ages can be counted.

Ages follow a steady clock that cannot be set, or with `use_sim_time` the clock of a simulation.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from rclpy.clock import Clock
from rclpy.node import Node

# This clock continues while the machine sleeps, where the system has it.
_STEADY = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
# Chosen by us; a clock that NTP adjusts drifts less between two readings.
_SET = 20_000_000
"""Change between two readings beyond which the system clock was set [ns]."""
_STOPPED = 1_000_000_000
"""Time between two readings beyond which the process or the machine was stopped [ns]."""
_DRAIN_TIME = 200_000_000
"""Time in which the messages that waited meanwhile are taken [ns]."""
_SILENCE = 2_000_000_000
"""Time without /clock beyond which an input that arrives shows that the clock is lost [ns]."""

CLOCK_TOPIC = "/clock"
NO_CLOCK = f"use_sim_time is set but nothing came on {CLOCK_TOPIC}"


class Arrival(NamedTuple):
    """When a message is taken and when it was received [ns].

    Attributes:
        now: time by the clock that ages follow.
        steady: time of reception by the steady clock.
        simulated: time of reception by the clock of a simulation; None without one.
        follows_simulation: whether ages follow the clock of the simulation.
    """

    now: int
    steady: int
    simulated: int | None = None
    follows_simulation: bool = False

    @property
    def received(self) -> int:
        """Time of reception by the clock that ages follow."""
        if self.follows_simulation and self.simulated is not None:
            return self.simulated
        return self.steady


class AgeClock(Protocol):
    """A clock by which the ages of inputs are counted."""

    @property
    def jumps(self) -> int:
        """How often the system clock was set."""

    @property
    def complaint(self) -> str:
        """Why the clock cannot be trusted, as a sentence; empty when it can."""

    def now(self) -> int:
        """Return the time [ns]."""

    def arrival(self, stamp: int) -> Arrival:
        """Return when a message with a stamp of the middleware was received."""

    def warning(self) -> str:
        """Return the complaint once, when it is time to log it; empty otherwise."""


class SteadyClock:
    """Times by a steady clock [ns].

    The middleware stamps messages by the system clock. As long as that keeps its distance from the
    steady clock, the stamp gives the age of a message, however long the message has waited. After
    the system clock was set, earlier stamps mean nothing, and a process that was stopped stamps
    late. What is taken right afterwards counts as received before that happened.

    Attributes:
        jumps: how often the system clock was set.
    """

    complaint = ""

    def __init__(self) -> None:
        self.jumps = 0
        self._last = time.clock_gettime_ns(_STEADY)
        self._offset = time.time_ns() - self._last
        self._last_undisturbed = self._last
        self._doubtful_until = self._last

    def now(self) -> int:
        """Return the time; must be called at least ten times a second."""
        now = time.clock_gettime_ns(_STEADY)
        offset = time.time_ns() - now
        was_set = abs(offset - self._offset) >= _SET
        if was_set:
            self.jumps += 1
        if was_set or now - self._last > _STOPPED:
            self._last_undisturbed = self._last
            self._doubtful_until = now + _DRAIN_TIME
        self._offset = offset
        self._last = now
        return now

    def arrival(self, stamp: int) -> Arrival:
        """Return when a message was received.

        Args:
            stamp: stamp of the middleware by the system clock [ns]; 0 when it gives none.
        """
        now = self.now()
        received = now
        if now < self._doubtful_until:
            received = self._last_undisturbed
        elif stamp > 0:
            received = min(stamp - self._offset, now)
        return Arrival(now, received)

    def warning(self) -> str:
        """Return nothing: this clock is always right."""
        return ""


class SimulatedClock:
    """Times by the clock of a simulation [ns], as long as one is published on /clock.

    A simulation may pause, and nothing ages meanwhile. But before the first message on /clock, and
    when inputs arrive long after the last one, there is no simulation: ages then follow a steady
    clock until the next message on /clock.

    Attributes:
        jumps: always 0; jumps of the simulation are counted where they are reported.
    """

    jumps = 0

    def __init__(self, clock: Clock, changed: Callable[[bool], None]) -> None:
        """Follow the clock of a node.

        Args:
            clock: clock that the middleware sets by /clock.
            changed: called when ages begin to follow the other clock, with whether that is the
                clock of the simulation.
        """
        self._clock = clock
        self._changed = changed
        self._steady = SteadyClock()
        self._lost = True
        self._lost_since = self._steady.now()
        self._heard: int | None = None  # time of the last message on /clock
        self._warned = False

    def listen(self, node: Node) -> None:
        """Observe every message that the node takes from /clock."""
        for subscription in node.subscriptions:
            if subscription.topic_name == CLOCK_TOPIC:
                subscription.callback = self._observed(subscription.callback)

    @property
    def complaint(self) -> str:
        """Why ages follow a steady clock; empty when they follow /clock."""
        if not self._lost:
            return ""
        silence = ""
        if self._heard is not None:
            seconds = (self._steady.now() - self._heard) * 1e-9
            silence = f" for {seconds:.0f} s while inputs came"
        return f"{NO_CLOCK}{silence}; ages follow the wall clock"

    def now(self) -> int:
        """Return the time; must be called at least ten times a second."""
        steady = self._steady.now()
        return steady if self._lost else self._simulated()

    def arrival(self, stamp: int) -> Arrival:
        """Return when a message was received: when it is taken, by the clock of a simulation."""
        arrival = self._steady.arrival(stamp)
        self._look_for_clock(arrival.now)
        simulated = self._simulated()
        return Arrival(
            now=arrival.now if self._lost else simulated,
            steady=arrival.steady,
            simulated=simulated,
            follows_simulation=not self._lost,
        )

    def warning(self) -> str:
        """Return the complaint once, when the clock has been missing for a while."""
        missing = self._steady.now() - self._lost_since
        if self._warned or not self._lost or missing < _SILENCE:
            return ""
        self._warned = True
        return self.complaint

    def _simulated(self) -> int:
        return int(self._clock.now().nanoseconds)

    def _observed(self, take: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def observe(message: Any) -> None:
            take(message)  # raises for a message that is no time
            self._heard = self._steady.now()
            if self._lost:
                self._lost = False
                self._warned = False
                self._changed(True)

        return observe

    def _look_for_clock(self, now: int) -> None:
        """Decide, when an input arrives, whether the clock is lost."""
        if self._lost or self._heard is None or now - self._heard <= _SILENCE:
            return
        self._lost = True
        self._lost_since = now
        self._changed(False)
