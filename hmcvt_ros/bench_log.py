# SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `append` returns. What a power cut leaves half written is taken out when
the log is opened and kept beside it.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.files.atomic import free_name, make_folder, sync_folder, write_atomically
from hmcvt_core.transmission.ranges import BENCH_COLUMNS

COLUMNS = ("stamp", "displacement_ratio", "engine_speed", "load_torque", "efficiency",
           "output_speed")
_HEADER = ",".join(COLUMNS) + "\n"
_RANGES = {column.name: column for column in BENCH_COLUMNS}


class BenchLog:
    """An append-only CSV of bench samples; `hmcvt_core.read_bench` reads it.

    Attributes:
        path: the file; it comes into being with the first sample.
        recovered: what opening it had to repair, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path, limit: int) -> None:
        """Open a log that holds at most `limit` samples.

        A file that cannot be read or repaired is no error yet: `append` tries again.
        """
        self.path = path
        self.recovered = ""
        self._limit = limit
        self._count = 0
        self._size = 0
        try:
            self._recover()
        except OSError as error:
            self.recovered = f"{path}: cannot be read or repaired: {error.strerror}"

    def __len__(self) -> int:
        return self._count

    def append(self, sample: BenchSamples) -> None:
        """Write samples and wait until they are on disk.

        Raises:
            InputError: the log is full, or a column is missing.
            OSError: they could not be written; the log is as before.
        """
        rows = _rows(sample)
        if self._count + len(sample) > self._limit:
            raise InputError(f"the bench log holds {self._count} samples and takes no more; "
                             "~/clear_samples sets it aside")
        if not self.path.exists():
            make_folder(self.path.parent)
            write_atomically(self.path, _HEADER)
        if self.path.stat().st_size != self._size:
            self._recover()  # new, or changed by someone else
        with self.path.open("ab", buffering=0) as file:
            try:
                left = rows
                while left:
                    left = left[file.write(left):]
                os.fsync(file.fileno())
            except OSError:
                with contextlib.suppress(OSError):  # if not now, the next call repairs it
                    file.truncate(self._size)
                raise
        self._count += len(sample)
        self._size += len(rows)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log; return how many samples the old one held and where it is now.

        Raises:
            OSError: the file cannot be renamed; the log is as before.
        """
        count = self._count
        if not self.path.exists():
            return 0, None
        kept = free_name(self.path, "cleared")
        self.path.rename(kept)
        sync_folder(self.path.parent)
        self._count = self._size = 0
        return count, kept

    def _recover(self) -> None:
        try:
            raw = self.path.read_bytes()
        except FileNotFoundError:
            self._count = self._size = 0
            return
        whole, newline, torn = raw.rpartition(b"\n")
        lines = (whole + newline).decode("utf-8", errors="replace").splitlines(keepends=True)
        # A cut in the middle of a number leaves a number: a line counts only with its end.
        good = [line for line in lines[1:] if _is_row(line)]
        text = _HEADER + "".join(good)
        self._count, self._size = len(good), -1  # no size that it could have
        if torn or lines[:1] != [_HEADER] or len(good) != len(lines) - 1:
            kept = free_name(self.path, "damaged")
            write_atomically(kept, raw)
            write_atomically(self.path, text)
            lost = max(len(lines) - 1, 0) + bool(torn) - len(good)
            self.recovered = (f"{self.path}: {lost} damaged lines taken out, the file as it was "
                              f"is kept as {kept.name}")
        self._size = len(text.encode())


def _rows(samples: BenchSamples) -> bytes:
    values = []
    for name in COLUMNS:
        column = getattr(samples, name)
        if column is None:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
        values.append(column.tolist())
    return "".join(",".join(map(repr, row)) + "\n" for row in zip(*values, strict=True)).encode()


def _is_row(line: str) -> bool:
    cells = line.rstrip("\n").split(",")
    if len(cells) != len(COLUMNS):
        return False
    try:
        return all(_RANGES[name].contains(float(cell))
                   for name, cell in zip(COLUMNS, cells, strict=True))
    except ValueError:
        return False
