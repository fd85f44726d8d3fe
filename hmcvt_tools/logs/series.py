# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Signals of a log, in pieces of limited size, and remarks on what could not be used."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from ..steady import stray_stamps

_HELD_READINGS = 2_000_000
"""Readings of all channels that are held at a time; 32 MB of times and numbers."""
_LARGEST_PIECE = 250_000
_SMALLEST_PIECE = 10_000

FEWEST_READINGS = 20
"""Readings from which a share of them says something of a channel."""

Report = Callable[[str], None]


class Series(NamedTuple):
    """Readings of one channel.

    Attributes:
        time: [s], rising, shape (n,).
        values: numbers, or texts for a channel of states; shape (n,).
    """

    time: Array
    values: Any

    def between(self, first: int, last: int) -> Series:
        """Return the readings first to last - 1."""
        return Series(self.time[first:last], self.values[first:last])

    def thinned(self, step: float) -> Series:
        """Return every n-th reading, not more often than every step [s] on average."""
        if len(self.time) < 2:
            return self
        usual = float(self.time[-1] - self.time[0]) / (len(self.time) - 1)
        stride = max(1, int(step / usual))
        return Series(self.time[::stride].copy(), self.values[::stride].copy())


def piece_readings(channels: int) -> int:
    """Return how many readings of each channel are held at a time.

    Args:
        channels: how many are read side by side.
    """
    share = _HELD_READINGS // max(channels, 1)
    return min(max(share, _SMALLEST_PIECE), _LARGEST_PIECE)


def joined_series(parts: Sequence[Series]) -> Series:
    """Return several series one after the other."""
    if len(parts) == 1:
        return parts[0]
    times = np.concatenate([part.time for part in parts])
    return Series(times, np.concatenate([part.values for part in parts]))


@dataclass(frozen=True)
class Channel:
    """A channel of a log.

    Attributes:
        name: unique in the log.
        unit: as the file states it; empty where it states none.
        quantity: what the channel is by a public standard; empty where its name has to say it.
        resolution: step of its values, in `unit`; 0 where it is not known.
        low: least valid value that the file states, in `unit`; -inf where it states none.
    """

    name: str
    unit: str = ""
    quantity: str = ""
    resolution: float = 0.0
    low: float = -math.inf


@dataclass
class _Remark:
    """A remark: time of the first reading it concerns [s], and how many."""

    time: float
    count: int


@dataclass
class Remarks:
    """What could not be used, one line for each channel and reason.

    Attributes:
        entries: by channel and reason, in the order in which they arose.
    """

    entries: dict[tuple[str, str], _Remark] = field(default_factory=dict)
    _ranges: dict[str, tuple[int, int, float]] = field(default_factory=dict)

    def note_range(self, channel: str, time: Array, outside: Any) -> None:
        """Count readings outside the range that the file states, and all of the channel.

        Args:
            channel: name.
            time: of all readings [s], shape (n,).
            outside: which ones are outside, shape (n,).
        """
        bad, count, first = self._ranges.get(channel, (0, 0, math.nan))
        if outside.any() and not bad:
            first = float(time[int(np.argmax(outside))])
        total = (bad + int(outside.sum()), count + len(time), first)
        self._ranges[channel] = total

    def share_outside(self, channel: str) -> tuple[float, float]:
        """Return the share of readings outside the stated range, and the time of the first [s]."""
        bad, count, first = self._ranges.get(channel, (0, 0, math.nan))
        if count < FEWEST_READINGS:
            return 0.0, first
        return bad / count, first

    def add(
        self, channel: str, reason: str, time: float = math.nan, count: int = 1
    ) -> None:
        """Count readings that share a channel and a reason.

        Args:
            channel: name, or `bus` or `file`.
            reason: clause that goes behind the channel.
            time: of the first of these readings [s].
            count: of readings; 0 for what is not counted.
        """
        remark = self.entries.setdefault((channel, reason), _Remark(time, 0))
        remark.count += count

    def add_readings(self, channel: str, reason: str, time: Array, bad: Any) -> None:
        """Count the readings of a mask.

        Args:
            channel: name.
            reason: clause.
            time: of all readings [s], shape (n,).
            bad: which ones are concerned, shape (n,).
        """
        if bad.any():
            first = float(time[int(np.argmax(bad))])
            self.add(channel, reason, first, int(bad.sum()))

    @property
    def lines(self) -> list[str]:
        """One sentence for each remark."""
        lines = []
        for (channel, reason), remark in self.entries.items():
            since = ""
            if math.isfinite(remark.time):
                since = f" from {remark.time:.3f} s"
            count = ""
            if remark.count > 0:
                count = f"{remark.count} "
            lines.append(f"{channel}{since}: {count}{reason}")
        return lines


class Log(ABC):
    """A recording of a machine.

    Attributes:
        path: of the file.
        remarks: what could not be used so far.
        group: group, run or bus that is read where several hold the same channels; `""` for
            none chosen.
    """

    _by_group: ClassVar[tuple[str, ...]] = ("channels",)
    """Cached properties that depend on the group."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks = Remarks()
        self.group = ""

    @property
    @abstractmethod
    def channels(self) -> Mapping[str, Channel]:
        """Channels by name."""

    @abstractmethod
    def pieces(self, names: Collection[str]) -> Iterator[dict[str, Series]]:
        """Yield the readings of channels in pieces, one after the other in time.

        Args:
            names: channels wanted.

        Yields:
            The readings of one span of time by channel; a channel may be missing.
        """

    def progress_of(self) -> float:
        """Return the part of the file that was read, 0 to 1; 0 where it is not known."""
        return 0.0

    @property
    @abstractmethod
    def groups(self) -> tuple[str, ...]:
        """Groups, runs or buses of the file, in its order."""

    @abstractmethod
    def groups_of(self, name: str) -> tuple[str, ...]:
        """Return the groups that hold a channel, of which none is chosen; () for one alone."""

    def take_group(self, group: str) -> None:
        """Read the channels of one group where several hold the same.

        Args:
            group: one of `groups`; `""` takes none.

        Raises:
            InputError: there is no such group.
        """
        if group and group not in self.groups:
            raise InputError(
                f"{self.path}: group {group!r} is missing; there is "
                f"{listed_names(self.groups)}"
            )
        if group != self.group:
            for name in self._by_group:
                self.__dict__.pop(name, None)
        self.group = group

    def clock_problem(self, names: Collection[str]) -> str:
        """Return why channels have no common time; `""` where they have one."""
        return ""

    def missing_messages(self) -> list[str]:
        """Return the messages of a DBC that the log does not hold."""
        return []

    def close(self) -> None:  # noqa: B027 - a trace of CAN is open only while it is read
        """Close the file."""

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def channel(self, name: str) -> Channel:
        """Return a channel.

        Raises:
            InputError: there is none of this name.
        """
        if name not in self.channels:
            raise InputError(
                f"{self.path}: channel {name!r} is missing; there is "
                f"{listed_names(self.channels)}"
            )
        return self.channels[name]


_MAX_NAMES = 20


def listed_names(names: Collection[str]) -> str:
    """Return names as text, the first of many."""
    shown = ", ".join(list(names)[:_MAX_NAMES])
    if len(names) > _MAX_NAMES:
        shown += f" and {len(names) - _MAX_NAMES} more"
    return shown or "none"


def rising(series: Series, last: float, remarks: Remarks, channel: str) -> Series:
    """Return the readings whose time is finite and later than that of all before.

    Args:
        series: readings in the order of the file.
        last: latest time before them [s].
        remarks: where duplicates and steps back of the clock are counted.
        channel: name, for remarks.
    """
    time = series.time
    stray = stray_stamps(time)
    rest = np.where(stray, -np.inf, time)
    before = np.maximum.accumulate(np.append(last, rest))[:-1]
    with np.errstate(invalid="ignore"):
        later = (time > before) & ~stray
    if later.all():
        return series
    same = (time == before) & ~stray
    remarks.add_readings(channel, "readings at a repeated time left out", time, same)
    back = ~later & ~same
    remarks.add_readings(channel, "readings out of order left out", time, back)
    return Series(time[later], series.values[later])


def in_windows(
    streams: Mapping[str, Iterator[Series]],
) -> Iterator[dict[str, Series]]:
    """Merge streams of different rates into pieces that cover the same spans of time.

    The stream that is shortest in time ends the piece; of the others the rest is kept.
    """
    kept: dict[str, Series] = {}
    open_streams = dict(streams)
    while open_streams or kept:
        for name in list(open_streams):
            if name in kept:
                continue
            part = next(open_streams[name], None)
            if part is None:
                del open_streams[name]
            elif len(part.time):
                kept[name] = part
        if not kept:
            continue
        end = min(float(series.time[-1]) for series in kept.values())
        piece = {}
        for name, series in list(kept.items()):
            cut = int(np.searchsorted(series.time, end, side="right"))
            piece[name] = series.between(0, cut)
            if cut == len(series.time):
                del kept[name]
            else:
                kept[name] = series.between(cut, len(series.time))
        yield piece
