# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""TDMS files of LabVIEW by npTDMS."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hmcvt_core.errors import InputError, in_one_line
from hmcvt_core.transmission.ranges import Array

from ..tables.rules import meaning_of
from ..tables.units import to_si
from .grouped import GroupedLog, InGroup
from .series import Channel, Series

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
        words = in_one_line(error)
        raise InputError(f"{path}: no TDMS file that can be read ({words})") from None


class TdmsLog(GroupedLog):
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

    def clock_problem(self, names: Collection[str]) -> str:
        """Return why channels have no common time: some state when they begin, others do not."""
        dated = []
        undated = []
        for name in names:
            channel = self._read_channels[name].item
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
        for name, channel in self._read_channels.items():
            if self._clock_of(channel.item) is not None:
                channels[name] = Channel(name, _unit_of(channel.item))
        if not channels:
            raise InputError(
                f"{self.path}: no channel has a time: neither wf_increment nor a channel "
                "of times in its group"
            )
        return channels

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._content.close()

    def _count(self, channel: InGroup) -> int:
        return len(channel.item)

    def _readings(self, channel: InGroup, offset: int, count: int) -> Series | None:
        """Return readings of a channel."""
        item = channel.item
        values = np.asarray(item.read_data(offset=offset, length=count))
        time = self._times(item, self._clock_of(item), offset, count)
        is_number = values.dtype.kind in "biuf"
        return Series(time, values.astype(float if is_number else str))

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
