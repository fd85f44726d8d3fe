# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The three inputs, and whether each is present, valid and fresh."""

import math
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from hmcvt_core.transmission.ranges import (
    DISPLACEMENT_RATIO,
    LOAD_TORQUE,
    POINT_RANGES,
    Range,
)

INPUT_RANGES = POINT_RANGES
STROKE_TOLERANCE = 0.02
"""How far beyond full stroke noise of its sensor may lead; it is taken as full stroke [-]."""
NANOSECONDS = 1e-9
REASONS = ("not finite", "out of range")
"""Why a message may be refused."""


class OperatingPoint(NamedTuple):
    """What the three inputs say together: [-], rad/s, N m."""

    displacement_ratio: float
    engine_speed: float
    load_torque: float


class AgeLimits(NamedTuple):
    """How old inputs may be [ns].

    Attributes:
        ages: of each input, in the order of `INPUT_RANGES`.
        skew: time between the oldest and the newest.
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
        reasons: why one may be refused.
        accepted: count of messages.
        refused: counts by `reasons`.
        at_limit: count of strokes a hair beyond 1 that were taken as 1.
        reason: why the last one was refused; empty when it was not.
        complaint: the same for a person.
    """

    reasons: tuple[str, ...]
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    at_limit: int = 0
    reason: str = ""
    complaint: str = ""

    def accept(self, count: int = 1) -> None:
        """Count what was taken."""
        self.accepted += count
        self.reason = self.complaint = ""

    def expect(self, reason: str, complaint: str) -> None:
        """Say why one would be refused before one is; the first that is taken proves it wrong."""
        self.reason, self.complaint = reason, complaint

    def refuse(self, reason: str, complaint: str, count: int = 1) -> None:
        """Count what was not taken."""
        self.refused[reason] += count
        self.expect(reason, complaint)

    def values(self, subject: str) -> dict[str, int]:
        """Return the counts as diagnostics name them."""
        return {
            f"{subject} received": self.accepted + self.refused.total(),
            f"{subject} accepted": self.accepted,
            **{
                f"{subject} refused, {reason}": self.refused[reason]
                for reason in self.reasons
            },
            f"{subject} taken as the limit": self.at_limit,
        }


@dataclass
class Input:
    """One input.

    Attributes:
        limits: its range.
        value: of the last message, None when that was refused or none came.
        stamp: when the last message came [ns], None before the first.
        tally: what became of its messages.
    """

    limits: Range
    value: float | None = None
    stamp: int | None = None
    tally: Tally = field(default_factory=lambda: Tally(REASONS))

    def take(self, value: float, received: int) -> bool:
        """Take a message; False when the value is refused, the tally says why."""
        self.stamp = received
        if not self.limits.low <= value <= self.limits.high:  # true for NaN
            value = tolerated(self.limits, value, self.tally)
            if not (self.limits.contains(value) or coasting(self.limits, value)):
                # The last good value is gone with it: what the sensor says now is not known.
                self.value = None
                self.tally.refuse(
                    REASONS[math.isfinite(value)], self.limits.complaint(value)
                )
                return False
        self.value = value
        self.tally.accept()
        return True

    def forget(self) -> None:
        """Be as if nothing had come yet; the counts stay."""
        self.value = self.stamp = None

    def fresh(self, now: int, limit: int) -> bool:
        """Tell whether there is a value, not older than a limit [ns]."""
        return (
            self.value is not None
            and self.stamp is not None
            and now - self.stamp <= limit
        )

    def age(self, now: int) -> float | None:
        """Seconds since the last message, None when there is none."""
        return None if self.stamp is None else (now - self.stamp) * NANOSECONDS

    def state(self, now: int, limit: int) -> tuple[State, str]:
        """Return the state at a time, for an age limit [ns], and what is to be said of it."""
        age, name = self.age(now), self.limits.name
        if age is None:
            return State.MISSING, f"{name}: nothing received"
        if age > limit * NANOSECONDS:
            return State.STALE, f"{name}: nothing received for {age:.1f} s"
        if self.value is None:
            return State.INVALID, self.tally.complaint
        why = coasting(self.limits, self.value)
        return State.COASTING if why else State.FRESH, why


def tolerated(limits: Range, value: float, tally: Tally) -> float:
    """Return a value; the limit instead, and count it, where noise leads a hair beyond it."""
    if limits is DISPLACEMENT_RATIO and 1.0 < abs(value) <= 1.0 + STROKE_TOLERANCE:
        tally.at_limit += 1
        return math.copysign(1.0, value)
    return value


def coasting(limits: Range, value: float) -> str:
    """Say that a load torque is near zero or drives the engine, as on every way downhill, if so."""
    if limits is not LOAD_TORQUE or not -limits.high <= value < limits.low:
        return ""
    return (
        f"{limits.name} = {value:g} N m: coasting; an efficiency begins "
        f"at {limits.low:g} N m"
    )


class Inputs:
    """The set of the three inputs.

    Attributes:
        by_name: each input.
        clock_jumps: how often a simulated clock was set back or exchanged.
        coasting: count of arrivals without an answer because the load torque was near zero or less.
        apart: count of arrivals without an answer because the inputs were of different times.
        apart_reason: of the last one, to be taken away when it has been told.
        asked: state of the last message on `operating_point` and what is to be said of it, to be
            taken away too; None when none came.
    """

    def __init__(self) -> None:
        self.by_name = {limits.name: Input(limits) for limits in INPUT_RANGES}
        self._all = tuple(self.by_name.values())
        self.clock_jumps = self.coasting = self.apart = 0
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

    def count_silence(self, now: int, limits: AgeLimits) -> None:
        """Count an arrival without an answer, where it is not for an input that has trouble."""
        if not self._fresh(now, limits):
            return
        if self._skew() > limits.skew:
            self.apart += 1
            ages = {name: item.age(now) or 0.0 for name, item in self.by_name.items()}
            newest, oldest = (
                min(ages, key=ages.__getitem__),
                max(ages, key=ages.__getitem__),
            )
            self.apart_reason = (
                f"{oldest} is {ages[oldest] - ages[newest]:.3f} s older than {newest}; "
                f"max_input_skew = {limits.skew * NANOSECONDS:g}"
            )
        else:
            self.coasting += 1

    def clock_jumped(self) -> None:
        """Forget what came by the clock before: its ages mean nothing now."""
        self.clock_jumps += 1
        for item in self._all:
            item.forget()

    def _fresh(self, now: int, limits: AgeLimits) -> bool:
        return all(map(Input.fresh, self._all, (now, now, now), limits.ages))

    def _skew(self) -> int:
        stamps = [item.stamp or 0 for item in self._all]
        return max(stamps) - min(stamps)
