# SPDX-License-Identifier: Apache-2.0
"""What pytest-benchmark has written down, as ratios turn by turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Figure = Callable[["Entry"], float]


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of a figure over the turns; all three the same for a single run."""

    median: float
    low: float
    high: float

    def text(self) -> str:
        """Write it, with three digits."""
        if self.low == self.high or np.isnan(self.median):
            return short(self.median)
        return f"{short(self.median)} ({short(self.low)} to {short(self.high)})"


def spread(values: Any) -> Spread:
    """Summarise values; NaN stands for a run without the figure and is left out."""
    known = np.asarray(values, dtype=float)
    known = known[~np.isnan(known)]
    if not known.size:
        return Spread(np.nan, np.nan, np.nan)
    low, median, high = np.percentile(known, (25, 50, 75))
    return Spread(float(median), float(low), float(high))


def short(value: float) -> str:
    """Write a number with three digits, without an exponent where that is readable."""
    if np.isnan(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


@dataclass(frozen=True)
class Entry:
    """One benchmark of one contender in one turn.

    Attributes:
        name: of the benchmark.
        told: parameters, and what the benchmark told besides its time.
        seconds: of the fastest round.
    """

    name: str
    told: Mapping[str, Any]
    seconds: float

    def per_call(self) -> float:
        """Seconds per call."""
        return self.seconds / self.told["calls"]


class Record:
    """The entries of one run."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        """Take what pytest-benchmark writes as JSON."""
        self.entries = [
            Entry(item["name"].partition("[")[0],
                  {**(item["params"] or {}), **item["extra_info"]}, item["stats"]["min"])
            for item in data["benchmarks"]]

    def select(self, name: str, **told: Any) -> list[Entry]:
        """Return the entries of a benchmark that told this, in the order they were made."""
        return list(self._matching(name, told))

    def _matching(self, name: str, told: Mapping[str, Any]) -> Iterator[Entry]:
        for entry in self.entries:
            if entry.name == name and all(entry.told.get(key) == value
                                          for key, value in told.items()):
                yield entry

    def one(self, name: str, **told: Any) -> Entry:
        """Return the first of them."""
        return self.select(name, **told)[0]

    def spread(self, name: str, figure: Figure = Entry.per_call, **told: Any) -> Spread:
        """Summarise a figure over the turns."""
        return spread([figure(entry) for entry in self.select(name, **told)])

    def ratio(self, name: str, over: Mapping[str, Any], under: Mapping[str, Any],
              figure: Figure = Entry.per_call, turn: str = "turn") -> Spread:
        """Summarise the ratios of one contender to another, turn by turn."""
        above, below = ({entry.told[turn]: figure(entry) for entry in self.select(name, **which)}
                        for which in (over, under))
        return spread([above[key] / below[key] for key in above.keys() & below.keys()])
