# SPDX-License-Identifier: Apache-2.0
"""The three inputs, and whether each is present, valid and fresh."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from hmcvt_core.transmission.ranges import POINT_RANGES, Range

INPUT_RANGES = POINT_RANGES
NANOSECONDS = 1e-9
REASONS = ("not finite", "out of range")
"""Why a message may be refused."""


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
class Tally:
    """What became of the messages of one kind.

    Attributes:
        reasons: why one may be refused.
        accepted: count of messages.
        refused: counts by `reasons`.
        reason: why the last one was refused; empty when it was not.
        complaint: the same for a person.
    """

    reasons: tuple[str, ...]
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    reason: str = ""
    complaint: str = ""

    def accept(self) -> None:
        """Count one that was taken."""
        self.accepted += 1
        self.reason = self.complaint = ""

    def expect(self, reason: str, complaint: str) -> None:
        """Say why one would be refused before one is; the first that is taken proves it wrong."""
        self.reason, self.complaint = reason, complaint

    def refuse(self, reason: str, complaint: str) -> None:
        """Count one that was not taken."""
        self.refused[reason] += 1
        self.expect(reason, complaint)

    def values(self, subject: str) -> dict[str, int]:
        """Return the counts as diagnostics name them."""
        return {f"{subject} received": self.accepted + self.refused.total(),
                f"{subject} accepted": self.accepted,
                **{f"{subject} refused, {reason}": self.refused[reason]
                   for reason in self.reasons}}


@dataclass
class Input:
    """One input.

    Attributes:
        limits: its range.
        value: of the last message, None when that was refused or none came.
        stamp: time of the last message [ns], None before the first.
        tally: what became of its messages.
    """

    limits: Range
    value: float | None = None
    stamp: int | None = None
    tally: Tally = field(default_factory=lambda: Tally(REASONS))

    def take(self, value: float, now: int) -> bool:
        """Take a message; False when the value is refused, the tally says why."""
        self.stamp = now
        if self.limits.low <= value <= self.limits.high:  # false for NaN
            self.value = value
            self.tally.accept()
            return True
        # The last good value is gone with it: what the sensor says now is not known.
        self.value = None
        self.tally.refuse(REASONS[math.isfinite(value)], self.limits.complaint(value))
        return False

    def forget(self) -> None:
        """Be as if nothing had come yet; the counts stay."""
        self.value = self.stamp = None

    def age(self, now: int) -> float | None:
        """Seconds since the last message, None when there is none."""
        if self.stamp is not None and now < self.stamp:
            # The clock went back (a bag was restarted): what came before is of another time.
            self.forget()
        return None if self.stamp is None else (now - self.stamp) * NANOSECONDS

    def state(self, now: int, timeout: float) -> tuple[State, str]:
        """Return the state at a time, for an age limit in seconds, and what is wrong."""
        age = self.age(now)
        if age is None:
            return State.MISSING, f"{self.limits.name}: nothing received"
        if age > timeout:
            return State.STALE, f"{self.limits.name}: nothing received for {age:.1f} s"
        return (State.INVALID, self.tally.complaint) if self.value is None else (State.FRESH, "")


class Inputs:
    """The set of the three inputs.

    Attributes:
        by_name: each input.
        clock_jumps: how often the clock that tells the ages was set back or exchanged.
    """

    def __init__(self) -> None:
        self.by_name = {limits.name: Input(limits) for limits in INPUT_RANGES}
        self.clock_jumps = 0

    def point(self, now: int, timeouts: Mapping[str, float]) -> OperatingPoint | None:
        """Return the operating point, None unless all three inputs are fresh and valid.

        Args:
            now: [ns].
            timeouts: age limit of each input by name [s].
        """
        values = []
        for name, item in self.by_name.items():
            if item.state(now, timeouts[name])[0] is not State.FRESH or item.value is None:
                return None
            values.append(item.value)
        return OperatingPoint(*values)

    def clock_jumped(self) -> None:
        """Forget what came by the clock before: its ages mean nothing now."""
        self.clock_jumps += 1
        for item in self.by_name.values():
            item.forget()
