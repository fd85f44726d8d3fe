# SPDX-License-Identifier: Apache-2.0
"""Columns of numbers from CSV, checked against their ranges; every complaint names its place."""

from __future__ import annotations

import csv
import hashlib
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .ranges import BENCH_COLUMNS

Array = NDArray[np.float64]
_MAX_BYTES = 256 * 1024 * 1024


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
    """Read a CSV file with a header.

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
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}") from None
    header, body = _lines(text, str(path), required)
    cells = {name: [row[i].strip() for _, row in body] for i, name in enumerate(header)}
    rows = [number for number, _ in body]
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


def _lines(
    text: str, source: str, required: Sequence[str]
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header and the numbered rows below it."""
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None
    numbered = [(number, row) for number, row in enumerate(rows, 1)
                if any(cell.strip() for cell in row)]
    if not numbered:
        raise InputError(f"{source}: is empty; needs columns {', '.join(required)}")
    (top, first), body = numbered[0], numbered[1:]
    header = [cell.strip() for cell in first]
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
        if len(row) != len(header):
            raise InputError(f"{source}: row {number}: {len(row)} fields, "
                             f"the header has {len(header)}")
    return header, body


def _numbers(cells: list[str], rows: list[int], name: str, source: str) -> Array:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            values[i] = float(cell)
        except ValueError:
            what = f"{cell!r} is not a number" if cell else "is empty"
            raise InputError(f"{source}: row {rows[i]}: {name} {what}") from None
    return values
