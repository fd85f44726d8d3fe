# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The signals of SAE J1939 and ISO 11783 that a drive line needs, without a DBC.

Positions, resolutions, offsets and codes are those of SAE J1939-71 (vehicle application layer) and
of the SAE J1939 Digital Annex; the power take-off is that of ISO 11783-7, whose data dictionary is
public (isobus.net). Bytes are counted from 1 in these standards and from 0 here.

`Actual Engine - Percent Torque` (SPN 513) is the indicated torque: it holds what the engine needs
to overcome its friction. The torque at the flywheel is

    reference torque x (actual - nominal friction - parasitic losses) / 100,

with the reference torque (SPN 544) in the configuration of the engine (EC1), which needs three
frames of the transport protocol (J1939-21).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .series import Remarks, Series
from .signals import Frames, Signal

PREFIX = "J1939."
"""Before the names of the built-in channels, so that those of a DBC differ."""

REFERENCE_TORQUE = f"{PREFIX}EngineReferenceTorque"
ENGINE_SOURCE = 0
"""Source address of the first engine (J1939-81)."""
TRANSMISSION_SOURCE = 3


class Group(NamedTuple):
    """A parameter group.

    Attributes:
        label: acronym of the standard.
        source: address that usually sends it; -1 for any.
        signals: those that are read.
    """

    label: str
    source: int
    signals: tuple[Signal, ...]


def _word(
    name: str,
    unit: str,
    byte: int,
    scale: float,
    offset: float = 0.0,
    quantity: str = "",
) -> Signal:
    """A signal of two bytes."""
    return Signal(PREFIX + name, unit, 8 * byte, 16, scale, offset, quantity=quantity)


def _byte(
    name: str,
    unit: str,
    byte: int,
    scale: float,
    offset: float = 0.0,
    quantity: str = "",
) -> Signal:
    """A signal of one byte."""
    return Signal(PREFIX + name, unit, 8 * byte, 8, scale, offset, quantity=quantity)


_ON_OFF = {0: "off", 1: "on"}

GROUPS: dict[int, Group] = {
    61444: Group(
        "EEC1",
        ENGINE_SOURCE,
        (
            _byte("EngineDemandTorque", "%", 1, 1.0, -125.0),  # SPN 512
            _byte("EngineActualTorque", "%", 2, 1.0, -125.0),  # SPN 513
            _word("EngineSpeed", "rpm", 3, 0.125, quantity="engine_speed"),  # SPN 190
        ),
    ),
    61443: Group(
        "EEC2",
        ENGINE_SOURCE,
        (
            _byte("AcceleratorPedal", "%", 1, 0.4),  # SPN 91
            _byte("EngineLoadAtSpeed", "%", 2, 1.0),  # SPN 92
        ),
    ),
    65247: Group(
        "EEC3",
        ENGINE_SOURCE,
        (
            _byte("EngineFrictionTorque", "%", 0, 1.0, -125.0),  # SPN 514
            _word("EngineDesiredSpeed", "rpm", 1, 0.125),  # SPN 515
            _byte("EngineParasiticTorque", "%", 4, 1.0, -125.0),  # SPN 2978
        ),
    ),
    61442: Group(
        "ETC1",
        TRANSMISSION_SOURCE,
        (
            Signal(PREFIX + "DrivelineEngaged", "", 0, 2, states=_ON_OFF),  # SPN 560
            _word(
                "OutputShaftSpeed", "rpm", 1, 0.125, quantity="output_speed"
            ),  # SPN 191
            _byte("ClutchSlip", "%", 3, 0.4),  # SPN 522
            _word("InputShaftSpeed", "rpm", 5, 0.125),  # SPN 161
        ),
    ),
    61445: Group(
        "ETC2",
        TRANSMISSION_SOURCE,
        (
            _byte("SelectedGear", "", 0, 1.0, -125.0),  # SPN 524
            _byte("CurrentGear", "", 3, 1.0, -125.0),  # SPN 523
        ),
    ),
    65266: Group(
        "LFE",
        ENGINE_SOURCE,
        (_word("EngineFuelRate", "L/h", 0, 0.05, quantity="fuel_rate"),),  # SPN 183
    ),
    65265: Group(
        "CCVS",
        -1,
        (_word("WheelBasedSpeed", "km/h", 1, 1.0 / 256.0),),  # SPN 84
    ),
    65262: Group(
        "ET1",
        ENGINE_SOURCE,
        (
            _byte("EngineCoolantTemperature", "deg C", 0, 1.0, -40.0),  # SPN 110
            _byte("EngineFuelTemperature", "deg C", 1, 1.0, -40.0),  # SPN 174
            _word("EngineOilTemperature", "deg C", 2, 0.03125, -273.0),  # SPN 175
        ),
    ),
    65272: Group(
        "TRF1",
        TRANSMISSION_SOURCE,
        (
            _word(
                "TransmissionOilTemperature",
                "deg C",
                4,
                0.03125,
                -273.0,
                quantity="oil_temperature",
            ),  # SPN 177
        ),
    ),
    65091: Group(
        "RPTO",
        -1,
        (_word("RearPtoSpeed", "rpm", 0, 0.125),),  # ISO 11783-7
    ),
    65092: Group(
        "FPTO",
        -1,
        (_word("FrontPtoSpeed", "rpm", 0, 0.125),),  # ISO 11783-7
    ),
}
"""Parameter groups by number."""

_CONFIGURATION = 65251
"""Number of EC1, engine configuration."""
_ANNOUNCEMENT = 0xEC00
"""Number of the group that announces a message of several frames (TP.CM)."""
_TRANSFER = 0xEB00
"""Number of the group that carries it (TP.DT)."""
_TO_ALL = 32
"""Control byte of an announcement to all (BAM)."""
_REFERENCE_PACKET = 3
"""Packet of EC1 that holds the reference torque: bytes 20 and 21 of the message stand in its
bytes 6 and 7, because each packet carries seven bytes behind its number."""
_REFERENCE_TORQUE = Signal(
    REFERENCE_TORQUE, "N m", 8 * 6, 16, quantity="reference_torque"
)


class ReferenceTorque:
    """Finds the reference torque of the engine in frames of the transport protocol."""

    groups = (_ANNOUNCEMENT, _TRANSFER)

    def __init__(self) -> None:
        self._is_configuration: dict[int, bool] = {}
        """Whether the message under way is EC1, by source address."""

    def read(self, frames: Frames, remarks: Remarks) -> Series:
        """Return the values in frames of `groups`, in their order."""
        rows = []
        announced = frames.group == _ANNOUNCEMENT
        sources = frames.source
        for row in range(len(frames.time)):
            source = int(sources[row])
            data = frames.data[row]
            if announced[row]:
                number = int(data[5]) | int(data[6]) << 8 | int(data[7]) << 16
                is_to_all = data[0] == _TO_ALL
                self._is_configuration[source] = is_to_all and number == _CONFIGURATION
            elif data[0] == _REFERENCE_PACKET and self._is_configuration.get(source):
                rows.append(row)
        return _REFERENCE_TORQUE.read(frames.select(np.array(rows, dtype=int)), remarks)
