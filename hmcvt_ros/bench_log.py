# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `write` returns. Every row has a checksum: what a power cut leaves half
written, or a disk returns otherwise than it was written, is taken out and kept in another file.
"""

import contextlib
import os
import zlib
from collections.abc import Sequence
from pathlib import Path

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.interface import (
    BENCH_COLUMNS,
    free_name,
    make_folder,
    sync_folder,
    write_atomically,
)

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
"""Logs set aside that are kept, and as many damaged ones; the newest."""

_PLAIN_HEADER = ",".join(COLUMNS).encode()
"""First line of logs up to version 0.1, without checksums."""
_HEADER = _PLAIN_HEADER + b",crc"
_HEADER_WITH_STAGE = _PLAIN_HEADER + b",stage,crc"
_NOT_IN_A_STAGE = frozenset(',"#\n\r')
"""Characters that would break the line of a stage."""
_UNKNOWN_SIZE = -1
_RANGES = {column.name: column for column in BENCH_COLUMNS}


class BenchLog:
    """An append-only CSV of bench samples; `hmcvt_core.read_bench` reads it.

    Attributes:
        path: path of the file, which the first sample creates.
        recovered: what had to be repaired in it, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path, limit: int, stages: bool = False) -> None:
        """Open a log.

        A file that cannot be read or repaired is no error yet: `write` tries again.

        Args:
            path: path of the file.
            limit: most samples that it holds.
            stages: whether each sample has a stage.
        """
        self.path = path
        self.recovered = ""
        self._stages = stages
        self._header = _HEADER_WITH_STAGE if stages else _HEADER
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
        """Write as many rows as there is room for, wait until they are on disk, return how many.

        Raises:
            OSError: they could not be written; the log is as before.
        """
        if self.path.exists() and self.path.stat().st_size != self._size:
            self.check()  # another program changed it
        if not self.path.exists():
            make_folder(self.path.parent)
            write_atomically(self.path, self._header + b"\n")
            self._count = 0
            self._size = len(self._header) + 1
        rows = rows[: max(self._limit - self._count, 0)]
        if not rows:
            return 0
        text = b"".join(rows)
        self._append(text)
        self._count += len(rows)
        self._size += len(text)
        return len(rows)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log; return how many samples the old one held, and its path.

        Raises:
            OSError: the file cannot be renamed; the log is as before.
        """
        count = 0
        kept = None
        if self.path.exists():
            count = self._count
            kept = self._free_name("cleared")
            self.path.rename(kept)
            sync_folder(self.path.parent)
        self._count = 0
        self._size = 0
        self.recovered = ""
        return count, kept

    def check(self) -> None:
        """Take out of the file what is not as it was written; a log without checksums gets them.

        Samples that had been written and are missing are reported in `recovered`.

        Raises:
            OSError: it cannot be read or repaired.
        """
        expected = self._count
        try:
            raw = self.path.read_bytes()
        except FileNotFoundError:
            self._count = 0
            self._size = 0
            if expected:
                self.recovered = f"{self.path}: is gone, and {expected} samples with it"
            return
        *lines, torn = raw.split(b"\n")
        header = lines.pop(0) if lines else b""
        if self._is_of_another_model(header):
            self._count = len(lines)
            _, aside = self.set_aside()
            self.recovered = (
                f"{self.path}: was of another model, one with stages or without, "
                f"and is set aside as {aside}"
            )
            return
        good = _intact_rows(lines, with_checksums=header != _PLAIN_HEADER)
        text = b"".join(line + b"\n" for line in (self._header, *good))
        self._count = len(good)
        self._size = _UNKNOWN_SIZE
        lost = len(lines) + bool(torn) - len(good)
        self._report_damage(raw, header, lost, expected)
        if text != raw:
            write_atomically(self.path, text)
        self._size = len(text)

    def _append(self, text: bytes) -> None:
        with self.path.open("ab", buffering=0) as file:
            try:
                rest = text
                while rest:
                    rest = rest[file.write(rest) :]
                os.fsync(file.fileno())
            except OSError:
                # If the file cannot be cut back now, the next call repairs it.
                with contextlib.suppress(OSError):
                    file.truncate(self._size)
                raise

    def _is_of_another_model(self, header: bytes) -> bool:
        """Whether the rows have stages and should not, or lack them."""
        if self._stages:
            return header in (_HEADER, _PLAIN_HEADER)
        return header == _HEADER_WITH_STAGE

    def _report_damage(
        self, raw: bytes, header: bytes, lost: int, expected: int
    ) -> None:
        """Keep a damaged file, and say which samples are lost.

        Args:
            raw: file as it was found.
            header: its first line.
            lost: count of damaged lines.
            expected: count of samples that had been written.
        """
        problems = []
        if lost or header not in (self._header, _PLAIN_HEADER):
            kept = self._free_name("damaged")
            write_atomically(kept, raw)
            problems.append(
                f"{lost} damaged lines taken out, the file as it was is kept as "
                f"{kept.name}"
            )
        missing = expected - self._count - lost
        if missing > 0:
            problems.append(f"{missing} samples that had been logged are gone")
        if problems:
            self.recovered = f"{self.path}: {'; '.join(problems)}"

    def _free_name(self, reason: str) -> Path:
        keep_newest(self.path.parent, KEPT - 1, f"{self.path.stem}.{reason}-")
        return free_name(self.path, reason)


def rows_of(samples: BenchSamples) -> list[bytes]:
    """Return samples as lines of the log.

    Raises:
        InputError: a column is missing, or the name of a stage would break its line.
    """
    columns = []
    for name in COLUMNS:
        column = getattr(samples, name)
        if column is None:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
        columns.append([repr(value) for value in column.tolist()])
    stages = samples.extra.get("stage")
    if stages:
        if any(_NOT_IN_A_STAGE & set(name) for name in stages):
            raise InputError(
                f"{samples.source}: stage {stages[0]!r} is no name for a log"
            )
        columns.append(list(stages))
    rows = zip(*columns, strict=True)
    return [_with_checksum(",".join(row).encode()) + b"\n" for row in rows]


def _intact_rows(lines: Sequence[bytes], with_checksums: bool) -> list[bytes]:
    """Return the rows that are as they were written, with checksums."""
    if with_checksums:
        return [
            line for line in lines if line == _with_checksum(line.rpartition(b",")[0])
        ]
    # A cut in the middle of a number leaves a number, so a line counts only with its end.
    return [_with_checksum(line.strip()) for line in lines if _is_row(line)]


def _with_checksum(row: bytes) -> bytes:
    return b"%b,%08x" % (row, zlib.crc32(row))


def _is_row(line: bytes) -> bool:
    cells = line.split(b",")
    if len(cells) != len(COLUMNS):
        return False
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return False
    return all(
        _RANGES[name].contains(value)
        for name, value in zip(COLUMNS, values, strict=True)
    )
