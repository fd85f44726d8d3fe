# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""CAN traces (.blf, .asc, .trc, candump's .log) as batches of frames, by python-can."""

from __future__ import annotations

import io
import logging
import math
import re
import struct
from collections.abc import Generator, Iterator
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError, in_one_line

from .series import Remarks
from .signals import BUS_NAME, BYTES, Frames

SUFFIXES = (".blf", ".asc", ".trc", ".log")
BATCH = 100_000
"""Frames of one batch: 2 MB of data and times."""

_CANDUMP = re.compile(
    r"\(\d+\.\d+\) +\S+ +[0-9A-Fa-f]{3,8}##?[0-9A-FRaf]*(?: +[RT])?\s*"
)
_CANDUMP_DATA = re.compile(
    r"\((\d+\.\d+)\) +(\S+) +([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#((?:[0-9A-Fa-f]{2}){0,8})"
    r"(?: +[RT])?\s*"
)
_CONSOLE = re.compile(
    r"\s*(?:\((?P<stamp>[\d. :-]+)\)\s+)?(?P<bus>\S+)\s+(?:[RT]X\s+[B-]\s+[E-]\s+)?"
    r"(?P<identifier>[0-9A-F]{3}|[0-9A-F]{8})\s+\[(?P<length>\d+)\]"
    r"(?P<data>(?:\s+[0-9A-F]{2})*)(?P<rest>.*)",
    re.IGNORECASE,
)
"""A frame as candump prints it: `(1700000000.001000)  can0  100   [8]  C0 2B ...`."""
_SCANNED_LINES = 2000
"""Lines of a printed candump that show what its stamps are."""
_ABSOLUTE_FROM = 1e8
"""Stamps from here on are seconds since 1970 [s]; a machine does not record for three years."""
_FEWEST_LINES = 20
"""Frames from which differences can be distinguished from times since the first frame."""
_CUT_OFF = "cut off; what is before is used"
_BLF_SIZE = struct.Struct("<16xQ")
"""Where a BLF file states its size: behind signature, size of the header and versions."""
_ERROR_FLAG = 0x20000000
"""Bit of the identifier of an error frame in a candump (linux/can.h)."""


def read_frames(path: Path, remarks: Remarks) -> Iterator[tuple[Frames, float]]:
    """Yield batches of frames, each with the part of the file that was read.

    What is damaged ends the file or is left out; a remark names time and damage.

    Raises:
        InputError: the file cannot be opened, or holds no frame at all.
    """
    size = max(path.stat().st_size, 1)
    with path.open("rb") as file:
        if path.suffix.lower() == ".log":
            stamps = _printed_stamps(path, file)
            batches = _candump(file, remarks)
            if stamps:
                batches = _console(file, stamps == "delta", remarks)
        else:
            batches = _by_python_can(path, file, remarks)
        # Closed in this order, also where only the beginning of the file is read.
        with closing(batches):
            for frames in batches:
                # The reader of BLF closes the file at its end.
                position = size if file.closed else file.tell()
                yield frames, min(position / size, 1.0)


class _Batch:
    """Frames that are collected one by one."""

    def __init__(self) -> None:
        self.time: list[float] = []
        self.identifier: list[int] = []
        self.extended: list[bool] = []
        self.data: list[bytes] = []
        self.bus: list[str] = []

    def __len__(self) -> int:
        return len(self.time)

    def add(
        self, time: float, identifier: int, is_extended: bool, data: bytes, bus: str
    ) -> None:
        """Append one frame."""
        self.time.append(time)
        self.identifier.append(identifier)
        self.extended.append(is_extended)
        self.data.append(data)
        self.bus.append(bus)

    def frames(self) -> Frames:
        """Return the frames as arrays."""
        lengths = np.fromiter(map(len, self.data), dtype=np.uint8, count=len(self))
        padded = b"".join([data[:BYTES].ljust(BYTES, b"\0") for data in self.data])
        return Frames(
            np.array(self.time, dtype=float),
            np.array(self.identifier, dtype=np.uint32),
            np.array(self.extended, dtype=bool),
            lengths,
            np.frombuffer(padded, dtype=np.uint8).reshape(-1, BYTES),
            np.array(self.bus, dtype=f"U{BUS_NAME}"),
        )


def _by_python_can(
    path: Path, file: Any, remarks: Remarks
) -> Generator[Frames, None, None]:
    try:
        import can
    except ImportError:
        raise InputError(
            f'{path}: a CAN trace needs python-can: pip install "hmcvt_ros[can]"'
        ) from None
    readers: dict[str, Any] = {
        ".blf": can.BLFReader,
        ".asc": can.ASCReader,
        ".trc": can.TRCReader,
    }
    suffix = path.suffix.lower()
    source = file
    text = None
    complaints = _Complaints(remarks)
    if suffix != ".blf":
        text = io.TextIOWrapper(file, encoding="utf-8", errors="replace")
        # Iterating over the lines would forbid to ask how far the file is read.
        source = _Lines(text)
        if suffix == ".asc":
            source = _AscLines(text, remarks)
    try:
        with complaints:
            yield from _messages(path, readers[suffix], source, remarks)
    finally:
        if text is not None:
            text.detach()


class _Complaints(logging.Handler):
    """Counts what python-can logs of lines that it cannot read, in place of printing it.

    Args:
        remarks: where they are counted.
    """

    def __init__(self, remarks: Remarks) -> None:
        super().__init__(logging.WARNING)
        self._remarks = remarks
        self._logger = logging.getLogger("can.io")

    def __enter__(self) -> None:
        self._logger.addHandler(self)
        self._logger.propagate = False

    def __exit__(self, *_: object) -> None:
        self._logger.removeHandler(self)
        self._logger.propagate = True

    def emit(self, record: logging.LogRecord) -> None:
        """Count one message."""
        self._remarks.add("file", "lines that cannot be read left out")


def _messages(
    path: Path, reader: Any, source: Any, remarks: Remarks
) -> Iterator[Frames]:
    """Yield what a reader of python-can gives, up to where the file is damaged."""
    batch = _Batch()
    last = math.nan
    now = 0.0
    try:
        messages = reader(source)
        for message in messages:
            now += float(message.timestamp)
            last = float(message.timestamp)
            if getattr(messages, "timestamps_format", None) == "relative":
                last = now  # each stamp counts from the frame before
            if message.is_error_frame:
                remarks.add("bus", "error frames", last)
            elif not message.is_remote_frame:
                batch.add(
                    last,
                    message.arbitration_id,
                    message.is_extended_id,
                    bytes(message.data),
                    "" if message.channel is None else str(message.channel),
                )
            if len(batch) >= BATCH:
                yield batch.frames()
                batch = _Batch()
        if _is_cut_off(path):
            remarks.add("file", _CUT_OFF, last, 0)
    except Exception as error:  # python-can raises errors of many kinds for damage
        words = in_one_line(error)
        if math.isnan(last):
            raise InputError(
                f"{path}: no CAN trace that can be read: {words}"
            ) from None
        remarks.add(
            "file", f"cut off or damaged ({words}); what is before is used", last, 0
        )
    if len(batch):
        yield batch.frames()


def _is_cut_off(path: Path) -> bool:
    """Whether a trace ends within a line, or is shorter than it states (BLF)."""
    with path.open("rb") as file:
        if path.suffix.lower() == ".blf":
            (stated,) = _BLF_SIZE.unpack(file.read(_BLF_SIZE.size))
            return bool(path.stat().st_size < stated)
        file.seek(-1, io.SEEK_END)
        return file.read(1) != b"\n"


class _Lines(io.TextIOBase):
    """A text file whose lines are read one by one, so that `tell` of its bytes stays allowed."""

    def __init__(self, file: io.TextIOWrapper) -> None:
        self._file = file

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override]
        """Return the next line."""
        return self._file.readline(size)

    def read(self, size: int | None = -1, /) -> str:
        """Return the next characters."""
        return self._file.read(size)

    def readable(self) -> bool:
        """Whether it can be read: always."""
        return True


_ASC_STAMP = re.compile(r"\s*(-?\d+\.\d+)(?=\s)")
"""Stamp in front of a frame of an ASC file."""


class _AscLines(_Lines):
    """The lines of an ASC file as python-can reads all of them.

    It takes the first line behind the header as part of it, and passes over stamps below zero,
    which frames before the trigger have.

    Args:
        file: the text.
        remarks: where stamps below zero are named.
    """

    def __init__(self, file: io.TextIOWrapper, remarks: Remarks) -> None:
        super().__init__(file)
        self._remarks = remarks
        self._shift = math.nan
        self._next = ""

    def readline(self, size: int = -1, /) -> str:  # type: ignore[override]
        """Return the next line, its stamp counted from the first one where that is below zero."""
        if self._next:
            line = self._next
            self._next = ""
            return line
        line = super().readline(size)
        stamp = _ASC_STAMP.match(line)
        if stamp is None:
            return line
        seconds = float(stamp[1])
        if math.isnan(self._shift):
            self._shift = float(math.ceil(max(-seconds, 0.0)))
            if self._shift:
                reason = f"stamps begin below zero: times count from {-self._shift:g} s"
                self._remarks.add("file", reason, count=0)
            self._next = self._shifted(line, stamp)
            return "no internal events logged\n"
        return self._shifted(line, stamp)

    def _shifted(self, line: str, stamp: re.Match[str]) -> str:
        seconds = float(stamp[1]) + self._shift
        if seconds < 0.0:
            self._remarks.add("file", "frames before the first stamp left out")
        if not self._shift:
            return line
        return f"{seconds:.9f}{line[stamp.end() :]}"


def _candump(file: Any, remarks: Remarks) -> Generator[Frames, None, None]:
    """Read the log of candump -l (can-utils): one frame a line, of ten times the speed."""
    batch = _Batch()
    last = math.nan
    for line in file:
        text = line.decode("ascii", "replace")
        if not text.endswith("\n"):
            # A frame that is cut may look like a shorter one.
            remarks.add("file", _CUT_OFF, last, 0)
            break
        match = _CANDUMP_DATA.fullmatch(text)
        if match is None:
            _count_line(text, last, remarks)
            continue
        stamp, bus, identifier, data = match.groups()
        last = float(stamp)
        number = int(identifier, 16)
        if len(identifier) == 8 and number & _ERROR_FLAG:
            remarks.add("bus", "error frames", last)
            continue
        batch.add(last, number, len(identifier) == 8, bytes.fromhex(data), bus)
        if len(batch) >= BATCH:
            yield batch.frames()
            batch = _Batch()
    if len(batch):
        yield batch.frames()


def _count_line(text: str, last: float, remarks: Remarks) -> None:
    """Count a line of a candump that is no frame with up to eight bytes."""
    if not text.strip():
        return
    if _CANDUMP.fullmatch(text):
        remarks.add("file", "remote or FD frames left out", last)
    else:
        remarks.add("file", "damaged lines left out", last)


def _printed_stamps(path: Path, file: Any) -> str:
    """Return what the stamps of a printed candump are.

    Args:
        path: of the file, for messages.
        file: opened at its beginning; is left there.

    Returns:
        `time` or `delta`; `""` for a log of candump -l.

    Raises:
        InputError: the frames have no stamp, or what their stamps are is open.
    """
    stamps = []
    printed = False
    for _, line in zip(range(_SCANNED_LINES), file, strict=False):
        text = line.decode("ascii", "replace").rstrip()
        if _CANDUMP.fullmatch(text):
            break
        match = _CONSOLE.fullmatch(text)
        if match is None:
            continue
        printed = True
        if match["stamp"]:
            stamps.append(_seconds(match["stamp"]))
    file.seek(0)
    if not printed:
        return ""
    if not stamps:
        raise InputError(
            f"{path}: the frames have no time stamp: record with candump -l (or -ta)"
        )
    times = np.array(stamps)
    if np.nanmin(times) >= _ABSOLUTE_FROM:
        return "time"
    steps = np.diff(times)
    falling = float(np.mean(steps < 0.0)) if len(steps) else 0.0
    if len(times) >= _FEWEST_LINES and falling == 0.0 and times[-1] > times[0]:
        return "time"
    if len(times) >= _FEWEST_LINES and falling > _FALLING_OF_DELTAS:
        return "delta"
    raise InputError(
        f"{path}: the stamps, from {times[0]:g} to {times[-1]:g} s, may be times (candump "
        "-tz) or differences (-td): record with candump -l (or -ta)"
    )


_FALLING_OF_DELTAS = 0.1
"""Share of stamps below the one before from which they are differences: of times without a
pattern it is one half, of steady ones less."""


def _seconds(stamp: str) -> float:
    """Return a stamp of a printed candump [s]; NaN for what is none."""
    try:
        if "-" in stamp:
            # Local time of an unknown zone: only differences count.
            return datetime.fromisoformat(stamp.strip() + "+00:00").timestamp()
        return float(stamp)
    except ValueError:
        return math.nan


def _console(
    file: Any, are_differences: bool, remarks: Remarks
) -> Generator[Frames, None, None]:
    """Read what candump prints with a stamp in front of each frame.

    Args:
        file: opened at its beginning.
        are_differences: whether each stamp counts from the frame before.
        remarks: where lines that are left out are counted.
    """
    batch = _Batch()
    last = math.nan
    now = 0.0
    if are_differences:
        remarks.add("file", "stamps are differences (candump -td), added up", count=0)
    for line in file:
        text = line.decode("ascii", "replace")
        match = _CONSOLE.fullmatch(text.rstrip())
        stamp = math.nan
        if match is not None and match["stamp"]:
            stamp = _seconds(match["stamp"])
        if match is None or math.isnan(stamp):
            if text.endswith("\n"):
                _count_line(text, last, remarks)
            else:
                remarks.add("file", _CUT_OFF, last, 0)
            continue
        now += stamp
        last = now if are_differences else stamp
        data = bytes.fromhex(match["data"])
        if len(data) != int(match["length"]) or len(data) > BYTES:
            remarks.add("file", "remote, FD or damaged frames left out", last)
            continue
        identifier = match["identifier"]
        number = int(identifier, 16)
        if len(identifier) == 8 and number & _ERROR_FLAG:
            remarks.add("bus", "error frames", last)
            continue
        batch.add(last, number, len(identifier) == 8, data, match["bus"])
        if len(batch) >= BATCH:
            yield batch.frames()
            batch = _Batch()
    if len(batch):
        yield batch.frames()
