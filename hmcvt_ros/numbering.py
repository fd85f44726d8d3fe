# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Lost messages, by the numbers that publishers give their messages."""

from collections import deque

STREAMS = 64
"""Publishers of a topic that are distinguished."""
_UNNUMBERED = 2**64 - 1
"""Number of every message of a middleware that does not number them."""


class Numbers:
    """Counts missing messages by the numbers of those that came.

    Every publisher numbers its messages from 1, and a message does not name its publisher. So a
    number continues the stream of which it is the next. Where there is none, it is a jump of the
    nearest stream below, which lacks the numbers between. If that stream turns out to continue, the
    jump is moved to the next stream below. A stream that is met in the middle lacks nothing: it
    began before the node listened.

    Attributes:
        missing: count of missing messages.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._last: deque[int] = deque(maxlen=STREAMS)
        """Last number of each stream."""
        self._jumps: dict[int, int] = {}
        """First number after a jump, by the last number before it."""

    def take(self, number: int) -> None:
        """Take the number of a message."""
        if not 0 < number < _UNNUMBERED:
            return
        if number - 1 in self._last:
            self._last.remove(number - 1)
        elif number - 1 in self._jumps:
            after = self._jumps.pop(number - 1)
            self.missing -= after - number
            self._assign_jump(below=number - 1, after=after)
        else:
            self._assign_jump(below=number, after=number)
        self._last.append(number)

    def _assign_jump(self, below: int, after: int) -> None:
        """Assign a jump to the nearest stream whose last number is below a number."""
        streams = [last for last in self._last if last < below]
        if not streams:
            return
        before = max(streams)
        self._last.remove(before)
        self._jumps[before] = after
        if len(self._jumps) > STREAMS:
            oldest = next(iter(self._jumps))
            del self._jumps[oldest]
        self.missing += after - before - 1
