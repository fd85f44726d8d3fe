# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A CAN trace as a log: frames decoded by the public signals of J1939 and by a DBC."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError

from ..steady import stray_stamps
from . import j1939
from .dbc import Message
from .series import Channel, Log, Remarks, Series, rising
from .signals import Frames, Signal

FrameSource = Callable[[Remarks], Iterator[tuple[Frames, float]]]
"""Opens the file and yields batches of frames, each with the part that was read."""

_SCANNED = 400_000
"""Frames at the beginning that show which messages the bus carries."""
_NAMED = 3
"""Messages of a DBC that an error names."""
_SILENT = 1.0
"""A pause of the whole bus from here on is worth a remark [s]; EEC1 comes every 10 to 100 ms."""


class _Key(NamedTuple):
    """What selects the frames of a message.

    Attributes:
        group: parameter group number; None for an identifier that has to match.
        identifier: 11 or 29 bits, where `group` is None.
        is_extended: whether it has 29 bits.
        source: address that sends a message of a group; -1 for any.
    """

    group: int | None
    identifier: int
    is_extended: bool
    source: int = -1

    def mask(self, frames: Frames, groups: Any) -> Any:
        """Return which frames are of the message, shape (n,)."""
        if self.group is not None:
            of_group = frames.extended & (groups == self.group)
            if self.source >= 0:
                of_group &= frames.source == self.source
            return np.asarray(of_group)
        same = frames.identifier == self.identifier
        return np.asarray(same & (frames.extended == self.is_extended))


def _key_of(message: Message) -> _Key:
    """Return what selects the frames of a message of a DBC."""
    return _Key(message.group, message.identifier, message.is_extended, message.address)


class _Sender(NamedTuple):
    """The frames of a message and its source.

    Attributes:
        key: selects the frames.
        usual: source address that usually sends it; -1 for any.
        label: for remarks.
    """

    key: _Key
    usual: int
    label: str


class BusLog(Log):
    """The signals of a CAN trace.

    Args:
        path: of the file.
        source: opens the file.
        messages: of the DBC; empty without one.
        closing: closes the file, where it stays open between readings.
        dbc: name of the DBC.
    """

    def __init__(
        self,
        path: Path,
        source: FrameSource,
        messages: Sequence[Message] = (),
        closing: Callable[[], None] | None = None,
        dbc: str = "",
    ) -> None:
        super().__init__(path)
        self._dbc = dbc
        self._closing = closing
        self._source = source
        self._messages = messages
        self._part = 0.0

    @cached_property
    def _signals(self) -> dict[str, tuple[_Sender, Signal]]:
        """All signals that are known, by name."""
        known: dict[str, tuple[_Sender, Signal]] = {}
        for number, group in j1939.GROUPS.items():
            sender = _Sender(_Key(number, 0, True), group.source, group.label)
            for signal in group.signals:
                known[signal.name] = (sender, signal)
        for message in self._messages:
            sender = _Sender(_key_of(message), -1, message.name)
            for signal in message.signals:
                known[signal.name] = (sender, signal)
        return known

    _by_group = ("channels", "_senders")

    @cached_property
    def _counted(self) -> dict[_Key, dict[str, Counter[int]]]:
        """Frames of each message by bus and source address."""
        sources: dict[_Key, dict[str, Counter[int]]] = {}
        senders = {sender.key: sender for sender, _ in self._signals.values()}
        scanned = 0
        frames_seen = False
        for frames, _ in self._source(Remarks()):
            frames_seen = frames_seen or len(frames.time) > 0
            groups = frames.group
            for key in senders:
                mask = key.mask(frames, groups)
                for bus in np.unique(frames.bus[mask]).tolist():
                    rows = np.flatnonzero(mask & (frames.bus == bus))
                    addresses = frames.source[rows].tolist()
                    buses = sources.setdefault(key, {})
                    buses.setdefault(bus, Counter()).update(addresses)
            scanned += len(frames.time)
            if scanned >= _SCANNED:
                break
        if not frames_seen:
            raise InputError(f"{self.path}: holds no CAN frame")
        self._require_known_message(sources)
        return sources

    def _require_known_message(self, counted: Collection[_Key]) -> None:
        """Refuse a bus of which no message is known, and a DBC of another machine.

        Args:
            counted: messages that the bus carries.

        Raises:
            InputError: no message of J1939 or of the DBC is on the bus.
        """
        if not self._messages:
            if not counted:
                raise InputError(
                    f"{self.path}: no message of its frames is one of J1939 that hmcvt "
                    "reads: add the signals of the bus by --dbc FILE"
                )
            return
        if any(_key_of(item) in counted for item in self._messages):
            return
        names = ", ".join(item.name for item in self._messages[:_NAMED])
        more = ", ..." if len(self._messages) > _NAMED else ""
        raise InputError(
            f"{self.path}: no message of {self._dbc or 'the DBC'} is on the bus ({names}{more}): "
            "is it that of this machine?"
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """Buses that carry known messages."""
        buses = {bus for counts in self._counted.values() for bus in counts}
        return tuple(sorted(buses))

    def groups_of(self, name: str) -> tuple[str, ...]:
        """Return the buses that carry a channel, of which none is chosen."""
        if name not in self._signals:
            return ()
        buses = self._counted[self._signals[name][0].key]
        if len(buses) < 2 or self.group in buses:
            return ()
        return tuple(sorted(buses))

    @cached_property
    def _senders(self) -> dict[_Key, tuple[str, int]]:
        """Bus and source address that are read of each message; -1 for 11 bits."""
        senders = {sender.key: sender for sender, _ in self._signals.values()}
        chosen: dict[_Key, tuple[str, int]] = {}
        for key, buses in self._counted.items():
            bus = self.group
            if bus not in buses:
                bus = max(buses, key=lambda name: buses[name].total())
            if len(buses) > 1:
                others = ", ".join(sorted(set(buses) - {bus}))
                self.remarks.add(
                    senders[key].label, f"on bus {bus}; left out: {others}", count=0
                )
            counts = buses[bus]
            if key.group is None:
                chosen[key] = (bus, -1)
                continue
            usual = senders[key].usual
            source = usual if usual in counts else counts.most_common(1)[0][0]
            if len(counts) > 1:
                listed = ", ".join(map(str, sorted(counts)))
                self.remarks.add(
                    senders[key].label,
                    f"sent by the addresses {listed}: that of {source} is read",
                    count=0,
                )
            chosen[key] = (bus, source)
        return chosen

    @cached_property
    def channels(self) -> Mapping[str, Channel]:
        """Channels whose messages are on the bus, by name."""
        channels = {}
        for name, (sender, signal) in self._signals.items():
            if sender.key in self._senders:
                channels[name] = Channel(
                    name,
                    signal.unit,
                    signal.quantity,
                    abs(signal.scale) if signal.states is None else 0.0,
                    signal.low,
                )
        torque = f"{j1939.PREFIX}EngineActualTorque"
        if torque in channels:
            channels[j1939.REFERENCE_TORQUE] = Channel(
                j1939.REFERENCE_TORQUE, "N m", "reference_torque", 1.0
            )
        return channels

    def missing_messages(self) -> list[str]:
        """Return the messages of the DBC that the bus does not carry."""
        return [
            message.name
            for message in self._messages
            if _key_of(message) not in self._senders
        ]

    def channel(self, name: str) -> Channel:
        """Return a channel.

        Raises:
            InputError: there is none of this name; the text says whether message or signal lack.
        """
        if name in self._signals and name not in self.channels:
            sender, _ = self._signals[name]
            raise InputError(
                f"{self.path}: channel {name!r}: no frame of message {sender.label} is "
                "on the bus"
            )
        return super().channel(name)

    def pieces(self, names: Collection[str]) -> Iterator[dict[str, Series]]:
        """Yield the readings of channels in pieces, see `Log`."""
        for name in names:
            self.channel(name)
        by_key: dict[_Key, list[Signal]] = {}
        for name in names:
            if name in self._signals:
                sender, signal = self._signals[name]
                by_key.setdefault(sender.key, []).append(signal)
        reference = None
        if j1939.REFERENCE_TORQUE in names:
            reference = j1939.ReferenceTorque()
        last: dict[str, float] = {}
        bus_time = math.nan
        for frames, part in self._source(self.remarks):
            self._part = part
            bus_time = self._remark_pauses(frames, bus_time)
            piece = {}
            groups = frames.group
            for key, signals in by_key.items():
                mask = key.mask(frames, groups)
                bus, source = self._senders[key]
                mask &= frames.bus == bus
                if source >= 0:
                    mask &= frames.source == source
                chosen = frames.select(np.flatnonzero(mask))
                for signal in signals:
                    piece[signal.name] = signal.read(chosen, self.remarks)
            if reference is not None:
                carried = frames.extended & np.isin(groups, reference.groups)
                chosen = frames.select(np.flatnonzero(carried))
                piece[j1939.REFERENCE_TORQUE] = reference.read(chosen, self.remarks)
            yield self._rising(piece, last)

    def progress_of(self) -> float:
        """Return the part of the file that was read."""
        return self._part

    def close(self) -> None:
        """Close the file."""
        if self._closing is not None:
            self._closing()

    def _rising(
        self, piece: Mapping[str, Series], last: dict[str, float]
    ) -> dict[str, Series]:
        """Return a piece without duplicates; `last` keeps the latest times."""
        kept = {}
        for name, series in piece.items():
            later = rising(series, last.get(name, -math.inf), self.remarks, name)
            if len(later.time):
                last[name] = float(later.time[-1])
            kept[name] = later
        return kept

    def _remark_pauses(self, frames: Frames, before: float) -> float:
        """Remark pauses of the whole bus; return the time of the last frame [s]."""
        known = frames.time[~stray_stamps(frames.time)]
        if not len(known):
            return before
        times = np.append(before, known)
        steps = np.diff(times)
        for row in np.flatnonzero(steps > _SILENT):
            self.remarks.add(
                "bus",
                f"no frame for {steps[row]:.1f} s (bus off, or not recorded)",
                float(times[row]),
                0,
            )
        return float(times[-1])
