# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The signals of a maker's messages, from a DBC by cantools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError

from .signals import BYTES, Signal, group_number

_J1939_FORMAT = "J1939PG"
"""Value of the attribute `VFrameFormat` of messages that J1939 numbers."""
_FIRST_OF_J1939 = 0xF000
"""Minimum parameter group number that is broadcast; below, a 29-bit number may mean anything."""


class Message(NamedTuple):
    """A message of a DBC.

    Attributes:
        name: of the message.
        identifier: 11 or 29 bits.
        is_extended: whether it has 29 bits.
        group: parameter group number; None where the identifier has to match as it is.
        signals: those that are read.
        address: source address that sends it; -1 where any may.
    """

    name: str
    identifier: int
    is_extended: bool
    group: int | None
    signals: tuple[Signal, ...]
    address: int = -1


def read_dbc(path: str | Path) -> list[Message]:
    """Return the messages of a DBC.

    Raises:
        InputError: the file cannot be read, or cantools is not installed.
    """
    try:
        import cantools
    except ImportError:
        raise InputError(
            f'{path}: a DBC needs cantools: pip install "hmcvt_ros[can]"'
        ) from None
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file")
    try:
        database: Any = cantools.database.load_file(str(path), strict=False)
    except Exception as error:  # cantools raises errors of many kinds
        text = " ".join(str(error).split())
        raise InputError(f"{path}: no DBC that can be read: {text}") from None
    messages = []
    for message in getattr(database, "messages", ()):
        messages.append(_message(message))
    if not messages:
        raise InputError(f"{path}: holds no message")
    return _by_address(messages)


def _by_address(messages: Sequence[Message]) -> list[Message]:
    """Return messages of which those of one parameter group are distinguished by their address.

    A DBC that has one message of a group leaves open which address sends it.
    """
    addresses: dict[int | None, set[int]] = {}
    for message in messages:
        addresses.setdefault(message.group, set()).add(message.identifier & 0xFF)
    distinct = []
    for message in messages:
        address = -1
        if message.group is not None and len(addresses[message.group]) > 1:
            address = message.identifier & 0xFF
        distinct.append(message._replace(address=address))
    return distinct


def _message(message: Any) -> Message:
    is_extended = bool(message.is_extended_frame)
    group = None
    if is_extended and _is_numbered_by_j1939(message):
        group = int(group_number(message.frame_id))
    by_name = {signal.name: signal for signal in message.signals}
    signals = []
    for signal in message.signals:
        read = _signal(message.name, signal, by_name, group is not None)
        if read.last_byte <= BYTES:
            signals.append(read)
    return Message(message.name, message.frame_id, is_extended, group, tuple(signals))


def _is_numbered_by_j1939(message: Any) -> bool:
    """Whether any source address may send a message under its parameter group number."""
    attributes = getattr(message.dbc, "attributes", None) or {}
    stated = attributes.get("VFrameFormat")
    if stated is not None:
        names: Sequence[str] = stated.definition.choices or ()
        value = stated.value
        if isinstance(value, int) and value < len(names):
            value = names[value]
        return str(value) == _J1939_FORMAT
    if message.protocol == "j1939":
        return True
    return int(group_number(message.frame_id)) >= _FIRST_OF_J1939


def _signal(message: str, signal: Any, others: Any, has_codes: bool) -> Signal:
    """Return a signal of cantools as one that reads many frames at once."""
    low = -np.inf if signal.minimum is None else float(signal.minimum)
    high = np.inf if signal.maximum is None else float(signal.maximum)
    if high <= low:
        # [0|0] in a DBC means that no range is stated.
        low = -np.inf
        high = np.inf
    # A half step of slack: ranges are rounded as they are written.
    slack = 0.5 * abs(float(signal.scale))
    states = None
    if signal.choices and _is_enumeration(signal):
        states = {int(code): str(text) for code, text in signal.choices.items()}
    switch = None
    if signal.multiplexer_ids and signal.multiplexer_signal in others:
        selector = _signal(
            message, others[signal.multiplexer_signal], others, has_codes
        )
        switch = (selector, frozenset(signal.multiplexer_ids))
    return Signal(
        f"{message}.{signal.name}",
        str(signal.unit or ""),
        signal.start,
        signal.length,
        float(signal.scale),
        float(signal.offset),
        low - slack,
        high + slack,
        is_intel=signal.byte_order == "little_endian",
        is_signed=bool(signal.is_signed),
        is_float=bool(signal.is_float),
        has_codes=has_codes,
        states=states,
        switch=switch,
    )


_FEWEST_STATES = 2


def _is_enumeration(signal: Any) -> bool:
    """Whether a table of texts names states; one text alone often names a code for "no value"."""
    words = [str(text).casefold() for text in signal.choices.values()]
    states = [word for word in words if not _says_no_value(word)]
    return len(states) >= _FEWEST_STATES and not signal.unit


def _says_no_value(word: str) -> bool:
    return any(part in word for part in ("available", "error", "invalid", "sna"))
