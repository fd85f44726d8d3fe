# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A signal in the data of CAN frames: bits, scale, codes for "no value", all frames at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import Array

from .series import Remarks, Series

BYTES = 8
"""Data bytes of a frame that are read; signals behind them (CAN FD) are not."""

BUS_NAME = 16
"""Letters of the name of a bus that are kept; Linux allows 15 for an interface."""

_NOT_AVAILABLE = {2: 3, 4: 15, 8: 0xFF, 16: 0xFF00, 32: 0xFF000000}
"""Raw value from which on a signal of J1939 is not available, by its bits (J1939-71, table 1)."""
_ERROR = {2: 2, 4: 14, 8: 0xFE, 16: 0xFE00, 32: 0xFE000000}
"""The same for an error of the sensor."""
_RESERVED = {8: 0xFB, 16: 0xFB00, 32: 0xFB000000}
"""The same for reserved codes; the largest valid value stands below."""


class Frames(NamedTuple):
    """CAN frames with data.

    Attributes:
        time: [s], shape (n,).
        identifier: 11 or 29 bits, shape (n,).
        extended: whether it has 29 bits, shape (n,).
        length: of the data [bytes], shape (n,).
        data: bytes, 0 behind the length, shape (n, 8).
        bus: name or number of the bus, `""` where the file states none; shape (n,).
    """

    time: Array
    identifier: NDArray[np.uint32]
    extended: NDArray[np.bool_]
    length: NDArray[np.uint8]
    data: NDArray[np.uint8]
    bus: NDArray[np.str_]

    def select(self, index: Any) -> Frames:
        """Return some of the frames."""
        return Frames(*(column[index] for column in self))

    @property
    def group(self) -> NDArray[np.uint32]:
        """Parameter group numbers of J1939, shape (n,); without meaning for 11 bits."""
        return group_number(self.identifier)

    @property
    def source(self) -> NDArray[np.uint32]:
        """Source addresses of J1939, shape (n,)."""
        return self.identifier & np.uint32(0xFF)


def group_number(identifier: Any) -> Any:
    """Return the parameter group number of 29-bit identifiers (J1939-21, 5.2).

    The lower byte is a destination where the format is below 240, and no part of the number then.
    """
    group = (identifier >> 8) & 0x3FFFF
    to_one = ((group >> 8) & 0xFF) < 240
    return np.where(to_one, group & 0x3FF00, group)


@dataclass(frozen=True)
class Signal:
    """Where a signal stands in the data of a frame, and what its bits mean.

    Attributes:
        name: of the channel.
        unit: of its values.
        start: least significant bit (Intel), or most significant one (Motorola), as in a DBC.
        bits: count of bits.
        scale, offset: value = scale * raw + offset.
        low, high: valid values, in `unit`; infinite where they are not stated.
        is_intel: byte order.
        is_signed: two's complement.
        is_float: IEEE 754, of 32 or 64 bits.
        has_codes: whether the codes of J1939 for "not available" and "error" apply.
        states: text by raw value; empty for a number.
        quantity: what it is by a public standard.
        switch: signal and raw values that select it in a multiplexed frame.
    """

    name: str
    unit: str
    start: int
    bits: int
    scale: float = 1.0
    offset: float = 0.0
    low: float = -np.inf
    high: float = np.inf
    is_intel: bool = True
    is_signed: bool = False
    is_float: bool = False
    has_codes: bool = True
    states: Mapping[int, str] | None = None
    quantity: str = ""
    switch: tuple[Signal, frozenset[int]] | None = None

    @property
    def last_byte(self) -> int:
        """Count of data bytes that the signal needs."""
        if self.is_intel:
            return (self.start + self.bits - 1) // 8 + 1
        first = 8 * (self.start // 8) + 7 - self.start % 8
        return (first + self.bits - 1) // 8 + 1

    def read(self, frames: Frames, remarks: Remarks) -> Series:
        """Return the values in frames of its message.

        Args:
            frames: of this message alone.
            remarks: where readings without a value are counted.
        """
        if self.switch is not None:
            selector, wanted = self.switch
            chosen = np.isin(selector.raw(frames), list(wanted))
            frames = frames.select(np.flatnonzero(chosen))
        time = frames.time
        usable = frames.length >= self.last_byte
        remarks.add_readings(self.name, "frames too short for it", time, ~usable)
        raw = self.raw(frames)
        if self.has_codes:
            usable = usable & self._has_value(raw, time, remarks)
        if self.states is not None:
            return Series(time[usable], self._texts(raw[usable]))
        values = self.scale * self._number(raw) + self.offset
        with np.errstate(invalid="ignore"):
            inside = (values >= self.low) & (values <= self.high)
        reason = f"readings outside {self.low:g} to {self.high:g} {self.unit} left out"
        remarks.add_readings(self.name, reason, time, usable & ~inside)
        remarks.note_range(self.name, time[usable], ~inside[usable])
        usable = usable & inside
        return Series(time[usable], values[usable])

    def raw(self, frames: Frames) -> NDArray[np.uint64]:
        """Return the bits as whole numbers, shape (n,)."""
        data = np.ascontiguousarray(frames.data)
        if self.is_intel:
            words = data.view("<u8").ravel()
            shift = self.start
        else:
            words = data.view(">u8").ravel().astype(np.uint64)
            first = 8 * (self.start // 8) + 7 - self.start % 8
            shift = 64 - first - self.bits
        mask = np.uint64((1 << self.bits) - 1)
        return np.asarray((words >> np.uint64(shift)) & mask)

    def _has_value(
        self, raw: NDArray[np.uint64], time: Array, remarks: Remarks
    ) -> NDArray[np.bool_]:
        """Whether raw values are no codes of J1939 for "no value", shape (n,)."""
        if self.bits not in _ERROR or self.is_signed or self.is_float:
            return np.ones(len(raw), dtype=bool)
        missing = raw >= _NOT_AVAILABLE[self.bits]
        error = (raw >= _ERROR[self.bits]) & ~missing
        reserved = np.zeros(len(raw), dtype=bool)
        if self.bits in _RESERVED:
            reserved = (raw >= _RESERVED[self.bits]) & ~missing & ~error
        remarks.add_readings(self.name, "readings 'not available'", time, missing)
        remarks.add_readings(self.name, "readings 'error'", time, error)
        remarks.add_readings(self.name, "readings of a reserved code", time, reserved)
        return np.asarray(~(missing | error | reserved))

    def _number(self, raw: NDArray[np.uint64]) -> Array:
        if self.is_float:
            if self.bits == 32:
                return raw.astype(np.uint32).view(np.float32).astype(float)
            return raw.astype(np.uint64).view(float)
        if self.is_signed:
            negative = raw >= (1 << (self.bits - 1))
            return np.where(negative, raw.astype(float) - 2.0**self.bits, raw)
        return raw.astype(float)

    def _texts(self, raw: NDArray[np.uint64]) -> NDArray[np.str_]:
        """Return the texts of states; the number itself where the table names none."""
        states = self.states or {}
        codes, index = np.unique(raw, return_inverse=True)
        names = [states.get(int(code), str(int(code))) for code in codes]
        return np.array(names, dtype=str)[index] if names else np.empty(0, dtype=str)
