# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Logs whose channels stand in groups or runs that may hold channels of one name (MDF, TDMS)."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from hmcvt_core.errors import in_one_line

from .series import (
    Log,
    Remarks,
    Series,
    in_windows,
    listed_names,
    piece_readings,
    rising,
)


class InGroup(NamedTuple):
    """A channel of a file whose groups may hold channels of one name.

    Attributes:
        name: as the file writes it.
        group: that holds it.
        key: name that is unique in the file.
        item: what the reader needs of it.
    """

    name: str
    group: str
    key: str
    item: Any


class GroupedLog(Log):
    """A log whose channels are read one by one, in parts.

    Args:
        path: of the file.
    """

    _by_group = ("channels", "_read_channels")

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._read = 0
        self._total = 1

    @property
    @abstractmethod
    def _listed(self) -> Sequence[InGroup]:
        """All channels of the file that have a time."""

    @abstractmethod
    def _count(self, channel: InGroup) -> int:
        """Return how many readings a channel has."""

    @abstractmethod
    def _readings(self, channel: InGroup, offset: int, count: int) -> Series | None:
        """Return readings of a channel; None for what holds no single values.

        Args:
            channel: of the file.
            offset: number of the first reading.
            count: of the readings.
        """

    @cached_property
    def _read_channels(self) -> dict[str, InGroup]:
        """Channels by name, of the group that is chosen where several hold the same."""
        return _of_group(self._listed, self.group, self.remarks)

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of channels."""
        return tuple(dict.fromkeys(channel.group for channel in self._listed))

    def groups_of(self, name: str) -> tuple[str, ...]:
        """Return the groups that hold a channel, of which none is chosen."""
        channel = self._read_channels[name]
        if channel.group == self.group:
            return ()
        groups = [other.group for other in self._listed if other.name == channel.name]
        if len(groups) < 2:
            return ()
        return tuple(dict.fromkeys(groups))

    def pieces(self, names: Collection[str]) -> Iterator[dict[str, Series]]:
        """Yield the readings of channels in pieces, see `Log`."""
        self._read = 0
        self._total = 1
        size = piece_readings(len(names))
        streams = {}
        for name in names:
            self.channel(name)
            self._total += self._count(self._read_channels[name])
            streams[name] = self._stream(name, size)
        yield from in_windows(streams)

    def progress_of(self) -> float:
        """Return the part of the readings that was read."""
        return min(self._read / self._total, 1.0)

    def _stream(self, name: str, size: int) -> Iterator[Series]:
        channel = self._read_channels[name]
        total = self._count(channel)
        last = -math.inf
        for offset in range(0, total, size):
            count = min(size, total - offset)
            try:
                series = self._readings(channel, offset, count)
            except Exception as error:  # the libraries raise many kinds for damage
                words = in_one_line(error)
                reason = f"cut off or damaged ({words}); what is before is used"
                self.remarks.add(name, reason, last, 0)
                return
            self._read += count
            if series is None:
                return
            series = rising(series, last, self.remarks, name)
            if len(series.time):
                last = float(series.time[-1])
                yield series


def _of_group(
    listed: Sequence[InGroup], group: str, remarks: Remarks
) -> dict[str, InGroup]:
    """Return channels by the name under which they are read.

    Args:
        listed: all channels of the file.
        group: whose channels are read where several groups hold the same; `""` for none chosen.
        remarks: where the groups that are left out are named.
    """
    counts = Counter(channel.name for channel in listed)
    chosen = {channel.name for channel in listed if channel.group == group}
    read = {}
    left_out: dict[str, None] = {}
    for channel in listed:
        if counts[channel.name] == 1:
            read[channel.name] = channel
        elif channel.name not in chosen:
            read[channel.key] = channel
        elif channel.group == group:
            read[channel.name] = channel
        else:
            left_out[channel.group] = None
    if left_out:
        names = listed_names([repr(name) for name in left_out])
        remarks.add(
            "file", f"channels of the same name left out: group {names}", count=0
        )
    return read
