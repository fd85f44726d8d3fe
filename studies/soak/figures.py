# SPDX-License-Identifier: Apache-2.0
"""Figures out of stretches of load."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .load import Segment
from .points import TOPICS

MEGABYTE = 1e6


@dataclass(frozen=True)
class Spread:
    """A figure that was measured several times: median, lowest, highest."""

    median: float
    low: float
    high: float

    def text(self, form: str = ".2f") -> str:
        return f"{self.median:{form}} ({self.low:{form}} to {self.high:{form}})"


def spread(values: Sequence[float]) -> Spread:
    return Spread(float(np.median(values)), min(values), max(values))


def latency(percentile: float) -> Callable[[Segment], float]:
    """Return what gives the latency of the whole answer, both outputs [ms]."""
    return lambda segment: float(np.percentile(segment.optimum_latency, percentile))


def first_latency(percentile: float) -> Callable[[Segment], float]:
    """Return what gives the latency of the first output [ms]."""
    return lambda segment: float(np.percentile(segment.efficiency_latency, percentile))


def ratio(figure: Callable[[Segment], float], above: Sequence[Segment],
          below: Sequence[Segment]) -> Spread:
    """Return the ratio of the medians of two sets of stretches, with the range turn by turn."""
    over, under = ([figure(segment) for segment in segments] for segments in (above, below))
    by_turn = [one / other for one, other in zip(over, under, strict=True)]
    return Spread(float(np.median(over) / np.median(under)), min(by_turn), max(by_turn))


def memory_slope(segments: Sequence[Segment]) -> float:
    """Return how fast the memory grows under load [MB a minute], the first stretch left out."""
    memory = np.concatenate([segment.memory for segment in segments[1:]]) / MEGABYTE
    seconds = sum(segment.seconds for segment in segments[1:])
    minutes = np.linspace(0.0, seconds / 60.0, len(memory))
    return float(np.polyfit(minutes, memory, 1)[0])


def kept_up(segment: Segment) -> bool:
    """Tell whether the generator sent at the rate aimed at."""
    return segment.sent / segment.seconds >= 0.95 * TOPICS * segment.rate


def ceiling(segments: Sequence[Segment], share: float) -> float:
    """Return the highest rate [Hz] that was sent and of which this share was answered, or 0."""
    return max((segment.rate for segment in segments
                if kept_up(segment) and segment.answers >= share * segment.sent), default=0.0)
