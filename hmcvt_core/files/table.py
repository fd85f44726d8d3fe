# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Strict CSV with known names and no broken row; every message names its row.

Tables of any other form are read by `hmcvt_tools.tables`.
"""

import csv
import io
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..transmission.ranges import Array, Range
from .numbers import is_number, no_number
from .text import read_text, split_rows

# A comma that cannot set thousands apart, as in 0,643 or 78,54, and a point that is one.
_COMMA = re.compile(
    r"[+-]?(0?,\d+|\d+,(\d{1,2}|\d{4,}))([eE][+-]?\d+)?|[+-]?\d{1,3}(\.\d{3})+,\d+"
)
_POINT = re.compile(r"[+-]?(\d*\.\d+|\d+\.)([eE][+-]?\d+)?")
_MAX_TITLES = 5
"""Rows of titles above a header."""
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")


@dataclass(frozen=True, eq=False)
class Table:
    """A table as text.

    Attributes:
        columns: one cell for each row, by column name; no name is doubled.
        rows: line or row of each in the file, from 1.
        broken: what rows of another length hold, by row.
        commas: columns whose commas are decimal commas.
        source, sha256: of the file.
    """

    columns: dict[str, list[str]]
    rows: list[int]
    broken: dict[int, str]
    commas: Collection[str]
    source: str
    sha256: str

    def numbers(self, name: str, optional: bool = False) -> Array:
        """Plain numbers of a column; an `InputError` names the row of what is no number."""
        values = np.empty(len(self.rows))
        for i, cell in enumerate(self.columns[name]):
            plain = cell
            if name in self.commas:
                # A point may stand between thousands where commas are decimal.
                plain = cell.replace(".", "?").replace(",", ".")
            try:
                values[i] = _plain_number(plain)
            except ValueError:
                cure = ""
                if optional and not cell:
                    cure = ": fill it in, or leave the column out"
                raise InputError(
                    f"{self.source}: row {self.rows[i]}: {no_number(name, cell)}{cure}"
                ) from None
        return values

    def require_range(self, values: Array, limits: Range) -> None:
        """Raise an `InputError` that names the row of the first value outside its range."""
        outside = np.flatnonzero(~limits.contains(values))
        if len(outside):
            raise InputError(
                f"{self.source}: row {self.rows[outside[0]]}: "
                f"{limits.complaint(values[outside[0]])}"
            )


def read_plain(
    path: str | os.PathLike[str],
    required: Sequence[str] = (),
    name_of: Callable[[str], str] = str.strip,
) -> Table:
    """Read CSV with a header in its first line that is not empty and does not begin with #.

    Args:
        path: of the file; separated by commas, semicolons or tabs; UTF-8, or else
            Windows-1252.
        required: columns that must be there.
        name_of: gives the name of a column from its cell in the header.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a required column is
            missing, a column doubled, or a row of another length than the header.
    """
    text, sha256 = read_text(path)
    # The header shows the separator of the columns; a note below may hold anything.
    line = _first_line(text)
    mark = max(",;\t", key=line.count)  # what stands there most, first a comma
    rows = split_rows(text, mark, str(path))
    # Above the header only: below it a cell may well begin like that.
    top = _header_row(rows)
    if top == 0:
        needs = ""
        if required:
            needs = f"; needs columns {', '.join(required)}"
        raise InputError(f"{path}: is empty{needs}")
    if all(map(is_number, rows[top - 1])):
        raise InputError(
            f"{path}: row {top}: holds numbers only: write the names of the columns above "
            "the numbers"
        )
    header = [name_of(cell) for cell in rows[top - 1]]
    _require_names(header, required, f"{path}: row {top}")
    table = _table(rows, top, header, str(Path(path)), sha256)
    for number, complaint in table.broken.items():
        raise InputError(f"{path}: row {number}: {complaint}")
    if mark == ",":
        return replace(table, commas=())
    return table


def _require_names(header: Sequence[str], required: Sequence[str], place: str) -> None:
    """Refuse a header with nameless, doubled or missing columns; see `read_plain`."""
    nameless = [str(number) for number, name in enumerate(header, 1) if not name]
    if len(nameless) > 1:
        raise InputError(
            f"{place}: columns {', '.join(nameless)} have no name: name them, or "
            "delete them"
        )
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{place}: column {name!r} stands there twice")
    missing = [name for name in required if name not in header]
    if missing:
        raise InputError(
            f"{place}: column {', '.join(missing)} is missing; "
            f"there is {', '.join(header)} (`hmcvt import` takes other names)"
        )


def _first_line(text: str) -> str:
    """Return the first line that is neither empty nor a comment; `""` for none."""
    for line in text.splitlines():
        if line.strip() and line[0] != "#":
            return line
    return ""


def _header_row(rows: Sequence[list[str]]) -> int:
    """Return the row of the header, from 1; 0 for none.

    It is the first row that is neither empty nor a comment, and no title: that leaves most cells
    empty, and a row of names stands below it.
    """
    filled = []
    for number, row in enumerate(rows, 1):
        if any(row) and row[0][:1] != "#":
            filled.append(number)
        if len(filled) > _MAX_TITLES:
            break
    for number, following in pairwise(filled):
        row = rows[number - 1]
        below = rows[following - 1]
        is_title = 2 * sum(map(bool, row)) <= len(row)
        if not (is_title and all(below) and not any(map(is_number, below))):
            return number
    return filled[0] if filled else 0


def _table(
    rows: Sequence[list[str]], top: int, header: Sequence[str], source: str, sha256: str
) -> Table:
    """The table below a header in row `top`."""
    numbers = []
    body = []
    broken = {}
    for number, row in enumerate(rows[top:], top + 1):
        while len(row) > len(header) and not row[-1]:
            row = row[:-1]  # separators at the end of a line
        if len(row) == len(header) and any(row):
            numbers.append(number)
            body.append(row)
        elif any(row):
            broken[number] = (
                f"{len(row)} fields, the header has {len(header)} (decimal comma, "
                "other separator, a comment, or lines above the header?)"
            )
    if not body and not broken:
        raise InputError(f"{source}: holds a header but no samples")
    columns = {}
    for position, name in enumerate(header):
        columns[name] = [row[position] for row in body]
    return Table(columns, numbers, broken, _with_commas(columns), source, sha256)


def _with_commas(columns: Mapping[str, Sequence[str]]) -> Collection[str]:
    """Columns in which a comma can be nothing but a decimal one, or is as in another column."""
    with_comma = set()
    pointed = set()
    for name, cells in columns.items():
        if any(map(_COMMA.fullmatch, cells)):
            with_comma.add(name)
        dotted = list(filter(_POINT.fullmatch, cells))
        # Not those between thousands, as in 850, 1.200.
        grouped = all(map(_THOUSANDS.fullmatch, dotted))
        if dotted and not grouped:
            pointed.add(name)
    if with_comma <= pointed:
        return ()
    return columns.keys() - pointed


def csv_text(columns: Mapping[str, Iterable[Any]]) -> str:
    """Return columns of one length as CSV."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(
        [columns, *zip(*columns.values(), strict=True)]
    )
    return buffer.getvalue()


def _plain_number(text: str) -> float:
    return float(text.replace("_", "?"))  # Python reads 2_99 as 299
