# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files as rows of text: encodings, Excel sheets, and formats that are no table of text.

Text is cut by the csv module, which keeps the line of every row and the rows of another length;
pandas reads Excel and OpenDocument files.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hmcvt_core.errors import InputError
from hmcvt_core.files.text import decoded, read_bytes, refuse_binary

from .workbook import Sheet, is_text_number, number_text, read_workbook

SPREADSHEETS = {
    ".xlsx": "openpyxl",
    ".xlsm": "openpyxl",
    ".xls": "xlrd",
    ".ods": "odfpy",
}
"""Suffixes of spreadsheets, and the package by which pandas reads them."""
SEPARATORS = (";", "\t", ",", "|", "")
"""What may separate columns; `""` stands for blanks."""
_SPREADSHEET_BYTES = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")


def is_spreadsheet(path: Path) -> bool:
    """Return whether the name of a file is that of a spreadsheet."""
    return path.suffix.lower() in SPREADSHEETS


def read_spreadsheet(path: Path, sheet: str | None) -> tuple[list[Sheet], str]:
    """Return the sheets of an Excel or OpenDocument file, and its SHA-256.

    Args:
        path: of the file.
        sheet: the only sheet wanted; None for all.

    Raises:
        InputError: the file cannot be read, a package is missing, or there is no such sheet.
    """
    raw, sha256 = read_bytes(path)
    refuse_binary(path, raw)
    if not raw.startswith(_SPREADSHEET_BYTES):
        raise InputError(f"{path}: {_no_spreadsheet(path, raw)}")
    sheets = _sheets(path, raw)
    if sheet is None:
        return sheets, sha256
    chosen = [candidate for candidate in sheets if candidate.name == sheet]
    if not chosen:
        names = ", ".join(candidate.name for candidate in sheets)
        raise InputError(f"{path}: sheet {sheet!r} is missing; there is {names}")
    return chosen, sha256


def _no_spreadsheet(path: Path, raw: bytes) -> str:
    """Say what a file named as a spreadsheet is instead."""
    try:
        text = decoded(raw, path, utf_16=True)
    except InputError:
        text = "\0"
    if "\0" in text or not text.strip():
        return "no Excel file, or damaged: it is no spreadsheet"
    return (
        "is text, no Excel file, in spite of its name: rename it to "
        f"{path.stem}.csv, and hmcvt reads it as the table of text that it is"
    )


def _sheets(path: Path, raw: bytes) -> list[Sheet]:
    try:
        if SPREADSHEETS[path.suffix.lower()] == "openpyxl":
            return read_workbook(raw)
        return _read_by_pandas(raw)
    except ImportError:
        package = SPREADSHEETS[path.suffix.lower()]
        raise InputError(
            f"{path}: a spreadsheet {path.suffix} needs {package}: pip install "
            '"hmcvt_ros[table]", or save it as CSV'
        ) from None
    except Exception as error:  # of the package that reads this kind of file
        raise InputError(f"{path}: no Excel file, or damaged: {error}") from None


def _read_by_pandas(raw: bytes) -> list[Sheet]:
    """Return the sheets of an old Excel or an OpenDocument file."""
    import pandas

    frames = pandas.read_excel(
        io.BytesIO(raw), sheet_name=None, header=None, dtype=object
    )
    sheets = []
    for name, frame in frames.items():
        rows = []
        texts = set()
        for number, cells in enumerate(frame.itertuples(index=False), 1):
            rows.append([_cell_text(cell) for cell in cells])
            for column, cell in enumerate(cells):
                if is_text_number(cell):
                    texts.add((number, column))
        sheets.append(Sheet(str(name), rows, text_numbers=frozenset(texts)))
    return sheets


def _cell_text(cell: Any) -> str:
    if cell is None or cell != cell:  # NaN and NaT differ from themselves
        return ""
    if isinstance(cell, float):
        return number_text(cell)
    return str(cell).strip()


def consistent_rows(rows: Sequence[Sequence[str]]) -> int:
    """Return how many rows have the most frequent number of fields, of rows with two or more."""
    lengths = [len(row) for row in rows if len(row) > 1]
    return max((lengths.count(length) for length in set(lengths)), default=0)
