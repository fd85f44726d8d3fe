# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A recording in whose table several tasks have a clock each.

Programs that export such a recording write the column of a clock in front of the columns that it
belongs to.
"""

import re
from collections.abc import Mapping

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from ..steady import interpolated, reach_of
from .header import RawTable
from .proposal import Column
from .recordings import holds_dates_alone
from .rules import meaning_of
from .stamps import read_times

_SAME_TIME = 0.5
"""Seconds by which two clocks of one recording differ at most; a steady window is ten times as
long."""
_WHOLE_SECOND = 1.0
"""Dates may be written in whole seconds."""
_FILLED = 0.5
"""Fraction of the cells of a clock that hold a number, up to its last one."""
_RISING = 0.9
"""Fraction of steps that rise in a column of times."""
_NUMBERED = re.compile(r" \(\d+\)$")
"""Number that the reader puts behind a name that stands in the header more than once."""
_ELAPSED = 1e8
"""Numbers up to this one are elapsed times [s]; larger ones are dates."""


def join_clocks(
    values: dict[str, Array], columns: Mapping[str, Column], table: RawTable
) -> list[str]:
    """Bring all columns to the clock of the engine speed; return a note on those of another one.

    Args:
        values: SI values by quantity with `stamp`, shape (n,) each; changed in place.
        columns: where they stand.
        table: as text.

    Raises:
        InputError: clocks differ, and a column stands in front of all of them.
    """
    clocks = _clocks(table)
    stamp = columns["stamp"].name
    if stamp not in clocks:
        return []
    owner = _owners(table, set(clocks))
    placed = {}
    for quantity, column in columns.items():
        if quantity != "stamp" and column.name in table.columns:
            placed[quantity] = owner.get(column.name, "")
    main = placed.get("engine_speed") or stamp
    others = {}
    for name in dict.fromkeys(placed.values()):
        if name and name != main and _differ(clocks[main], clocks[name]):
            others[name] = clocks[name]
    if not others:
        return []
    for name, time in others.items():
        if _is_dated(time) != _is_dated(clocks[main]):
            raise InputError(
                f"{table.source}: of the times in {main!r} and {name!r} one counts from the "
                "start and one is a date, and they do not go on alike: keep one of them"
            )
    first = [quantity for quantity, name in placed.items() if not name]
    if first:
        in_front = columns[first[0]].name
        raise InputError(
            f"{table.source}: the times in {' and '.join(map(repr, clocks))} differ, and "
            f"column {in_front!r} stands in front of them: put each time in front of the "
            "columns that it belongs to"
        )
    values["stamp"] = clocks[main]
    joined = []
    for quantity, name in placed.items():
        if name in others:
            values[quantity] = _at(clocks[main], others[name], values[quantity])
            joined.append(f"{columns[quantity].name!r} by {name!r}")
    return [
        f"clocks differ, each is that of the columns behind it: {', '.join(joined)}"
    ]


def _clocks(table: RawTable) -> dict[str, Array]:
    """Return the times of columns that rise as a clock does [s], by name."""
    clocks = {}
    for name, cells in table.columns.items():
        unit = table.units.get(name, "")
        meaning = meaning_of(_NUMBERED.sub("", name), unit)
        # The name of a clock may be that of its task, as in `t_stroke [s]`.
        has_unit = meaning.unit is not None and meaning.unit.kind == "time"
        if meaning.excluded or not (has_unit or meaning.kind == "time"):
            continue
        of_header = meaning.unit.name if has_unit and meaning.unit is not None else ""
        time = read_times(cells, of_header, table.styles[name].comma).seconds
        if _is_clock(time):
            clocks[name] = time
    return clocks


def _is_clock(time: Array) -> bool:
    """Return whether times rise, from the first row to their last one.

    A task that reads slower than another one has fewer rows.
    """
    rows = np.flatnonzero(np.isfinite(time))
    if len(rows) < 2 or len(rows) < _FILLED * (rows[-1] + 1):
        return False
    known = time[rows]
    return bool(np.mean(np.diff(known) >= 0.0) > _RISING) and not holds_dates_alone(
        known
    )


def _is_dated(time: Array) -> bool:
    """Return whether times are dates, not counted from the start of the recording."""
    return bool(np.nanmax(time) > _ELAPSED)


def _differ(one: Array, other: Array) -> bool:
    """Return whether two clocks show other times in one row."""
    known = np.isfinite(one) & np.isfinite(other)
    if not known.any():
        return True
    apart = one[known] - other[known]
    limit = _SAME_TIME
    if _is_dated(one) != _is_dated(other):
        apart = apart - np.median(apart)
        limit += _WHOLE_SECOND
    return bool(np.max(np.abs(apart)) > limit)


def _owners(table: RawTable, clocks: set[str]) -> dict[str, str]:
    """Return the clock in front of each column that is none."""
    owner = {}
    clock = ""
    for name in table.columns:
        if name in clocks:
            clock = name
        else:
            owner[name] = clock
    return owner


def _at(main: Array, time: Array, column: Array) -> Array:
    """Return a column of another clock at the times of the stamp; NaN beyond a gap."""
    known = np.isfinite(time) & np.isfinite(column)
    times, first = np.unique(time[known], return_index=True)
    if len(times) < 2:
        return np.full(len(main), np.nan)
    rows = np.nan_to_num(main, nan=-np.inf)
    return interpolated(rows, times, column[known][first], reach_of(times))
