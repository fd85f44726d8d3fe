# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Signals of different rates on one time axis, piece by piece.

Numbers are interpolated between two readings up to a second apart; across longer steps they keep
the previous reading, since a set-point may be sent on change only. States keep the previous one.
Neither reaches across a gap, which is a step of more than three of the channel's usual steps; a
channel that is slower than any meter is sent on change, and reaches farther.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.transmission.ranges import Array

from ..steady import FEWEST_STEPS, LONGEST_HOLD, LONGEST_REACH, interpolated, reach_of
from .series import Remarks, Series, joined_series


class Joined(NamedTuple):
    """Signals at common times.

    Attributes:
        time: [s], rising, shape (n,).
        values: by channel, shape (n,) each: numbers, NaN where there is none; or texts, empty
            where there is none.
    """

    time: Array
    values: dict[str, Any]


class Joiner:
    """Joins the pieces of a log.

    Args:
        names: channels; each is a column of the result.
        clock: channel whose times are taken.
        step: least distance of two times [s]; 0 takes every reading of the clock.
        remarks: where gaps are counted.
    """

    def __init__(
        self, names: Collection[str], clock: str, step: float, remarks: Remarks
    ) -> None:
        self._names = list(names)
        self._clock = clock
        self._step = step
        self._remarks = remarks
        self._kept: dict[str, Series] = {}
        self._reach: dict[str, float] = {}
        self._text: set[str] = set()
        self._done = -np.inf

    def rows(self, pieces: Iterable[Mapping[str, Series]]) -> Iterator[Joined]:
        """Yield the signals at common times, one piece after the other."""
        for piece in pieces:
            for name, series in piece.items():
                self._append(name, series)
            latest = self._latest()
            lag = max(self._reach.get(name, LONGEST_REACH) for name in self._names)
            if np.isfinite(latest):
                yield from self._until(latest - lag)
        yield from self._until(np.inf)

    def _append(self, name: str, series: Series) -> None:
        if not len(series.time):
            return
        before = self._kept.get(name)
        first = series
        if before is not None:
            # The last reading before shows a gap between two pieces.
            first = Series(np.append(before.time[-1:], series.time), series.values)
            series = joined_series([before, series])
        self._kept[name] = series
        if series.values.dtype.kind == "U":
            self._text.add(name)
        self._note_reach(name, series.time)
        reach = self._reach.get(name, LONGEST_REACH)
        steps = np.diff(first.time)
        (gaps,) = np.nonzero(steps > reach)
        if len(gaps):
            longest = float(steps[gaps].max())
            self._remarks.add(
                name,
                "gaps, across which it is not joined",
                float(first.time[gaps[int(np.argmax(steps[gaps] == longest))]]),
                len(gaps),
            )

    def _note_reach(self, name: str, time: Array) -> None:
        """Keep how far a channel reaches once enough readings show it."""
        if self._reach.get(name, LONGEST_HOLD) < LONGEST_HOLD or len(time) < 2:
            return
        reach = reach_of(time)
        if len(time) > FEWEST_STEPS or reach == LONGEST_HOLD:
            self._reach[name] = reach

    def _latest(self) -> float:
        times = [series.time[-1] for series in self._kept.values()]
        return float(max(times, default=-np.inf))

    def _until(self, end: float) -> Iterator[Joined]:
        """Yield the times up to an end [s], and forget what no later time needs."""
        clock = self._kept.get(self._clock)
        if clock is None:
            return
        axis = self._axis(clock.time[(clock.time > self._done) & (clock.time <= end)])
        if len(axis):
            values = {name: self._at(name, axis) for name in self._names}
            self._done = float(axis[-1])
            yield Joined(axis, values)
        for name, series in self._kept.items():
            reach = self._reach.get(name, LONGEST_REACH)
            first = int(np.searchsorted(series.time, self._done - reach)) - 1
            first = max(first, 0)
            self._kept[name] = series.between(first, len(series.time))

    def _axis(self, time: Array) -> Array:
        """Return readings of the clock that are at least a step apart [s]."""
        if self._step <= 0.0 or not len(time):
            return time
        ticks = np.floor(time / self._step + 1e-6)
        first = np.append(True, np.diff(ticks) > 0.0)
        if np.isfinite(self._done):
            first &= ticks > np.floor(self._done / self._step + 1e-6)
        return np.asarray(time[first])

    def _at(self, name: str, axis: Array) -> Any:
        """Return a channel at times [s]."""
        series = self._kept.get(name)
        if series is None:
            return np.full(len(axis), np.nan)
        reach = self._reach.get(name, LONGEST_REACH)
        if name in self._text:
            return _held(series, axis, reach)
        values = np.asarray(series.values, dtype=float)
        return interpolated(axis, series.time, values, reach)


def _held(series: Series, axis: Array, reach: float) -> Any:
    """Return the previous reading at times [s], empty where it is older than the reach."""
    before = np.searchsorted(series.time, axis, side="right") - 1
    clipped = np.maximum(before, 0)
    fresh = (before >= 0) & (axis - series.time[clipped] <= reach)
    return np.where(fresh, series.values[clipped], "")
