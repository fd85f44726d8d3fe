# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""All that waits for a disk, in a thread of its own: bench samples, and changes of model.

Samples that come while the disk is busy are written together, with one wait for all of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hmcvt_core import BenchSamples

from .bench_log import BenchLog, rows_of
from .inputs import Tally

INVALID, FULL, BUSY, NOT_WRITTEN = "invalid", "log full", "too many at once", "not written"
BENCH_REASONS = (INVALID, FULL, BUSY, NOT_WRITTEN)
"""Why a bench sample may be refused."""

MOST_WAITING = 10_000
_UNNUMBERED = 2**64 - 1  # what a middleware says that does not number its messages


class Recorder:
    """Takes bench samples and writes them to a log, in the order in which they came.

    Nothing here waits for a disk but `close`, and what is given to `call`.

    Attributes:
        log: on disk.
        numbers: of the messages with the samples.
    """

    def __init__(self, log: BenchLog, tally: Tally, warn: Callable[[str], None]) -> None:
        """Write to a log, count in `tally` what is on disk, and say what is not."""
        self.log, self.numbers = log, Numbers()
        self._tally, self._warn = tally, warn
        self._missed_before = 0  # this log was begun
        self._waiting: deque[bytes] = deque()
        self._thread = ThreadPoolExecutor(1, "storage")

    @property
    def complaint(self) -> str:
        """What this log lacks, as a sentence; empty when nothing."""
        missed = self._missed - self._missed_before
        overrun = f"{missed} bench samples were sent and not taken: too many at once"
        return "; ".join(filter(None, (self.log.recovered, overrun if missed > 0 else "")))

    @property
    def _missed(self) -> int:
        return self.numbers.missing + self._tally.refused[BUSY]

    def submit(self, samples: BenchSamples) -> None:
        """Take samples, which are not on disk yet."""
        if len(self._waiting) + len(samples) > MOST_WAITING:
            self.refuse(BUSY, f"bench log: {MOST_WAITING} samples wait already for the disk")
        else:
            self._waiting.extend(rows_of(samples))
            self.call(self._write)

    def refuse(self, reason: str, complaint: str) -> None:
        """Count a sample as refused."""
        # Behind what came before, so that the last complaint is that of the last sample.
        self.call(self._refuse, reason, complaint)

    def call(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Do in the thread, after all that came before, what waits for a disk."""
        return self._thread.submit(work, *arguments)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log, as `BenchLog.set_aside`; for `call`."""
        done = self.log.set_aside()
        self._missed_before = self._missed
        return done

    def close(self) -> None:
        """Write what waits, and end."""
        self._thread.shutdown()

    # --- the thread; it alone counts, lest two do at once -----------------------------------------

    def _refuse(self, reason: str, complaint: str, count: int = 1) -> None:
        self._tally.refuse(reason, complaint, count)
        self._warn(complaint)

    def _write(self) -> None:
        rows = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if not rows:
            return  # they were written with those before
        try:
            written = self.log.write(rows)
        except Exception as error:  # of any kind: what was taken must be accounted for
            self._refuse(NOT_WRITTEN, f"bench log: {error}", len(rows))
            return
        if written:
            self._tally.accept(written)
        if written < len(rows):
            self._refuse(FULL, self.log.full, len(rows) - written)


class Numbers:
    """Counts the messages that are missing, by the numbers of those that came.

    Every publisher numbers its messages from 1, and a message does not tell its publisher. So a
    number goes with the stream of which it is the next; where there is none, the nearest stream
    below lacks some, unless that goes on later: then it was the next one below, if any. A stream
    that is met in the middle lacks nothing: it had begun before we listened.

    Attributes:
        missing: count of messages.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._last: deque[int] = deque(maxlen=64)  # of each stream
        self._jumps: deque[tuple[int, int]] = deque(maxlen=64)  # last number before, first after

    def take(self, number: int) -> None:
        """Take the number of a message."""
        if not 0 < number < _UNNUMBERED:
            return
        if number - 1 in self._last:
            self._last.remove(number - 1)
        elif doubted := [jump for jump in self._jumps if jump[0] == number - 1]:
            before, after = doubted[0]
            self._jumps.remove(doubted[0])
            self.missing -= after - before - 1
            self._jump(before, after)
        else:
            self._jump(number, number)
        self._last.append(number)

    def _jump(self, below: int, after: int) -> None:
        """Lay a jump to a number to the nearest stream below another."""
        if streams := [last for last in self._last if last < below]:
            before = max(streams)
            self._last.remove(before)
            self._jumps.append((before, after))
            self.missing += after - before - 1
