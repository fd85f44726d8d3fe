# SPDX-License-Identifier: Apache-2.0
"""What became of a bag, in numbers and in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class SteadyWindow:
    """One steady window.

    Attributes:
        start: time of its first message [s].
        duration: [s].
        messages: in it.
        effective_size: independent messages that would tell as much.
    """

    start: float
    duration: float
    messages: int
    effective_size: float


@dataclass(frozen=True)
class ImportReport:
    """What became of a bag.

    Attributes:
        bag: its path.
        clock: `header stamp` or `time of receipt`.
        read: messages by topic.
        refused: messages by topic and reason.
        averaged: every message was taken as a steady average; the times below are 0 then.
        seconds_logged: time covered by usable messages, gaps left out.
        seconds_steady: in windows.
        seconds_transient: seconds_logged less seconds_steady.
        gaps: count of pauses and steps back of the clock.
        windows_found: steady windows, or messages that are averages already.
        windows_refused: of those, by reason.
        windows: those that became samples.
        notes: what else is worth knowing, in sentences.
    """

    bag: str
    clock: str
    read: Mapping[str, int]
    refused: Mapping[str, Mapping[str, int]]
    averaged: bool
    seconds_logged: float
    seconds_steady: float
    gaps: int
    windows_found: int
    windows_refused: Mapping[str, int]
    windows: tuple[SteadyWindow, ...]
    notes: tuple[str, ...] = ()

    @property
    def seconds_transient(self) -> float:
        """Time that is in no window [s]."""
        return self.seconds_logged - self.seconds_steady

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {**asdict(self), "seconds_transient": self.seconds_transient}

    def text(self) -> str:
        """Return the report as lines."""
        lines = [f"{self.bag}, times by {self.clock}"]
        for topic, count in self.read.items():
            lines.append(f"  {topic}: {count} messages read, {_refused(self.refused[topic])}")
        if self.averaged:
            lines.append(f"  {self.windows_found} averages, {_refused(self.windows_refused)}")
        else:
            lines += self._steadiness()
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])

    def _steadiness(self) -> list[str]:
        return [
            f"  {self.seconds_logged:.1f} s logged: {self.seconds_steady:.1f} s steady, "
            f"{self.seconds_transient:.1f} s rejected as transient; gaps: {self.gaps}",
            f"  {self.windows_found} steady windows, {_refused(self.windows_refused)}",
        ]


def _refused(reasons: Mapping[str, int]) -> str:
    if not reasons:
        return "0 refused"
    listed = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
    return f"{sum(reasons.values())} refused ({listed})"
