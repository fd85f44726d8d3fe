# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""MDF files (INCA, CANape, CANoe, CANedge) by asammdf: measured channels, or frames of a bus."""

from __future__ import annotations

import logging
import math
import traceback
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.errors import InputError, in_one_line

from .can_files import BATCH
from .grouped import GroupedLog, InGroup
from .series import Channel, Remarks, Series, in_windows, listed_names
from .signals import BUS_NAME, BYTES, Frames

SUFFIXES = (".mf4", ".mdf", ".dat")
STARTS = (b"MDF ", b"UnFinMF ")
"""First bytes of an MDF file, closed or not."""
_FRAMES = "CAN_DataFrame"
"""Channel of a bus log (ASAM MDF 4, bus logging)."""
_ERRORS = "CAN_ErrorFrame"


def open_mdf(path: Path) -> Any:
    """Open an MDF file.

    Raises:
        InputError: it cannot be read, or asammdf is not installed.
    """
    try:
        import asammdf
    except ImportError:
        raise InputError(
            f'{path}: an MDF file needs asammdf: pip install "hmcvt_ros[mdf]"'
        ) from None
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    with path.open("rb") as file:
        if not file.read(8).startswith(STARTS):
            raise InputError(f"{path}: no MDF file: it does not begin as one does")
    try:
        return asammdf.MDF(path)
    except Exception as error:  # asammdf raises errors of many kinds for damage
        _release(error)
        words = in_one_line(error)
        raise InputError(
            f"{path}: no MDF file that asammdf can read ({words}); a file that was not "
            "closed may be repaired by the tool that wrote it"
        ) from None


def _release(error: Exception) -> None:
    """Let an object of asammdf that was not opened be deleted without a message on stderr."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        half_open: Any = frame.f_locals.get("self")
        if type(half_open).__name__ != "MDF4":
            continue
        for name in ("_file", "_tempfile"):
            file = getattr(half_open, name, None)
            if file is not None:
                file.close()
        half_open._closed = True


def holds_frames(mdf: Any) -> bool:
    """Whether an MDF file holds CAN frames."""
    return any(True for _ in _groups_with(mdf, _FRAMES))


def _groups_with(mdf: Any, name: str) -> Iterator[int]:
    """Yield the groups with readings of a channel."""
    for number, group in enumerate(mdf.groups):
        if not group.channel_group.cycles_nr:
            continue
        if any(channel.name == name for channel in group.channels):
            yield number


def frames_of(mdf: Any, remarks: Remarks) -> Iterator[tuple[Frames, float]]:
    """Yield batches of frames of an MDF file, each with the part of the file that was read."""
    for number in _groups_with(mdf, _ERRORS):
        count = mdf.groups[number].channel_group.cycles_nr
        time = mdf.get(f"{_ERRORS}.BusChannel", group=number, raw=True).timestamps
        first = float(time[0]) if len(time) else math.nan
        remarks.add("bus", "error frames", first, int(count))
    numbers = list(_groups_with(mdf, _FRAMES))
    total = sum(mdf.groups[number].channel_group.cycles_nr for number in numbers)
    if len(numbers) == 1:
        done = 0
        for frames in _group_frames(mdf, numbers[0]):
            done += len(frames.time)
            yield frames, done / total
        return
    # Several groups of frames (one for each kind, or each bus): merged in time.
    streams = {str(number): _group_frames(mdf, number) for number in numbers}
    done = 0
    for frames in _merged(streams):
        done += len(frames.time)
        yield frames, done / total


def _merged(streams: Mapping[str, Iterator[Frames]]) -> Iterator[Frames]:
    rows: dict[str, Iterator[Series]] = {}
    for name, stream in streams.items():
        rows[name] = (Series(frames.time, _packed(frames)) for frames in stream)
    for piece in in_windows(rows):
        parts = [_unpacked(series) for series in piece.values()]
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        merged = Frames(*columns)
        yield merged.select(np.argsort(merged.time, kind="stable"))


_PACKED = [
    ("identifier", "<u4"),
    ("extended", "?"),
    ("length", "u1"),
    ("data", "u1", (BYTES,)),
    ("bus", f"U{BUS_NAME}"),
]


def _packed(frames: Frames) -> Any:
    """Return frames without their times as one array of records."""
    packed = np.empty(len(frames.time), dtype=_PACKED)
    packed["identifier"] = frames.identifier
    packed["extended"] = frames.extended
    packed["length"] = frames.length
    packed["data"] = frames.data
    packed["bus"] = frames.bus
    return packed


def _unpacked(series: Series) -> Frames:
    packed = series.values
    return Frames(
        series.time,
        packed["identifier"],
        packed["extended"],
        packed["length"],
        packed["data"],
        packed["bus"],
    )


def _group_frames(mdf: Any, group: int) -> Iterator[Frames]:
    count = mdf.groups[group].channel_group.cycles_nr
    names = {channel.name for channel in mdf.groups[group].channels}
    for offset in range(0, count, BATCH):

        def column(name: str, offset: int = offset) -> Any:
            return mdf.get(
                f"{_FRAMES}.{name}",
                group=group,
                raw=True,
                record_offset=offset,
                record_count=min(BATCH, count - offset),
                ignore_invalidation_bits=True,
            )

        identifier = column("ID")
        raw = identifier.samples.astype(np.uint32)
        number = raw & np.uint32(0x1FFFFFFF)
        extended = number > 0x7FF
        if f"{_FRAMES}.IDE" in names:
            extended = column("IDE").samples.astype(bool)
        length_name = "DataLength"
        if f"{_FRAMES}.DataLength" not in names:
            length_name = "DLC"
        length = column(length_name).samples
        bus = np.zeros(len(raw), dtype=int)
        if f"{_FRAMES}.BusChannel" in names:
            bus = column("BusChannel").samples
        data = _eight_bytes(column("DataBytes").samples)
        yield Frames(
            identifier.timestamps.astype(float),
            number,
            extended,
            np.minimum(length, 64).astype(np.uint8),
            data,
            bus.astype(str).astype(f"U{BUS_NAME}"),
        )


def _eight_bytes(data: Any) -> Any:
    """Return the first eight data bytes of frames, shape (n, 8)."""
    array = np.asarray(data)
    if array.ndim == 1:  # of variable length
        rows = [bytes(row)[:BYTES].ljust(BYTES, b"\0") for row in array]
        return np.frombuffer(b"".join(rows), dtype=np.uint8).reshape(-1, BYTES)
    eight = np.zeros((len(array), BYTES), dtype=np.uint8)
    width = min(BYTES, array.shape[1])
    eight[:, :width] = array[:, :width]
    return eight


class MdfLog(GroupedLog):
    """The measured channels of an MDF file.

    Args:
        path: of the file.
        mdf: the open file.
    """

    def __init__(self, path: Path, mdf: Any) -> None:
        super().__init__(path)
        self._mdf = mdf

    @cached_property
    def _listed(self) -> list[InGroup]:
        """Channels with a time, with group and index of each."""
        names = self._group_names
        listed = []
        for number, group in enumerate(self._mdf.groups):
            master = self._mdf.masters_db.get(number)
            if not group.channel_group.cycles_nr:
                continue
            if master is None:
                without = listed_names([channel.name for channel in group.channels])
                self.remarks.add(
                    "file", f"channels without a time left out: {without}", count=0
                )
                continue
            for index, channel in enumerate(group.channels):
                if index != master:
                    key = f"{channel.name}@{number}"
                    position = (number, index)
                    listed.append(InGroup(channel.name, names[number], key, position))
        return listed

    @cached_property
    def _group_names(self) -> list[str]:
        """Name of each group: that of its source where it is unique, else its number."""
        names = []
        for group in self._mdf.groups:
            stated = getattr(group.channel_group, "acq_name", "") or ""
            names.append(str(stated).strip())
        unique = []
        for number, name in enumerate(names):
            unique.append(name if name and names.count(name) == 1 else str(number))
        return unique

    @cached_property
    def channels(self) -> Mapping[str, Channel]:
        """Channels by name."""
        channels = {}
        for name, channel in self._read_channels.items():
            number, index = channel.item
            block = self._mdf.groups[number].channels[index]
            channels[name] = Channel(name, _unit_of(block))
        return channels

    def close(self) -> None:
        """Close the file."""
        self._mdf.close()

    def _count(self, channel: InGroup) -> int:
        number, _ = channel.item
        return int(self._mdf.groups[number].channel_group.cycles_nr)

    def _readings(self, channel: InGroup, offset: int, count: int) -> Series | None:
        """Return readings of a channel; None for arrays and structures.

        What asammdf returns are views of the records of all channels: only copies leave.
        """
        group, index = channel.item
        signal = self._mdf.get(
            group=group, index=index, record_offset=offset, record_count=count
        )
        values = _values(signal.samples)
        if values is None:
            return None
        return Series(np.array(signal.timestamps, dtype=float), values)


def _values(samples: Any) -> Any:
    """Return samples as numbers or texts; None for arrays and structures."""
    array = np.asarray(samples)
    if array.ndim != 1 or array.dtype.names:
        return None
    if array.dtype.kind in "biuf":
        return array.astype(float)
    if array.dtype.kind == "S":
        return np.char.decode(array, "utf-8", "replace")
    return array.astype(str)


def _unit_of(channel: Any) -> str:
    """Return the unit of a channel; its conversion may hold it instead."""
    unit = str(getattr(channel, "unit", "") or "")
    if not unit:
        unit = str(getattr(getattr(channel, "conversion", None), "unit", "") or "")
    return unit.strip()
