# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers in cells: decimal style, thousands, units behind them and codes for "no value".

`1.050` is 1.05 or 1050, and no cell alone says which. The whole table decides: a cell such as
`0,643` or `78.54` can be read in one way only, and shows the style of the table. Where cells
remain that can be read both ways, the reader asks.
"""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.files.numbers import BLANKS, NUMBER, SENTINELS, is_number, with_point
from hmcvt_core.transmission.ranges import Array

from .units import unit_of

_NOT_AVAILABLE = re.compile(
    r"n/?\.?a\.?|nan|null|none|inv(alid)?|err(or)?|#\w*[!/?]?\w*!?|-+|\.+|\?+|",
    re.IGNORECASE,
)
_TAIL = r"(?:[eEdD][+-]?\d+)?(?:[ \t]*[^-+\d\s.,][^\n]*)?$"
# Cells that have one reading only; searched in the joined cells of a column.
_COMMA = re.compile(
    r"^[+-]?(?:0*,\d+|\d{4,},\d+|\d+,(?:\d{1,2}|\d{4,})|\d{1,3}(?:\.\d{3})+,\d*"
    r"|[1-9]\d{0,2}(?:\.\d{3}){2,})" + _TAIL,
    re.MULTILINE,
)
_POINT = re.compile(
    r"^[+-]?(?:0*\.\d+|\d{4,}\.\d*|\d+\.(?:\d{1,2}|\d{4,}|)|\d{1,3}(?:,\d{3})+\.\d*"
    r"|[1-9]\d{0,2}(?:,\d{3}){2,})" + _TAIL,
    re.MULTILINE,
)
_EITHER = re.compile(r"^[+-]?[1-9]\d{0,2}[.,]\d{3}" + _TAIL, re.MULTILINE)


class Style(NamedTuple):
    """Decimal style of a column.

    Attributes:
        comma: whether the decimal sign is a comma.
        doubtful: a cell that can be read in two ways while nothing decides; `""` for none.
    """

    comma: bool
    doubtful: str = ""


class Numbers(NamedTuple):
    """A column as numbers.

    Attributes:
        values: NaN where a cell holds none, shape (n,).
        units: text of the units behind the numbers, without `""`.
    """

    values: Array
    units: tuple[str, ...]


def decimal_styles(
    columns: Mapping[str, Sequence[str]], decimal: str | None, comma_separated: bool
) -> dict[str, Style]:
    """Return the decimal style of every column.

    Args:
        columns: cells by column name.
        decimal: `point` or `comma`, where the user says so.
        comma_separated: whether commas separate the columns of the file.
    """
    if decimal is not None:
        return dict.fromkeys(columns, Style(decimal == "comma"))
    joined = {name: _without_blanks("\n".join(c)) for name, c in columns.items()}
    commas = _matching(_COMMA, ",", r"\d\.\d{3}\.", joined)
    points = _matching(_POINT, ".", r"\d,\d{3},", joined)
    has_comma = any("," in text for text in joined.values())
    plain = comma_separated and not has_comma
    table_decides = plain or bool(commas) != bool(points)
    of_table = Style(bool(commas) and not points)
    styles = {}
    for name, text in joined.items():
        if name in commas and name in points:
            doubtful = _EITHER.search(text) or _COMMA.search(text)
            styles[name] = _doubtful_style(doubtful)
        elif name in commas or name in points:
            styles[name] = Style(name in commas)
        elif table_decides:
            styles[name] = of_table
        else:
            styles[name] = _doubtful_style(_EITHER.search(text))
    return styles


def _matching(
    pattern: re.Pattern[str], sign: str, grouped: str, joined: Mapping[str, str]
) -> set[str]:
    """Return the names of the columns with a cell of a pattern.

    Args:
        pattern: of cells.
        sign: decimal one of the pattern.
        grouped: pattern without which no cell without that sign fits.
        joined: cells of each column.
    """
    names = set()
    for name, text in joined.items():
        possible = sign in text or re.search(grouped, text)
        if possible and pattern.search(text):
            names.add(name)
    return names


def _doubtful_style(cell: re.Match[str] | None) -> Style:
    """Return the style of a column with a cell that can be read in two ways, if it has one."""
    if cell is None:
        return Style(False)
    return Style(False, cell[0])


def _without_blanks(text: str) -> str:
    """Remove blanks between thousands."""
    if any(blank in text for blank in " '\u2019\u00a0\u202f"):
        return BLANKS.sub("", text)
    return text


def read_numbers(cells: Sequence[str], comma: bool) -> Numbers:
    """Read a column of cells; codes for "no value" become NaN.

    Args:
        cells: text.
        comma: whether the decimal sign is a comma.
    """
    values = _plain_numbers(cells, comma)
    units: set[str] = set()
    if values is None:
        parsed_cells = [parsed(cell, comma) for cell in cells]
        values = np.array([value for value, _ in parsed_cells])
        units = {unit for _, unit in parsed_cells if unit}
    return Numbers(
        np.where(np.isin(values, SENTINELS), np.nan, values), tuple(sorted(units))
    )


def _plain_numbers(cells: Sequence[str], comma: bool) -> Array | None:
    """Read cells that Python reads as they are; None where one is of another form."""
    joined = "\n".join(cells)
    if "," in joined or "_" in joined or (comma and "." in joined):
        return None
    try:
        return np.fromiter(map(float, cells), float, len(cells))
    except ValueError:
        pass  # cells may be empty
    try:
        return np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return None


def parsed(cell: str, comma: bool) -> tuple[float, str]:
    """Return the number of a cell, NaN where it holds none, and the unit behind it or `""`.

    Args:
        cell: as text.
        comma: whether a comma is a decimal one; else it may set thousands apart.
    """
    hit = NUMBER.fullmatch(BLANKS.sub("", cell))
    if hit is None:
        value = math.nan
        with suppress(ValueError):
            if "_" not in cell:
                value = float(cell)
        return value, ""
    number = hit[1]
    unit = ""
    if hit[2] == "-" and cell[-2].isdigit():
        return math.nan, ""  # some programs write a minus behind the number
    if hit[2]:
        known = unit_of(hit[2])
        if known is None:
            return math.nan, ""
        unit = known.name
    text = with_point(number, comma).replace("d", "e").replace("D", "e")
    with suppress(ValueError):
        return float(text), unit
    return math.nan, unit


def not_available(cell: str) -> bool:
    """Return whether a cell says that no value is available, or is empty."""
    if _NOT_AVAILABLE.fullmatch(cell.strip()):
        return True
    try:
        return float(cell.replace(",", ".")) in SENTINELS
    except ValueError:
        return False


def finite_share(values: NDArray[np.float64]) -> float:
    """Return the share of finite values; 0 for no values."""
    return float(np.isfinite(values).mean()) if len(values) else 0.0


def last_digit(cell: str, comma: bool) -> float:
    """Return the size of the last digit of a number, as 0.01 of `3.25`; 0 for no number."""
    if not is_number(cell):
        return 0.0
    sign = "," if comma else "."
    _, _, decimals = cell.partition(sign)
    digits = re.match(r"\d*", decimals)
    if digits is None:
        return 1.0
    return float(10.0 ** -len(digits[0]))
