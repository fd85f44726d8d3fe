# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables from CSV or Excel, as text and as numbers; every complaint names its place.

`read_plain` wants a header with known names and no broken row; `read_table` makes what it can of
the titles, units, footers and gaps of any bench.
"""

import csv
import hashlib
import io
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cache, cached_property
from itertools import accumulate, count, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..transmission.ranges import Array, Range
from .guess import holds_units, quantity_of, unit_of

EXCEL = (".xlsx", ".xlsm", ".xls", ".ods")
_MAX_BYTES = 256 * 1024 * 1024
_TOP = 40  # rows among which the header is looked for
_SENTINELS = (-999.0, -9999.0, -99999.0, 9999.0, 99999.0, 1e30, -1e30)
_NUMBER = re.compile(
    r"([+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?)(?:\s*([^\d\s.,].*))?"
)
_BLANKS = re.compile(r"(?<=\d)[ '\u00a0\u202f](?=\d{3}\b)")  # between thousands
# A comma that cannot set thousands apart, as in 0,643 or 78,54, and a point that is one.
_COMMA = re.compile(
    r"[+-]?(0?,\d+|\d+,(\d{1,2}|\d{4,}))([eE][+-]?\d+)?|[+-]?\d{1,3}(\.\d{3})+,\d+"
)
_POINT = re.compile(r"[+-]?(\d*\.\d+|\d+\.)([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")
STATISTIC = re.compile(
    r"(mean( values?)?|average|avg|min(imum)?|max(imum)?|median|std|st(d\.? ?)?dev|sum|total|rms|"
    r"standard deviation|mittel(wert)?|durchschnitt|summe|gesamt|streuung|standardabweichung|"
    r"moyenne|médiane|écart[ -]type|media)\.?:?",
    re.IGNORECASE,
)
"""A cell that makes a row a summary of others."""
_TIMES = [
    f"%Y-%m-%d{mark}{time}"
    for mark in " T"
    for time in ("%H:%M:%S", "%H:%M:%S.%f", "%H:%M", "%H:%M:%S%z", "%H:%M:%S.%f%z")
]


@dataclass(frozen=True, eq=False)
class Table:
    """A table as text.

    Attributes:
        columns: one cell for each row, by column name; no name is doubled.
        units: what a row of units says, by column; empty without one.
        rows: line or row of each in the file, from 1.
        broken: what rows of another length hold, by row.
        commas: columns whose commas are decimal commas.
        source, sha256: of the file.
    """

    columns: dict[str, list[str]]
    units: dict[str, str]
    rows: list[int]
    broken: dict[int, str]
    commas: Collection[str]
    source: str
    sha256: str

    def numbers(self, name: str, optional: bool = False) -> Array:
        """Plain numbers of a column; an `InputError` names the row of what is none."""
        values = np.empty(len(self.rows))
        for i, cell in enumerate(self.columns[name]):
            # Beside decimal commas a point may be one between thousands.
            plain = (
                cell.replace(".", "?").replace(",", ".")
                if name in self.commas
                else cell
            )
            try:
                values[i] = _plain_number(plain)
            except ValueError:
                cure = (
                    ": fill it in, or leave the column out"
                    if optional and not cell
                    else ""
                )
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

    @cached_property
    def readings(self) -> Callable[[str], tuple[Array, NDArray[np.str_]]]:
        """Of a column: numbers, NaN where a cell holds none, and the units behind them."""
        return cache(self._readings)

    def _readings(self, name: str) -> tuple[Array, NDArray[np.str_]]:
        found = [parsed(cell, name in self.commas) for cell in self.columns[name]]
        values = np.array([value for value, _ in found])
        units = np.array([unit for _, unit in found], str)
        return np.where(np.isin(values, _SENTINELS), np.nan, values), units

    def stamps(self, name: str, unit: float = 1.0) -> Array:
        """Seconds of a column of times: numbers of a unit [s], times of day, or dates (UTC)."""
        return np.array(
            [
                _seconds(cell) if ":" in cell else unit * value
                for cell, value in zip(
                    self.columns[name], self.readings(name)[0], strict=True
                )
            ]
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
    text, sha256 = _text(Path(path))
    # The header says what parts the columns; a note below may hold anything.
    line = next(
        (line for line in text.splitlines() if line.strip() and line[0] != "#"), ""
    )
    mark = max(",;\t", key=line.count)  # what stands there most, first a comma
    rows = _separated(text, mark, str(path))
    # Above the header only: below it a cell may well begin like that.
    top = next(
        (i for i, row in enumerate(rows, 1) if any(row) and row[0][:1] != "#"), None
    )
    if top is None:
        needs = f"; needs columns {', '.join(required)}" if required else ""
        raise InputError(f"{path}: is empty{needs}")
    header = [name_of(cell) for cell in rows[top - 1]]
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{path}: row {top}: column {name!r} stands there twice")
    missing = [name for name in required if name not in header]
    if missing:
        raise InputError(
            f"{path}: row {top}: column {', '.join(missing)} is missing; "
            f"there is {', '.join(header)} (`hmcvt import` takes other names)"
        )
    table = _table(rows, top, header, str(Path(path)), sha256)
    for number, told in table.broken.items():
        raise InputError(f"{path}: row {number}: {told}")
    return replace(table, commas=()) if mark == "," else table


def read_table(
    path: str | os.PathLike[str],
    names: Collection[str] = (),
    header_row: int | None = None,
    sheet: str | None = None,
) -> Table:
    """Read a table as text.

    Args:
        path: CSV as `read_plain` takes it, or separated by blanks, or Excel.
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
        text, sha256 = _text(Path(path))
        lines = [line for line in text.splitlines()[: 2 * _TOP] if line.strip()]
        sheets = [_separated(text, _mark(lines), source)]
    rows, top, header = max(
        ((rows, *_header(rows, names, header_row)) for rows in sheets),
        key=lambda found: _worth(found[2]),
    )
    if not any(header):
        raise InputError(f"{source}: is empty")
    table = _table(rows, top, _distinct(header), source, sha256)
    wanted = [name for name in names if name in table.columns] or list(table.columns)
    if not table.rows or not holds_units([table.columns[name][0] for name in wanted]):
        return table
    if not table.rows[1:] and not table.broken:
        raise InputError(f"{source}: holds a header but no samples")
    return replace(
        table,
        units={name: cells[0] for name, cells in table.columns.items()},
        rows=table.rows[1:],
        columns={name: cells[1:] for name, cells in table.columns.items()},
    )


def _table(
    rows: Sequence[list[str]], top: int, header: Sequence[str], source: str, sha256: str
) -> Table:
    """The table below a header in row `top`."""
    numbers, body, broken = [], [], {}
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
    columns = {name: [row[i] for row in body] for i, name in enumerate(header)}
    return Table(columns, {}, numbers, broken, _with_commas(columns), source, sha256)


def _with_commas(columns: Mapping[str, Sequence[str]]) -> Collection[str]:
    """Columns in which a comma can be nothing but a decimal one, or is as in another column."""
    told = {
        name for name, cells in columns.items() if any(map(_COMMA.fullmatch, cells))
    }
    pointed = set()
    for name, cells in columns.items():
        dotted = list(filter(_POINT.fullmatch, cells))
        # Not those between thousands, as in 850, 1.200.
        grouped = all(map(_THOUSANDS.fullmatch, dotted)) and any(
            map(str.isdecimal, cells)
        )
        if dotted and not grouped:
            pointed.add(name)
    return columns.keys() - pointed if told - pointed else ()


def csv_text(columns: Mapping[str, Iterable[Any]]) -> str:
    """Return columns of one length as CSV."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(
        [columns, *zip(*columns.values(), strict=True)]
    )
    return buffer.getvalue()


def _text(path: Path) -> tuple[str, str]:
    """Return the text of a file and its SHA-256; `InputError` where that cannot be."""
    raw, sha256 = _bytes(path)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in raw:
            raise InputError(
                f"{path}: not UTF-8 text at byte {error.start}: save it as 'CSV UTF-8'"
            ) from None
        text = raw.decode("cp1252", "replace")
    if "\n" not in text:
        text = text.replace("\r", "\n")  # line ends of old programs
    return text, sha256


def _bytes(path: Path) -> tuple[bytes, str]:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a bench log"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return raw, hashlib.sha256(raw).hexdigest()


def _mark(lines: Sequence[str]) -> str:
    """What parts the columns: the mark most often equally often in a line, or blanks."""
    counts = {
        mark: Counter(count for line in lines if (count := line.count(mark)))
        for mark in ";\t,"
    }
    mark = max(counts, key=lambda each: max(counts[each].values(), default=0))
    return mark if counts[mark] or not lines else ""


def _separated(text: str, mark: str, source: str) -> list[list[str]]:
    """The cells of every line, without blanks around them."""
    if not mark:
        return [re.split(r"\s+", line.strip()) for line in text.splitlines()]
    try:
        return [
            [cell.strip() for cell in row]
            for row in csv.reader(io.StringIO(text), delimiter=mark, strict=True)
        ]
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None


def _excel(path: Path, sheet: str | None) -> tuple[str, list[list[list[str]]]]:
    try:
        import pandas
    except ImportError:
        raise InputError(
            f"{path}: an Excel file needs pandas and openpyxl: pip install "
            '"hmcvt_ros[table]", or save it as CSV'
        ) from None
    raw, sha256 = _bytes(path)
    try:
        frames = pandas.read_excel(
            io.BytesIO(raw), sheet_name=None, header=None, dtype=object
        )
    except Exception as error:  # of the library that reads this kind of file
        raise InputError(f"{path}: no Excel file, or damaged: {error}") from None
    if sheet is not None:
        if sheet not in frames:
            raise InputError(
                f"{path}: sheet {sheet!r} is missing; there is {', '.join(frames)}"
            )
        frames = {sheet: frames[sheet]}
    return sha256, [
        [
            ["" if pandas.isna(cell) else str(cell).strip() for cell in row]
            for row in frame.itertuples(index=False)
        ]
        for frame in frames.values()
    ]


def _header(
    rows: Sequence[list[str]], names: Collection[str], header_row: int | None
) -> tuple[int, list[str]]:
    """How many rows stand above the table, and its header; two rows of names are joined."""
    if header_row is not None:
        return header_row, rows[header_row - 1] if header_row <= len(rows) else []
    filled = [
        i for i, row in enumerate(rows) if any(row) and not row[0].startswith("#")
    ][:_TOP]
    options = [(i + 1, rows[i]) for i in filled]
    for i in filled:
        if i and len(rows[i - 1]) == len(rows[i]):
            # A name above may stand for several below.
            groups: Iterable[str] = accumulate(
                rows[i - 1], lambda last, cell: cell or last
            )
            options.append(
                (
                    i + 1,
                    [
                        " ".join(pair).strip()
                        for pair in zip(groups, rows[i], strict=True)
                    ],
                )
            )

    def rank(option: tuple[int, list[str]]) -> tuple[bool, int]:
        return bool(names) and set(names) <= set(_distinct(option[1])), _worth(
            option[1]
        )

    best = max(options, key=rank, default=(0, []))
    return best if rank(best) > (False, 1) else options[0] if options else best


def _worth(header: Sequence[str]) -> int:
    """How many quantities of a bench a row names."""
    return len(
        {
            hit[0]
            for cell in header
            if cell
            and not _NUMBER.fullmatch(cell)
            and (hit := quantity_of(cell)) is not None
        }
    )


def _distinct(header: Sequence[str]) -> list[str]:
    """Name the columns of a header so that no name is empty and all differ."""
    given = [cell.strip() or "unnamed" for cell in header]
    names: list[str] = []
    for first in given:
        others = (f"{first} ({number})" for number in count(2))
        names.append(
            first
            if first not in names
            else next(name for name in others if name not in {*given, *names})
        )
    return names


def _plain_number(text: str) -> float:
    return float(text.replace("_", "?"))  # Python reads 2_99 as 299


def parsed(cell: str, comma: bool) -> tuple[float, str]:
    """Number of a cell, NaN where it holds none, and the unit behind it, `""` without one.

    Args:
        cell: as text.
        comma: whether a comma is a decimal one; else it may set thousands apart.
    """
    if comma and _THOUSANDS.fullmatch(cell):
        cell = cell.replace(".", "")
    with suppress(ValueError):
        return _plain_number(cell), ""
    hit = _NUMBER.fullmatch(_BLANKS.sub("", cell))
    if hit is None:
        return math.nan, ""
    text, (_, unit) = hit[1], unit_of(hit[2] or "") or ("", "")
    if comma and "," in text:
        text = text.replace(".", "").replace(",", ".")
    elif re.fullmatch(r"[+-]?\d{1,3}(,\d{3})+\.\d+", text):
        text = text.replace(",", "")
    if unit or not hit[2]:
        with suppress(ValueError):
            return float(text), unit
    return math.nan, unit


def _seconds(cell: str) -> float:
    day = re.sub(r"(\d\d?)[./](\d\d?)[./](\d{4})\b", r"\3-\2-\1", cell)
    for text, form in product(
        (day, f"1970-01-01 {day}"), _TIMES
    ):  # or a time of day alone
        with suppress(ValueError):
            found = datetime.strptime(text, form)
            return found.replace(tzinfo=found.tzinfo or timezone.utc).timestamp()
    return math.nan


def no_number(name: str, cell: str) -> str:
    """Say what is wrong with a cell of a column that holds no number."""
    cure = (
        ": write a decimal point, and nothing between thousands"
        if re.search(r"\d[.,]\d", cell)
        else ""
    )
    return f"{name} {f'{cell!r} is not a number' if cell else 'is empty'}{cure}"
