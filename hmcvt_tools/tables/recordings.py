# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A table that is a recording: recognised by its time, joined, and cut into steady windows.

The windows are found by `steady`, as for a bag. Signals that were written one a row are joined by
interpolation in time, never across a gap; a signal that is sent on change holds its value.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.quantities import BY_NAME, STORED
from hmcvt_core.transmission.ranges import Array

from ..steady import (
    LONGEST_LINE,
    Readings,
    Shafts,
    Steadiness,
    complaint,
    held,
    interpolated,
    reach_of,
    split_at_gaps,
    steady_tests,
    stray_stamps,
)
from .header import RawTable
from .numbers import last_digit

_RECORDED = 100
"""Rows from which a table with a step of at most `_STEP` is a recording."""
_STEP = 1.1  # s; a bench test takes longer to settle
_SLOW_RECORDED = 40
"""Rows from which a table that barely changes from row to row is a recording."""
_SLOW_STEP = 120.0  # s; slower loggers do not exist on benches
_DAY = 86_400.0  # s
_REGULAR = 0.2  # part by which the steps of a clock differ from their median
_SMOOTH = 0.1  # of the spread: the median change of a recording from row to row
_SETTINGS = 3
_SWEPT = 100
"""Fewest settings of a grid, and the most points of the sweep at one of them."""
_AGE = 5.0  # s; so far a reading of the oil holds, as in a bag
_SPARSE = 0.5
"""Share of complete rows below which signals are joined by time."""
_LINE_STEPS = 3.0
"""Rows for each signal across which a signal changes gradually, where each stands in rows of its
own."""


class Cut(NamedTuple):
    """Averages of the steady windows of a recording.

    Attributes:
        columns: bench columns, shape (n,) each.
        stages: of every window.
        notes: what was cut and left out.
    """

    columns: dict[str, Any]
    stages: tuple[str, ...]
    notes: tuple[str, ...]


class Clock(NamedTuple):
    """Stamps of a recording from zero on.

    Attributes:
        stamp: NaN where none is known or one is wrong, shape (n,) [s].
        notes: what was changed.
    """

    stamp: Array
    notes: tuple[str, ...]


def clock_of(stamp: Array) -> Clock:
    """Return stamps without single wrong ones, counted so that none is below zero.

    What is recorded before a trigger has stamps below zero.

    Args:
        stamp: times in the order of the file, NaN where none is known, shape (n,) [s].
    """
    notes = []
    wrong = stray_stamps(stamp) | stray_stamps(-stamp[::-1])[::-1]
    if wrong.any():
        notes.append(f"{int(wrong.sum())} rows with a stamp out of order left out")
    kept = np.where(wrong, np.nan, stamp)
    origin = stamp_origin(kept)
    if origin:
        notes.append(f"stamps begin below zero: times count from {origin:g} s")
    return Clock(kept - origin, tuple(notes))


def stamp_origin(stamp: Array) -> float:
    """Return the whole second from which stamps count so that none is below zero [s].

    Args:
        stamp: times [s], NaN where none is known, shape (n,).
    """
    return min(0.0, float(np.floor(np.nanmin(stamp))))


def is_recording(stamp: Array, values: Mapping[str, Array]) -> bool:
    """Return whether rows are momentary readings instead of steady tests.

    Args:
        stamp: time [s], NaN where none is known, shape (n,).
        values: other quantities, shape (n,) each.
    """
    if holds_dates_alone(stamp):
        return False
    steps = np.diff(stamp[np.isfinite(stamp)])
    if len(steps) < _SLOW_RECORDED - 1 or not np.any(steps > 0.0):
        return False
    if np.mean(steps >= 0.0) <= 0.9:
        return False
    # A log may be faster than the last digit of its clock: then most steps are 0.
    step = float(np.median(steps))
    if step < _STEP and len(stamp) >= _RECORDED:
        return True
    regular = np.abs(steps - step) <= _REGULAR * step
    if step > _SLOW_STEP or regular.mean() < 0.8:
        return False
    return step < _STEP or is_smooth(values)


def holds_dates_alone(stamp: Array) -> bool:
    """Return whether all stamps are dates without a time of day, at which no logger writes.

    Args:
        stamp: time [s], NaN where none is known, shape (n,).
    """
    known = stamp[np.isfinite(stamp)]
    return bool(len(known)) and bool(np.all((known >= _DAY) & (known % _DAY == 0.0)))


def days_of(stamp: Array) -> tuple[str, ...]:
    """Return the ISO date of each stamp [s], empty where none is known, shape (n,)."""
    days = np.where(np.isfinite(stamp), stamp, 0.0).astype("datetime64[s]")
    dates = np.datetime_as_string(days.astype("datetime64[D]"))
    return tuple(np.where(np.isfinite(stamp), dates, "").tolist())


def is_smooth(values: Mapping[str, Array]) -> bool:
    """Return whether all quantities barely change from row to row."""
    changes = []
    for name, column in values.items():
        known = column[np.isfinite(column)]
        if name == "stamp" or len(known) < _SLOW_RECORDED:
            continue
        spread = float(np.std(known))
        if spread > 1e-3 * float(np.abs(known).max()):
            changes.append(float(np.median(np.abs(np.diff(known)))) / spread)
    return bool(changes) and max(changes) < _SMOOTH


def looks_recorded(values: Mapping[str, Array]) -> bool:
    """Return whether rows without a time are so many and so alike that they are a recording."""
    rows = min(len(column) for column in values.values())
    return rows >= _RECORDED and is_smooth(values) and not is_grid(values)


def even_columns(table: RawTable) -> list[str]:
    """Return the columns that go in equal steps to the last digit, as in a computed curve.

    Readings of meters do not. The step to an end of the range may differ, and a number that only
    counts the rows is left aside.
    """
    names = []
    for name, cells in table.columns.items():
        values = table.numbers(name).values[1:-1]
        if len(values) < _RECORDED - 2 or not np.all(np.isfinite(values)):
            continue
        step = (values[-1] - values[0]) / (len(values) - 1)
        comma = table.styles[name].comma
        # Cells may be written without zeros at their end, so that the finest one decides.
        digit = min(last_digit(cell, comma) for cell in cells[1:_FORMATTED])
        line = values[0] + step * np.arange(len(values))
        is_count = abs(step) == 1.0
        is_even = np.all(np.abs(values - line) <= digit)
        if is_even and abs(step) > _MIN_STEP * digit and not is_count:
            names.append(name)
    return names


_FORMATTED = 20
"""Cells by which the last digit of a column is judged."""
_MIN_STEP = 2.0
"""Last digits that an even step has at least: rounding hides the noise of smaller ones."""


def is_grid(values: Mapping[str, Array]) -> bool:
    """Return whether rows go through a grid: one quantity set, another one swept at each setting.

    In a grid each setting stands in one run of rows, exactly, and the swept quantity begins again
    at each. A sweep of more rows than a bench takes points is a ramp of a recording.
    """
    for name, column in values.items():
        starts = np.flatnonzero(np.diff(column) != 0.0) + 1
        settings = len(starts) + 1
        if settings < _SETTINGS or len(np.unique(column)) != settings:
            continue
        if len(column) > _SWEPT * settings:
            continue
        within = np.delete(np.arange(1, len(column)), starts - 1)
        for other, swept in values.items():
            steps = np.diff(swept)
            if other == name or not within.size or not np.all(np.isfinite(steps)):
                continue
            for sign in (1.0, -1.0):
                rises = sign * steps > 0.0
                if rises[within - 1].all() and not rises[starts - 1].any():
                    return True
    return False


def cut(
    values: Mapping[str, Array], extra: Mapping[str, Sequence[str]], source: str
) -> Cut:
    """Average the steady windows of a recording.

    Args:
        values: SI values with `stamp`, shape (n,) each, NaN where a cell holds none.
        extra: other columns; `stage` is the stage engaged.
        source: name of the file, for messages.

    Raises:
        InputError: no window is steady and in range.
    """
    rows = len(values["stamp"])
    part = windows_of(values, extra.get("stage", [""] * rows), source)
    kept = part.kept
    note = (
        f"a recording of {rows} rows was cut into {len(kept)} steady windows of "
        f"{part.limits.min_duration:g} s and more (--averaged takes each row as a test); "
        f"{out_of_range_note(part.out_of_range)} and {part.incomplete} rows without a "
        "number left out"
    )
    if not kept:
        raise InputError(f"{source}: {note}{_no_window(part.span, part.limits)}")
    notes = [note, *part.notes]
    not_averaged = [name for name in _NOT_AVERAGED if name in values]
    not_averaged += [name for name in extra if name != "stage"]
    if not_averaged:
        notes.append(f"not averaged, left out: {', '.join(not_averaged)}")
    columns = bench_columns([sample for _, sample in kept])
    if "output_speed" not in values:
        columns.pop("output_speed", None)
    return Cut(columns, tuple(stage for stage, _ in kept), tuple(notes))


class Windows(NamedTuple):
    """Steady windows of a recording, or of a part of it.

    Attributes:
        kept: stage and averages of each window that makes a bench sample.
        out_of_range: why windows make none, one reason for each.
        incomplete: rows that lack a number.
        span: time that the usable rows cover [s].
        limits: when a window counts as steady.
        notes: what was left out or joined.
    """

    kept: list[tuple[str, dict[str, float]]]
    out_of_range: list[str]
    incomplete: int
    span: float
    limits: Steadiness
    notes: tuple[str, ...]


def windows_of(
    values: Mapping[str, Array], stage_of_row: Sequence[str], source: str
) -> Windows:
    """Find the steady windows of a recording.

    Args:
        values: SI values with `stamp`, shape (n,) each, NaN where a cell holds none.
        stage_of_row: stage engaged, n of them.
        source: name of the file, for messages.

    Raises:
        InputError: no row holds all quantities.
    """
    signals, out_of_range = _in_range(_averaged_signals(values))
    needed = [name for name in signals if name != "oil_temperature"]
    time = values["stamp"]
    joined = _joined(time, signals, needed)
    complete = np.isfinite(time)
    for name in needed:
        complete &= np.isfinite(joined[name])
    usable = complete & (joined["engine_speed"] > 0.0)
    if not usable.any():
        raise InputError(f"{source}: {_no_row(time, signals, needed)}")
    stages = np.array(stage_of_row)[usable]
    readings = _readings(time[usable], {n: c[usable] for n, c in joined.items()})
    block = max(1.0, 4.0 * _median_step(readings.time))
    limits = Steadiness(max(5.0, 3.0 * block), block)
    tests = _tests_by_stage(readings, stages, limits)
    kept = []
    reasons = []
    for stage, sample in tests:
        reason = complaint(sample)
        if reason is None:
            kept.append((stage, sample))
        else:
            reasons.append(reason)
    notes = list(out_of_range)
    if joined is not signals:
        notes.append("signals of rows of their own were joined by time")
    return Windows(
        kept,
        reasons,
        int(np.sum(~usable)),
        readings.span,
        limits,
        tuple(notes),
    )


def out_of_range_note(reasons: Sequence[str]) -> str:
    """Return how many windows are out of range, and by which quantity.

    Args:
        reasons: one for each window, see `complaint`.
    """
    note = f"{len(reasons)} windows out of range"
    if not reasons:
        return note
    counts = Counter(reason.removesuffix(" out of range") for reason in reasons)
    listed = ", ".join(f"{name} in {count}" for name, count in counts.items())
    return f"{note} ({listed})"


_NOT_AVERAGED = tuple(column.name for column in STORED if not column.averaged)


def _averaged_signals(values: Mapping[str, Array]) -> dict[str, Array]:
    """Return the quantities that are averaged over a window."""
    signals = {}
    for name, column in values.items():
        if name != "stamp" and name not in _NOT_AVERAGED:
            signals[name] = column
    return signals


def _tests_by_stage(
    readings: Readings, stages: NDArray[np.str_], limits: Steadiness
) -> list[tuple[str, Any]]:
    """Return the steady windows with their stage; a shift ends a window as a gap does."""
    gap = max(1.0, limits.block)
    shifts = np.cumsum(np.append(False, stages[1:] != stages[:-1]))
    tests = []
    for part in split_at_gaps(readings.time + 3.0 * gap * shifts, gap):
        for _, sample in steady_tests([readings.select(part)], limits):
            tests.append((str(stages[part[0]]), sample))
    return tests


def bench_columns(samples: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the columns of samples that have the same keys."""
    columns = {}
    for name in samples[0]:
        columns[name] = np.array([sample[name] for sample in samples])
    return columns


def _in_range(
    signals: Mapping[str, Array],
) -> tuple[dict[str, Array], list[str]]:
    """Drop readings that no bench shows, so that no code for "no value" enters a mean."""
    cleaned = {}
    notes = []
    for name, column in signals.items():
        limits = BY_NAME[name]
        # An engine that coasts turns torques and powers round; a shaft may stand.
        least = -limits.high if name not in ("engine_speed", "oil_temperature") else 0.0
        if name == "oil_temperature":
            least = limits.low
        # A sensor of stroke may read a little above full stroke.
        most = 1.05 * limits.high
        outside = (column > most) | (column < 1.05 * least)
        if outside.any():
            notes.append(
                f"{int(outside.sum())} readings of {name} out of range left out"
            )
        cleaned[name] = np.where(outside, np.nan, column)
    return cleaned, notes


def _joined(
    time: Array, signals: dict[str, Array], needed: Sequence[str]
) -> dict[str, Array]:
    """Return signals at the time of every row, where most rows hold only some of them."""
    filled = np.stack([np.isfinite(signals[name]) for name in needed])
    sparse = np.isfinite(time) & filled.any(axis=0)
    if filled.all(axis=0).sum() >= _SPARSE * max(int(sparse.sum()), 1):
        return signals
    rows_apart = _median_step(np.sort(time[sparse]))
    line = max(LONGEST_LINE, _LINE_STEPS * len(needed) * rows_apart)
    joined = dict(signals)
    for name in needed:
        joined[name] = _interpolated(time, signals[name], line)
    return joined


def _interpolated(time: Array, column: Array, line: float) -> Array:
    """Return a signal at the time of every row, but not across a gap.

    Args:
        time: of the rows, NaN where none is known [s].
        column: the signal, NaN where a row holds none.
        line: longest step across which it changes gradually [s].
    """
    known = np.isfinite(column) & np.isfinite(time)
    if known.sum() < 2:
        return column
    times, first = np.unique(time[known], return_index=True)
    if len(times) < 2:
        return column
    readings = column[known][first]
    reach = reach_of(times)
    rows = np.nan_to_num(time, nan=-np.inf)
    return interpolated(rows, times, readings, reach, line)


def _median_step(time: Array) -> float:
    steps = np.diff(time)
    rising = steps[steps > 0.0]
    return float(np.median(rising)) if len(rising) else 1.0


def _readings(time: Array, values: Mapping[str, Array]) -> Readings:
    """Return readings of both shafts in order of time."""
    spread = _spread(time)
    speed = values["engine_speed"]
    into, out = powers(values)
    output_speed = values.get("output_speed", speed)
    turning = np.where(output_speed != 0.0, output_speed, 1.0)
    output_torque = np.where(output_speed != 0.0, out / turning, 0.0)
    oil = values.get("oil_temperature")
    if oil is not None:
        known = np.isfinite(oil)
        oil = held(spread, spread[known], oil[known], _AGE) if known.any() else None
    shafts = Shafts(
        speed, into / speed, output_speed, output_torque, values["displacement_ratio"]
    )
    return Readings(spread, shafts, oil)


def _spread(stamp: Array) -> Array:
    """Spread rows within one tick of a clock that is slower than the log."""
    first = np.flatnonzero(np.diff(stamp, prepend=-np.inf))
    counts = np.diff(np.append(first, len(stamp)))
    if np.median(counts) == 1.0:
        return stamp  # what stands twice is a copy
    position = np.arange(len(stamp)) - np.repeat(first, counts)
    part = position / np.repeat(counts, counts)
    return np.asarray(stamp + np.median(np.diff(stamp[first])) * part)


def _no_row(time: Array, signals: Mapping[str, Array], needed: Sequence[str]) -> str:
    """Say why no row of a recording can be used."""
    counts = {name: int(np.isfinite(signals[name]).sum()) for name in needed}
    if not np.isfinite(time).any():
        return "no row holds a time"
    densest = max(counts, key=lambda name: counts[name])
    sparsest = min(counts, key=lambda name: counts[name])
    return (
        f"no row holds all of {', '.join(needed)}, and they cannot be joined by time: "
        f"{densest} has {counts[densest]} readings, {sparsest} {counts[sparsest]}"
    )


def _no_window(span: float, limits: Steadiness) -> str:
    if span >= limits.min_duration:
        return "; nothing stays steady for so long"
    return f"; it lasts {span:.3g} s"


def powers(values: Mapping[str, Array]) -> tuple[NDArray[np.float64], Array]:
    """Return the power of the engine and of the output [W].

    Args:
        values: SI values by quantity, enough for bench samples.
    """
    if "load_torque" in values:
        out = values["load_torque"] * values["engine_speed"]
    elif "torque_loss" in values and "engine_torque" in values:
        remaining = values["engine_torque"] - values["torque_loss"]
        out = remaining * values["engine_speed"]
    elif "output_torque" in values:
        out = values["output_torque"] * values["output_speed"]
    elif "output_power" in values:
        out = values["output_power"]
    else:
        out = values["efficiency"] * _engine_power(values)
    if "engine_torque" in values or "engine_power" in values:
        return _engine_power(values), out
    return out / values["efficiency"], out


def _engine_power(values: Mapping[str, Array]) -> Array:
    if "engine_torque" in values:
        return values["engine_torque"] * values["engine_speed"]
    return values["engine_power"]
