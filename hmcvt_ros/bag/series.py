# SPDX-License-Identifier: Apache-2.0
"""Time series: clocks, stretches without a gap, slow channels aligned to fast ones."""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Series(NamedTuple):
    """Readings in the order they were received.

    Attributes:
        stamp: time in the header [s], 0 where there is none; shape (n,).
        receipt: when the recorder received them [s]; shape (n,).
        values: shape (n, channels).
    """

    stamp: Array
    receipt: Array
    values: Array

    @property
    def stamped(self) -> bool:
        """Whether every reading carries its own time.

        Half of the readings on one clock and half on another make no time series.
        """
        return bool(len(self.stamp) and np.all(self.stamp > 0.0))

    @property
    def time(self) -> Array:
        """Header stamps when every reading has one, else times of receipt."""
        return self.stamp if self.stamped else self.receipt


class SeriesBuffer:
    """Collects readings, eight bytes a number."""

    def __init__(self, channels: int) -> None:
        self._channels = channels
        self._numbers = array("d")

    def append(self, stamp: float, receipt: float, *values: float) -> None:
        """Add a reading."""
        self._numbers.extend((stamp, receipt, *values))

    def series(self) -> Series:
        """Return what was collected."""
        table = np.array(self._numbers, dtype=float).reshape(-1, 2 + self._channels)
        return Series(table[:, 0], table[:, 1], table[:, 2:])


class Stretches(NamedTuple):
    """Readings split where the time has a gap or goes back.

    Attributes:
        parts: indices of each stretch; time rises strictly within.
        out_of_order: count of readings left out because another of that time or later came before.
    """

    parts: list[Index]
    out_of_order: int

    def seconds(self, time: Array) -> float:
        """Return the time that the stretches cover, gaps left out [s]."""
        return float(sum(time[part[-1]] - time[part[0]] for part in self.parts))


def split_at_gaps(time: Array, gap: float) -> Stretches:
    """Split readings at every step of the time by more than `gap` [s], forwards or backwards.

    Args:
        time: [s], shape (n,), in the order received.
        gap: [s].
    """
    parts: list[list[int]] = []
    out_of_order, last = 0, -np.inf
    for i, now in enumerate(time.tolist()):
        if abs(now - last) > gap:
            parts.append([i])
        elif now > last:
            parts[-1].append(i)
        else:
            out_of_order += 1
            continue
        last = now
    return Stretches([np.array(part, dtype=np.intp) for part in parts], out_of_order)


def align(slow: Series, fast: Series, age_limit: float) -> Array:
    """Return the first channel of a slow series at the times of a fast one.

    Both on header stamps when both have them and those of the slow one rise, else both on times of
    receipt: two clocks are never mixed.

    Args:
        slow, fast: the series.
        age_limit: a reading further away than this in time is not used [s].

    Returns:
        Shape (len(fast),); between two readings linear, beside only one that reading, else NaN.
    """
    stamps = slow.stamped and fast.stamped and bool(np.all(np.diff(slow.stamp) >= 0.0))
    times, at = (slow.stamp, fast.stamp) if stamps else (slow.receipt, fast.receipt)
    if not len(times):
        return np.full(len(at), np.nan)
    order = np.argsort(times, kind="stable")
    times, values = times[order], slow.values[order, 0]
    after = np.searchsorted(times, at)
    before = np.maximum(after - 1, 0)
    after = np.minimum(after, len(times) - 1)
    # At the ends both are the same reading, on one side.
    fresh_before = np.abs(at - times[before]) <= age_limit
    fresh_after = np.abs(times[after] - at) <= age_limit
    between = np.interp(at, times, values)
    return np.select([fresh_before & fresh_after, fresh_before, fresh_after],
                     [between, values[before], values[after]], np.nan)
