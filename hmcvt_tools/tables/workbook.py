# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Excel workbooks as text: what a cell shows, and what the sheet hides.

openpyxl reads the values. Which rows and columns are hidden, which cells are merged and which
formulas have no stored value stands in the XML of each sheet.
"""

import io
import re
import zipfile
from collections.abc import Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree

from .units import unit_of

_RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
_HIDDEN_ROW = re.compile(r"<row\b(?=[^>]*\bhidden=\"(?:1|true)\")[^>]*\br=\"(\d+)\"")
_HIDDEN_COLUMNS = re.compile(r"<col\b(?=[^>]*\bhidden=\"(?:1|true)\")[^>]*>")
_MERGED = re.compile(r"<mergeCell ref=\"([A-Z]+)(\d+):([A-Z]+)(\d+)\"")
_NO_VALUE = re.compile(
    r"<c r=\"([A-Z]+)(\d+)\"[^>]*><f(?:[^>]*/>|[^>]*>([^<]*)</f>)(?:<v\s*/>|<v></v>)?</c>"
)
_TEXT_NUMBER = re.compile(r"\s*[+-]?\d*[.,]\d")
_LITERAL = re.compile(r"\"([^\"]*)\"|\\(.)")


class Sheet(NamedTuple):
    """Rows of cells without blanks around them.

    Attributes:
        name: of a sheet, `""` for text.
        rows: cells as text.
        hidden: whether the sheet is hidden.
        hidden_rows: hidden rows, from 1.
        hidden_columns: hidden columns, from 0.
        text_numbers: row, from 1, and column, from 0, of text with a decimal sign.
        merged_ends: row, from 1, and last column, from 0, of cells merged across columns.
    """

    name: str
    rows: list[list[str]]
    hidden: bool = False
    hidden_rows: frozenset[int] = frozenset()
    hidden_columns: frozenset[int] = frozenset()
    merged_ends: frozenset[tuple[int, int]] = frozenset()
    text_numbers: frozenset[tuple[int, int]] = frozenset()


def read_workbook(raw: bytes) -> list[Sheet]:
    """Return the sheets of an Excel workbook (.xlsx, .xlsm).

    Args:
        raw: content of the file.

    Raises:
        ImportError: openpyxl is missing.
        Exception: of openpyxl or zipfile, where the file is damaged.
    """
    import openpyxl

    book = openpyxl.load_workbook(io.BytesIO(raw), read_only=True, data_only=True)
    parts = _sheet_parts(raw)
    sheets = []
    for worksheet in book.worksheets:
        worksheet.reset_dimensions()
        rows = []
        formats: dict[str, _Format] = {}
        texts = set()
        for number, cells in enumerate(worksheet.iter_rows(), 1):
            rows.append([_shown(cell, formats) for cell in cells])
            for column, cell in enumerate(cells):
                if is_text_number(cell.value):
                    texts.add((number, column))
        width = max(map(len, rows), default=0)
        for row in rows:
            row += [""] * (width - len(row))
        hidden = worksheet.sheet_state != "visible"
        xml = parts.get(worksheet.title, "")
        sheet = Sheet(worksheet.title, rows, hidden, text_numbers=frozenset(texts))
        sheets.append(_with_layout(sheet, xml))
    return sheets


def _sheet_parts(raw: bytes) -> dict[str, str]:
    """Return the XML of every sheet by its name."""
    parts = {}
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        relations = ElementTree.fromstring(archive.read("xl/_rels/workbook.xml.rels"))
        targets = {item.get("Id"): item.get("Target", "") for item in relations}
        book = ElementTree.fromstring(archive.read("xl/workbook.xml"))
        for item in book.iter():
            target = targets.get(item.get(_RELATION))
            if target is None or not item.tag.endswith("}sheet"):
                continue
            path = target.lstrip("/")
            if not path.startswith("xl/"):
                path = f"xl/{path}"
            parts[str(item.get("name"))] = archive.read(path).decode("utf-8", "replace")
    return parts


class _Format(NamedTuple):
    """How a number format shows a number: in percent, and with which unit behind it."""

    percent: bool
    unit: str


def _shown(cell: Any, formats: dict[str, _Format]) -> str:
    """Return the text of a cell; percent and units of its format stand behind the number."""
    value = cell.value
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value).strip()
    text = number_text(value)
    name = cell.number_format
    if name == "General":
        return text
    if name not in formats:
        formats[name] = _format(name)
    shown = formats[name]
    if shown.percent:
        return f"{number_text(float(f'{100.0 * value:.12g}'))} %"
    if shown.unit:
        return f"{text} {shown.unit}"
    return text


def is_text_number(value: Any) -> bool:
    """Return whether a value is text that begins as a number with a decimal sign."""
    return isinstance(value, str) and _TEXT_NUMBER.match(value) is not None


def number_text(value: float) -> str:
    """Return a number without `.0` behind a whole one."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return str(value)


def _format(name: str) -> _Format:
    """Return what a number format such as `0.0" lb ft"` adds to a number."""
    literal = "".join(quoted or single for quoted, single in _LITERAL.findall(name))
    plain = _LITERAL.sub("", name)
    unit = literal.strip()
    known = unit_of(unit) if unit else None
    if known is None or known.kind == "other":
        unit = ""
    return _Format("%" in plain, unit)


def _with_layout(sheet: Sheet, xml: str) -> Sheet:
    """Return a sheet with what its XML states besides the values."""
    rows = sheet.rows
    for letters, number, formula in _NO_VALUE.findall(xml):
        _set(rows, int(number) - 1, _column(letters), f"={formula}")
    merged = set()
    for first, top, last, bottom in _MERGED.findall(xml):
        if top == bottom and first != last:
            _spread(rows, int(top) - 1, _column(first), _column(last))
            merged.add((int(top), _column(last)))
    hidden_columns: set[int] = set()
    for tag in _HIDDEN_COLUMNS.findall(xml):
        limits = {
            name: int(number)
            for name, number in re.findall(r"(min|max)=\"(\d+)\"", tag)
        }
        hidden_columns.update(range(limits["min"] - 1, limits["max"]))
    return sheet._replace(
        hidden_rows=frozenset(map(int, _HIDDEN_ROW.findall(xml))),
        hidden_columns=frozenset(hidden_columns),
        merged_ends=frozenset(merged),
    )


def _column(letters: str) -> int:
    """Return the position of a column such as `AB`, from 0."""
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _set(rows: Sequence[list[str]], row: int, column: int, text: str) -> None:
    if row < len(rows) and column < len(rows[row]):
        rows[row][column] = text


def _spread(rows: Sequence[list[str]], row: int, first: int, last: int) -> None:
    """Write the text of merged cells into each of them."""
    if row >= len(rows) or first >= len(rows[row]):
        return
    for column in range(first + 1, last + 1):
        _set(rows, row, column, rows[row][first])
