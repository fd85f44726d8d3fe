# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The three inputs, and whether each is present, valid and fresh."""

import math
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from hmcvt_core.interface import (
    DISPLACEMENT_RATIO,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    POINT_RANGES,
    Range,
)

from .clocks import Arrival
from .numbering import Numbers

INPUT_RANGES = POINT_RANGES
STROKE_TOLERANCE = 0.02
"""How far sensor noise may lead beyond full stroke, which is taken instead [-]; chosen by us."""
NANOSECONDS = 1e-9
NOT_FINITE = "not finite"
OUT_OF_RANGE = "out of range"
REASONS = (NOT_FINITE, OUT_OF_RANGE)
"""Why a message may be refused."""


class OperatingPoint(NamedTuple):
    """The values of the three inputs: [-], rad/s, N m."""

    displacement_ratio: float
    engine_speed: float
    load_torque: float


class AgeLimits(NamedTuple):
    """How old inputs may be [ns].

    Attributes:
        ages: limit of each input, in the order of `INPUT_RANGES`.
        skew: limit of the time between the oldest and the newest.
    """

    ages: tuple[int, int, int]
    skew: int


class State(Enum):
    """State of one input, from good to bad."""

    FRESH = "fresh"
    COASTING = "coasting"
    MISSING = "missing"
    STALE = "stale"
    INVALID = "invalid"


@dataclass
class Tally:
    """What became of the messages of one kind.

    Attributes:
        reasons: why a message may be refused.
        accepted: count of accepted messages.
        refused: counts of refused messages by `reasons`.
        at_limit: count of strokes slightly beyond 1 that were taken as 1.
        reason: why the last message was refused; empty when it was accepted.
        complaint: the same as a sentence.
    """

    reasons: tuple[str, ...]
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    at_limit: int = 0
    reason: str = ""
    complaint: str = ""

    def accept(self, count: int = 1) -> None:
        """Count accepted messages."""
        self.accepted += count
        self.reason = ""
        self.complaint = ""

    def expect(self, reason: str, complaint: str) -> None:
        """State why the next message will be refused; an accepted message clears it."""
        self.reason = reason
        self.complaint = complaint

    def refuse(self, reason: str, complaint: str, count: int = 1) -> None:
        """Count refused messages."""
        self.refused[reason] += count
        self.expect(reason, complaint)

    def values(self, subject: str) -> dict[str, int]:
        """Return the counts by the keys that diagnostics use."""
        values = {
            f"{subject} received": self.accepted + self.refused.total(),
            f"{subject} accepted": self.accepted,
        }
        for reason in self.reasons:
            values[f"{subject} refused, {reason}"] = self.refused[reason]
        values[f"{subject} taken as the limit"] = self.at_limit
        return values


@dataclass
class Input:
    """One input.

    Attributes:
        limits: range of the input.
        value: value of the last message, None when it was refused or none came.
        arrival: when the last message was received, None before the first.
        stamp: the same by the clock that ages follow [ns].
        tally: what became of its messages.
        numbers: counts those that were lost on the way.
    """

    limits: Range
    value: float | None = None
    arrival: Arrival | None = None
    stamp: int | None = None
    tally: Tally = field(default_factory=lambda: Tally(REASONS))
    numbers: Numbers = field(default_factory=Numbers)

    def take(self, value: float, arrival: Arrival) -> bool:
        """Take a message; return False when its value is refused, for the reason in the tally."""
        self.arrival = arrival
        self.stamp = arrival.received
        if not self.limits.low <= value <= self.limits.high:  # true for NaN
            value = tolerated(self.limits, value, self.tally)
            if not (self.limits.contains(value) or coasting(self.limits, value)):
                # The value before is discarded too: what the sensor reads now is not known.
                self.value = None
                reason = OUT_OF_RANGE if math.isfinite(value) else NOT_FINITE
                self.tally.refuse(reason, self.limits.complaint(value))
                return False
        self.value = value
        self.tally.accept()
        return True

    def forget(self) -> None:
        """Discard the last message; the counts stay."""
        self.value = None
        self.arrival = None
        self.stamp = None

    def change_clock(self, follow_simulation: bool) -> None:
        """Count the age by the clock of the simulation, or by the steady clock."""
        if self.arrival is not None:
            self.arrival = self.arrival._replace(follows_simulation=follow_simulation)
            self.stamp = self.arrival.received

    def fresh(self, now: int, limit: int) -> bool:
        """Return whether there is a value that is not older than a limit [ns]."""
        return (
            self.value is not None
            and self.stamp is not None
            and now - self.stamp <= limit
        )

    def age(self, now: int) -> float | None:
        """Return the time since the last message [s], None when there is none."""
        if self.stamp is None:
            return None
        return (now - self.stamp) * NANOSECONDS

    def state(self, now: int, limit: int) -> tuple[State, str]:
        """Return the state for an age limit [ns], and a message about it; empty when fresh."""
        name = self.limits.name
        age = self.age(now)
        if age is None:
            return State.MISSING, f"{name}: nothing received"
        if age > limit * NANOSECONDS:
            return State.STALE, f"{name}: nothing received for {age:.1f} s"
        if self.value is None:
            return State.INVALID, self.tally.complaint
        reason = coasting(self.limits, self.value)
        if reason:
            return State.COASTING, reason
        return State.FRESH, ""


def tolerated(limits: Range, value: float, tally: Tally) -> float:
    """Return a value, or full stroke where noise leads slightly beyond it; the tally counts it."""
    if limits is DISPLACEMENT_RATIO and 1.0 < abs(value) <= 1.0 + STROKE_TOLERANCE:
        tally.at_limit += 1
        return math.copysign(1.0, value)
    return value


def coasting(limits: Range, value: float) -> str:
    """Return a message if a load torque is near zero or drives the engine; empty otherwise."""
    if limits is not LOAD_TORQUE or not -limits.high <= value < limits.low:
        return ""
    return (
        f"{limits.name} = {value:g} N m: coasting; an efficiency begins "
        f"at {limits.low:g} N m"
    )


class Inputs:
    """The set of the three inputs.

    Attributes:
        by_name: inputs by name.
        oil: oil temperature [deg C], which may stay away.
        clock_jumps: how often a simulated clock was set back or exchanged.
        coasting: count of arrivals without an answer because the load torque was near zero or less.
        apart: count of arrivals without an answer because of `max_input_skew`.
        apart_reason: reason of the last one; the reader clears it.
        asked: state and message of the last message on `operating_point`; the reader clears it.
            None when none came.
    """

    def __init__(self) -> None:
        self.by_name = {limits.name: Input(limits) for limits in INPUT_RANGES}
        self._all = tuple(self.by_name.values())
        self.oil = Input(OIL_TEMPERATURE)
        self.clock_jumps = 0
        self.coasting = 0
        self.apart = 0
        self.apart_reason = ""
        self.asked: tuple[State, str] | None = None

    def point(self, now: int, limits: AgeLimits) -> OperatingPoint | None:
        """Return the operating point, None unless all inputs are fresh, valid and of one time."""
        stroke, speed, torque = self._all
        if (
            torque.value is None
            or torque.value < LOAD_TORQUE.low
            or not self._fresh(now, limits)
            or self._skew() > limits.skew
        ):
            return None
        return OperatingPoint(stroke.value, speed.value, torque.value)  # type: ignore[arg-type]

    def oil_temperature(self, now: int, limit: int) -> float | None:
        """Return the oil temperature [deg C]; None without one that is not older than a limit."""
        return self.oil.value if self.oil.fresh(now, limit) else None

    def count_silence(self, now: int, limits: AgeLimits) -> None:
        """Count an arrival without an answer although all inputs are fresh."""
        if not self._fresh(now, limits):
            return
        if self._skew() <= limits.skew:
            self.coasting += 1
            return
        self.apart += 1
        ages = {name: item.age(now) or 0.0 for name, item in self.by_name.items()}
        newest = min(ages, key=ages.__getitem__)
        oldest = max(ages, key=ages.__getitem__)
        self.apart_reason = (
            f"{oldest} is {ages[oldest] - ages[newest]:.3f} s older than {newest}; "
            f"max_input_skew = {limits.skew * NANOSECONDS:g}"
        )

    def clock_jumped(self) -> None:
        """Discard all inputs: their ages by the clock before mean nothing."""
        self.clock_jumps += 1
        for item in (*self._all, self.oil):
            item.forget()

    def change_clock(self, follow_simulation: bool) -> None:
        """Count all ages by the clock of the simulation, or by the steady clock."""
        for item in (*self._all, self.oil):
            item.change_clock(follow_simulation)

    def _fresh(self, now: int, limits: AgeLimits) -> bool:
        return all(map(Input.fresh, self._all, (now, now, now), limits.ages))

    def _skew(self) -> int:
        stamps = [item.stamp or 0 for item in self._all]
        return max(stamps) - min(stamps)
