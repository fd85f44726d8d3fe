# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bus of a tractor: what a drive looks like in J1939 messages, and their trace.

The messages are encoded from the standard, not by the code that reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.ranges import RPM

from .drive import Array, Drive, Machine

EPOCH = 1_750_000_000.0
MAKER = f"""VERSION ""

NS_ :

BS_:

BU_: TCU

BO_ {0x98FF1003} HMT: 8 TCU
 SG_ DisplacementRatio : 0|16@1+ (0.0001,-2) [-1.1|1.1] "" TCU
 SG_ Stage : 16|8@1+ (1,0) [0|15] "" TCU

VAL_ {0x98FF1003} Stage 0 "H0" 1 "HM1" 2 "HM2" 3 "HM3" 4 "HM4" ;
"""
"""A maker's message in a DBC."""
STAGES = ("H0", "HM1", "HM2", "HM3", "HM4")


class Faults(NamedTuple):
    """Errors of one bus.

    Attributes:
        torque_bias: of the indicated torque, a fraction.
        delays: of engine torque, engine speed, output speed and the maker's message [s].
    """

    torque_bias: float
    delays: tuple[float, float, float, float]


def faults_of(
    rng: np.random.Generator, bias: float = 0.02, delay: float = 0.05
) -> Faults:
    """Draw the errors of a bus.

    Args:
        rng: random numbers.
        bias: standard deviation of the torque bias.
        delay: largest delay [s].
    """
    late = rng.uniform(0.0, delay, 4)
    first, second, third, fourth = late.tolist()
    return Faults(float(rng.normal(0.0, bias)), (first, second, third, fourth))


class Encoded(NamedTuple):
    """Messages of one kind: times [s], identifier, and data of shape (n, 8)."""

    time: Array
    identifier: int
    data: NDArray[np.uint8]


def encode(
    drive: Drive, machine: Machine, faults: Faults, with_unit: bool
) -> list[Encoded]:
    """Return the messages that a drive sends.

    Args:
        drive: what truly happens.
        machine: reference torque of its engine.
        faults: errors of the bus.
        with_unit: whether the maker's message with displacement ratio and stage is sent.
    """
    torque_late, speed_late, output_late, unit_late = faults.delays
    messages = []
    at = np.arange(0.1, drive.time[-1], 0.02)
    gross = drive.engine_torque + drive.friction_torque
    stated = gross * (1.0 + faults.torque_bias)
    percent = 100.0 * _at(drive, stated, at - torque_late) / machine.reference
    data = _blank(at)
    known = np.isfinite(percent)
    data[known, 2] = np.clip(np.round(percent[known]), 0, 125) + 125
    _word(data, 3, _at(drive, drive.engine_speed, at - speed_late) / RPM / 0.125)
    messages.append(Encoded(at, 0x0CF00400, data))
    at = np.arange(0.107, drive.time[-1], 0.02)
    data = _blank(at)
    data[:, 0] = 0b11111101
    _word(data, 1, _at(drive, drive.output_speed, at - output_late) / RPM / 0.125)
    messages.append(Encoded(at, 0x0CF00203, data))
    at = np.arange(0.111, drive.time[-1], 0.25)
    data = _blank(at)
    friction = _at(drive, drive.friction_torque, at) / machine.reference
    data[:, 0] = np.round(100.0 * friction) + 125
    messages.append(Encoded(at, 0x18FEDF00, data))
    messages += _configuration(drive, machine)
    if with_unit:
        messages.append(_unit(drive, unit_late))
    if machine.oil_temperature is not None:
        messages.append(_oil(drive, machine.oil_temperature))
    return messages


def _oil(drive: Drive, temperature: float) -> Encoded:
    """Return TRF1, every second: bytes 5 and 6, 1/32 deg C from -273."""
    at = np.arange(0.119, drive.time[-1], 1.0)
    data = _blank(at)
    _word(data, 4, np.full(len(at), (temperature + 273.0) * 32.0))
    return Encoded(at, 0x18FEF803, data)


def _unit(drive: Drive, late: float) -> Encoded:
    at = np.arange(0.113, drive.time[-1], 0.05)
    data = _blank(at)
    stroke = _at(drive, drive.displacement_ratio, at - late)
    _word(data, 0, (stroke + 2.0) / 0.0001)
    numbers = np.array([STAGES.index(name) if name else 0 for name in drive.stage])
    rows = np.searchsorted(drive.time, at - late)
    data[:, 2] = numbers[np.clip(rows, 0, len(numbers) - 1)]
    return Encoded(at, 0x18FF1003, data)


def _configuration(drive: Drive, machine: Machine) -> list[Encoded]:
    """Return EC1 in frames of the transport protocol, every five seconds."""
    content = np.full(42, 0xFF, dtype=np.uint8)
    reference = round(machine.reference)
    content[19] = reference & 0xFF
    content[20] = reference >> 8
    at = np.arange(0.15, drive.time[-1], 5.0)
    announcement = np.array([32, 39, 0, 6, 0xFF, 0xE3, 0xFE, 0x00], dtype=np.uint8)
    messages = [Encoded(at, 0x1CECFF00, np.tile(announcement, (len(at), 1)))]
    for number in range(6):
        packet = np.append(number + 1, content[7 * number : 7 * number + 7])
        rows = np.tile(packet.astype(np.uint8), (len(at), 1))
        messages.append(Encoded(at + 0.05 * (number + 1), 0x1CEBFF00, rows))
    return messages


def _blank(at: Array) -> NDArray[np.uint8]:
    return np.full((len(at), 8), 0xFF, dtype=np.uint8)


def _word(data: NDArray[np.uint8], byte: int, raw: Array) -> None:
    """Write whole numbers into two bytes, the lower one first."""
    rounded = np.clip(np.round(raw), 0, 0xFAFF).astype(np.uint16)
    data[:, byte] = rounded & 0xFF
    data[:, byte + 1] = rounded >> 8


def _at(drive: Drive, values: Array, time: Array) -> Array:
    return np.interp(time, drive.time, values)


def in_order(messages: list[Encoded]) -> Iterator[tuple[float, int, bytes]]:
    """Yield time [s], identifier and data of all frames in order of time."""
    times = np.concatenate([message.time for message in messages])
    identifiers = np.concatenate(
        [np.full(len(message.time), message.identifier) for message in messages]
    )
    data = np.concatenate([message.data for message in messages])
    for row in np.argsort(times, kind="stable").tolist():
        yield float(times[row]), int(identifiers[row]), data[row].tobytes()


def write_trace(path: Path, messages: list[Encoded]) -> None:
    """Write a trace by python-can; the ending of the file names its kind."""
    import can

    writer: Any = can.Logger(str(path))
    with writer:
        for time, identifier, data in in_order(messages):
            writer(
                can.Message(
                    timestamp=EPOCH + time,
                    arbitration_id=identifier,
                    is_extended_id=True,
                    data=data,
                )
            )
