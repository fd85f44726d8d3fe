# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""When a message came, on a clock that nobody can set."""

import time

from rclpy.clock import Clock

# It goes on while the machine sleeps, where the system has such a clock.
_STEADY = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
_STEP = 20_000_000  # ns between two looks by which no clock is drawn right, only set
_STOPPED = (
    1_000_000_000  # ns between two looks: the process, or the machine, has been stopped
)
_DRAINED = 200_000_000  # ns in which the messages that have waited meanwhile are taken


class SteadyClock:
    """Times in nanoseconds by a steady clock.

    The middleware stamps what it receives by the system clock. As long as that keeps its distance
    from the steady clock, the stamp tells the age of a message, however long it has waited. When
    the system clock is set, stamps of before mean nothing; and a process that was stopped stamps
    late. What is taken right afterwards counts as received when all was last seen well.

    Attributes:
        jumps: how often the system clock was set.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._seen = time.clock_gettime_ns(_STEADY)
        self._offset = time.time_ns() - self._seen
        self._last_well = self._doubtful_until = self._seen

    def now(self) -> int:
        """Return the time; to be asked ten times a second at least."""
        now = time.clock_gettime_ns(_STEADY)
        offset = time.time_ns() - now
        was_set = not -_STEP < offset - self._offset < _STEP
        if was_set or now - self._seen > _STOPPED:
            self.jumps += was_set
            self._last_well, self._doubtful_until = self._seen, now + _DRAINED
        self._offset, self._seen = offset, now
        return now

    def received(self, stamp: int, now: int) -> int:
        """Return when a message came.

        Args:
            stamp: of the middleware, by the system clock; 0 when it gives none.
            now: what `now` has just given.
        """
        if now < self._doubtful_until:
            return self._last_well
        return min(stamp - self._offset, now) if stamp > 0 else now


class NodeClock:
    """Times by the clock of a node, which a simulation drives: when a message is taken.

    Attributes:
        jumps: always 0; those of the simulation are counted where they are heard of.
    """

    jumps = 0

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def now(self) -> int:
        """Return the time."""
        return int(self._clock.now().nanoseconds)

    def received(self, stamp: int, now: int) -> int:
        """Return the time now: stamps are by another clock."""
        return now
