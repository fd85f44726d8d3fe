# SPDX-License-Identifier: Apache-2.0
"""Columns of numbers from CSV, checked against their ranges; every complaint names its place."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .ranges import BENCH_COLUMNS, REQUIRED_COLUMNS

Array = NDArray[np.float64]
_MAX_BYTES = 256 * 1024 * 1024
_NAMES = frozenset(column.name for column in BENCH_COLUMNS)
_SPECIAL = ("nan", "inf", "infinity")
_DECIMAL_COMMA = re.compile(r"[+-]?(0?,\d+|\d+,(\d{1,2}|\d{4,}))([eE][+-]?\d+)?")


class Columns(NamedTuple):
    """What a file holds.

    Attributes:
        known: columns that hmcvt knows, by name, shape (n,) each.
        extra: the others, as text.
        rows: line of each sample in the file, from 1.
        source, sha256: of the file.
    """

    known: dict[str, Array]
    extra: dict[str, tuple[str, ...]]
    rows: list[int]
    source: str
    sha256: str


def read_columns(path: str | os.PathLike[str], required: Sequence[str]) -> Columns:
    """Read a CSV file with a header, separated by commas, semicolons or tabs.

    Lines above the header that begin with # are left out. The names of known columns may be
    written with capitals and spaces.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a required column is
            missing or a column doubled, or a value is not a number or outside its range.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a bench log")
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}: "
                         "save it as 'CSV UTF-8'") from None
    if "\n" not in text:
        text = text.replace("\r", "\n")  # line ends of old programs
    separator = _separator(text)
    header, body = _lines(text, separator, str(path), required)
    cells = {name: [row[i].strip() for _, row in body] for i, name in enumerate(header)}
    rows = [number for number, _ in body]
    if separator != ",":
        _read_decimal_commas(cells)
    _refuse_units(cells, rows, str(path), required)
    known = {}
    for column in BENCH_COLUMNS:
        if column.name not in cells:
            continue
        values = _numbers(cells.pop(column.name), rows, column.name, str(path))
        inside = column.contains(values)
        if not inside.all():
            first = int(np.flatnonzero(~inside)[0])
            raise InputError(f"{path}: row {rows[first]}: {column.complaint(values[first])}")
        known[column.name] = values
    extra = {name: tuple(column) for name, column in cells.items()}
    return Columns(known, extra, rows, str(path), hashlib.sha256(raw).hexdigest())


def _separator(text: str) -> str:
    """Tell from the header what separates the columns: what stands there most, first a comma."""
    header = next((line for line in io.StringIO(text) if line.strip() and line[0] != "#"), "")
    return max(",;\t", key=header.count)


def _lines(
    text: str, separator: str, source: str, required: Sequence[str]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header and the numbered rows below it."""
    try:
        rows = list(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None
    numbered = [(number, row) for number, row in enumerate(rows, 1)
                if any(cell.strip() for cell in row)]
    # Above the header only: below it a cell may well begin like that.
    while numbered and numbered[0][1][0].startswith("#"):
        numbered.pop(0)
    if not numbered:
        raise InputError(f"{source}: is empty; needs columns {', '.join(required)}")
    (top, first), body = numbered[0], numbered[1:]
    header = [_column_name(cell) for cell in first]
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{source}: row {top}: column {name!r} stands there twice")
    missing = [name for name in required if name not in header]
    if missing:
        raise InputError(f"{source}: row {top}: column {', '.join(missing)} is missing; "
                         f"there is {', '.join(header)}")
    if not body:
        raise InputError(f"{source}: holds a header but no samples")
    for number, row in body:
        while len(row) > len(header) and not row[-1].strip():
            row.pop()  # separators at the end of a line
        if len(row) != len(header):
            raise InputError(f"{source}: row {number}: {len(row)} fields, the header has "
                             f"{len(header)} (decimal comma, other separator or a comment?)")
    return header, body


def _column_name(cell: str) -> str:
    """Return the name of a column that hmcvt knows also where it is spelled another way."""
    plain = re.sub("[ -]+", "_", cell.strip().lower())
    return plain if plain in _NAMES else cell.strip()


def _read_decimal_commas(cells: dict[str, list[str]]) -> None:
    """Turn decimal commas into points where nothing but decimal commas can be meant.

    That is where no number has a point, and some comma cannot set thousands apart: 0,643 or 78,54.
    """
    known = {name: column for name, column in cells.items() if name in _NAMES}
    every = [cell for column in known.values() for cell in column]
    if not any("." in cell for cell in every) and any(map(_DECIMAL_COMMA.fullmatch, every)):
        for name, column in known.items():
            cells[name] = [cell.replace(",", ".") for cell in column]


def _refuse_units(
    cells: dict[str, list[str]], rows: list[int], source: str, required: Sequence[str]
) -> None:
    """Name a row below the header that holds no number at all where numbers belong."""
    first = [cells[name][0] for name in required]
    if all(cell and not any(map(str.isdigit, cell)) and cell.lower().strip("+-") not in _SPECIAL
           for cell in first):
        raise InputError(f"{source}: row {rows[0]}: {', '.join(first)} are no numbers; remove a "
                         f"row of units ({required[1]} is in rad/s, {required[2]} in N m)")


def _numbers(cells: list[str], rows: list[int], name: str, source: str) -> Array:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            values[i] = float(cell)
        except ValueError:
            what = f"{cell!r} is not a number" if cell else "is empty"
            if "," in cell:
                what += ": write a decimal point, and nothing between thousands"
            elif not cell and name not in REQUIRED_COLUMNS:
                what += ": fill it in, or leave the column out"
            raise InputError(f"{source}: row {rows[i]}: {name} {what}") from None
    return values
