# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `write` returns. Every row has two checksums: `crc` covers the row itself,
and `chain` covers the row and the chain of the row before. What a power cut leaves half written, a
disk returns otherwise than it was written, or another program appends, is taken out and kept in
another file. Rows of the log that are appended again break the chain.
"""

import contextlib
import os
import stat
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.interface import (
    BENCH_COLUMNS,
    make_folder,
    sync_folder,
    write_atomically,
)

from .state_folder import Series, next_name, require_no_link

COLUMNS = (
    "stamp",
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "efficiency",
    "output_speed",
    "stated_std",
)
"""The last may be empty: the standard deviation that a sample states of its efficiency. It is not
called `efficiency_std`, because a bench file has that of all samples or of none."""
_ATTRIBUTES = {"stated_std": "efficiency_std"}
"""Names of columns in `BenchSamples`, where they differ."""

_PLAIN_HEADER = ",".join(COLUMNS[:-1]).encode()
"""First line of logs up to version 0.1, without checksums."""
_UNCHAINED_HEADERS = (_PLAIN_HEADER + b",crc", _PLAIN_HEADER + b",stage,crc")
"""First lines of logs of version 0.2, in which rows have only `crc`."""
_HEADER = ",".join(COLUMNS).encode() + b",crc,chain"
_HEADER_WITH_STAGE = ",".join(COLUMNS).encode() + b",stage,crc,chain"
_WITH_STAGE = (_HEADER_WITH_STAGE, _UNCHAINED_HEADERS[1])
_WITHOUT_STAGE = (_HEADER, _UNCHAINED_HEADERS[0], _PLAIN_HEADER)
_NOT_IN_A_STAGE = frozenset(',"#\n\r')
"""Characters that would break the line of a stage."""
_RANGES = {column.name: column for column in BENCH_COLUMNS}
_BEGIN = b"00000000"
"""Chain before the first row."""
_HEX = 8
"""Digits of a checksum."""


class _Identity(NamedTuple):
    """What shows that a file is the one that was written last."""

    device: int
    inode: int
    size: int


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
        self._chain = _BEGIN
        self._written: _Identity | None = None
        self._removed = 0  # samples that vanished with the file
        try:
            self.check(takes_over=True)
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

        Args:
            rows: see `rows_of`.

        Raises:
            OSError: they could not be written; the log is as before.
        """
        while True:
            if self._written is None or self._identity() != self._written:
                self.check()  # another program changed, removed or replaced it
            if self._written is None:
                make_folder(self.path.parent)
                write_atomically(self.path, self._header + b"\n")
                self._chain = _BEGIN
                self._written = self._identity()
            fitting = rows[: max(self._limit - self._count, 0)]
            if not fitting:
                return 0
            text, chain = _chained(fitting, self._chain)
            if self._append(text):
                self._count += len(fitting)
                self._chain = chain
                return len(fitting)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log; return how many samples the old one held, and its path.

        A log without samples stays.

        Raises:
            OSError: the file cannot be renamed; the log is as before.
        """
        count = 0
        kept = None
        if self._identity() is not None and self._count:
            count = self._count
            kept = self._free_name("cleared")
            self.path.rename(kept)
            sync_folder(self.path.parent)
            self._written = None
        self._count = 0
        self._removed = 0
        self._chain = _BEGIN
        self.recovered = ""
        return count, kept

    def check(self, takes_over: bool = False) -> None:
        """Take out of the file what is not as it was written.

        Samples that had been written and are missing are reported in `recovered`.

        Args:
            takes_over: whether a log of an earlier version, without chain or checksums, is taken
                over; only at the start, because while the node runs nobody else writes one.

        Raises:
            OSError: it cannot be read or repaired.
        """
        expected = self._count
        if self._identity() is None:
            self._forget(expected)
            return
        raw = self.path.read_bytes()
        *lines, torn = raw.split(b"\n")
        header = lines.pop(0) if lines else b""
        if header in (_WITHOUT_STAGE if self._stages else _WITH_STAGE):
            self._set_aside_of_another_model(len(lines))
            return
        rows = _intact_rows(lines, header, self._header, takes_over)
        text, self._chain = _chained(rows, _BEGIN)
        text = self._header + b"\n" + text
        self._count = len(rows)
        self._written = None  # until it has been written
        lost = len(lines) + bool(torn) - len(rows)
        known = header == self._header or (takes_over and header in _OLD_HEADERS)
        self._report_damage(raw, known, lost, expected)
        if text != raw:
            write_atomically(self.path, text)
        self._written = self._identity()

    def _identity(self) -> _Identity | None:
        """Return which file has the name of the log; None when none has.

        Raises:
            OSError: it is a link, or lies in a folder that is one.
        """
        require_no_link(self.path.parent)
        require_no_link(self.path)
        try:
            status = self.path.lstat()
        except FileNotFoundError:
            return None
        return _Identity(status.st_dev, status.st_ino, status.st_size)

    def _forget(self, expected: int) -> None:
        """Take note that the file is gone with the samples that it held."""
        self._count = 0
        self._chain = _BEGIN
        self._written = None
        if expected:
            self._removed += expected
            self.recovered = (
                f"{self.path}: is gone, and {self._removed} samples with it"
            )

    def _append(self, text: bytes) -> bool:
        """Append to the file; return False when it turns out to have been removed or replaced."""
        assert self._written is not None
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_NOFOLLOW)
        with open(handle, "ab", buffering=0) as file:
            if not stat.S_ISREG(os.fstat(handle).st_mode):
                raise OSError(0, "is no regular file", str(self.path))
            try:
                rest = text
                while rest:
                    rest = rest[file.write(rest) :]
                os.fsync(handle)
            except OSError:
                # If the file cannot be cut back now, the next call repairs it.
                with contextlib.suppress(OSError):
                    file.truncate(self._written.size)
                raise
        expected = self._written._replace(size=self._written.size + len(text))
        if self._identity() != expected:
            return False
        self._written = expected
        return True

    def _set_aside_of_another_model(self, count: int) -> None:
        self._count = max(count, 1)
        _, aside = self.set_aside()
        self.recovered = (
            f"{self.path}: was of another model, one with stages or without, "
            f"and is set aside as {aside}"
        )

    def _report_damage(self, raw: bytes, known: bool, lost: int, expected: int) -> None:
        """Keep a damaged file, and say which samples are lost.

        Args:
            raw: file as it was found.
            known: whether its first line is one of a log.
            lost: count of damaged lines.
            expected: count of samples that had been written.
        """
        problems = []
        if lost or not known:
            kept = self._free_name("damaged")
            write_atomically(kept, raw)
            problems.append(
                f"{lost} damaged lines taken out, the file as it was is kept as "
                f"{kept.name}"
            )
        missing = expected - self._count
        if missing > 0 and missing > lost:
            problems.append(f"{missing - lost} samples that had been logged are gone")
        if problems:
            self.recovered = f"{self.path}: {'; '.join(problems)}"

    def _free_name(self, reason: str) -> Path:
        prefix = f"{self.path.stem}.{reason}-"
        series = Series(
            rf"{prefix.replace('.', '[.]')}\d+[.]csv", (_PLAIN_HEADER + b",",)
        )
        name = next_name(self.path.parent, series, prefix=prefix)
        return name.with_name(f"{name.name}{self.path.suffix}")


_OLD_HEADERS = (_PLAIN_HEADER, *_UNCHAINED_HEADERS)


def rows_of(samples: BenchSamples) -> list[bytes]:
    """Return samples as rows of the log, with `crc` and without `chain`.

    Raises:
        InputError: a column is missing, or the name of a stage would break its line.
    """
    columns = []
    for name in COLUMNS:
        column = getattr(samples, _ATTRIBUTES.get(name, name))
        if column is not None:
            columns.append([repr(value) for value in column.tolist()])
        elif name in _ATTRIBUTES:
            columns.append([""] * len(samples))
        else:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
    stages = samples.extra.get("stage")
    if stages:
        if any(_NOT_IN_A_STAGE & set(name) for name in stages):
            raise InputError(
                f"{samples.source}: stage {stages[0]!r} is no name for a log"
            )
        columns.append(list(stages))
    rows = zip(*columns, strict=True)
    return [_with_checksum(",".join(row).encode()) for row in rows]


def _with_checksum(row: bytes) -> bytes:
    return b"%b,%08x" % (row, zlib.crc32(row))


def _link(row: bytes, before: bytes) -> bytes:
    """Return the chain of a row after a row with another chain."""
    return b"%08x" % zlib.crc32(row, int(before, 16))


def _chained(rows: Sequence[bytes], before: bytes) -> tuple[bytes, bytes]:
    """Return rows as lines after a chain, and the chain after them."""
    lines = []
    for row in rows:
        before = _link(row, before)
        lines.append(b"%b,%b\n" % (row, before))
    return b"".join(lines), before


def _intact_rows(
    lines: Sequence[bytes], header: bytes, wanted: bytes, takes_over: bool
) -> list[bytes]:
    """Return the rows that are as they were written, with `crc` and without `chain`."""
    if takes_over and header == _PLAIN_HEADER:
        # A cut in the middle of a number leaves a number, so a line counts only with its end.
        plain = [line.strip() for line in lines if _is_row(line)]
        return [_with_empty_cell(row) for row in plain]
    if takes_over and header in _UNCHAINED_HEADERS:
        good = [line for line in lines if _intact(line)]
        stage = header == _UNCHAINED_HEADERS[1]
        return [_with_empty_cell(line[: -_HEX - 1], stage) for line in good]
    return _rows_in_chain(lines)


def _with_empty_cell(row: bytes, stage: bool = False) -> bytes:
    """Return a row of an earlier version with a cell for `stated_std`."""
    if stage:
        values, _, name = row.rpartition(b",")
        return _with_checksum(values + b",," + name)
    return _with_checksum(row + b",")


def _rows_in_chain(lines: Sequence[bytes]) -> list[bytes]:
    """Return the rows that are intact and follow each other.

    A damaged line says no more than the chain that it ends with, which the next line may continue.
    A line that is intact, but does not continue the chain, comes from elsewhere, and so do the
    lines that continue it.
    """
    rows = []
    before = {_BEGIN}
    for line in lines:
        row, _, chain = line.rpartition(b",")
        if not _intact(row):
            if _is_checksum(chain):
                before.add(chain)
            continue
        links = {_link(row, link) for link in before}
        if chain in links:
            rows.append(row)
            before = {chain}
        else:
            # Where only its chain is damaged, the next line continues what it should be.
            before |= links
    return rows


def _intact(row: bytes) -> bool:
    return row == _with_checksum(row.rpartition(b",")[0])


def _is_checksum(text: bytes) -> bool:
    return len(text) == _HEX and all(digit in b"0123456789abcdef" for digit in text)


def _is_row(line: bytes) -> bool:
    cells = line.split(b",")
    if len(cells) != len(COLUMNS) - 1:
        return False
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return False
    return all(
        _RANGES[name].contains(value)
        for name, value in zip(COLUMNS[:-1], values, strict=True)
    )
