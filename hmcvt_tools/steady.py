# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Momentary readings of a bench, their steady windows, and how well a mean in one is known.

The series is cut into short blocks. A run of blocks is steady when in each channel the means of the
blocks agree (drift) and no block scatters too much. Blocks average the noise away, so that drift
can be judged tightly although single readings are noisy; and the tail of a transient, which a line
fitted over a long window would hide, shows in the first block. The longest steady run is taken
first, then the longest in what is left on either side, so that a plateau is not spoilt by a run
that began in the transient before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import (
    BENCH_COLUMNS,
    DISPLACEMENT_RATIO,
    EFFICIENCY_STD,
    Array,
)

MIN_BLOCKS = 3  # fewer block means show no drift
_MIN_READINGS = 3  # in a block; fewer have no scatter to speak of
_LAGS_SUMMED = 3.0  # in correlation times
_ZERO_ERROR = (
    0.01  # at full stroke a stroke sensor may read this much above 1 on average
)
_MAX_LAGS = 4  # a quarter of the readings: further lags have too few pairs


def limit(default: float, text: str) -> Any:
    """A setting that is a positive number, and what it limits."""
    return field(default=default, metadata={"text": text})


@dataclass(frozen=True)
class Steadiness:
    """When a bench counts as steady.

    A window is cut into blocks. Drift is the spread of the block means, largest less smallest;
    scatter is the standard deviation within a block. Both are fractions of the mean, those of the
    displacement ratio plain numbers. The metadata of each field states what it limits; a block is
    short against a window and long against the noise.

    Raises:
        InputError: a value is not positive, or a window holds fewer than 3 blocks.
    """

    min_duration: float = limit(5.0, "Shortest steady window in s.")
    block: float = limit(1.0, "Blocks of this many s are averaged to judge drift.")
    speed_drift: float = limit(
        0.005, "Of engine and output speed over a window, a fraction."
    )
    speed_scatter: float = limit(
        0.01, "Of engine and output speed in a block, a fraction."
    )
    torque_drift: float = limit(
        0.02, "Of engine and load torque over a window, a fraction."
    )
    torque_scatter: float = limit(
        0.05, "Of engine and load torque in a block, a fraction."
    )
    displacement_drift: float = limit(
        0.01, "Of the displacement ratio over a window; also its scatter."
    )

    def __post_init__(self) -> None:
        require_positive(self)
        if self.min_duration < MIN_BLOCKS * self.block:
            raise InputError(
                f"min_duration = {self.min_duration:g} s holds fewer than "
                f"{MIN_BLOCKS} blocks of {self.block:g} s"
            )


def require_positive(settings: Any) -> None:
    """Refuse a `limit` that is not a positive number."""
    for name in (item.name for item in fields(settings) if item.metadata):
        if not 0.0 < (value := getattr(settings, name)) < math.inf:
            raise InputError(f"{name} = {value:g}: a positive number is needed")


class Channels(NamedTuple):
    """Quantities that have to be settled.

    Attributes:
        values: shape (c, n).
        drift: largest spread of block means, shape (c,).
        scatter: largest standard deviation in a block, shape (c,).
        relative: whether both are fractions of the mean, shape (c,).
    """

    values: Array
    drift: Array
    scatter: Array
    relative: NDArray[np.bool_]


def block_statistics(
    time: Array, values: Array, block: float
) -> tuple[NDArray[np.intp], Array, Array]:
    """Cut a series at times (n,) [s], values (c, n), into blocks [s]; the rest is left over.

    Returns:
        Edges, shape (blocks + 1,): block k holds the readings edges[k] to edges[k + 1] - 1. Means
        and standard deviations, shape (c, blocks); NaN for a block of fewer than 3 readings.
    """
    if len(time) < _MIN_READINGS:
        return np.zeros(1, dtype=np.intp), *np.empty((2, len(values), 0))
    # The last reading stands for a step of time, as every other one does.
    span = time[-1] - time[0] + np.median(np.diff(time))
    count = int(span / block + 1e-6)
    edges = np.searchsorted(time, time[0] + block * (np.arange(count + 1) - 1e-6))
    origin = values[:, :1]
    means, deviations = np.full((2, len(values), count), np.nan)
    for k, (first, last) in enumerate(pairwise(edges)):
        if last - first >= _MIN_READINGS:
            part = values[:, first:last] - origin
            means[:, k], deviations[:, k] = part.mean(axis=1), part.std(axis=1, ddof=1)
    return edges, means + origin, deviations


def find_windows(
    time: Array, channels: Channels, steadiness: Steadiness
) -> list[slice]:
    """Steady windows of a series without gaps, at times (n,) that rise [s], in order."""
    edges, means, deviations = block_statistics(time, channels.values, steadiness.block)
    least = int(np.ceil(steadiness.min_duration / steadiness.block - 1e-9))
    return [
        slice(int(edges[first]), int(edges[last]))
        for first, last in _longest_first(_reach(means, deviations, channels), least)
    ]


def _reach(means: Array, deviations: Array, channels: Channels) -> NDArray[np.intp]:
    """For each block the end (exclusive) of the longest steady run that starts there."""
    relative = channels.relative
    scale = np.where(relative[:, None], np.abs(means), 1.0)
    # False for NaN.
    quiet = np.all(deviations <= channels.scatter[:, None] * scale, axis=0)
    count = means.shape[1]
    reach = np.arange(count, dtype=np.intp)
    end = 0
    for start in np.flatnonzero(quiet).tolist():
        end = max(end, start + 1)
        low, high = means[:, start:end].min(axis=1), means[:, start:end].max(axis=1)
        while end < count and quiet[end]:
            low, high = np.minimum(low, means[:, end]), np.maximum(high, means[:, end])
            # The larger end as the scale: then a run never becomes steady by growing, and the
            # ends of successive runs never go back.
            largest = np.where(relative, np.maximum(np.abs(low), np.abs(high)), 1.0)
            if np.any(high - low > channels.drift * largest):
                break
            end += 1
        reach[start] = end
    return reach


def _longest_first(reach: NDArray[np.intp], least: int) -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    free = [(0, len(reach))]
    while free:
        first, last = free.pop()
        lengths = np.minimum(reach[first:last], last) - np.arange(first, last)
        if (longest := int(lengths.max(initial=0))) >= least:
            start = first + int(np.argmax(lengths))
            found.append((start, start + longest))
            free += [(first, start), (start + longest, last)]
    return sorted(found)


def effective_size(values: Array) -> float:
    """Return the number of independent readings with as good a mean.

    The autocorrelations rho_k are summed up to the first lag M that is 3 times the sum so far,
    S = 1 + 2 sum(rho_k) (Sokal's automatic windowing): further lags add noise only. About the
    sample's own mean every rho_k comes out too small by the very variance sought; with that put
    back, variance of the mean = s^2 S / (n - 2 M - 1) = s^2 / (size - 1). Readings that alternate
    would give S < 1; that gain is not taken.

    The deviation that follows is still a fifth too small when the time constant of the noise is
    1/20 of the series: so short a series cannot show it.

    Args:
        values: equally spaced readings, shape (n,), n at least 2.
    """
    count = len(values)
    centred = values - values.mean()
    spectrum = np.fft.rfft(centred, 1 << (2 * count - 1).bit_length())
    products = np.fft.irfft(np.abs(spectrum) ** 2)[: count // _MAX_LAGS + 1]
    if not products[0] > 0.0:
        return float(count)
    sums = np.maximum(2.0 * np.cumsum(products / products[0]) - 1.0, 1.0)
    enough = np.flatnonzero(np.arange(len(sums)) >= _LAGS_SUMMED * sums)
    last = int(enough[0]) if len(enough) else len(sums) - 1
    return 1.0 + float((count - 2 * last - 1) / sums[last])


def ratio_of_means(numerator: Array, denominator: Array) -> tuple[float, float, float]:
    """Return mean(numerator) / mean(denominator), its standard deviation and effective size.

    The deviation is that of the mean of `numerator - ratio denominator`, so that what moves both
    alike cancels; NaN for a single reading. Both are NaN where the denominator is 0 on average.

    Args:
        numerator, denominator: equally spaced readings, shape (n,).
    """
    base = float(denominator.mean())
    value = float(numerator.mean()) / base if base else math.nan
    if len(numerator) == 1 or not base:
        return value, math.nan, float(len(numerator))
    residual = numerator - value * denominator
    size = effective_size(residual)
    return value, float(residual.std()) / abs(base) / math.sqrt(size - 1.0), size


class Shafts(NamedTuple):
    """Readings of both shafts: numbers, or arrays of one shape.

    Attributes:
        engine_speed, engine_torque, output_speed, output_torque: rad/s, N m.
        displacement_ratio: NaN where the message does not hold it.
    """

    engine_speed: Any
    engine_torque: Any
    output_speed: Any
    output_torque: Any
    displacement_ratio: Any

    @property
    def engine_power(self) -> Any:
        """[W]."""
        return self.engine_torque * self.engine_speed

    @property
    def output_power(self) -> Any:
        """[W]."""
        return self.output_torque * self.output_speed

    @property
    def load_torque(self) -> Any:
        """Output power / engine speed [N m]."""
        return self.output_power / self.engine_speed

    @property
    def efficiency(self) -> Any:
        """Output power / engine power [-]."""
        return self.output_power / self.engine_power


class Readings(NamedTuple):
    """Momentary readings of a bench.

    Attributes:
        time: [s], shape (n,).
        shafts: arrays of shape (n,).
        oil_temperature: [deg C], shape (n,), NaN where none is known; None when no topic has it.
    """

    time: Array
    shafts: Shafts
    oil_temperature: Array | None

    @property
    def span(self) -> float:
        """Time that they cover [s]."""
        return float(self.time[-1] - self.time[0])

    def select(self, index: slice | list[int]) -> Readings:
        """Return some of the readings."""
        temperature = (
            None if self.oil_temperature is None else self.oil_temperature[index]
        )
        return Readings(
            self.time[index],
            Shafts(*(column[index] for column in self.shafts)),
            temperature,
        )


@dataclass(frozen=True)
class SteadyWindow:
    """One steady window: time of its first message and duration [s], count of messages.

    `effective_size` is how many independent messages would determine as much.
    """

    start: float
    duration: float
    messages: int
    effective_size: float


def split_at_gaps(time: Array, gap: float) -> list[list[int]]:
    """Split readings (n,) at every step of their time [s] by more than a gap, either way.

    Returns:
        Indices of each stretch, in which time rises strictly: a reading is left out when another
        of its time or later came before.
    """
    parts: list[list[int]] = []
    last = -np.inf
    for i, now in enumerate(time.tolist()):
        if abs(now - last) > gap:
            parts.append([])
        elif now <= last:
            continue
        parts[-1].append(i)
        last = now
    return parts


def stray_stamps(time: Array) -> NDArray[np.bool_]:
    """Return which stamps jump ahead for one reading, shape (n,).

    The clock goes on below them, so that the reading is dropped and not all that follow.

    Args:
        time: stamps in the order of the file, NaN where none is known, shape (n,) [s].
    """
    stray = np.zeros(len(time), dtype=bool)
    known = np.flatnonzero(np.isfinite(time))
    stamps = time[known]
    if len(stamps) < 3:
        return stray
    before = np.append(-np.inf, stamps[:-1])
    after = np.append(stamps[1:], np.inf)
    ahead = (stamps > after) & (before < after)
    # The first one is wrong only where the second one is not.
    ahead[0] = stamps[0] > stamps[2] > stamps[1]
    stray[known] = ahead
    return stray


_MAX_STEPS = 3.0
"""Usual steps of a signal across which it is joined; more is a gap."""
_MIN_REACH = 0.05
"""A signal reaches at least so far [s]: loggers batch frames, so that steps vary."""
LONGEST_REACH = 30.0
"""And at most so far [s]."""
_SLOWEST_METER = 10.0
"""Usual step from which on a signal is sent on change [s]: temperatures are read at 0.1 Hz."""
LONGEST_HOLD = 600.0
"""So far a signal that is sent on change holds its value [s]; a test takes minutes."""
LONGEST_LINE = 1.0
"""Longest step across which a number changes gradually [s]; beyond, it holds until the next one."""
FEWEST_STEPS = 10
"""Steps from which the usual step of a signal is known well enough to be kept."""


def reach_of(times: Array) -> float:
    """Return the longest step of a signal that is no gap [s].

    Args:
        times: of its readings, rising, two or more [s].
    """
    usual = float(np.median(np.diff(times)))
    if usual > _SLOWEST_METER:
        return LONGEST_HOLD
    return float(np.clip(_MAX_STEPS * usual, _MIN_REACH, LONGEST_REACH))


def interpolated(
    at: Array, times: Array, values: Array, reach: float, line: float = LONGEST_LINE
) -> Array:
    """Return readings between two of which no gap lies; NaN elsewhere.

    Numbers are interpolated between two readings up to `line` apart; across longer steps they keep
    the previous reading, since a set-point may be sent on change only.

    Args:
        at: times at which they are wanted, shape (n,) [s].
        times: of the readings, rising [s].
        values: readings, NaN where there is none.
        reach: longest step that is no gap, see `reach_of` [s].
        line: longest step across which a number changes gradually [s].
    """
    finite = np.isfinite(values)
    time = times[finite]
    known = values[finite]
    if not len(time):
        return np.full(len(at), np.nan)
    after = np.searchsorted(time, at)
    right = np.minimum(after, len(time) - 1)
    left = np.maximum(after - 1, 0)
    at_reading = time[right] == at
    step = time[right] - time[left]
    inside = (after > 0) & (after < len(time))
    close = inside & (step <= reach)
    # Before the first and behind the last reading the nearest one holds for half a gap; what it
    # was before a change is not known.
    before = (after == 0) & (time[0] - at <= min(0.5 * reach, line))
    behind = (after == len(time)) & (at - time[-1] <= 0.5 * reach)
    result = np.interp(at, time, known)
    holds = inside & ~at_reading & (step > line)
    result = np.where(holds, known[left], result)
    return np.where(at_reading | close | before | behind, result, np.nan)


def held(at: Array, times: Array, values: Array, age: float) -> Array:
    """Values (m,) of a slow series, read at times (m,), at other times [s].

    Linear between two readings; with only one within an age [s], that reading; else NaN.
    """
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    after = np.searchsorted(times, at)
    around = np.clip([after - 1, after], 0, len(times) - 1)
    fresh = np.abs(at - times[around]) <= age
    return np.select(
        [fresh.all(axis=0), *fresh],
        [np.interp(at, times, values), *values[around]],
        np.nan,
    )


SETTLED = (
    "engine_speed",
    "output_speed",
    "engine_torque",
    "load_torque",
    "displacement_ratio",
)
"""What has to be settled.

The load torque alone is not enough: an engine that takes up speed shows in the engine torque
only. The output speed shows a stroke that still moves when the displacement ratio in the log is
the one commanded.
"""


def channels(readings: Readings, limits: Steadiness) -> Channels:
    """Return the quantities of `SETTLED` and their limits."""
    stroke = limits.displacement_drift
    drift = np.repeat([limits.speed_drift, limits.torque_drift, stroke], (2, 2, 1))
    scatter = np.repeat(
        [limits.speed_scatter, limits.torque_scatter, stroke], (2, 2, 1)
    )
    return Channels(
        np.stack([getattr(readings.shafts, name) for name in SETTLED]),
        drift,
        scatter,
        np.array(SETTLED) != "displacement_ratio",
    )


def steady_tests(
    stretches: Iterable[Readings], limits: Steadiness, averaged: bool = False
) -> list[tuple[SteadyWindow, dict[str, float]]]:
    """Average the steady windows of stretches without gaps, or each as a whole; see `average`."""
    return [
        average(part)
        for stretch in stretches
        for part in (
            [stretch]
            if averaged
            else map(
                stretch.select,
                find_windows(stretch.time, channels(stretch, limits), limits),
            )
        )
    ]


def average(part: Readings) -> tuple[SteadyWindow, dict[str, float]]:
    """Average the readings of a steady window, by column of a bench file; `stamp` is its middle.

    Efficiency is mean output power / mean engine power, its deviation that of the mean from the
    scatter within the window; a single reading does not show how well it is known.
    """
    shafts, start, end = part.shafts, float(part.time[0]), float(part.time[-1])
    efficiency, std, size = ratio_of_means(shafts.output_power, shafts.engine_power)
    speed, stroke = (
        float(shafts.engine_speed.mean()),
        float(shafts.displacement_ratio.mean()),
    )
    if abs(stroke) <= DISPLACEMENT_RATIO.high + _ZERO_ERROR:
        stroke = float(np.clip(stroke, DISPLACEMENT_RATIO.low, DISPLACEMENT_RATIO.high))
    values = {
        "displacement_ratio": stroke,
        "engine_speed": speed,
        "load_torque": float(shafts.output_power.mean()) / speed,
        "efficiency": efficiency,
        "output_speed": float(shafts.output_speed.mean()),
        "stamp": (start + end) / 2.0,
    }
    if part.oil_temperature is not None:
        known = part.oil_temperature[~np.isnan(part.oil_temperature)]
        # A few readings without a temperature do no harm; a window mostly without one has none.
        enough = 2 * len(known) > len(part.oil_temperature)
        values["oil_temperature"] = float(known.mean()) if enough else math.nan
    if len(part.time) > 1:
        # A log without any noise still has a last digit.
        values["efficiency_std"] = max(std, EFFICIENCY_STD.low)
    return SteadyWindow(start, end - start, len(part.time), size), values


def complaint(values: Mapping[str, float]) -> str | None:
    """Say why averages make no bench sample, None when they do."""
    if math.isnan(values.get("oil_temperature", 0.0)):
        return "no oil_temperature in time (--no-oil-temperature does without)"
    return next(
        (
            f"{column.name} out of range"
            for column in BENCH_COLUMNS
            if column.name in values and not column.contains(values[column.name])
        ),
        None,
    )
