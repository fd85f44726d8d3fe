# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The thread that writes bench samples, and the count of those that never arrived.

Everything that waits for a disk runs in a thread of its own: bench samples and changes of model.
Samples that come while the disk is busy are written together, with one wait for all of them.
"""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from hmcvt_core import BenchSamples, InputError

from .bench_log import BenchLog, rows_of
from .inputs import Tally
from .numbering import Numbers

INVALID = "invalid"
FULL = "log full"
BUSY = "too many at once"
NOT_WRITTEN = "not written"
BENCH_REASONS = (INVALID, FULL, BUSY, NOT_WRITTEN)
"""Why a bench sample may be refused."""

MAX_WAITING = 10_000
"""Samples that may wait for the disk; about 1 MB."""
# Chosen by us: a healthy disk answers within a second.
_HANGING = 5.0
"""Time without an answer after which the disk counts as hanging [s]."""
_PATIENCE = 2.0
"""Time for the disk when the node ends [s]."""


class Recorder:
    """Takes bench samples and writes them to a log in the order in which they came.

    Only `close`, and the work given to `call`, wait for a disk.

    Attributes:
        log: log on disk.
        numbers: numbers of the messages with the samples.
        tally: what became of the samples.
        repeats: count of samples that had been logged before, with the same stamp and values.
        news: samples that came and were no repeats, for a reader that takes them away.
    """

    def __init__(
        self, log: BenchLog, warn: Callable[[str], None], look: Callable[[], str]
    ) -> None:
        """Start the thread.

        Args:
            log: log to write to.
            warn: called with the reason why a sample was refused.
            look: looks at the disk and returns a complaint; empty when all is well.
        """
        self.log = log
        self.numbers = Numbers()
        self.tally = Tally(BENCH_REASONS)
        self.repeats = 0
        self.news: deque[BenchSamples] = deque(maxlen=MAX_WAITING)
        self._warn = warn
        self._look = look
        self._missed_before = 0  # missed before this log was begun
        self._waiting: deque[tuple[bytes, BenchSamples]] = deque()
        self._thread = ThreadPoolExecutor(1, "storage")
        self._trouble = ""  # with the disk
        self._ask_disk()

    @property
    def complaint(self) -> str:
        """What this log lacks, as a sentence; empty when nothing."""
        complaints = [self._trouble, self.log.recovered]
        missed = self._missed - self._missed_before
        if missed > 0:
            complaints.append(
                f"{missed} bench samples were sent and not taken: too many at once"
            )
        return "; ".join(filter(None, complaints))

    @property
    def _missed(self) -> int:
        return self.numbers.missing + self.tally.refused[BUSY]

    def poll(self) -> None:
        """Look at the disk again once it has answered; to be called about once a second."""
        if self._answer.done():
            self._trouble = self._answer.result()
            self._ask_disk()
            return
        silence = time.monotonic() - self._asked
        if silence > _HANGING:
            self._trouble = f"the disk has not answered for {silence:.0f} s"

    def submit(self, sample: BenchSamples) -> None:
        """Take one sample; it is on disk later.

        Raises:
            InputError: as of `rows_of`.
        """
        if len(self._waiting) >= MAX_WAITING:
            self.refuse(
                BUSY, f"bench log: {MAX_WAITING} samples wait already for the disk"
            )
            return
        (row,) = rows_of(sample)
        self._waiting.append((row, sample))
        self.call(self._write)

    def refuse(self, reason: str, complaint: str) -> None:
        """Count a sample as refused."""
        # In the thread, so that the last complaint is that of the last sample.
        self.call(self._refuse, reason, complaint)

    def call(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run work that waits for a disk in the thread, after everything that came before.

        Raises:
            InputError: the recorder is closed.
        """
        try:
            return self._thread.submit(work, *arguments)
        except RuntimeError:
            raise InputError(
                "the node was closed: it logs and refits no more"
            ) from None

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log, as `BenchLog.set_aside`; for `call`."""
        result = self.log.set_aside()
        self._missed_before = self._missed
        return result

    def close(self) -> bool:
        """Write what waits, and end; return False when the disk takes too long."""
        written = wait([self.call(self._note)], _PATIENCE).done
        self._thread.shutdown(wait=False)
        return bool(written)

    def _ask_disk(self) -> None:
        self._asked = time.monotonic()
        self._answer = self.call(self._look_at_disk)

    # --- the thread; it alone counts, so that no two threads do -----------------------------------

    def _look_at_disk(self) -> str:
        self._note()
        return self._look()

    def _note(self) -> None:
        with contextlib.suppress(OSError):  # the next sample tells of it
            self.log.note()

    def _refuse(self, reason: str, complaint: str, count: int = 1) -> None:
        self.tally.refuse(reason, complaint, count)
        self._warn(complaint)

    def _write(self) -> None:
        waiting = [self._waiting.popleft() for _ in range(len(self._waiting))]
        if not waiting:
            return  # they were written together with earlier ones
        rows = [row for row, _ in waiting]
        try:
            written = self.log.write(rows)
        except Exception as error:  # of any kind: every sample must be accounted for
            self._refuse(NOT_WRITTEN, f"bench log: {error}", len(rows))
            self.news.extend(sample for _, sample in waiting)
            return
        for position, (_, sample) in enumerate(waiting):
            if position not in written.repeats:
                self.news.append(sample)
        if written.repeats:
            self.repeats += len(written.repeats)
            self._warn(
                f"bench_sample: {len(written.repeats)} were logged before, with the same stamp "
                "and values, and count once"
            )
        if written.logged:
            self.tally.accept(written.logged)
        refused = len(rows) - written.logged - len(written.repeats)
        if refused:
            self._refuse(FULL, self.log.full, refused)
