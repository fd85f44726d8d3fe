# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which row is the header, and the table below it as columns of text.

A row of numbers is never a header and never the second row of one. A row of units below the header
adds units to the names. A row that ends before the header does is complete where only columns
that hold no quantity are missing, or where every row ends there.
"""

import os
import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.numbers import is_number
from hmcvt_core.files.text import read_text, split_rows
from hmcvt_core.transmission.units import usual_unit

from . import labview
from .matrix import with_points
from .numbers import Numbers, Style, decimal_styles, parsed, read_numbers
from .reading import SEPARATORS, consistent_rows, is_spreadsheet, read_spreadsheet
from .rules import names_quantity
from .units import holds_units
from .workbook import Sheet

_TOP = 60
"""Filled rows among which the header is looked for; exports have up to 40 lines of keys."""
_SNIFFED = 150
"""Lines by which the separator is judged."""
_ROWS_OF_KINDS = 3
"""Rows of text below the header of which one may hold units: channels, kinds of mean, units."""
_RIVAL_SHEET = 0.6
"""Fraction of the quantities of the best sheet from which another sheet is asked about."""
_CHANNEL = re.compile(
    r"[A-Za-z]{0,8}[ _-]?\d{1,4}|float\d*|double|real\d*|int\d*|num(eric)?",
    re.IGNORECASE,
)
_LONG_ROWS = 0.5
"""Share of rows of another length from which the table as a whole is refused."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """A table as text.

    Attributes:
        columns: one cell for each row, by column name; no name is doubled.
        units: what a row of units says, by column; empty without one.
        rows: line or row of each in the file, from 1.
        broken: what is wrong with rows of another length, by row.
        styles: decimal style by column.
        source, sheet, sha256: of the file.
        header_row: row of the header in the file, from 1; last row above the numbers where
            the user names the columns.
        doubled: names that stand in the header more than once.
        above: text of the lines above the header.
        hidden: columns that a spreadsheet hides.
        without_name: columns that hold numbers and have no name in the header.
        matrix: how a map that is a matrix was read as points; `""` for a table of rows.
    """

    columns: dict[str, Sequence[str]]
    units: dict[str, str]
    rows: list[int]
    broken: dict[int, str]
    styles: Mapping[str, Style]
    source: str
    sheet: str
    sha256: str
    header_row: int
    doubled: tuple[str, ...] = field(default=())
    above: str = ""
    hidden: tuple[str, ...] = ()
    without_name: tuple[str, ...] = field(default=())
    matrix: str = ""
    _read: dict[str, Numbers] = field(default_factory=dict, init=False, repr=False)

    def numbers(self, name: str) -> Numbers:
        """Return a column as numbers, NaN where a cell holds none; it is read once."""
        if name not in self._read:
            self._read[name] = read_numbers(self.columns[name], self.styles[name].comma)
        return self._read[name]

    def with_constants(self, names: Sequence[str]) -> "RawTable":
        """Return the table with columns that hold their own name in every row."""
        constants: dict[str, Sequence[str]] = {
            name: [name] * len(self.rows) for name in names
        }
        return replace(
            self,
            columns={**constants, **self.columns},
            styles={**dict.fromkeys(names, Style(False)), **self.styles},
        )

    def with_joined(self, first: str, second: str, cells: Sequence[str]) -> "RawTable":
        """Return the table with one column in place of two.

        Args:
            first, second: columns; the new one is named by both.
            cells: of the new column.
        """
        name = f"{first} {second}"
        columns: dict[str, Sequence[str]] = {}
        for old, old_cells in self.columns.items():
            if old == first:
                columns[name] = cells
            elif old != second:
                columns[old] = old_cells
        return replace(
            self, columns=columns, styles={**self.styles, name: Style(False)}
        )


def read_table(
    path: str | os.PathLike[str],
    names: Collection[str] = (),
    header_row: int | None = None,
    sheet: str | None = None,
    decimal: str | None = None,
    header: Sequence[str] = (),
    matrix: Sequence[str] = (),
) -> RawTable:
    """Read a table as text.

    Args:
        path: text (separated by commas, semicolons, tabs, bars or blanks) or a spreadsheet.
        names: columns that the user named; they show which row is the header.
        header_row: row of the header, from 1; searched when left out.
        header: names of the columns of a table without any, in place of its header.
        sheet: of a spreadsheet; the one that names most quantities when left out.
        decimal: `point` or `comma`; the table decides when left out.
        matrix: names of the row axis, the column axis and the cells of a map that is a matrix.

    Raises:
        InputError: the file cannot be read or holds no table, or the sheet is missing.
    """
    source = str(Path(path))
    if is_spreadsheet(Path(path)):
        sheets, sha256 = read_spreadsheet(Path(path), sheet)
        separator = "sheet"
    elif sheet is not None:
        raise InputError(f"{source}: has no sheets; --sheet is for Excel")
    else:
        text, sha256 = read_text(path, utf_16=True)
        separator = labview.stated_separator(text)
        if not separator and header:
            separator = _separator_of_width(text, len(header), source)
        elif not separator:
            separator = _separator(text, names, header_row, source)
        sheets = [Sheet("", split_rows(text, separator, source))]
    described = ""
    if matrix or (not header and header_row is None):
        sheets, described = with_points(sheets, matrix, names, source)
    chosen, top, names_of_columns = _best_sheet(
        sheets, names, header_row, header, source
    )
    if labview.names_row(chosen.rows) == top > 0:
        rows_of_numbers = labview.without_segment_keys(chosen.rows, top, source)
        chosen = chosen._replace(rows=rows_of_numbers)
    columns, units, rows, broken = _body(chosen, top, names_of_columns, source)
    if separator == "sheet":
        columns, styles = _with_plain_texts(columns, rows, chosen.text_numbers, decimal)
    else:
        styles = decimal_styles(columns, decimal, separator == ",")
    doubled = [
        name
        for name in dict.fromkeys(names_of_columns)
        if name and names_of_columns.count(name) > 1
    ]
    return RawTable(
        columns,
        units,
        rows,
        broken,
        styles,
        source,
        chosen.name,
        sha256,
        top,
        tuple(doubled),
        _text_above(chosen.rows, top),
        _hidden(chosen, columns),
        _without_name(columns, names_of_columns),
        described,
    )


def _best_sheet(
    sheets: Sequence[Sheet],
    names: Collection[str],
    header_row: int | None,
    given: Sequence[str],
    source: str,
) -> tuple[Sheet, int, list[str]]:
    """Return the sheet that names most quantities, its row of the header and the header.

    Args:
        sheets: of a spreadsheet, or the rows of a text as one sheet.
        names: columns that the user named.
        header_row: row of the header, from 1; searched when left out.
        given: names of the columns of a table without any, in place of its header.
        source: name of the file, for messages.

    Raises:
        InputError: all sheets are empty, another sheet holds such a table too, or it is hidden.
    """
    ranked = []
    for sheet in sheets:
        top, header = _header(sheet.rows, names, header_row, sheet.merged_ends)
        if given:
            top = header_row or _rows_above_numbers(sheet.rows)
            header = list(given)
        worth = _worth(header)
        rank = (_matches(header, names), worth > 0 and not sheet.hidden, worth)
        ranked.append((rank, sheet, top, header))
    if not ranked:
        raise InputError(f"{source}: is empty")
    best = max(ranked, key=lambda candidate: candidate[0])
    rank, chosen, top, header = best
    if not any(header):
        raise InputError(f"{source}: is empty")
    rivals = []
    for other, sheet, _, _ in ranked:
        alike = other[:2] == rank[:2] and other[2] >= _RIVAL_SHEET * rank[2]
        if sheet is chosen or (alike and rank[2] > 1):
            rivals.append(sheet.name)
    options = " or ".join(f"--sheet {shlex.quote(name)}" for name in rivals)
    if len(rivals) > 1:
        raise InputError(
            f"{source}: {len(rivals)} sheets hold such a table: add {options}"
        )
    if chosen.hidden and len(sheets) > 1:
        raise InputError(
            f"{source}: the sheet {chosen.name!r} with the table is hidden: add {options}"
        )
    return chosen, top, header


def _with_plain_texts(
    columns: Mapping[str, Sequence[str]],
    rows: Sequence[int],
    text_numbers: Collection[tuple[int, int]],
    decimal: str | None,
) -> tuple[dict[str, Sequence[str]], dict[str, Style]]:
    """Write numbers that a sheet holds as text with a decimal point, as its other cells are.

    Args:
        columns: cells by column.
        rows: number of each row in the sheet.
        text_numbers: row and column of numbers that are text.
        decimal: `point` or `comma`, where the user says so.

    Returns:
        Columns, and their styles; doubtful where the texts can be read in two ways.
    """
    texts: dict[str, list[int]] = {}
    for position, name in enumerate(columns):
        held = [
            index for index, row in enumerate(rows) if (row, position) in text_numbers
        ]
        if held:
            texts[name] = held
    cells_of_text = {
        name: [columns[name][index] for index in held] for name, held in texts.items()
    }
    styles = decimal_styles(cells_of_text, decimal, False)
    plain = dict(columns)
    for name, held in texts.items():
        if not styles[name].comma:
            continue
        cells = list(columns[name])
        for index in held:
            value, unit = parsed(cells[index], True)
            if np.isfinite(value):
                cells[index] = f"{value!r} {unit}".strip()
        plain[name] = cells
    taken = {name: Style(False) for name in columns}
    for name, style in styles.items():
        taken[name] = Style(False, style.doubtful)
    return plain, taken


def _hidden(sheet: Sheet, columns: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the names of the columns that a sheet hides."""
    names = list(columns)
    return tuple(
        names[position]
        for position in sorted(sheet.hidden_columns)
        if position < len(names)
    )


def _text_above(rows: Sequence[list[str]], top: int) -> str:
    """Return the text of the lines above a header."""
    lines = [" ".join(cell for cell in row if cell) for row in rows[: top - 1]]
    return "\n".join(line for line in lines if line)


def _without_name(
    columns: Mapping[str, Sequence[str]], header: Sequence[str]
) -> tuple[str, ...]:
    """Return the columns of numbers below an empty cell of the header."""
    names = []
    for name, given in zip(columns, header, strict=False):
        if not given and any(is_number(cell) for cell in columns[name]):
            names.append(name)
    return tuple(names)


def _separator(
    text: str, names: Collection[str], header_row: int | None, source: str
) -> str:
    """Return the separator by which most rows fit the header, and the header names most."""
    lines = text.splitlines()[: 3 * _SNIFFED]
    head = "\n".join(lines[:_SNIFFED])
    best = ""
    best_rank: tuple[bool, bool, int, int] | None = None
    for separator in SEPARATORS:
        if separator and separator not in head:
            continue
        try:
            rows = split_rows(head, separator, source)
        except InputError:
            if separator and head.count(separator) > len(lines):
                raise
            continue
        _, header = _header(rows, names, header_row)
        filled = [row for row in rows if any(row)]
        fitting = sum(len(row) == len(header) for row in filled) > len(filled) / 2
        rank = (
            _matches(header, names),
            fitting and len(header) > 1,
            _worth(header) if separator else min(_worth(header), 1),
            consistent_rows(rows) if separator else 0,
        )
        if best_rank is None or rank > best_rank:
            best = separator
            best_rank = rank
    return best


def _separator_of_width(text: str, width: int, source: str) -> str:
    """Return the separator by which most rows have a number of fields.

    Raises:
        InputError: by none of them a row has as many.
    """
    head = "\n".join(text.splitlines()[:_SNIFFED])
    best = ""
    most = -1
    for separator in SEPARATORS:
        try:
            rows = split_rows(head, separator, source)
        except InputError:
            continue
        fitting = sum(len(row) == width for row in rows)
        if fitting > most:
            best = separator
            most = fitting
    if most < 1:
        raise InputError(
            f"{source}: {width} names are given, but no row has {width} cells: name every "
            "column of the table, in its order"
        )
    return best


def _rows_above_numbers(rows: Sequence[list[str]]) -> int:
    """Return how many rows stand above the first row of numbers."""
    for number, row in enumerate(rows):
        if _numeric(row):
            return number
    return 0


def _header(
    rows: Sequence[list[str]],
    names: Collection[str],
    header_row: int | None,
    merged_ends: Collection[tuple[int, int]] = (),
) -> tuple[int, list[str]]:
    """Return the row of the header, from 1, and its cells; two rows of names are joined."""
    if header_row is not None:
        if header_row > len(rows):
            return header_row, []
        return header_row, rows[header_row - 1]
    of_labview = labview.names_row(rows)
    if of_labview > 0:
        return of_labview, rows[of_labview - 1]
    filled = [number for number, row in enumerate(rows[: 10 * _TOP]) if any(row)][:_TOP]
    best = (0, [""])
    best_rank = (False, 0, True)
    for number in filled:
        comment = rows[number][0].startswith("#")
        for header in _possible_headers(rows, number, merged_ends):
            rank = (_matches(header, names), _worth(header), not comment)
            if rank > best_rank:
                best = (number + 1, header)
                best_rank = rank
    if best[0] > 0:
        return best
    for number in filled:
        if not rows[number][0].startswith("#"):
            return number + 1, rows[number]
    return best


def _possible_headers(
    rows: Sequence[list[str]],
    number: int,
    merged_ends: Collection[tuple[int, int]],
) -> list[list[str]]:
    """Return a row of names, and the same joined with the row above it; none for numbers.

    Args:
        rows: of the file.
        number: position of the row.
        merged_ends: row, from 1, and last column, from 0, of merged cells.
    """
    row = rows[number]
    if _numeric(row) or _mostly_units(row):
        return []
    if number == 0:
        return [row]
    above = rows[number - 1]
    groups = sum(map(bool, above)) >= 2  # one cell alone is a title
    if (
        len(above) == len(row)
        and groups
        and not (_numeric(above) or _only_units(above))
    ):
        ends = {column for line, column in merged_ends if line == number}
        return [row, _joined(above, row, ends)]
    return [row]


def _joined(
    above: Sequence[str], below: Sequence[str], ends: Collection[int]
) -> list[str]:
    """Join two rows of names; a name above may stand for several below.

    Args:
        above, below: cells.
        ends: last columns of merged cells above, behind which their name stands no longer.
    """
    joined = []
    group = ""
    for column, (upper, lower) in enumerate(zip(above, below, strict=True)):
        if upper or column - 1 in ends:
            group = upper
        joined.append(f"{group} {lower}".strip())
    return joined


def _numeric(row: Sequence[str]) -> bool:
    """Return whether at least half of the filled cells of a row are numbers."""
    filled = [cell for cell in row if cell]
    numbers = sum(is_number(cell) for cell in filled)
    return 2 * numbers >= len(filled) > 0


def _mostly_units(row: Sequence[str]) -> bool:
    """Return whether at least half of the filled cells of a row are units."""
    filled = [cell for cell in row if cell]
    units = sum(usual_unit(cell) is not None for cell in filled)
    return 2 * units >= len(filled) > 0


def _only_units(row: Sequence[str]) -> bool:
    """Return whether a row holds two or more units and nothing else."""
    filled = [cell for cell in row if cell]
    return len(filled) >= 2 and all(usual_unit(cell) is not None for cell in filled)


def _matches(header: Sequence[str], names: Collection[str]) -> bool:
    return bool(names) and set(names) <= set(distinct(header))


def _worth(header: Sequence[str]) -> int:
    """Return how many quantities a row names."""
    named = {names_quantity(cell) for cell in header if cell and not is_number(cell)}
    return len(named - {""})


def distinct(header: Sequence[str]) -> list[str]:
    """Name the columns of a header so that no name is empty and all differ."""
    given = [cell.strip() or "unnamed" for cell in header]
    names: list[str] = []
    for first in given:
        name = first
        for number in count(2):
            if name not in names and (name == first or name not in given):
                break
            name = f"{first} ({number})"
        names.append(name)
    return names


def _body(
    sheet: Sheet, top: int, header: Sequence[str], source: str
) -> tuple[dict[str, Sequence[str]], dict[str, str], list[int], dict[int, str]]:
    """Return columns, row of units, row numbers and broken rows below the header."""
    all_rows = sheet.rows
    body = [
        (number, row)
        for number, row in enumerate(all_rows[top:], top + 1)
        if any(row) and number not in sheet.hidden_rows
    ]
    header = _without_empty_end(header, [row for _, row in body])
    width = len(header)
    names = distinct(header)
    shortest = _complete_from(header, [row for _, row in body])
    rows, cells, broken = _complete_rows(body, width, shortest, top)
    if len(broken) > _LONG_ROWS * (len(body) or 1) and len(broken) > 1:
        _refuse_lengths(header, top, broken, len(body), source)
    names, units, first = _units_of(names, cells, all_rows[:top])
    if not units and labview.names_row(all_rows) == top > 0:
        stated = labview.stated_units(all_rows, top)
        units = dict(zip(names, stated, strict=False))
    cells = cells[first:]
    rows = rows[first:]
    broken |= _hidden_rows(sheet, top)
    if not cells and not broken:
        raise InputError(f"{source}: holds a header but no samples")
    columns: dict[str, Sequence[str]] = dict.fromkeys(names, ())
    if cells:
        columns = dict(zip(names, zip(*cells, strict=True), strict=True))
    return columns, units, rows, broken


def _units_of(
    names: list[str], cells: Sequence[list[str]], above: Sequence[list[str]]
) -> tuple[list[str], dict[str, str], int]:
    """Return the names of the columns, their units, and the position of the first test.

    Args:
        names: of the header.
        cells: rows below the header; the row of units may be among the first.
        above: rows down to the header; the row of units may be the last but one.
    """
    position = _row_of_units(cells)
    if position is not None:
        for kinds in cells[:position]:
            names = _with_kinds(names, kinds)
        units = dict(zip(names, cells[position], strict=True))
        return names, units, position + 1
    if len(above) > 1 and _mostly_units(above[-2]):
        padded = [*above[-2], *[""] * len(names)]
        return names, dict(zip(names, padded, strict=False)), 0
    return names, {}, 0


def _hidden_rows(sheet: Sheet, top: int) -> dict[int, str]:
    """Return the filled rows below a header that a sheet hides."""
    hidden = {}
    for number in sheet.hidden_rows:
        if top < number <= len(sheet.rows) and any(sheet.rows[number - 1]):
            hidden[number] = "is hidden in the sheet"
    return hidden


def _row_of_units(cells: Sequence[list[str]]) -> int | None:
    """Return the position of the row of units among the first rows; None without one."""
    for position, row in enumerate(cells[:_ROWS_OF_KINDS]):
        if holds_units(row):
            return position
        if any(map(is_number, row)):
            return None
    return None


def _with_kinds(names: Sequence[str], kinds: Sequence[str]) -> list[str]:
    """Add the cells of a row such as `mean` or `set value` between header and units.

    Numbers of channels and types of data say nothing about a column.
    """
    joined = []
    for name, kind in zip(names, kinds, strict=True):
        if _CHANNEL.fullmatch(kind):
            joined.append(name)
        else:
            joined.append(f"{name} {kind}".strip())
    return distinct(joined)


def _without_empty_end(
    header: Sequence[str], body: Sequence[Sequence[str]]
) -> list[str]:
    """Return a header without names that are missing at its end.

    A name stays missing, as that of a column, where most rows have a cell below it.
    """
    names = list(header)
    while len(names) > 1 and not names[-1]:
        last = len(names) - 1
        filled = sum(len(row) > last and bool(row[last]) for row in body)
        if 2 * filled > len(body):
            break
        names.pop()
    return names


def _complete_rows(
    body: Sequence[tuple[int, list[str]]], width: int, shortest: int, top: int
) -> tuple[list[int], list[list[str]], dict[int, str]]:
    """Return numbers and cells of complete rows, and what is wrong with the others.

    Args:
        body: number and cells of each row.
        width: fields of the header.
        shortest: fields that a complete row has at least.
        top: row of the header.
    """
    rows: list[int] = []
    cells: list[list[str]] = []
    broken: dict[int, str] = {}
    for number, row in body:
        while len(row) > width and not row[-1]:
            row = row[:-1]  # separators at the end of a line
        if shortest <= len(row) <= width:
            row += [""] * (width - len(row))
            cells.append(row)
            rows.append(number)
        else:
            broken[number] = (
                f"{len(row)} fields, the header in row {top} has {width} (decimal comma, "
                "other separator, a comment, or lines above the header?)"
            )
    return rows, cells, broken


def _complete_from(header: Sequence[str], body: Sequence[Sequence[str]]) -> int:
    """Return the fields that a complete row has at least.

    A lost field in the middle of a row shifts the rest, so that a row without the last quantity is
    not taken, unless no row has it.
    """
    longest = max((len(row) for row in body[1:]), default=len(header))
    least = min(len(header), longest)
    if least < max(2, len(header) // 2):
        return len(header)
    while least > 1 and not names_quantity(header[least - 1]):
        least -= 1
    return least


def _refuse_lengths(
    header: Sequence[str], top: int, broken: Mapping[int, str], total: int, source: str
) -> None:
    first = min(broken)
    shown = ", ".join(cell for cell in header if cell)
    raise InputError(
        f"{source}: row {top} was taken for the header ({shown}), but {len(broken)} of "
        f"{total} rows below have another number of fields: row {first}: {broken[first]}"
    )
