# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The table of any bench, from CSV or Excel: titles, units, footers and gaps of its own."""

from __future__ import annotations

import io
import math
import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from itertools import accumulate, count, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .bench import below, commas_are_points, file_bytes, file_text, split
from .guess import holds_units, quantity_of, unit_of

Array = NDArray[np.float64]
EXCEL = (".xlsx", ".xlsm", ".xls", ".ods")
_TOP = 40  # rows among which the header is looked for
_SENTINELS = (-999.0, -9999.0, -99999.0, 9999.0, 99999.0, 1e30, -1e30)
_NUMBER = re.compile(r"([+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?)(?:\s*([^\d\s.,].*))?")
_BLANKS = re.compile(r"(?<=\d)[ '\u00a0\u202f](?=\d{3}\b)")  # between thousands
_GROUPED = re.compile(r"[+-]?\d{1,3}(\.\d{3})+,\d+")
STATISTIC = re.compile(
    r"(mean( values?)?|average|avg|min(imum)?|max(imum)?|median|std|st(d\.? ?)?dev|sum|total|rms|"
    r"standard deviation|mittel(wert)?|durchschnitt|summe|gesamt|streuung|standardabweichung|"
    r"moyenne|médiane|écart[ -]type|media)\.?:?", re.IGNORECASE)
"""A cell that makes a row a summary of others."""
_TIMES = [f"%Y-%m-%d{mark}{time}" for mark in " T" for time in (
    "%H:%M:%S", "%H:%M:%S.%f", "%H:%M", "%H:%M:%S%z", "%H:%M:%S.%f%z")]


class Table(NamedTuple):
    """A table as text.

    Attributes:
        columns: one cell for each row, by column name; no name is empty or doubled.
        units: what a row of units says, by column; empty without one.
        rows: line or row of each in the file, from 1.
        broken: what rows of another length hold, by row.
        comma: whether commas are decimal commas.
        source, sha256: of the file.
    """

    columns: dict[str, list[str]]
    units: dict[str, str]
    rows: list[int]
    broken: dict[int, str]
    comma: bool
    source: str
    sha256: str

    def numbers(self, name: str) -> Array:
        """Numbers of a column, NaN where a cell holds none; a known unit may follow them."""
        found = np.array([_number(cell, self.comma) for cell in self.columns[name]])
        return np.where(np.isin(found, _SENTINELS), np.nan, found)

    def cell_units(self, name: str) -> list[str]:
        """Units behind the numbers of a column; `""` where a cell says none."""
        said = [_parts(cell)[1] for cell in self.columns[name]]
        known = {text: unit_of(text) or ("", "") for text in {*said}}
        return [known[text][1] for text in said]

    def stamps(self, name: str, unit: float = 1.0) -> Array:
        """Seconds of a column of times: numbers of a unit [s], times of day, or dates (UTC)."""
        return np.array([_seconds(cell) if ":" in cell else unit * value for cell, value in zip(
            self.columns[name], self.numbers(name), strict=True)])


def read_table(
    path: str | os.PathLike[str], names: Collection[str] = (), header_row: int | None = None,
    sheet: str | None = None,
) -> Table:
    """Read a table as text.

    Args:
        path: CSV (commas, semicolons, tabs or blanks; UTF-8 or Windows-1252) or Excel.
        names: columns that must be there; they tell which row is the header.
        header_row: row of the header, from 1; found when left out.
        sheet: of an Excel file; the one that looks most like a bench table when left out.

    Raises:
        InputError: the file is missing, empty, too large or no table, or the sheet is not there.
    """
    source = str(Path(path))
    if Path(path).suffix.lower() in EXCEL:
        sha256, sheets = _excel(Path(path), sheet)
    elif sheet is not None:
        raise InputError(f"{source}: has no sheets; --sheet is for Excel")
    else:
        text, sha256 = file_text(Path(path))
        sheets = [_separated(text, source)]
    rows, top, header = max((
        (rows, *_header(rows, names, header_row)) for rows in sheets),
        key=lambda found: _worth(found[2]))
    if not any(header):
        raise InputError(f"{source}: is empty")
    titles = _distinct(header)
    body, broken = below(rows, top, len(header), source)
    units = {}
    wanted = [titles.index(name) for name in names if name in titles] or range(len(titles))
    if body and holds_units([body[0][1][i] for i in wanted]):
        units = dict(zip(titles, body.pop(0)[1], strict=True))
    if not body and not broken:
        raise InputError(f"{source}: holds a header but no samples")
    cells = [cell for _, row in body for cell in row]
    comma = any(map(_GROUPED.fullmatch, cells)) or commas_are_points(cells)
    return Table({name: [row[i] for _, row in body] for i, name in enumerate(titles)}, units,
                 [number for number, _ in body], broken, comma, source, sha256)


def _separated(text: str, source: str) -> list[list[str]]:
    lines = [line for line in text.splitlines()[:2 * _TOP] if line.strip()]
    counts = {mark: Counter(count for line in lines if (count := line.count(mark)))
              for mark in ";\t,"}
    # The mark that stands most often equally often in a line.
    mark = max(counts, key=lambda each: max(counts[each].values(), default=0))
    if lines and not counts[mark]:
        return [re.split(r"\s+", line.strip()) for line in text.splitlines()]
    return split(text, mark, source)


def _excel(path: Path, sheet: str | None) -> tuple[str, list[list[list[str]]]]:
    try:
        import pandas
    except ImportError:
        raise InputError(f"{path}: an Excel file needs pandas and openpyxl: pip install "
                         "\"hmcvt_ros[table]\", or save it as CSV") from None
    raw, sha256 = file_bytes(path)
    try:
        frames = pandas.read_excel(io.BytesIO(raw), sheet_name=None, header=None, dtype=object)
    except Exception as error:  # of the library that reads this kind of file
        raise InputError(f"{path}: no Excel file, or damaged: {error}") from None
    if sheet is not None:
        if sheet not in frames:
            raise InputError(f"{path}: sheet {sheet!r} is missing; there is {', '.join(frames)}")
        frames = {sheet: frames[sheet]}
    return sha256, [
        [["" if pandas.isna(cell) else str(cell).strip() for cell in row]
         for row in frame.itertuples(index=False)] for frame in frames.values()]


def _header(
    rows: Sequence[list[str]], names: Collection[str], header_row: int | None
) -> tuple[int, list[str]]:
    """How many rows stand above the table, and its header; two rows of names are joined."""
    if header_row is not None:
        return header_row, rows[header_row - 1] if header_row <= len(rows) else []
    filled = [i for i, row in enumerate(rows) if any(row) and not row[0].startswith("#")][:_TOP]
    options = [(i + 1, rows[i]) for i in filled]
    options += [(i + 1, _joined(rows[i - 1], rows[i])) for i in filled
                if i and len(rows[i - 1]) == len(rows[i])]

    def rank(option: tuple[int, list[str]]) -> tuple[bool, int]:
        return bool(names) and set(names) <= set(_distinct(option[1])), _worth(option[1])

    best = max(options, key=rank, default=(0, []))
    return best if rank(best) > (False, 1) else options[0] if options else best


def _joined(above: Sequence[str], names: Sequence[str]) -> list[str]:
    """The names of a row each behind the one above, which may stand for several."""
    groups: Iterable[str] = accumulate(above, lambda last, cell: cell or last)
    return [f"{group} {name}".strip() for group, name in zip(groups, names, strict=True)]


def _worth(header: Sequence[str]) -> int:
    """How many quantities of a bench a row names."""
    return len({hit[0] for cell in header if cell and not _NUMBER.fullmatch(cell)
                and (hit := quantity_of(cell)) is not None})


def _distinct(header: Sequence[str]) -> list[str]:
    """Name the columns of a header so that no name is empty and all differ."""
    given = [cell.strip() or "unnamed" for cell in header]
    names: list[str] = []
    for first in given:
        others = (f"{first} ({number})" for number in count(2))
        names.append(first if first not in names else next(
            name for name in others if name not in {*given, *names}))
    return names


def _parts(cell: str) -> tuple[str, str]:
    """Number of a cell, as text, and what stands behind it."""
    hit = _NUMBER.fullmatch(_BLANKS.sub("", cell))
    return (hit[1], hit[2] or "") if hit else ("", "")


def _number(cell: str, comma: bool) -> float:
    with suppress(ValueError):
        return float(cell.replace("_", "?"))  # Python reads 2_99 as 299
    text, unit = _parts(cell)
    if unit and unit_of(unit) is None:
        return math.nan
    if comma and "," in text:
        text = text.replace(".", "").replace(",", ".")
    elif re.fullmatch(r"[+-]?\d{1,3}(,\d{3})+\.\d+", text):
        text = text.replace(",", "")
    with suppress(ValueError):
        return float(text)
    return math.nan


def _seconds(cell: str) -> float:
    day = re.sub(r"(\d\d?)[./](\d\d?)[./](\d{4})\b", r"\3-\2-\1", cell)
    for text, form in product((day, f"1970-01-01 {day}"), _TIMES):  # or a time of day alone
        with suppress(ValueError):
            found = datetime.strptime(text, form)
            return found.replace(tzinfo=found.tzinfo or timezone.utc).timestamp()
    return math.nan
