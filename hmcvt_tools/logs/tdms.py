# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""TDMS files of LabVIEW by npTDMS."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from ..tables.rules import meaning_of
from ..tables.units import to_si
from .series import (
    Channel,
    InGroup,
    Log,
    Series,
    groups_with,
    in_windows,
    of_group,
    piece_readings,
    rising,
)

SUFFIXES = (".tdms",)
_START = b"TDSm"
_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units")
"""Properties in which programs write the unit, the first one as LabVIEW does."""


def open_tdms(path: Path) -> TdmsLog:
    """Open a TDMS file.

    Raises:
        InputError: it cannot be read, or npTDMS is not installed.
    """
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        raise InputError(
            f'{path}: a TDMS file needs npTDMS: pip install "hmcvt_ros[tdms]"'
        ) from None
    # What it warns of is in its `file_status`.
    log_manager.set_level(logging.ERROR)
    content = path.open("rb")  # closed here or by the log: npTDMS leaves it open
    try:
        if content.read(len(_START)) != _START:
            raise InputError(f"{path}: no TDMS file: it does not begin as one does")
        content.seek(0)
        file = TdmsFile.open(content)
        log = TdmsLog(path, file, content)
        if file.file_status.incomplete_final_segment:
            log.remarks.add("file", "cut off; what is before is used", count=0)
        return log
    except InputError:
        content.close()
        raise
    except Exception as error:  # npTDMS raises errors of many kinds for damage
        content.close()
        words = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: no TDMS file that can be read ({words})") from None


class TdmsLog(Log):
    """The channels of a TDMS file.

    Their time is that of the waveform (`wf_start_time`, `wf_start_offset`, `wf_increment`), else
    the channel of the same group and length that names a time.

    Args:
        path: of the file.
        file: the open file.
        content: its bytes, to be closed behind it.
    """

    def __init__(self, path: Path, file: Any, content: BinaryIO) -> None:
        super().__init__(path)
        self._file = file
        self._content = content
        self._read = 0
        self._total = 1

    _by_group = ("channels", "_objects", "_read_channels")

    @cached_property
    def _listed(self) -> list[InGroup]:
        """Channels of npTDMS with readings."""
        listed = []
        for group in self._file.groups():
            for channel in group.channels():
                if len(channel):
                    key = f"{channel.group_name}.{channel.name}"
                    listed.append(
                        InGroup(channel.name, channel.group_name, key, channel)
                    )
        return listed

    @cached_property
    def _read_channels(self) -> dict[str, InGroup]:
        """Channels by name, of the group that is chosen where several hold the same."""
        return of_group(self._listed, self.group, self.remarks)

    @cached_property
    def _objects(self) -> dict[str, Any]:
        """Channels of npTDMS by name."""
        return {name: channel.item for name, channel in self._read_channels.items()}

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of channels."""
        return tuple(dict.fromkeys(channel.group for channel in self._listed))

    def groups_of(self, name: str) -> tuple[str, ...]:
        """Return the groups that hold a channel, of which none is chosen."""
        channel = self._read_channels[name]
        if channel.group == self.group:
            return ()
        return groups_with(self._listed, channel)

    def clock_problem(self, names: Collection[str]) -> str:
        """Return why channels have no common time: some state when they begin, others do not."""
        dated = []
        undated = []
        for name in names:
            channel = self._objects[name]
            if _start_of(channel, self._clock_of(channel)) is None:
                undated.append(name)
            else:
                dated.append(name)
        if not dated or not undated:
            return ""
        return (
            f"channels {', '.join(map(repr, dated))} state a date at which they begin "
            f"(wf_start_time), {', '.join(map(repr, undated))} none, so that they have no "
            "common time: write it in all channels, or in none"
        )

    @cached_property
    def _first_start(self) -> np.datetime64 | None:
        """Earliest start of all channels; None where none states one."""
        starts = []
        for channel in self._listed:
            start = _start_of(channel.item, self._clock_of(channel.item))
            if start is not None:
                starts.append(start)
        return min(starts, default=None)

    @cached_property
    def channels(self) -> Mapping[str, Channel]:
        """Channels by name; without those of time."""
        channels = {}
        for name, channel in self._objects.items():
            if self._clock_of(channel) is not None:
                channels[name] = Channel(name, _unit_of(channel))
        if not channels:
            raise InputError(
                f"{self.path}: no channel has a time: neither wf_increment nor a channel "
                "of times in its group"
            )
        return channels

    def pieces(self, names: Collection[str]) -> Iterator[dict[str, Series]]:
        """Yield the readings of channels in pieces, see `Log`."""
        self._read = 0
        self._total = 1
        size = piece_readings(len(names))
        streams = {}
        for name in names:
            self.channel(name)
            self._total += len(self._objects[name])
            streams[name] = self._stream(name, size)
        yield from in_windows(streams)

    def progress_of(self) -> float:
        """Return the part of the readings that was read."""
        return min(self._read / self._total, 1.0)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._content.close()

    def _stream(self, name: str, size: int) -> Iterator[Series]:
        channel = self._objects[name]
        clock = self._clock_of(channel)
        last = -math.inf
        for offset in range(0, len(channel), size):
            count = min(size, len(channel) - offset)
            try:
                values = np.asarray(channel.read_data(offset=offset, length=count))
                time = self._times(channel, clock, offset, count)
            except Exception as error:  # of a damaged segment, of many kinds
                words = " ".join(str(error).split()) or type(error).__name__
                self.remarks.add(
                    name,
                    f"cut off or damaged ({words}); what is before is used",
                    last,
                    0,
                )
                return
            self._read += count
            is_number = values.dtype.kind in "biuf"
            values = values.astype(float if is_number else str)
            series = rising(Series(time, values), last, self.remarks, name)
            if len(series.time):
                last = float(series.time[-1])
                yield series

    def _times(self, channel: Any, clock: Any, offset: int, count: int) -> Array:
        """Return times [s], since the earliest start of the file where channels state theirs."""
        time = _times(channel, clock, offset, count)
        start = _start_of(channel, clock)
        if start is None or self._first_start is None:
            return time
        late = (start - self._first_start) / np.timedelta64(1, "us") * 1e-6
        return time + late

    def _clock_of(self, channel: Any) -> Any:
        """Return step of the waveform [s], or the channel of times; None without both."""
        step = channel.properties.get("wf_increment")
        if isinstance(step, (int, float)) and step > 0.0:
            return float(step)
        for other in self._file[channel.group_name].channels():
            if other is channel or len(other) != len(channel):
                continue
            if other.data_type is not None and _names_time(other):
                return other
        return None


def _names_time(channel: Any) -> bool:
    """Whether a channel holds times: it has the type of a date, or the name of a time."""
    if channel.dtype.kind == "M":
        return True
    return meaning_of(channel.name, _unit_of(channel)).quantity == "stamp"


_UNSET = np.datetime64("1970-01-01", "us")
"""LabVIEW writes 1904 for a start that is not set."""


def _start_of(channel: Any, clock: Any) -> np.datetime64 | None:
    """Return when a channel begins; None where the file does not say.

    Args:
        channel: of npTDMS.
        clock: step of its waveform [s], or its channel of times.
    """
    if isinstance(clock, float):
        start = channel.properties.get("wf_start_time")
    elif clock is not None and clock.dtype.kind == "M":
        start = np.asarray(clock.read_data(offset=0, length=1))[0]
    else:
        return None
    try:
        date = np.datetime64(start, "us")
    except (TypeError, ValueError):
        return None
    if np.isnat(date) or date <= _UNSET:
        return None
    return date


def _times(channel: Any, clock: Any, offset: int, count: int) -> Array:
    """Return the times of readings offset to offset + count - 1 [s].

    They count from `wf_start_time`, or as the channel of times does.
    """
    if isinstance(clock, float):
        start = float(channel.properties.get("wf_start_offset") or 0.0)
        return start + clock * np.arange(offset, offset + count, dtype=float)
    values = np.asarray(clock.read_data(offset=offset, length=count))
    if values.dtype.kind == "M":
        first = np.asarray(clock.read_data(offset=0, length=1))[0]
        since = values.astype("datetime64[us]") - first.astype("datetime64[us]")
        return since.astype(float) * 1e-6
    unit = meaning_of(clock.name, _unit_of(clock)).unit
    size = 1.0
    if unit is not None and unit.kind == "time":
        size = to_si("time", unit.name)[0]
    return size * values.astype(float)


def _unit_of(channel: Any) -> str:
    for name in _UNITS:
        unit = channel.properties.get(name)
        if unit:
            return str(unit).strip()
    return ""
