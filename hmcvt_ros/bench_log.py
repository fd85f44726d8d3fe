# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `write` returns. What a power cut leaves half written, or a disk gives
back otherwise than it was written, is taken out and kept beside the log: every row has a checksum.
"""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Sequence
from pathlib import Path

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.files.atomic import free_name, make_folder, sync_folder, write_atomically
from hmcvt_core.transmission.ranges import BENCH_COLUMNS

from .state_folder import keep_newest

COLUMNS = ("stamp", "displacement_ratio", "engine_speed", "load_torque", "efficiency",
           "output_speed")
KEPT = 10
"""Logs set aside that are kept, and damaged ones; the newest."""

_WITHOUT_CHECKSUMS = ",".join(COLUMNS).encode()  # the header of logs up to version 0.1
_HEADER = _WITHOUT_CHECKSUMS + b",crc"
_RANGES = {column.name: column for column in BENCH_COLUMNS}


class BenchLog:
    """An append-only CSV of bench samples; `hmcvt_core.read_bench` reads it.

    Attributes:
        path: the file; it comes into being with the first sample.
        recovered: what had to be repaired in it, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path, limit: int) -> None:
        """Open a log that holds at most `limit` samples.

        A file that cannot be read or repaired is no error yet: `write` tries again.
        """
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
        return (f"the bench log holds {self._count} samples and takes no more; "
                "~/clear_samples sets it aside")

    def write(self, rows: Sequence[bytes]) -> int:
        """Write as many rows as there is room for, wait until they are on disk, say how many.

        Raises:
            OSError: they could not be written; the log is as before.
        """
        if not self.path.exists():
            make_folder(self.path.parent)
            write_atomically(self.path, _HEADER + b"\n")
        if self.path.stat().st_size != self._size:
            self.check()  # new, or changed by someone else
        rows = rows[:max(self._limit - self._count, 0)]
        if not rows:
            return 0
        text = b"".join(rows)
        with self.path.open("ab", buffering=0) as file:
            try:
                left = text
                while left:
                    left = left[file.write(left):]
                os.fsync(file.fileno())
            except OSError:
                with contextlib.suppress(OSError):  # if not now, the next call repairs it
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
        count = self._count
        if not self.path.exists():
            return 0, None
        kept = self._free_name("cleared")
        self.path.rename(kept)
        sync_folder(self.path.parent)
        self._count = self._size = 0
        self.recovered = ""
        return count, kept

    def check(self) -> None:
        """Take out of the file what is not as it was written; a log without checksums gets them.

        Raises:
            OSError: it cannot be read or repaired.
        """
        try:
            raw = self.path.read_bytes()
        except FileNotFoundError:
            self._count = self._size = 0
            return
        *lines, torn = raw.split(b"\n")
        old = lines[:1] == [_WITHOUT_CHECKSUMS]
        # A cut in the middle of a number leaves a number: a line counts only with its end.
        good = ([_sealed(line.strip()) for line in lines[1:] if _is_row(line)] if old
                else [line for line in lines[1:] if line == _sealed(line.rpartition(b",")[0])])
        text = b"".join(line + b"\n" for line in (_HEADER, *good))
        self._count, self._size = len(good), -1  # no size that it could have
        lost = max(len(lines) - 1, 0) + bool(torn) - len(good)
        if lost or lines[:1] not in ([_HEADER], [_WITHOUT_CHECKSUMS]):
            kept = self._free_name("damaged")
            write_atomically(kept, raw)
            self.recovered = (f"{self.path}: {lost} damaged lines taken out, the file as it was "
                              f"is kept as {kept.name}")
        if text != raw:
            write_atomically(self.path, text)
        self._size = len(text)

    def _free_name(self, why: str) -> Path:
        keep_newest(self.path.parent, KEPT - 1, f"{self.path.stem}.{why}-")
        return free_name(self.path, why)


def rows_of(samples: BenchSamples) -> list[bytes]:
    """Return samples as lines of the log.

    Raises:
        InputError: a column is missing.
    """
    values = []
    for name in COLUMNS:
        column = getattr(samples, name)
        if column is None:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
        values.append(column.tolist())
    return [_sealed(",".join(map(repr, row)).encode()) + b"\n"
            for row in zip(*values, strict=True)]


def _sealed(row: bytes) -> bytes:
    return b"%b,%08x" % (row, zlib.crc32(row))


def _is_row(line: bytes) -> bool:
    cells = line.split(b",")
    if len(cells) != len(COLUMNS):
        return False
    try:
        return all(_RANGES[name].contains(float(cell))
                   for name, cell in zip(COLUMNS, cells, strict=True))
    except ValueError:
        return False
