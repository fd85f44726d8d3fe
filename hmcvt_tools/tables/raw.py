# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples from a table with its own names and units, of tests or of a recording.

The steps of `hmcvt_tools.tables`, put together: `choose_columns` reads the table and proposes
columns, `import_table` converts and checks the values and makes the samples.
"""

import math
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.bench import BenchSamples, column_name
from hmcvt_core.files.numbers import is_number, no_number
from hmcvt_core.transmission.quantities import BY_NAME
from hmcvt_core.transmission.ranges import BENCH_COLUMNS, Array
from hmcvt_core.transmission.units import UNITS, kind_of

from .checks import (
    causes_of_efficiency,
    changing_strokes,
    contradicting_tests,
    contradictions,
    implausible,
)
from .clocks import join_clocks
from .header import RawTable, read_table
from .no_tests import confirmed_torque, rows_without_test
from .numbers import not_available, parsed
from .proposal import (
    INPUTS,
    OPTIONAL,
    OUTPUTS,
    Column,
    Proposal,
    Question,
    missing_quantities,
    named_column,
    option,
    propose,
)
from .recordings import (
    clock_of,
    cut,
    days_of,
    even_columns,
    holds_dates_alone,
    is_recording,
    looks_recorded,
    powers,
)
from .rules import meaning_of
from .shafts import exchanged_shafts, odd_oil, odd_ratios, shafts_note
from .stamps import joined_stamps, read_times
from .summaries import header_rows, summary_rows
from .units import to_si, unit_of

__all__ = [
    "UNITS",
    "Column",
    "Imported",
    "Proposal",
    "Question",
    "choose_columns",
    "import_table",
    "read_raw_bench",
]

_KEPT = tuple(column.name for column in BENCH_COLUMNS)
_COMPUTED = (
    "; computed from torques and speeds of the shafts: check their columns and units"
)
_LOSS_NOTE = "load torque = engine torque - torque loss, both at the input shaft"
_PERCENT = "%"
_FEWEST_EVEN = 2
"""Columns in equal steps from which a table is a computed curve and no recording."""
_FEWEST_MATRIX_COLUMNS = 3
"""Numbers in a header from which it is that of a matrix."""
_MAX_SHOWN = 20  # rows or names in one message


class Imported(NamedTuple):
    """Bench samples and how they came about.

    Attributes:
        samples: of the tests, or of the steady windows of a recording.
        left_out: rows that were left out, each with the reason.
        notes: what else was done.
        doubtful: how many of the rows that were left out may be tests.
    """

    samples: BenchSamples
    left_out: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    doubtful: int = 0


def read_raw_bench(
    path: str | os.PathLike[str],
    columns: Mapping[str, str],
    *,
    header_row: int | None = None,
    sheet: str | None = None,
    skip_bad: bool = False,
) -> BenchSamples:
    """Read bench samples from a table; see `choose_columns` and `import_table`."""
    table, proposal = choose_columns(path, columns, header_row=header_row, sheet=sheet)
    return import_table(table, proposal, skip_bad=skip_bad).samples


def choose_columns(
    path: str | os.PathLike[str],
    columns: Mapping[str, str],
    *,
    header_row: int | None = None,
    sheet: str | None = None,
    decimal: str | None = None,
    names: str | None = None,
    matrix: str | None = None,
    guess: bool = False,
    averaged: bool = False,
) -> tuple[RawTable, Proposal]:
    """Read a table with its own names and units, and say where each quantity stands in it.

    Args:
        path: text or spreadsheet.
        columns: where each quantity of `UNITS` stands, and `stage`, as `COLUMN` or
            `COLUMN:UNIT`, such as `{"engine_speed": "n_engine:rpm"}`; or a number for all rows:
            `"1500:rpm"`.
        header_row: row of the header, from 1; searched when left out.
        sheet: of a spreadsheet.
        decimal: `point` or `comma`; the table decides when left out.
        names: of the columns of a table without any, separated by commas, as
            `n_engine [rpm],M_engine [Nm]`.
        matrix: names of the row axis, the column axis and the cells of a map that is a matrix,
            separated by commas.
        guess: whether to propose columns for what is not named.
        averaged: whether each row is a steady test, however fast the stamps rise.

    Raises:
        InputError: the file cannot be read, a column is missing or a unit is unknown.
    """
    unknown = [name for name in columns if name not in (*UNITS, "stage")]
    if unknown:
        raise InputError(
            f"{unknown[0]} is no quantity of a bench; there is {', '.join(UNITS)}"
        )
    bare = list(map(_bare_name, columns.values()))
    constants = [name for name in bare if math.isfinite(parsed(name, False)[0])]
    header = _listed_names(names)
    axes = _listed_names(matrix)
    table = read_table(path, bare, header_row, sheet, decimal, header, axes)
    if not set(bare) <= table.columns.keys():
        # A number for all rows does not show which row is the header.
        of_columns = [name for name in bare if name not in constants]
        table = read_table(path, of_columns, header_row, sheet, decimal, header, axes)
    missing = [name for name in constants if name not in table.columns]
    table = table.with_constants(missing)
    if "stamp" in columns and _bare_name(columns["stamp"]) not in table.columns:
        table = _with_joined_stamp(table, columns)
    named = {
        quantity: named_column(quantity, text, table)
        for quantity, text in columns.items()
    }
    proposal = Proposal(named, {}, (), ())
    if guess and _lacking(named, table, ()):
        if "stamp" not in named:
            table = _with_joined_stamp(table, columns)
        proposal = propose(table, named, averaged)
    assumed = _assumed_units(proposal.columns, columns, table)
    return table, replace(proposal, assumed=tuple(assumed))


def _listed_names(text: str | None) -> list[str]:
    """Return names that are separated by commas; none without a text."""
    return text.split(",") if text else []


def _with_joined_stamp(table: RawTable, columns: Mapping[str, str]) -> RawTable:
    """Return the table with its column of dates and its column of times of day as one.

    Args:
        table: as text.
        columns: `COLUMN` or `COLUMN:UNIT` that the user named; a named column stays.
    """
    named = set(map(_bare_name, columns.values()))
    of_time = []
    for name in table.columns:
        meaning = meaning_of(name, table.units.get(name, ""))
        if meaning.quantity == "stamp" and name not in named:
            of_time.append(name)
    for day, clock in permutations(of_time, 2):
        joined = joined_stamps(table.columns[day], table.columns[clock])
        if joined is not None:
            return table.with_joined(day, clock, joined)
    return table


def _assumed_units(
    columns: Mapping[str, Column], texts: Mapping[str, str], table: RawTable
) -> list[str]:
    """Say of which torques and powers, and speeds of a matrix, nothing states the unit.

    Args:
        columns: by quantity, named or proposed.
        texts: `COLUMN` or `COLUMN:UNIT` that the user named, by quantity.
        table: where they stand.
    """
    notes = []
    kinds = ["torque", "power"]
    if table.matrix:
        kinds.append("speed")
    for quantity, column in columns.items():
        if kind_of(quantity) not in kinds:
            continue
        name = column.name
        if quantity in texts and texts[quantity].strip() != name:
            continue  # the user states it
        stated = meaning_of(name, table.units.get(name, "")).unit
        if stated is not None and stated.name != "-":
            continue
        if not table.numbers(name).units:
            notes.append(f"unit assumed: {column.unit} (column {name!r} names none)")
    return notes


def _bare_name(text: str) -> str:
    """Return the column of `COLUMN:UNIT`."""
    name, colon, unit = text.rpartition(":")
    if colon and (unit_of(unit) or unit in ("dmy", "mdy", "ymd")):
        return name.strip()
    return text.strip()


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def import_table(
    table: RawTable,
    proposal: Proposal,
    *,
    skip_bad: bool = False,
    averaged: bool = False,
    unchecked: bool = False,
    session: str | None = None,
) -> Imported:
    """Make bench samples of a table.

    Efficiency and load torque are computed where no column holds them, from the powers or torques
    and speeds of both shafts. Columns that hold no quantity are kept; one with the name of a bench
    column as `raw <name>`. A recording is cut into its steady windows.

    Args:
        table, proposal: of `choose_columns`.
        skip_bad: leave rows out that hold no test, instead of refusing the table.
        averaged: each row is a steady test, however fast the stamps rise.
        unchecked: take values that contradict each other or look like another unit.
        session: column of which the caller makes sessions, so that days do not count as such.

    Raises:
        InputError: a column is named twice, a unit is not that of the cells, quantities are
            missing or given twice, values contradict each other, it is a recording whose stamps
            are not named, or rows hold no test: all are named.
    """
    lacking = _lacking(proposal.columns, table, proposal.notes)
    if lacking:
        raise InputError(lacking)
    columns = dict(proposal.columns)
    _refuse_shared_columns(columns, table)
    extra = _extra_columns(columns, table)
    if "stage" in columns:
        extra["stage"] = table.columns[columns.pop("stage").name]
    values = _all_values(columns, table)
    notes = [*proposal.notes, *proposal.assumed]
    if not averaged:
        if "stamp" not in values or holds_dates_alone(values["stamp"]):
            notes += _refuse_recording(table, values)
        elif is_recording(values["stamp"], values):
            return _from_recording(values, columns, proposal, extra, table, unchecked)
    notes += _drop_empty(values, columns, table)
    has_sessions = session is not None or "session" in extra
    dated = "stamp" in values and holds_dates_alone(values["stamp"])
    if dated and not has_sessions:
        days = days_of(values["stamp"])
        extra["session"] = list(days)
        notes.append(_dates_note(columns["stamp"].name, len(set(days) - {""})))
    stated = dict(values)
    into, out = powers(values)
    values.setdefault("load_torque", out / values["engine_speed"])
    values.setdefault("efficiency", out / into)
    if "torque_loss" in columns:
        notes.append(_LOSS_NOTE)
    rows = _sorted_rows(values, columns, table)
    spares = _all_values(proposal.spares, table)
    if not unchecked:
        odd = _odd_rows(values, spares, rows.kept, extra.get("stage"), table)
        rows = rows.without(odd, table)
    _require_tests(rows, skip_bad, table)
    taken = _rows(values, rows.kept)
    stages = _stages(extra, rows.kept)
    if not unchecked:
        confirmed = confirmed_torque(values, columns, table)
        sure: list[str] = []
        if confirmed is not None and confirmed.in_all_rows:
            sure += ["load_torque", "engine_speed"]
            notes.append(
                f"column {confirmed.name!r} agrees with the load torque by power and speed"
            )
        _refuse_contradictions(
            _rows(stated, rows.kept),
            _rows(spares, rows.kept),
            taken,
            columns,
            table,
            stages,
            sure,
        )
        possible = [
            index for index, row in enumerate(table.rows) if row not in rows.no_tests
        ]
        _refuse(changing_strokes(values["displacement_ratio"][possible]), table)
    note = shafts_note(taken, columns, stages)
    if note:
        notes.append(note)
    notes += _not_used_note(extra, session, proposal, notes)
    samples = _bench(taken, extra, rows.kept, table)
    return Imported(samples, rows.left_out, tuple(notes), len(rows.doubtful))


def _not_used_note(
    extra: Mapping[str, Sequence[str]],
    session: str | None,
    proposal: Proposal,
    notes: Sequence[str],
) -> list[str]:
    """Name the columns of which nothing is made, and no other note says so.

    Args:
        extra: columns that hold no quantity.
        session: column of the sessions, if the user names one.
        proposal: whose spare columns are compared with others.
        notes: so far.
    """
    compared = {column.name for column in proposal.spares.values()}
    named = " ".join(notes)
    names = []
    for name in extra:
        is_used = name in ("stage", "session", session) or name in compared
        if not is_used and repr(name) not in named:
            names.append(name)
    if not names:
        return []
    shown = ", ".join(map(repr, names[:_MAX_SHOWN]))
    if len(names) > _MAX_SHOWN:
        shown += f" and {len(names) - _MAX_SHOWN} more"
    return [f"kept as they are, not used: {shown}"]


def _dates_note(column: str, days: int) -> str:
    """Say that days count as sessions where the stamps are dates alone."""
    counted = "the day counts" if days == 1 else f"each of the {days} days counts"
    return (
        f"column {column!r} holds dates without a time of day: each row is a test, and {counted} "
        "as a session, between which the meters may drift (--session names another column)"
    )


class _SortedRows(NamedTuple):
    """Rows of a table by what becomes of them.

    Attributes:
        kept: positions of the rows that are tests.
        doubtful: rows that cannot be used, by number, each with the reason; they may be tests.
        no_tests: rows that hold no test beyond doubt.
    """

    kept: list[int]
    doubtful: dict[int, str]
    no_tests: dict[int, str]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Return one line for each doubtful row, and one for each reason of the others."""
        return (*_row_lines(self.doubtful), *_grouped_lines(self.no_tests))

    def without(self, odd: Mapping[int, str], table: RawTable) -> "_SortedRows":
        """Return the same with further doubtful rows, where nothing is wrong with them yet."""
        further = {row: why for row, why in odd.items() if row not in self.no_tests}
        doubtful = {**further, **self.doubtful}
        kept = [index for index in self.kept if table.rows[index] not in doubtful]
        ordered = {row: doubtful[row] for row in sorted(doubtful)}
        return _SortedRows(kept, ordered, self.no_tests)


def _sorted_rows(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> _SortedRows:
    """Return the rows that are tests, those that may be none, and those that are none.

    Args:
        values: SI values by quantity, measured and computed, shape (n,) each.
        columns: where the measured ones stand.
        table: as text.
    """
    no_tests = _rows_by_number(rows_without_test(values, columns, table), table)
    bad = _bad_rows(values, columns, table, no_tests.keys())
    doubtful = {row: bad[row] for row in sorted(bad) if row not in no_tests}
    kept = []
    for index, row in enumerate(table.rows):
        if row not in doubtful and row not in no_tests:
            kept.append(index)
    return _SortedRows(kept, doubtful, no_tests)


def _require_tests(rows: _SortedRows, skip_bad: bool, table: RawTable) -> None:
    """Raise an `InputError` that names doubtful rows, or that says why no row is a test."""
    if rows.doubtful and not (skip_bad and rows.kept):
        message = _rows_message(_row_lines(rows.doubtful))
        raise InputError(f"{table.source}: {message}")
    if not rows.kept:
        reasons = "; ".join(_grouped_lines(rows.no_tests))
        raise InputError(f"{table.source}: no row holds a test: {reasons}")


def _rows_by_number(reasons: Mapping[int, str], table: RawTable) -> dict[int, str]:
    """Return reasons by number of the row in place of its position."""
    return {table.rows[index]: reasons[index] for index in sorted(reasons)}


def _row_lines(reasons: Mapping[int, str]) -> tuple[str, ...]:
    """Return one line for each row that is left out."""
    return tuple(f"row {row}: {reason}" for row, reason in reasons.items())


def _grouped_lines(reasons: Mapping[int, str]) -> tuple[str, ...]:
    """Return one line for all rows that are left out for one reason."""
    by_reason: dict[str, list[int]] = {}
    for row, reason in reasons.items():
        by_reason.setdefault(reason, []).append(row)
    lines = []
    for reason, rows in by_reason.items():
        if len(rows) == 1:
            lines.append(f"row {rows[0]}: {reason}")
            continue
        lines.append(f"{len(rows)} rows ({_listed(rows)}): {reason}")
    return tuple(lines)


def _listed(rows: Sequence[int]) -> str:
    """Return numbers of rows, those in a row as `3 to 9`."""
    runs: list[list[int]] = []
    for row in rows:
        if runs and row == runs[-1][-1] + 1:
            runs[-1].append(row)
        else:
            runs.append([row])
    texts = []
    for run in runs[:_MAX_SHOWN]:
        if len(run) == 1:
            texts.append(str(run[0]))
        else:
            texts.append(f"{run[0]} to {run[-1]}")
    if len(runs) > _MAX_SHOWN:
        texts.append("and more")
    return ", ".join(texts)


def _stages(
    extra: Mapping[str, Sequence[str]], kept: Sequence[int]
) -> list[str] | None:
    """Return the stage of each row that is kept; None where no column names it."""
    if "stage" not in extra:
        return None
    return [extra["stage"][index] for index in kept]


def _odd_rows(
    values: Mapping[str, Array],
    spares: Mapping[str, Array],
    kept: Sequence[int],
    stages: Sequence[str] | None,
    table: RawTable,
) -> dict[int, str]:
    """Return rows whose values do not fit those of the others, by number.

    Args:
        values: SI values by quantity.
        spares: the same of columns that say the same again.
        kept: positions of the rows with all values; others, such as averages below them, do not
            count among the tests of which too many contradict.
        stages: of the rows, on which the speed ratio depends; None where no column names them.
        table: where they stand.
    """
    odd = odd_oil(values) | odd_ratios(values, stages)
    of_tests = _rows({**spares, **values}, kept)
    for index, reason in contradicting_tests(of_tests).items():
        odd[kept[index]] = reason
    return {table.rows[index]: reason for index, reason in odd.items()}


def _bench(
    taken: Mapping[str, Array],
    extra: Mapping[str, Sequence[str]],
    kept: Sequence[int],
    table: RawTable,
) -> BenchSamples:
    """Return bench samples of the rows that are kept."""
    samples: dict[str, Any] = {name: taken[name] for name in _KEPT if name in taken}
    kept_extra = {}
    for name, cells in extra.items():
        kept_extra[name] = tuple(cells[index] for index in kept)
    return BenchSamples(
        **samples, extra=kept_extra, source=table.source, sha256=table.sha256
    )


def _all_values(columns: Mapping[str, Column], table: RawTable) -> dict[str, Array]:
    """Return the SI values of columns by quantity, NaN where a cell holds no number."""
    values = {}
    for quantity, column in columns.items():
        values[quantity] = _values(quantity, column, table)
    return values


def _rows(values: Mapping[str, Array], kept: Sequence[int]) -> dict[str, Array]:
    """Return the values of the rows that are kept."""
    return {name: column[kept] for name, column in values.items()}


def _refuse_shared_columns(columns: Mapping[str, Column], table: RawTable) -> None:
    names = [column.name for column in columns.values()]
    for quantity, column in columns.items():
        if names.count(column.name) == 1:
            continue
        constant = set(table.columns[column.name]) == {column.name}
        if not constant:
            raise InputError(f"{quantity}: column {column.name!r} is named twice")


def _extra_columns(
    columns: Mapping[str, Column], table: RawTable
) -> dict[str, Sequence[str]]:
    """Return the columns that hold no quantity, under names that read as none."""
    used = {column.name for column in columns.values()}
    extra = {}
    for name, cells in table.columns.items():
        if name in used:
            continue
        kept_name = name
        if column_name(name) in _KEPT:
            kept_name = f"raw {name}"
        extra[kept_name] = cells
    return extra


def _lacking(columns: Mapping[str, Any], table: RawTable, notes: Sequence[str]) -> str:
    """Say why these quantities make no bench samples; `""` if they do.

    Args:
        columns: by quantity.
        table: where they stand; its columns that name a missing quantity are explained.
        notes: of the proposal: why columns were refused.
    """
    into = [name for name in INPUTS if name in columns]
    out = [name for name in OUTPUTS if name in columns]
    with_efficiency = []
    if out and "efficiency" in columns:
        with_efficiency = ["efficiency", *into]
    for same in (into, out, with_efficiency):
        if len(same) > 1:
            return f"{same[0]} and {same[1]} say the same twice: name one"
    missing = missing_quantities({*columns})
    if not missing:
        return ""
    hints = [*notes, *_hints_of_names(table)]
    if not hints:
        return f"no column is named for {', '.join(missing)}"
    names = list(table.columns)
    shown = ", ".join(names[:_MAX_SHOWN])
    if len(names) > _MAX_SHOWN:
        shown += f" and {len(names) - _MAX_SHOWN} more"
    return (
        f"{table.source}: header in row {table.header_row}: {shown}; missing is "
        f"{', '.join(missing)}; {'; '.join(hints)}"
    )


def _hints_of_names(table: RawTable) -> list[str]:
    """Return what is wrong with the names of the columns: numbers, or none."""
    named = [name for name, cells in table.columns.items() if set(cells) != {name}]
    numbers = [name for name in named if is_number(name)]
    if numbers and len(numbers) == len(named):
        return [
            f"row {table.header_row} holds numbers, so that nothing names the columns: "
            f"name all {len(numbers)}, each with its unit, as in --names "
            "'engine speed [rpm],load torque [Nm],efficiency [%]'"
        ]
    if len(numbers) > _FEWEST_MATRIX_COLUMNS:
        return [
            f"row {table.header_row} holds numbers, as that of a map over two axes does: "
            "write one row for each of its points, or name rows, columns and cells, as in "
            "--matrix 'engine speed [rpm],load torque [Nm],efficiency [%]'"
        ]
    hints = []
    for name in table.without_name:
        hints.append(
            f"column {name!r} has no name: an option may name it "
            f"({option('efficiency', name)})"
        )
    return hints


def _values(quantity: str, column: Column, table: RawTable) -> Array:
    """Return a column in SI units, NaN where a cell holds no number.

    Raises:
        InputError: its cells name another unit than is taken, or can be read in two ways.
    """
    if quantity == "stamp":
        return _stamp(column, table)
    name = column.name
    unit = column.unit
    style = table.styles[name]
    if style.doubtful:
        question = Question(
            f"column {name!r}: {style.doubtful!r} can be read in two ways",
            ("--decimal point", "--decimal comma"),
        )
        raise InputError(f"{table.source}: {question}")
    kind = kind_of(quantity)
    taken = to_si(kind, unit)
    numbers = table.numbers(name)
    below = unit_of(table.units.get(name, ""))
    stated = []
    if below is not None:
        stated.append(("of units", below.name))
    for other in numbers.units:
        if other == _PERCENT and unit == "-":
            continue  # each cell says by its sign whether it is in percent
        stated.append((_row_with_unit(table, name, other), other))
    for row, other in stated:
        if other == "-" and kind != "part":
            continue  # a dash in a row of units stands for none
        try:
            same = to_si(kind, other) == to_si(kind, unit.partition("@")[0])
            cure = f"; write {name}:{other}"
        except KeyError:
            same = False
            cure = ""
        if not same:
            raise InputError(
                f"{table.source}: row {row}: {quantity}: {other} in column {name!r} is "
                f"not in {unit}{cure}"
            )
    size, zero = taken
    values = np.asarray(size * (numbers.values - zero))
    if _PERCENT in numbers.units and unit == "-":
        in_percent = _ends_with(table.columns[name], _PERCENT)
        values = np.where(in_percent, 0.01 * values, values)
    return values


def _ends_with(cells: Sequence[str], sign: str) -> list[bool]:
    """Return which cells end with a sign."""
    return [cell.endswith(sign) for cell in cells]


def _row_with_unit(table: RawTable, name: str, unit: str) -> str:
    """Return the row of the first cell of a column with a unit behind its number."""
    comma = table.styles[name].comma
    for row, cell in zip(table.rows, table.columns[name], strict=True):
        if parsed(cell, comma)[1] == unit:
            return str(row)
    return "?"


def _stamp(column: Column, table: RawTable) -> Array:
    """Return a column of times [s].

    Raises:
        InputError: its cells are no times, or leave day and month open.
    """
    name = column.name
    times = read_times(table.columns[name], column.unit, table.styles[name].comma)
    if times.question and times.scale_known:
        answers = tuple(option("stamp", name, choice) for choice in times.choices)
        question = Question(f"column {name!r}: {times.question}", answers)
        raise InputError(f"{table.source}: {question}")
    unread = times.unreadable and np.isfinite(times.seconds).mean() < 0.5
    if unread:
        raise InputError(
            f"{table.source}: stamp: cannot read {times.unreadable!r} in column {name!r} "
            "as a time"
        )
    return times.seconds


def _drop_empty(
    values: dict[str, Array], columns: dict[str, Column], table: RawTable
) -> list[str]:
    """Remove optional quantities of which most cells are empty; return what was removed."""
    notes = []
    for quantity in OPTIONAL:
        if quantity not in values or np.isnan(values[quantity]).mean() <= 0.5:
            continue
        name = columns[quantity].name
        cells = table.columns[name]
        if sum(not_available(cell) for cell in cells) <= 0.5 * len(cells):
            continue  # its text is refused row by row
        notes.append(f"column {name!r} is mostly empty and was left out")
        del columns[quantity]
        del values[quantity]
    return notes


def _refuse_recording(table: RawTable, values: Mapping[str, Array]) -> list[str]:
    """Return a note where rows as alike as those of a recording are tests.

    Raises:
        InputError: the rows are those of a recording, or look like it.
    """
    for name in table.columns:
        meaning = meaning_of(name, table.units.get(name, ""))
        if meaning.kind != "time":
            continue
        unit = ""
        if meaning.unit is not None and meaning.unit.kind == "time":
            unit = meaning.unit.name
        times = read_times(table.columns[name], unit, table.styles[name].comma)
        if is_recording(times.seconds, values):
            raise InputError(
                f"{table.source}: column {name!r} looks like that of a recording: "
                "name it by --stamp, or give --averaged"
            )
    recorded = looks_recorded(values)
    even = even_columns(table) if recorded else []
    if recorded and len(even) < _FEWEST_EVEN:
        raise InputError(
            f"{table.source}: its {len(table.rows)} rows change as little from one to the "
            "next as a recording does: name the column of its time by --stamp, or give "
            "--averaged if each row is a steady test"
        )
    if recorded:
        listed = ", ".join(map(repr, even[:_MAX_SHOWN]))
        return [f"each row is a test, not a reading: {listed} go in equal steps"]
    return []


def _from_recording(
    values: dict[str, Array],
    columns: Mapping[str, Column],
    proposal: Proposal,
    extra: Mapping[str, Sequence[str]],
    table: RawTable,
    unchecked: bool,
) -> Imported:
    """Make a bench sample of each steady window, as of a bag."""
    joined = join_clocks(values, columns, table)
    clock = clock_of(values["stamp"])
    values["stamp"] = clock.stamp
    if not unchecked:
        spares = _all_values(proposal.spares, table)
        _refuse_contradictions(
            values, spares, values, columns, table, extra.get("stage")
        )
    windows = cut(values, extra, table.source)
    stages = windows.stages if "stage" in extra else None
    if not unchecked:
        _refuse_contradictions(
            windows.columns, {}, windows.columns, columns, table, stages
        )
        _refuse(changing_strokes(windows.columns["displacement_ratio"]), table)
    samples = BenchSamples(
        **windows.columns,
        extra={} if stages is None else {"stage": stages},
        source=table.source,
        sha256=table.sha256,
    )
    notes = [*proposal.notes, *proposal.assumed, *windows.notes, *joined]
    notes += clock.notes
    if table.broken:
        first = min(table.broken)
        notes.append(
            f"{len(table.broken)} rows of another length left out, the first: row {first}: "
            f"{table.broken[first]}"
        )
    return Imported(samples, (), tuple(notes))


def _refuse_contradictions(
    stated: Mapping[str, Array],
    spares: Mapping[str, Array],
    values: Mapping[str, Array],
    columns: Mapping[str, Column],
    table: RawTable,
    stages: Sequence[str] | None,
    confirmed: Collection[str] = (),
) -> None:
    """Raise an `InputError` where values contradict each other or look like another unit."""
    problems = contradictions(stated, spares)
    problems += implausible(values, columns, confirmed)
    if not problems:
        problems += exchanged_shafts(stated, columns, stages)
    _refuse(problems, table)


def _refuse(problems: Sequence[str], table: RawTable) -> None:
    """Raise an `InputError` that names problems, if there are any."""
    if problems:
        raise InputError(
            f"{table.source}: {'; '.join(problems)} (name column and unit, or --unchecked "
            "takes it as it is)"
        )


def _rows_message(left_out: Sequence[str]) -> str:
    count = ""
    if len(left_out) > 1:
        count = f"{len(left_out)} rows cannot be used (--skip-bad leaves them out): "
    return f"{count}{first_rows(left_out, _MAX_SHOWN)}"


def first_rows(rows: Sequence[str], most: int) -> str:
    """Return the first of some rows as one line, and how many more there are."""
    shown = "; ".join(rows[:most])
    if len(rows) > most:
        shown += f"; and {len(rows) - most} more"
    return shown


def _bad_rows(
    values: Mapping[str, Array],
    columns: Mapping[str, Column],
    table: RawTable,
    no_tests: Collection[int],
) -> dict[int, str]:
    """Return what is wrong with rows, by number.

    Args:
        values: SI values by quantity, shape (n,) each.
        columns: where they stand.
        table: as text.
        no_tests: numbers of the rows that hold no test beyond doubt.
    """
    with_text = np.zeros(len(table.rows), dtype=bool)
    for quantity in set(columns) - {"stamp", "stage"}:
        with_text |= np.isnan(values[quantity])
    bad = dict(table.broken)
    bad |= header_rows(table, np.flatnonzero(with_text).tolist())
    bad |= _repeated_rows(table)
    for row, reason in summary_rows(table).items():
        bad.setdefault(row, reason)
    for quantity, column in values.items():
        limits = BY_NAME[quantity]
        remark = _COMPUTED
        if quantity in columns:
            name, unit, _ = columns[quantity]
            remark = (
                f"; column {name!r} is taken as {unit}: another unit is written "
                f"{name}:UNIT, one of {', '.join(UNITS[quantity])}"
            )
            for index in np.flatnonzero(np.isnan(column)).tolist():
                cell = table.columns[name][index]
                if cell.lower() not in ("nan", "inf"):
                    bad.setdefault(table.rows[index], no_number(name, cell))
        elif quantity == "efficiency":
            causes = causes_of_efficiency(values)
            if causes:
                remark = f"{_COMPUTED}; are {causes}?"
        outside = {
            table.rows[index]: limits.complaint(column[index])
            for index in np.flatnonzero(~limits.contains(column)).tolist()
            if table.rows[index] not in bad and table.rows[index] not in no_tests
        }
        others = bad.keys() | no_tests
        if outside and 2 * len(outside) > len(column) - len(others):
            row = min(outside)  # the column or its unit is wrong
            raise InputError(f"{table.source}: row {row}: {outside[row]}{remark}")
        bad |= outside
    return bad


def _repeated_rows(table: RawTable) -> dict[int, str]:
    """Return rows that copy another one in every cell."""
    first: dict[tuple[str, ...], int] = {}
    repeated = {}
    rows = zip(*table.columns.values(), strict=True)
    for number, row in zip(table.rows, rows, strict=True):
        earlier = first.setdefault(row, number)
        if earlier != number:
            repeated[number] = f"copies row {earlier}"
    return repeated
