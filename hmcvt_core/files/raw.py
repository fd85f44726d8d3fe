# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples from a table with names and units of its own, of tests or of a recording."""

import os
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..transmission.ranges import BENCH_COLUMNS, Array, Range
from .bench import BenchSamples, column_name
from .guess import UNITS, likely_unit, quantity_of, strange_words, unit_of
from .steady import (
    Readings,
    Shafts,
    Steadiness,
    complaint,
    held,
    split_at_gaps,
    steady_tests,
)
from .table import STATISTIC, Table, no_number, parsed, read_table

_ZERO = {"deg F": 32.0, "K": 273.15}  # of a unit, in that unit
_KEPT = {column.name: column for column in BENCH_COLUMNS}
_RANGES = {
    **_KEPT,
    **{
        name: Range(name, 0.1, 20_000.0, "N m", "positive in forward driving")
        for name in ("engine_torque", "output_torque")
    },
    **{
        name: Range(name, 10.0, 2e6, "W", "positive in forward driving")
        for name in ("engine_power", "output_power")
    },
}
# What tells the power of a side, and the speed that it is taken times.
_INPUTS = {"engine_torque": "engine_speed", "engine_power": ""}
_OUTPUTS = {
    "load_torque": "engine_speed",
    "output_torque": "output_speed",
    "output_power": "",
}
# A shaft that is not named; and guesses that say no more than others, the worst first.
_UNNAMED = {
    "any_speed": "engine_speed",
    "any_torque": "load_torque",
    "any_power": "output_power",
}
_SPARE = (
    "engine_power",
    "engine_torque",
    "output_power",
    "load_torque",
    "output_torque",
)
_OPTIONAL = ("oil_temperature", "efficiency_std", "stamp", "pressure")
_COMPUTED = (
    "; computed from torques and speeds of the shafts: check their columns and units"
)
_MOST_TOLD = 20  # rows
# Of these a row of units may say anything (a dash, hh:mm:ss); others are in a unit that is known.
_UNITS_VARY = ("stage", "stamp", "displacement_ratio", "efficiency", "efficiency_std")
# From so many rows and with so short a step [s] on, rows are no steady tests but readings.
_RECORDED, _STEP = 100, 1.0
_AGE = 5.0  # s; so far a reading of the oil holds, as in a bag


class Column(NamedTuple):
    """Where a quantity stands, its unit, and what told the unit where it was guessed, else `""`."""

    name: str
    unit: str
    why: str = ""


class Imported(NamedTuple):
    """Bench samples, the rows that were left out, each with the reason, and what was done."""

    samples: BenchSamples
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_raw_bench(
    path: str | os.PathLike[str],
    columns: Mapping[str, str],
    *,
    header_row: int | None = None,
    sheet: str | None = None,
    skip_bad: bool = False,
) -> BenchSamples:
    """Read bench samples from a table; see `choose_columns` and `import_table`."""
    chosen = choose_columns(path, columns, header_row=header_row, sheet=sheet)
    return import_table(*chosen, skip_bad=skip_bad).samples


def choose_columns(
    path: str | os.PathLike[str],
    columns: Mapping[str, str],
    *,
    header_row: int | None = None,
    sheet: str | None = None,
    guess: bool = False,
) -> tuple[Table, dict[str, Column]]:
    """Read a table with names and units of its own, and say where each quantity stands in it.

    Args:
        path: CSV or Excel file.
        columns: where each quantity of `UNITS` stands, and `stage`, as `COLUMN` or `COLUMN:UNIT`,
            such as `{"engine_speed": "n_engine:rpm"}`; or a number for all rows: `"1500:rpm"`.
        header_row: row of the header, from 1; found when left out.
        sheet: of an Excel file.
        guess: what other columns hold, where those named do not make bench samples.

    Raises:
        InputError: the file cannot be read, a column is missing or a unit is unknown.
    """
    parted = [(text, *text.rpartition(":")) for text in columns.values()]
    bare = [
        (name if colon and unit_of(unit) else text).strip()
        for text, name, colon, unit in parted
    ]
    same = [name for name in bare if np.isfinite(parsed(name, False)[0])]
    table = read_table(path, bare, header_row, sheet)
    if not table.columns.keys() >= {*bare}:  # a number for all rows tells no header
        table = read_table(
            path, [name for name in bare if name not in same], header_row, sheet
        )
    table = replace(
        table,
        columns={**{name: [name] * len(table.rows) for name in same}, **table.columns},
    )
    chosen = {
        quantity: _column(quantity, text, table) for quantity, text in columns.items()
    }
    return table, chosen | (
        _guesses(table, chosen) if guess and _lacking(columns) else {}
    )


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def import_table(
    table: Table,
    columns: Mapping[str, Column],
    *,
    skip_bad: bool = False,
    averaged: bool = False,
) -> Imported:
    """Make bench samples of a table.

    Efficiency and load torque are computed where no column holds them, from the powers or torques
    and speeds of both shafts. A row of units below the header is left out. Columns that hold no
    quantity are kept; one with the name of a bench column as `raw <name>`. A recording (100
    rows or more whose stamps rise by a second or less) is cut into its steady windows.

    Args:
        table, columns: of `choose_columns`.
        skip_bad: leave rows out that hold no test, instead of refusing the table.
        averaged: each row is a steady test, however fast the stamps rise.

    Raises:
        InputError: a column is named twice, a unit is not that of the cells, quantities are
            missing or say the same twice, it is a recording whose stamps are not named, or rows
            hold no test: all are named.
    """
    columns = dict(columns)
    if lacking := _lacking(columns):
        raise InputError(lacking)
    names = [column.name for column in columns.values()]
    for quantity, column in columns.items():
        if names.count(column.name) > 1 and {*table.columns[column.name]} != {
            column.name
        }:
            raise InputError(f"{quantity}: column {column.name!r} is named twice")
    extra = {
        name if column_name(name) not in _KEPT else f"raw {name}": cells
        for name, cells in table.columns.items()
        if name not in names
    }
    if "stage" in columns:
        extra["stage"] = table.columns[columns.pop("stage").name]
    values = {
        quantity: _values(quantity, column, table)
        for quantity, column in columns.items()
    }
    if "stamp" not in values and not averaged:
        _refuse_recording(table)
    elif not averaged and _is_recording(values["stamp"]):
        return _cut(values, extra, table)
    notes = []
    for quantity in [name for name in _OPTIONAL if name in values]:
        if np.isnan(values[quantity]).mean() > 0.5:  # it says less than it costs
            notes.append(
                f"column {columns.pop(quantity).name!r} is mostly empty and was left out"
            )
            del values[quantity]
    into, out = _powers(values)
    values.setdefault("load_torque", out / values["engine_speed"])
    values.setdefault("efficiency", out / into)
    bad = _bad_rows(values, columns, table)
    kept = [i for i, number in enumerate(table.rows) if number not in bad]
    told = tuple(f"row {number}: {bad[number]}" for number in sorted(bad))
    if told and not (skip_bad and kept):
        more = f"; and {len(told) - _MOST_TOLD} more" if len(told) > _MOST_TOLD else ""
        count = (
            f"{len(told)} rows cannot be used (--skip-bad leaves them out): "
            if len(told) > 1
            else ""
        )
        raise InputError(f"{table.source}: {count}{'; '.join(told[:_MOST_TOLD])}{more}")
    samples: dict[str, Any] = {
        name: values[name][kept] for name in _KEPT if name in values
    }
    return Imported(
        BenchSamples(
            **samples,
            extra={
                name: tuple(cells[i] for i in kept) for name, cells in extra.items()
            },
            source=table.source,
            sha256=table.sha256,
        ),
        told,
        tuple(notes),
    )


def _lacking(columns: Mapping[str, Any]) -> str:
    """Why these quantities make no bench samples."""
    unknown = [name for name in columns if name not in (*UNITS, "stage")]
    if unknown:
        return f"{unknown[0]} is no quantity of a bench; there is {', '.join(UNITS)}"
    into, out = (
        [name for name in names if name in columns] for names in (_INPUTS, _OUTPUTS)
    )
    efficiency = ["efficiency"] if "efficiency" in columns else []
    for same in (into, out, [*efficiency, *into] if out else []):
        if len(same) > 1:
            return f"{same[0]} and {same[1]} say the same twice: name one"
    missing = _missing({*columns})
    return f"no column is named for {', '.join(missing)}" if missing else ""


def _missing(columns: Set[str]) -> list[str]:
    into, out = columns & _INPUTS.keys(), columns & _OUTPUTS.keys()
    missing = [
        name for name in ("displacement_ratio", "engine_speed") if name not in columns
    ]
    if "output_torque" in out and "output_speed" not in columns:
        missing.append("load_torque (or output_speed)")
    elif not out and not (into and "efficiency" in columns):
        missing.append(
            "load_torque (or output_power, or output_torque and output_speed)"
        )
    if not into and "efficiency" not in columns:
        missing.append("efficiency (or engine_torque or engine_power)")
    return missing


def _column(quantity: str, text: str, table: Table) -> Column:
    """What `COLUMN` or `COLUMN:UNIT` names; a column may hold a colon itself."""
    units = list(UNITS.get(quantity, [""]))
    whole, (name, unit) = text.strip(), map(str.strip, text.rpartition(":")[::2])
    if whole in table.columns:
        return Column(whole, units[0])
    if name in table.columns:
        for known in units:
            if unit.casefold() == known.casefold():
                return Column(name, known)
        raise InputError(
            f"{quantity}: {unit!r} is no unit of it; there is {', '.join(units)}"
        )
    raise InputError(
        f"{table.source}: {quantity}: column {(name if ':' in whole else whole)!r} is "
        f"missing; there is {', '.join(table.columns)}"
    )


def _guesses(table: Table, known: Mapping[str, Column]) -> dict[str, Column]:
    """Columns and units of quantities that are not known, by names, rows of units and ranges."""
    ranked: dict[str, tuple[tuple[bool, int, bool], Column]] = {}
    named = {column.name for column in known.values()}
    for name in table.columns:
        below = table.units.get(name, "")
        quantity, unit = quantity_of(name, below) or ("", "")
        if (
            not quantity
            or quantity in known
            or name in named
            or (below and not unit_of(below) and quantity not in _UNITS_VARY)
        ):
            continue
        why = "cells" if not unit else "row of units" if unit_of(below) else "name"
        unit = unit or next(filter(None, table.readings(name)[1]), "")
        meant, numbers = _UNNAMED.get(quantity, quantity), table.stamps(name)
        told, rank = unit in UNITS.get(meant, ()), (True, 0, True)
        if not told and (unit not in ("", "-") or meant == "pressure"):
            continue  # numbers do not tell bar from MPa
        if meant == "stage":
            why = why if unit else "name"
        elif not np.isfinite(numbers).any():
            continue
        else:
            if not told:
                unit, why = likely_unit(meant, numbers), "range"
            fits = _RANGES[meant].contains(
                UNITS[meant][unit] * (numbers - _ZERO.get(unit, 0.0))
            )
            # One that fits goes first, then one of plain words, then one that tells its unit.
            rank = bool(fits.mean() > 0.5), -strange_words(name), told
        if quantity not in ranked or rank > ranked[quantity][0]:
            ranked[quantity] = rank, Column(name, unit, why)
    found = {quantity: column for quantity, (_, column) in ranked.items()}
    for unnamed, other in _UNNAMED.items():
        if (alone := found.pop(unnamed, None)) and other not in {*found, *known}:
            found[other] = alone
    for spare in _SPARE:
        there = {*found, *known}
        if spare in found and _missing(there - {spare}) == _missing(there):
            del found[spare]
    # An output that turns slowly may look like rad/s; a bench has one unit for both shafts.
    if (
        "engine_speed" in found
        and "output_speed" in found
        and (found["output_speed"].why == "range")
    ):
        found["output_speed"] = found["output_speed"]._replace(
            unit=found["engine_speed"].unit
        )
    return found


def _values(quantity: str, column: Column, table: Table) -> Array:
    """A column in SI units, NaN where a cell holds no number.

    Raises:
        InputError: its cells, or the row of units, say another unit than is taken.
    """
    name, unit, _ = column
    sizes = {key: (size, _ZERO.get(key)) for key, size in UNITS[quantity].items()}
    below = unit_of(table.units.get(name, "")) or ("", "")
    numbers, units = table.readings(name)
    for row, said in zip(
        ("of units", *table.rows), (below[1], *units.tolist()), strict=True
    ):
        if said == "-" and said not in sizes:
            continue  # of a row of units: none is told
        if said and sizes.get(said) != sizes[unit]:
            cure = f"; write {name}:{said}" if said in sizes else ""
            raise InputError(
                f"{table.source}: row {row}: {quantity}: {said} in column "
                f"{name!r} is not in {unit}{cure}"
            )
    if quantity == "stamp":
        return table.stamps(name, UNITS[quantity][unit])
    return UNITS[quantity][unit] * (numbers - _ZERO.get(unit, 0.0))


def _bad_rows(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: Table
) -> dict[int, str]:
    """What is wrong with rows, by number."""
    bad = dict(table.broken)
    first: dict[tuple[str, ...], int] = {}
    for number, row in zip(
        table.rows, zip(*table.columns.values(), strict=True), strict=True
    ):
        if statistic := next(filter(STATISTIC.fullmatch, row), ""):
            bad[number] = f"{statistic!r} is no test"
        elif first.setdefault(row, number) != number:
            bad[number] = f"copies row {first[row]}"
    for quantity, found in values.items():
        limits, remark = _RANGES[quantity], _COMPUTED
        if quantity in columns:
            name, unit, _ = columns[quantity]
            remark = (
                f"; column {name!r} is taken as {unit}: another unit is written {name}:UNIT, "
                f"one of {', '.join(UNITS[quantity])}"
            )
            for i in np.flatnonzero(np.isnan(found)).tolist():
                if (cell := table.columns[name][i]).lower() not in ("nan", "inf"):
                    bad.setdefault(table.rows[i], no_number(name, cell))
        fresh = [
            i
            for i in np.flatnonzero(~limits.contains(found))
            if table.rows[i] not in bad
        ]
        told = {table.rows[i]: limits.complaint(found[i]) for i in fresh}
        if told and 2 * len(told) > len(found) - len(
            bad
        ):  # the column or its unit is wrong
            number = min(told)
            raise InputError(f"{table.source}: row {number}: {told[number]}{remark}")
        bad |= told
    return bad


def _powers(values: Mapping[str, Array]) -> tuple[Array, Array]:
    """Power of the engine and of the output [W], where the shafts tell them."""
    into, out = (
        [
            values[name] * values.get(speed, 1.0)
            for name, speed in side.items()
            if name in values
        ]
        for side in (_INPUTS, _OUTPUTS)
    )
    return (into or [out[0] / values["efficiency"]])[0], (
        out or [values["efficiency"] * into[0]]
    )[0]


def _is_recording(stamp: Array) -> bool:
    steps = np.diff(stamp[np.isfinite(stamp)])
    # A log may be faster than the last digit of its clock: then most steps are 0.
    return (
        len(stamp) >= _RECORDED
        and bool(np.any(steps > 0.0))
        and bool(np.mean(steps >= 0.0) > 0.9)
        and bool(np.median(steps) < 1.1 * _STEP)
    )


def _refuse_recording(table: Table) -> None:
    for name in table.columns:
        quantity, unit = quantity_of(name, table.units.get(name, "")) or ("", "")
        if quantity == "stamp" and _is_recording(
            table.stamps(name, UNITS["stamp"].get(unit, 1.0))
        ):
            raise InputError(
                f"{table.source}: column {name!r} looks like that of a recording: "
                "name it by --stamp, or give --averaged"
            )


def _spread(stamp: Array) -> Array:
    """Stamps (n,) of a log; those of one tick of a clock that is too slow lie evenly within it."""
    first = np.flatnonzero(np.diff(stamp, prepend=-np.inf))
    counts = np.diff(np.append(first, len(stamp)))
    if np.median(counts) == 1.0:
        return stamp  # what stands twice is a copy
    place = (np.arange(len(stamp)) - np.repeat(first, counts)) / np.repeat(
        counts, counts
    )
    return stamp + np.median(np.diff(stamp[first])) * place


def _cut(
    values: Mapping[str, Array], extra: Mapping[str, Sequence[str]], table: Table
) -> Imported:
    """Make a bench sample of each steady window, as of a bag."""
    spare = [name for name in ("pressure", "efficiency_std") if name in values]
    needed = [
        values[name] for name in values if name not in (*spare, "oil_temperature")
    ]
    known = np.isfinite(needed).all(axis=0) & (values["engine_speed"] > 0.0)
    values = {name: column[known] for name, column in values.items()}
    values["stamp"] = time = _spread(values["stamp"])
    block = max(1.0, 4.0 * float(np.median(np.diff(time)))) if len(time) > 1 else 1.0
    limits = Steadiness(max(5.0, 3.0 * block), block)
    oil = values.get("oil_temperature")
    if oil is not None:
        there = np.isfinite(oil)
        oil = held(time, time[there], oil[there], _AGE) if there.any() else None
    stages = np.array(extra.get("stage", [""] * len(known)))[known]
    (into, out), speed = _powers(values), values["engine_speed"]
    turned = values.get("output_speed", speed)
    readings = Readings(
        values["stamp"],
        Shafts(
            speed,
            into / speed,
            turned,
            np.where(turned != 0.0, out / turned, 0.0),
            values["displacement_ratio"],
        ),
        oil,
    )
    gap = max(_STEP, limits.block)
    shifts = np.cumsum(
        np.append(False, stages[1:] != stages[:-1])
    )  # of a stage: a gap too
    tests = [
        (str(stages[part[0]]), sample)
        for part in split_at_gaps(values["stamp"] + 3.0 * gap * shifts, gap)
        for _, sample in steady_tests([readings.select(part)], limits)
    ]
    found = [(name, sample) for name, sample in tests if complaint(sample) is None]
    note = (
        f"a recording of {len(known)} rows was cut into {len(found)} steady windows of "
        f"{limits.min_duration:g} s and more (--averaged takes each row as a test); "
        f"{len(tests) - len(found)} windows out of range and {np.sum(~known)} rows without a "
        "number left out"
    )
    if not found:
        raise InputError(f"{table.source}: {note}")
    spare += [name for name in extra if name != "stage"]
    notes = (note, *[f"not averaged, left out: {', '.join(spare)}"] * bool(spare))
    columns: dict[str, Any] = {
        name: np.array([sample[name] for _, sample in found])
        for name in found[0][1]
        if name != "output_speed" or name in values
    }
    told = {"stage": tuple(name for name, _ in found)} if "stage" in extra else {}
    return Imported(
        BenchSamples(**columns, extra=told, source=table.source, sha256=table.sha256),
        (),
        notes,
    )
