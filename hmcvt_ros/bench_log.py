# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The log of bench samples: a CSV that loses nothing and can be read at any moment.

A sample is on disk when `write` returns. Every row has a number and a checksum, so that each row
can be judged alone: what a power cut leaves half written, or a person or a program changes, is
taken out, named and kept in another file, and the other rows stay. Numbers without a row are
samples that are gone. A row that stands there twice counts once. A JSON file of the same name keeps
the last number, so that rows missing at the end are noticed after a restart too.
"""

import codecs
import contextlib
import errno
import hashlib
import json
import os
import stat
import zlib
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from hmcvt_core import BenchSamples, InputError
from hmcvt_core.interface import (
    BENCH_COLUMNS,
    make_folder,
    sync_folder,
    write_atomically,
)

from .state_folder import Series, next_name, read_small, require_plain_path

FROM_SHAFTS = tuple(
    column.name
    for column in BENCH_COLUMNS
    if not column.joint and column.name != "stamp"
)
"""Columns that follow from the joints of the shafts."""
COLUMNS = ("stamp", *FROM_SHAFTS)
"""Columns that every sample has."""
STATED = {
    "stated_std": "efficiency_std",
    **{
        f"stated_{column.name}": column.name
        for column in BENCH_COLUMNS
        if column.joint and column.name != "efficiency_std"
    },
}
"""Columns that may be empty, with their names in `BenchSamples`. They are called otherwise here,
because a bench file has a value of all samples or of none."""
STATED_SESSION = "stated_session"
"""Column with the session of a sample, which may be empty."""

_NUMBERS = (*COLUMNS, *STATED)
_HEADER = ("number", *_NUMBERS, STATED_SESSION, "crc")
_HEADER_WITH_STAGE = (*_HEADER[:-1], "stage", "crc")
_CHAINED = (*COLUMNS, "stated_std", "crc", "chain")
"""Columns of an earlier version, in which a second checksum depended on the row before."""
_CHAINED_WITH_STAGE = (*_CHAINED[:-2], "stage", "crc", "chain")
_EARLIER = {len(_CHAINED), len(_CHAINED_WITH_STAGE)}
"""Counts of cells of an earlier version; each count is that of one header."""
_NAMES = (*_HEADER_WITH_STAGE, "chain")
"""Columns of logs of all versions, in their order."""
_MARK = ",".join(COLUMNS).encode()
"""What the first line of every log holds."""
_NOT_IN_A_STAGE = frozenset(',"#\n\r')
"""Characters that would break the line of a stage."""
_ROW_BYTES = 512
_ROWS_READ = 100_000
"""A file of more bytes than this many rows of that size, or than the limit of the log, is no log:
it is set aside unread, so that reading is bounded."""
_LINES_OF_A_ROW = 4
"""Lines of a file for each row that a log may hold, beyond which it is no log."""
_LINE_BYTES = 8 * _ROW_BYTES
"""Bytes of a line beyond which it is no row, also with quotes and added cells."""
_MAX_NAMED = 20
"""Lines or runs of samples that a message names."""
_MAX_NUMBER = 1 << 53
"""Numbers of rows below it are exact as floats."""
_MAX_KEPT = 50_000
"""Runs of missing samples that the JSON file names; about 0.7 MB."""
_NAME_SHOWN = 40
"""Characters of the name of a column that a message shows."""
_STAMP_DIGITS = 15
"""Significant digits of a stamp: as many as a spreadsheet keeps."""
_DIGITS = 14
"""Significant digits of the other numbers. With one less than a spreadsheet keeps, a value that was
computed from the torques and speeds of a message is that of a bench file to the last digit, so that
a diagnosis of both is the same."""


class Written(NamedTuple):
    """What became of rows.

    Attributes:
        logged: count of rows that are on disk.
        repeats: positions of the rows that had been logged before.
    """

    logged: int
    repeats: frozenset[int]


class _Row(NamedTuple):
    """A row without number and checksum, and its number; 0 where it has none."""

    number: int
    text: bytes


class _Reading(NamedTuple):
    """What a file holds.

    Attributes:
        rows: intact rows of the log's kind, in the order of their numbers.
        damaged: numbers of the lines that are no intact rows, from 1.
        strangers: numbers of the lines that are rows of the other kind, with stages or without,
            or of a later version.
        repeats: count of rows that stand there more than once.
        added: names of columns that are not the log's.
    """

    rows: list[_Row]
    damaged: list[int]
    strangers: list[int]
    repeats: int
    added: list[str]


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
        header = _HEADER_WITH_STAGE if stages else _HEADER
        self._header = ",".join(header).encode() + b"\n"
        self._cells = len(header)
        self._limit = limit
        self._logged: set[int] = set()  # hashes of the rows
        self._last = 0  # number of the last row
        self._gone: list[str] = []  # runs of numbers without a row, as reported
        self._noted: tuple[int, list[str]] | None = None  # what the JSON file holds
        self._written: _Identity | None = None
        self._content = hashlib.sha256()  # of the file as it was written
        self._removed = 0  # samples that vanished with the file
        self._last = self._noted_last()
        try:
            self.check()
        except OSError as error:
            self.recovered = f"{path}: cannot be read or repaired: {error.strerror}"

    def __len__(self) -> int:
        return len(self._logged)

    @property
    def full(self) -> str:
        """Why there is no room for a sample."""
        return (
            f"the bench log holds {len(self)} samples and takes no more; "
            "~/clear_samples sets it aside"
        )

    def write(self, rows: Sequence[bytes]) -> Written:
        """Write the rows that are new and for which there is room; wait until they are on disk.

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
                write_atomically(self.path, self._header)
                self._content = hashlib.sha256(self._header)
                self._written = self._identity()
            fresh, repeats = self._sorted_out(rows)
            lines = map(_line, enumerate(fresh, self._last + 1))
            if not fresh or self._append(b"".join(lines)):
                self._logged.update(map(hash, fresh))
                self._last += len(fresh)
                return Written(len(fresh), repeats)

    def set_aside(self) -> tuple[int, Path | None]:
        """Begin a new log; return how many samples the old one held, and its path.

        A log without samples stays.

        Raises:
            OSError: the file cannot be renamed; the log is as before.
        """
        count = 0
        kept = None
        if self._identity() is not None and len(self):
            count = len(self)
            kept = self._rename("cleared")
        self._begin()
        self._removed = 0
        self.recovered = ""
        return count, kept

    def check(self) -> None:
        """Take out of the file what is not as it was written, and put the rest in order.

        Samples that had been written and are missing are reported in `recovered`.

        Raises:
            OSError: it cannot be read or repaired.
        """
        expected = len(self) or self._last
        identity = self._identity()
        if identity is None:
            self._begin()
            if expected:
                self._removed += expected
                self.recovered = (
                    f"{self.path}: is gone, and {self._removed} samples with it"
                )
            self._forget()
            return
        most = max(self._limit, _ROWS_READ)
        if identity.size > _ROW_BYTES * most:
            self._set_aside_unread(f"{identity.size} bytes")
            return
        raw = self.path.read_bytes()
        unchanged = hashlib.sha256(raw).digest() == self._content.digest()
        if unchanged and identity == self._written:
            return  # before every job: to read each row would hold up answers
        lines = raw.count(b"\n")
        if lines > _LINES_OF_A_ROW * most:
            self._set_aside_unread(f"{lines} lines")
            return
        reading = _read(raw, self._cells)
        if reading.strangers and not reading.rows:
            aside = self._rename("cleared")
            self._begin()
            self.recovered = (
                f"{self.path}: was of another model, one with stages or without, or of "
                f"another version, and is set aside as {aside}"
            )
            return
        self._written = None  # until it has been written
        self._logged = {hash(row.text) for row in reading.rows}
        self._last = max(self._last, *(row.number for row in reading.rows), 0)
        text = self._header + b"".join(map(_line, reading.rows))
        damaged = sorted(reading.damaged + reading.strangers)
        changed = damaged or reading.added
        self._report(reading, damaged, self._keep(raw) if changed else None)
        if text != raw:
            write_atomically(self.path, text)
        self._content = hashlib.sha256(text)
        self._written = self._identity()
        with contextlib.suppress(OSError):
            self.note()

    def _set_aside_unread(self, size: str) -> None:
        """Begin a new log in place of a file whose size, in words, is that of no log."""
        aside = self._rename("damaged")
        self._begin()
        self.recovered = (
            f"{self.path}: has {size}, too many for a log of {self._limit} samples, and is set "
            f"aside unread as {aside.name}"
        )

    def note(self) -> None:
        """Write the last number and the missing ones to the JSON file, if they have changed.

        Raises:
            OSError: they cannot be written.
        """
        now = (self._last, self._gone)
        if self._written is None or now == self._noted:
            return
        require_plain_path(self._note_path)
        text = json.dumps({"last": self._last, "gone": _listed(self._gone, _MAX_KEPT)})
        write_atomically(self._note_path, f"{text}\n")
        self._noted = now

    @property
    def _note_path(self) -> Path:
        return self.path.with_suffix(".json")

    def _noted_last(self) -> int:
        """Return the number of the last sample as it was noted; 0 where it is not known."""
        try:
            require_plain_path(self._note_path)
            last = json.loads(read_small(self._note_path))["last"]
        except (OSError, ValueError, LookupError, TypeError, RecursionError):
            return 0
        return last if isinstance(last, int) and 0 <= last < _MAX_NUMBER else 0

    def _forget(self) -> None:
        """Remove the JSON file: the log that it describes is another file now."""
        self._noted = None
        with contextlib.suppress(OSError):
            require_plain_path(self._note_path.parent)
            self._note_path.unlink(missing_ok=True)

    def _sorted_out(self, rows: Sequence[bytes]) -> tuple[list[bytes], frozenset[int]]:
        """Return the new rows for which there is room, and the positions of the repeats."""
        room = self._limit - len(self)
        fresh: dict[bytes, None] = {}
        repeats = set()
        for position, row in enumerate(rows):
            if hash(row) in self._logged or row in fresh:
                repeats.add(position)
            elif len(fresh) < room:
                fresh[row] = None
        return list(fresh), frozenset(repeats)

    def _begin(self) -> None:
        """Forget the file: the next sample begins another one."""
        self._logged = set()
        self._last = 0
        self._gone = []
        self._written = None

    def _identity(self) -> _Identity | None:
        """Return which file has the name of the log; None when none has.

        Raises:
            OSError: it is a link, a pipe or a device, or lies in a folder that is a link.
        """
        require_plain_path(self.path.parent)
        require_plain_path(self.path)
        try:
            status = self.path.lstat()
        except FileNotFoundError:
            return None
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is no regular file", str(self.path))
        return _Identity(status.st_dev, status.st_ino, status.st_size)

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
        self._content.update(text)
        self._written = expected
        return True

    def _report(
        self, reading: _Reading, damaged: Sequence[int], kept: Path | None
    ) -> None:
        """State which lines were taken out, and which samples are gone.

        Args:
            reading: what the file holds.
            damaged: numbers of the lines that are taken out.
            kept: copy of the file as it was.
        """
        problems = []
        if damaged:
            lines = _listed([str(number) for number in damaged])
            problems.append(f"{len(damaged)} damaged lines taken out (line {lines})")
        if reading.added:
            columns = _listed([repr(name[:_NAME_SHOWN]) for name in reading.added])
            problems.append(f"columns that are not the log's taken out ({columns})")
        if kept is not None:
            problems[-1] = f"{problems[-1]}, the file as it was is kept as {kept.name}"
        if reading.repeats:
            problems.append(
                f"{reading.repeats} rows stood there more than once and count once"
            )
        gone = _gaps([row.number for row in reading.rows], self._last)
        if gone and gone != self._gone:
            words = f"gone are samples number {_listed(gone)}"
            if len(gone) > _MAX_NAMED:
                words = f"{words}, all of them in {self._note_path.name}"
            problems.append(words)
        self._gone = gone
        if problems:
            self.recovered = f"{self.path}: {'; '.join(problems)}"

    def _rename(self, reason: str) -> Path:
        kept = self._free_name(reason)
        self._forget()  # before the log is gone, or it would be missed after a crash
        self.path.rename(kept)
        sync_folder(self.path.parent)
        return kept

    def _keep(self, raw: bytes) -> Path:
        kept = self._free_name("damaged")
        write_atomically(kept, raw)
        return kept

    def _free_name(self, reason: str) -> Path:
        prefix = f"{self.path.stem}.{reason}-"
        series = Series(rf"{prefix.replace('.', '[.]')}\d+[.]csv", (_MARK,))
        name = next_name(self.path.parent, series, prefix=prefix)
        return name.with_name(f"{name.name}{self.path.suffix}")


def require_intact(path: Path) -> None:
    """Refuse a log that was set aside and is not as it was written; other files pass.

    Raises:
        InputError: a line is damaged; it is named.
        OSError: the file cannot be read.
    """
    with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        first = file.readline(_ROW_BYTES)
        header = _cells(first.rstrip(b"\n"))
        if not _is_header(header):
            return
        rest = file.read(_ROW_BYTES * _ROWS_READ)
        if file.read(1):
            raise InputError(f"{path.name}: more than {len(rest)} bytes, too many")
        damaged = _read(first + rest, len(header)).damaged
        if damaged:
            lines = _listed([str(number) for number in damaged])
            raise InputError(f"{path.name}: damaged is line {lines}: take it out")


def rows_of(samples: BenchSamples) -> list[bytes]:
    """Return samples as rows of the log, without their numbers and checksums.

    Raises:
        InputError: a column is missing, or the name of a stage would break its line.
    """
    columns = []
    for name in _NUMBERS:
        column = getattr(samples, STATED.get(name, name))
        if column is not None:
            digits = _STAMP_DIGITS if name == "stamp" else _DIGITS
            columns.append([_written(value, digits) for value in column.tolist()])
        elif name in STATED:
            columns.append([""] * len(samples))
        else:
            # An empty cell would make a log that `read_bench` refuses.
            raise InputError(f"{samples.source}: {name} is missing")
    columns.append(list(samples.extra.get("session", [""] * len(samples))))
    stages = samples.extra.get("stage")
    if stages:
        columns.append(list(stages))
    rows = list(zip(*columns, strict=True))
    for row in rows:
        for name in row[len(_NUMBERS) :]:
            if _NOT_IN_A_STAGE & set(name):
                raise InputError(f"{samples.source}: {name!r} is no name for a log")
    return [",".join(row).encode() for row in rows]


def _written(value: float, digits: int) -> str:
    """Return a number with some significant digits, as the log writes it."""
    return repr(float(f"{value:.{digits}g}"))


def _line(row: tuple[int, bytes]) -> bytes:
    """Return a line of the log from the number of a row and its text."""
    body = b"%d,%b" % row
    # With a letter first, so that a spreadsheet takes it for text.
    return b"%b,x%08x\n" % (body, zlib.crc32(body))


def _read(raw: bytes, cells: int) -> _Reading:
    """Read a file line by line; each line is judged alone.

    Args:
        raw: content of the file.
        cells: count of cells of a row of this log.
    """
    rows: dict[bytes, int] = {}
    damaged = []
    strangers = []
    repeats = 0
    added: list[str] = []
    last = 0
    numbers = _NUMBERS
    picked: list[int] = []  # positions of columns, where some were moved or added
    text = raw.removeprefix(codecs.BOM_UTF8)
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = raw.decode("utf-16", errors="replace").encode()
    if b"\n" not in text:  # ends of lines as of old Macintoshs
        text = text.replace(b"\r", b"\n")
    for place, line in enumerate(text.split(b"\n"), 1):
        if len(line) > _LINE_BYTES:
            damaged.append(place)
            continue
        values = _cells(line)
        known = _known_columns(values)
        header = [values[position] for position in known]
        if _is_header(header):
            numbers = _numbers_of(header)
            picked = known if known != list(range(len(values))) else []
            added += [name for name in values if name and name not in _NAMES]
            continue
        if not any(values):
            continue
        row = None
        if picked and len(values) > max(picked):
            row = _intact([values[position] for position in picked], numbers)
        if row is None:
            row = _intact(values, _NUMBERS if picked else numbers)
        if row is None:
            damaged.append(place)
        elif row.text.count(b",") != cells - 3:
            strangers.append(place)
        elif row.text in rows:
            repeats += 1
        else:
            last = row.number or last + 1
            rows[row.text] = last
    # Sorted or swapped rows are put back in the order in which they were written.
    numbered = sorted(
        (_Row(n, text) for text, n in rows.items()), key=lambda r: r.number
    )
    return _Reading(numbered, damaged, strangers, repeats, added)


def _cells(line: bytes) -> list[str]:
    """Return the cells of a line as the log writes them, also after a spreadsheet saved it.

    A spreadsheet may separate by semicolons or tabs, with decimal commas, add quotes, and write
    numbers in another form.
    """
    text = line.decode(errors="replace").strip("\r")
    mark = max(",;\t", key=text.count)
    if mark != ",":
        text = text.replace(",", ".").replace(mark, ",")
    return [cell.strip('"') for cell in text.split(",")]


def _known_columns(cells: Sequence[str]) -> list[int]:
    """Return the positions of the cells that name columns of the log, in the order of the log."""
    if "crc" not in cells:  # no header, as nearly every line
        return []
    return [cells.index(name) for name in _NAMES if name in cells]


def _is_header(cells: Sequence[str]) -> bool:
    """Return whether a line is the header of a log, also of an earlier version."""
    names = tuple(cells)
    if names in (_CHAINED, _CHAINED_WITH_STAGE):
        return True
    # Columns that samples may state were added from version to version.
    begin = ("number", *COLUMNS)
    is_known = set(names) <= set(_HEADER_WITH_STAGE)
    return is_known and names[: len(begin)] == begin and names[-1] == "crc"


def _numbers_of(header: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of numbers of a header."""
    others = ("number", STATED_SESSION, "stage", "crc", "chain")
    return tuple(name for name in header if name not in others)


def _intact(cells: Sequence[str], numbers: Sequence[str]) -> _Row | None:
    """Return the row in the cells of a line; None where its checksum does not match.

    Args:
        cells: of the line.
        numbers: columns of numbers that the log had when the line was written.
    """
    if len(cells) in _EARLIER:
        body = ",".join(cells[:-2])
        if f"{zlib.crc32(body.encode()):08x}" != cells[-2]:
            return None
        values = cells[: len(COLUMNS) + 1]
        added = [""] * (len(_HEADER) - len(_CHAINED))
        return _Row(0, ",".join([*values, *added, *cells[len(values) : -2]]).encode())
    end = len(numbers) + 1
    if len(cells) < end + 2:
        return None
    try:
        number = int(float(cells[0]))
        values = [_number(cell) for cell in cells[1:end]]
    except (ValueError, OverflowError):
        return None
    if not 0 < number < _MAX_NUMBER:
        return None
    session, *others = cells[end:-1]
    words = [_whole(session), *others]
    written = _line((number, ",".join([*values, *words]).encode())).decode().rstrip()
    if not written.endswith(f",{cells[-1]}"):
        return None
    by_name = dict(zip(numbers, values, strict=True))
    now = [by_name.get(name, "") for name in _NUMBERS]
    return _Row(number, ",".join([*now, *words]).encode())


def _whole(cell: str) -> str:
    """Return a whole number without the decimals that a program has added."""
    return cell.removesuffix(".0")


def _number(cell: str) -> str:
    """Return a number in the form in which the log writes it; empty for an empty cell."""
    return repr(float(cell)) if cell else ""


def _gaps(numbers: Iterable[int], last: int) -> list[str]:
    """Return which numbers from 1 to `last` are missing among rising numbers, as runs."""
    missing = []
    for before, after in pairwise([0, *numbers, last + 1]):
        if after - before == 2:
            missing.append(f"{before + 1}")
        elif after - before > 2:
            missing.append(f"{before + 1} to {after - 1}")
    return missing


def _listed(words: Sequence[str], most: int = _MAX_NAMED) -> str:
    """Return words in one line; `most` of them, and the count of the others."""
    listed = ", ".join(words[:most])
    if len(words) > most:
        return f"{listed} and {len(words) - most} more"
    return listed
