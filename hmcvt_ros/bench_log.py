# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `write` returns. What a power cut leaves half written, or a disk gives
back otherwise than it was written, is taken out and kept beside the log: every row has a checksum.

All that waits for a disk has a thread of its own: bench samples, and changes of model. Samples that
come while the disk is busy are written together, with one wait for all of them.
"""

import contextlib
import os
import time
import zlib
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.files.atomic import (
    free_name,
    make_folder,
    sync_folder,
    write_atomically,
)
from hmcvt_core.transmission.ranges import BENCH_COLUMNS

from .inputs import Tally
from .state_folder import keep_newest

COLUMNS = (
    "stamp",
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "efficiency",
    "output_speed",
)
KEPT = 10
"""Logs set aside that are kept, and damaged ones; the newest."""

INVALID, FULL, BUSY, NOT_WRITTEN = (
    "invalid",
    "log full",
    "too many at once",
    "not written",
)
BENCH_REASONS = (INVALID, FULL, BUSY, NOT_WRITTEN)
"""Why a bench sample may be refused."""

MOST_WAITING = 10_000
STREAMS = 64
"""Publishers of bench samples that are told apart."""
_HANGING = 5.0  # seconds without a sign of life from the disk
_PATIENCE = 2.0  # seconds for what waits for the disk at the end
_UNNUMBERED = 2**64 - 1  # what a middleware says that does not number its messages

_WITHOUT_CHECKSUMS = ",".join(COLUMNS).encode()  # the header of logs up to version 0.1
_HEADERS = _WITHOUT_CHECKSUMS + b",crc", _WITHOUT_CHECKSUMS + b",stage,crc"
_RANGES = {column.name: column for column in BENCH_COLUMNS}


class BenchLog:
    """An append-only CSV of bench samples; `hmcvt_core.read_bench` reads it.

    Attributes:
        path: the file; it comes into being with the first sample.
        recovered: what had to be repaired in it, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path, limit: int, stages: bool = False) -> None:
        """Open a log that holds at most `limit` samples, each with its `stage` if so said.

        A file that cannot be read or repaired is no error yet: `write` tries again.
        """
        self._header, self._other = _HEADERS[::-1] if stages else _HEADERS
        self.path = path
        self.recovered = ""
        self._limit = limit
        self._count = 0
        self._size = 0
        try:
            self.check()
        except OSError as error:
            self.recovered = f"{path}: cannot be read or repaired: {error.strerror}"

    def __len__(self) -> int:
        return self._count

    @property
    def full(self) -> str:
        """Why there is no room for a sample."""
        return (
            f"the bench log holds {self._count} samples and takes no more; "
            "~/clear_samples sets it aside"
        )

    def write(self, rows: Sequence[bytes]) -> int:
        """Write as many rows as there is room for, wait until they are on disk, say how many.

        Raises:
            OSError: they could not be written; the log is as before.
        """
        if self.path.exists() and self.path.stat().st_size != self._size:
            self.check()  # changed by someone else
        if not self.path.exists():
            make_folder(self.path.parent)
            write_atomically(self.path, self._header + b"\n")
            self._count, self._size = 0, len(self._header) + 1
        rows = rows[: max(self._limit - self._count, 0)]
        if not rows:
            return 0
        text = b"".join(rows)
        with self.path.open("ab", buffering=0) as file:
            try:
                left = text
                while left:
                    left = left[file.write(left) :]
                os.fsync(file.fileno())
            except OSError:
                with contextlib.suppress(
                    OSError
                ):  # if not now, the next call repairs it
                    file.truncate(self._size)
                raise
        self._count += len(rows)
        self._size += len(text)
        return len(rows)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log; return how many samples the old one held and where it is now.

        Raises:
            OSError: the file cannot be renamed; the log is as before.
        """
        count, kept = 0, None
        if self.path.exists():
            count, kept = self._count, self._free_name("cleared")
            self.path.rename(kept)
            sync_folder(self.path.parent)
        self._count = self._size = 0
        self.recovered = ""
        return count, kept

    def check(self) -> None:
        """Take out of the file what is not as it was written; a log without checksums gets them.

        What had been written and is not there any more can only be told.

        Raises:
            OSError: it cannot be read or repaired.
        """
        before = self._count
        try:
            raw = self.path.read_bytes()
        except FileNotFoundError:
            self._count = self._size = 0
            if before:
                self.recovered = f"{self.path}: is gone, and {before} samples with it"
            return
        *lines, torn = raw.split(b"\n")
        if lines[:1] == [self._other] or (
            self._header == _HEADERS[1] and lines[:1] == [_WITHOUT_CHECKSUMS]
        ):
            self._count = len(lines) - 1
            _, aside = self.set_aside()
            self.recovered = (
                f"{self.path}: was of another model, one with stages or without, "
                f"and is set aside as {aside}"
            )
            return
        old = lines[:1] == [_WITHOUT_CHECKSUMS]
        # A cut in the middle of a number leaves a number: a line counts only with its end.
        good = (
            [_sealed(line.strip()) for line in lines[1:] if _is_row(line)]
            if old
            else [
                line for line in lines[1:] if line == _sealed(line.rpartition(b",")[0])
            ]
        )
        text = b"".join(line + b"\n" for line in (self._header, *good))
        self._count, self._size = len(good), -1  # no size that it could have
        lost = max(len(lines) - 1, 0) + bool(torn) - len(good)
        if lost or lines[:1] not in ([self._header], [_WITHOUT_CHECKSUMS]):
            kept = self._free_name("damaged")
            write_atomically(kept, raw)
            self.recovered = (
                f"{self.path}: {lost} damaged lines taken out, the file as it was "
                f"is kept as {kept.name}"
            )
        if before > len(good) + lost:
            gone = f"{before - len(good) - lost} samples that had been logged are gone"
            self.recovered = (
                f"{self.recovered}; {gone}" if lost else f"{self.path}: {gone}"
            )
        if text != raw:
            write_atomically(self.path, text)
        self._size = len(text)

    def _free_name(self, why: str) -> Path:
        keep_newest(self.path.parent, KEPT - 1, f"{self.path.stem}.{why}-")
        return free_name(self.path, why)


class Recorder:
    """Takes bench samples and writes them to a log, in the order in which they came.

    Nothing here waits for a disk but `close`, and what is given to `call`.

    Attributes:
        log: on disk.
        numbers: of the messages with the samples.
        tally: what became of the samples.
    """

    def __init__(
        self, log: BenchLog, warn: Callable[[str], None], look: Callable[[], str]
    ) -> None:
        """Write to a log; say what could not be written, and what a look at the disk finds."""
        self.log, self.numbers, self.tally = log, Numbers(), Tally(BENCH_REASONS)
        self._warn, self._look = warn, look
        self._missed_before = 0  # this log was begun
        self._waiting: deque[bytes] = deque()
        self._thread = ThreadPoolExecutor(1, "storage")
        self._trouble = ""  # of the disk
        self._asked, self._sign = (
            time.monotonic(),
            self.call(look),
        )  # for a sign of life

    @property
    def complaint(self) -> str:
        """What this log lacks, as a sentence; empty when nothing."""
        missed = self._missed - self._missed_before
        overrun = f"{missed} bench samples were sent and not taken: too many at once"
        return "; ".join(
            filter(
                None, (self._trouble, self.log.recovered, overrun if missed > 0 else "")
            )
        )

    @property
    def _missed(self) -> int:
        return self.numbers.missing + self.tally.refused[BUSY]

    def poll(self) -> None:
        """Look at the disk again, where the last look has ended; now and then."""
        if self._sign.done():
            self._trouble = self._sign.result()
            self._asked, self._sign = time.monotonic(), self.call(self._look)
        elif (silent := time.monotonic() - self._asked) > _HANGING:
            self._trouble = f"the disk has not answered for {silent:.0f} s"

    def submit(self, samples: BenchSamples) -> None:
        """Take samples, which are not on disk yet."""
        if len(self._waiting) + len(samples) > MOST_WAITING:
            self.refuse(
                BUSY, f"bench log: {MOST_WAITING} samples wait already for the disk"
            )
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

    def close(self) -> bool:
        """Write what waits, and end; False when the disk takes too long."""
        written = wait([self.call(bool)], _PATIENCE).done
        self._thread.shutdown(wait=False)
        return bool(written)

    # --- the thread; it alone counts, lest two do at once -----------------------------------------

    def _refuse(self, reason: str, complaint: str, count: int = 1) -> None:
        self.tally.refuse(reason, complaint, count)
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
            self.tally.accept(written)
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
        self._last: deque[int] = deque(maxlen=STREAMS)  # of each stream
        self._jumps: dict[
            int, int
        ] = {}  # from the last number before to the first one after

    def take(self, number: int) -> None:
        """Take the number of a message."""
        if not 0 < number < _UNNUMBERED:
            return
        if number - 1 in self._last:
            self._last.remove(number - 1)
        elif number - 1 in self._jumps:
            after = self._jumps.pop(number - 1)
            self.missing -= after - number
            self._jump(number - 1, after)
        else:
            self._jump(number, number)
        self._last.append(number)

    def _jump(self, below: int, after: int) -> None:
        """Lay a jump to a number to the nearest stream below another."""
        if streams := [last for last in self._last if last < below]:
            before = max(streams)
            self._last.remove(before)
            self._jumps[before] = after
            if len(self._jumps) > STREAMS:
                del self._jumps[next(iter(self._jumps))]
            self.missing += after - before - 1


def rows_of(samples: BenchSamples) -> list[bytes]:
    """Return samples as lines of the log.

    Raises:
        InputError: a column is missing, or the name of a stage would break its line.
    """
    values = []
    for name in COLUMNS:
        column = getattr(samples, name)
        if column is None:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
        values.append(map(repr, column.tolist()))
    if stages := samples.extra.get("stage"):
        if any(set(',"#\n\r') & set(name) for name in stages):
            raise InputError(
                f"{samples.source}: stage {stages[0]!r} is no name for a log"
            )
        values.append(map(str, stages))
    return [
        _sealed(",".join(row).encode()) + b"\n" for row in zip(*values, strict=True)
    ]


def _sealed(row: bytes) -> bytes:
    return b"%b,%08x" % (row, zlib.crc32(row))


def _is_row(line: bytes) -> bool:
    cells = line.split(b",")
    if len(cells) != len(COLUMNS):
        return False
    try:
        return all(
            _RANGES[name].contains(float(cell))
            for name, cell in zip(COLUMNS, cells, strict=True)
        )
    except ValueError:
        return False
