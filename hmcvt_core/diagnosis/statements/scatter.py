# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Statement: scatter above its statement that no recorded axis explains."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ExcessScatter:
    """Scatter above the stated noise: the statement is too small, or something varied unrecorded.

    Attributes:
        ratio: scatter / stated noise of `channel`.
        channel: that shows it most clearly.
        time_scale: `tests` (each test anew), `minutes`, `hours` or `sessions`; None where the
            samples have neither stamps nor sessions, or do not tell.
        quantities: what may have varied, with the probability of each, most probable first.
        sensor: what to record to find out, in words.
        sentence: all of it in one sentence.
    """

    ratio: float
    channel: str
    time_scale: str | None
    quantities: tuple[tuple[str, float], ...]
    sensor: str
    sentence: str
