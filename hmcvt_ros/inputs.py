# SPDX-License-Identifier: Apache-2.0
"""The three inputs, and whether each is present, valid and fresh."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from hmcvt_core.ranges import DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE, Range

INPUT_RANGES = (DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE)
NANOSECONDS = 1e-9


class OperatingPoint(NamedTuple):
    """What the three inputs say together: [-], rad/s, N m."""

    displacement_ratio: float
    engine_speed: float
    load_torque: float


class State(Enum):
    """State of one input, from good to bad."""

    FRESH = "fresh"
    MISSING = "missing"
    STALE = "stale"
    INVALID = "invalid"


@dataclass
class Input:
    """One input and what became of its messages.

    Attributes:
        limits: its range.
        value: of the last message, None when that was refused or none came.
        received: time of the last message [ns], None before the first.
        complaint: why the last message was refused, empty when it was not.
        accepted: count of messages.
        refused: counts of messages by reason.
    """

    limits: Range
    value: float | None = None
    received: int | None = None
    complaint: str = ""
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)

    def take(self, value: float, now: int) -> bool:
        """Take a message; False when the value is refused, `complaint` says why."""
        self.received = now
        if self.limits.low <= value <= self.limits.high:  # false for NaN
            self.value, self.complaint = value, ""
            self.accepted += 1
            return True
        # The last good value is gone with it: what the sensor says now is not known.
        self.value, self.complaint = None, self.limits.complaint(value)
        self.refused["out of range" if math.isfinite(value) else "not finite"] += 1
        return False

    def age(self, now: int) -> float | None:
        """Seconds since the last message, None when there is none."""
        if self.received is None:
            return None
        if now < self.received:
            # The clock went back (a bag was restarted): what came before is of another time.
            self.received = self.value = None
            self.complaint = ""
            return None
        return (now - self.received) * NANOSECONDS

    def state(self, now: int, timeout: float) -> State:
        """Return the state at a time, for an age limit in seconds."""
        age = self.age(now)
        if age is None:
            return State.MISSING
        if age > timeout:
            return State.STALE
        return State.INVALID if self.value is None else State.FRESH

    def problem(self, now: int, timeout: float) -> str:
        """Say what is wrong, empty when nothing is."""
        state = self.state(now, timeout)
        if state is State.MISSING:
            return f"{self.limits.name}: nothing received"
        if state is State.STALE:
            return f"{self.limits.name}: nothing received for {self.age(now):.1f} s"
        return self.complaint


class Inputs:
    """The set of the three inputs."""

    def __init__(self) -> None:
        self.by_name = {limits.name: Input(limits) for limits in INPUT_RANGES}

    def point(self, now: int, timeout: float) -> OperatingPoint | None:
        """Return the operating point, None unless all three inputs are fresh and valid."""
        values = []
        for item in self.by_name.values():
            if item.state(now, timeout) is not State.FRESH or item.value is None:
                return None
            values.append(item.value)
        return OperatingPoint(*values)

    def problems(self, now: int, timeout: float) -> list[str]:
        """Say what is wrong with each input that is not fresh and valid."""
        found = (item.problem(now, timeout) for item in self.by_name.values())
        return [problem for problem in found if problem]
