# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A recording in whose table several tasks have a clock each.

Programs that export such a recording write the column of a clock in front of the columns that it
belongs to.
"""

from collections.abc import Mapping

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from ..steady import interpolated, reach_of
from .header import RawTable
from .numbers import finite_share
from .proposal import Column
from .rules import meaning_of
from .stamps import read_times

_SAME_TIME = 0.5
"""Seconds by which two clocks of one recording differ at most; a steady window is ten times as
long."""
_FILLED = 0.5
"""Fraction of the cells of a clock that hold a number."""
_RISING = 0.9
"""Fraction of steps that rise in a column of times."""


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
    first = [quantity for quantity, name in placed.items() if not name]
    if first:
        column = columns[first[0]].name
        raise InputError(
            f"{table.source}: the times in {' and '.join(map(repr, clocks))} differ, and "
            f"column {column!r} stands in front of them: put each time in front of the "
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
    """Return the times of columns of elapsed time [s], by name."""
    clocks = {}
    for name, cells in table.columns.items():
        meaning = meaning_of(name.removesuffix(" (2)"), table.units.get(name, ""))
        is_time = meaning.kind == "time" and not meaning.excluded
        if not is_time or finite_share(table.numbers(name).values) < _FILLED:
            continue
        unit = ""
        if meaning.unit is not None and meaning.unit.kind == "time":
            unit = meaning.unit.name
        time = read_times(cells, unit, table.styles[name].comma).seconds
        known = time[np.isfinite(time)]
        if len(known) < 2 or known.max() > _ELAPSED:
            continue
        if np.mean(np.diff(known) >= 0.0) > _RISING:
            clocks[name] = time
    return clocks


def _differ(one: Array, other: Array) -> bool:
    """Return whether two clocks show other times in one row."""
    known = np.isfinite(one) & np.isfinite(other)
    if not known.any():
        return False
    return bool(np.max(np.abs(one[known] - other[known])) > _SAME_TIME)


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
