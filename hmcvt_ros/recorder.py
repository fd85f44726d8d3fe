# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""All that waits for a disk, in a thread of its own: bench samples, and changes of model.

Samples that come while the disk is busy are written together, with one wait for all of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
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
    """

    def __init__(self, log: BenchLog, tally: Tally) -> None:
        """Write to a log, and count in `tally`, when asked by `poll`, what is on disk."""
        self._log, self._tally = log, tally
        self._numbers = Numbers()
        self._missed_before = 0  # this log was begun
        self._waiting: deque[bytes] = deque()
        self._done: deque[Callable[[], None]] = deque()
        self._thread = ThreadPoolExecutor(1, "storage")

    def __len__(self) -> int:
        """Samples on disk."""
        return len(self._log)

    @property
    def path(self) -> Path:
        """The log."""
        return self._log.path

    @property
    def lost(self) -> int:
        """Messages that were sent and did not come, since the start."""
        return self._numbers.missing

    @property
    def complaint(self) -> str:
        """What this log lacks, as a sentence; empty when nothing."""
        missed = self._missed - self._missed_before
        overrun = f"{missed} bench samples were sent and not taken: too many at once"
        return "; ".join(filter(None, (self._log.recovered, overrun if missed > 0 else "")))

    @property
    def _missed(self) -> int:
        return self.lost + self._tally.refused[BUSY]

    def submit(self, samples: BenchSamples, number: int) -> None:
        """Take samples out of the message of a number; `poll` tells what became of them."""
        self._numbers.take(number)
        if len(self._waiting) + len(samples) > MOST_WAITING:
            self._tell(self._tally.refuse, BUSY, f"bench log: {MOST_WAITING} samples wait already "
                       "for the disk")
            return
        self._waiting.extend(rows_of(samples))
        self._thread.submit(self._write)

    def refuse(self, reason: str, complaint: str, number: int) -> None:
        """Count the message of a number as refused."""
        self._numbers.take(number)
        self._tell(self._tally.refuse, reason, complaint)

    def poll(self) -> str:
        """Count what has been done since the last call; return the last complaint of it."""
        complaint = ""
        while self._done:
            self._done.popleft()()
            complaint = self._tally.complaint or complaint
        return complaint

    def call(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Do in the thread, after all that came before, what waits for a disk."""
        return self._thread.submit(work, *arguments)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log, as `BenchLog.set_aside`; for `call`."""
        done = self._log.set_aside()
        self._missed_before = self._missed
        return done

    def checked(self) -> int:
        """Check the log as `BenchLog.check` does, and count its samples; for `call`."""
        self._log.check()
        return len(self._log)

    def close(self) -> None:
        """Write what waits, and end."""
        self._thread.shutdown()

    # --- the thread -----------------------------------------------------------------------------

    def _tell(self, count: Callable[..., None], *arguments: Any) -> None:
        # Behind what came before, so that the last complaint is that of the last sample.
        self._thread.submit(self._done.append, partial(count, *arguments))

    def _write(self) -> None:
        rows = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if not rows:
            return  # they were written with those before
        refuse = partial(self._tally.refuse, count=len(rows))
        try:
            written = self._log.write(rows)
        except Exception as error:  # of any kind: what was taken must be accounted for
            self._done.append(partial(refuse, NOT_WRITTEN, f"bench log: {error}"))
            return
        if written:
            self._done.append(partial(self._tally.accept, written))
        if written < len(rows):
            self._done.append(partial(refuse, FULL, self._log.full, count=len(rows) - written))


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
