# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A map as a matrix: one axis down the first column, the other along the header, cells between.

It is read as one row for each point where a text names both axes and the cells, as
`Speed (rad/s) vs Torque (Nm)` in the corner or above, or where the user names them. Matrices of one
workbook over the same axes make one table.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.numbers import is_number
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.transmission.units import usual_unit

from .numbers import parsed
from .rules import SHAFT_KINDS, Meaning, file_says_efficiency, meaning_of
from .units import to_si
from .workbook import Sheet

_FEWEST_COLUMNS = 4
_FEWEST_ROWS = 3
_BETWEEN_AXES = re.compile(
    r"\s+(?:vs\.?|versus|over|by|x)\s+|\s*[\\:|]\s*|\s+/\s+", re.IGNORECASE
)
_CELLS_AND_AXES = re.compile(r"(?P<cells>[^(]+)\((?P<axes>.+)\)")
_KINDS_OF_AXES = ("speed", "torque", "power", "stroke", "pressure")
_LARGEST = {"speed": (60.0, 2000.0), "torque": (3.0, 5000.0)}
"""Range of the largest value of an axis [rad/s, N m]: below the idle of no engine, and up to the
fastest electric machine or the largest load torque of a bench."""

_CONSTANTS = frozenset({"0", "1"})
"""Usual numbers for all rows, which name no column."""
_OPEN = (
    "holds a matrix, as of a map over two axes, and nothing says for sure what its rows, "
    "columns and cells are: write one row for each of its points, or name all three, as in "
    "--matrix 'engine speed [rpm],load torque [Nm],efficiency [%]'"
)


@dataclass(frozen=True)
class _Matrix:
    """A matrix of a sheet.

    Attributes:
        row_axis, column_axis: numbers as text, n and m.
        cells: n rows of m cells; empty where the map has no point.
        texts: corner, and the lines above it.
        sheet: name of the sheet, `""` for text.
        names: of the row axis, the column axis and the cells.
        reason: what named them.
    """

    row_axis: tuple[str, ...]
    column_axis: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]
    texts: tuple[str, ...]
    sheet: str
    names: tuple[str, str, str] = ("", "", "")
    reason: str = ""


def with_points(
    sheets: Sequence[Sheet],
    names: Sequence[str],
    columns: Collection[str],
    source: str,
) -> tuple[list[Sheet], str]:
    """Return the sheets with matrices as rows of points, and what was read so; `""` for none.

    Args:
        sheets: of a spreadsheet, or the rows of a text as one sheet.
        names: of the row axis, the column axis and the cells, where the user gives them.
        columns: that the user named; a header of numbers may name columns, too.
        source: name of the file.

    Raises:
        InputError: names are given, but not three, or no sheet holds a matrix; or nothing names
            the axes and cells of the only matrix.
    """
    if names and len(names) != 3:
        raise InputError(
            f"{source}: --matrix needs three names: of the rows, the columns and the cells"
        )
    matrices = []
    others = []
    for sheet in sheets:
        matrix = _matrix(sheet)
        if matrix is not None:
            matrix = _named(matrix, names, source)
            if (
                matrix is None
                and len(sheets) == 1
                and not _names_column(sheet, columns)
            ):
                raise InputError(f"{source}: {_OPEN}")
        if matrix is None:
            others.append(sheet)
        else:
            matrices.append(matrix)
    if names and not matrices:
        raise InputError(f"{source}: no sheet holds a matrix of numbers over two axes")
    points = []
    described = []
    matrices.sort(key=_axes)
    for _, same in groupby(matrices, key=_axes):
        sheet, text = _points(list(same))
        points.append(sheet)
        described.append(text)
    return [*points, *others], "; ".join(described)


def _names_column(sheet: Sheet, columns: Collection[str]) -> bool:
    """Return whether the user named a column of a sheet."""
    named = set(columns) - _CONSTANTS
    return any(not named.isdisjoint(row) for row in sheet.rows)


def _axes(matrix: _Matrix) -> tuple[tuple[str, ...], ...]:
    """Return what matrices of one map share: axes and their names."""
    return matrix.row_axis, matrix.column_axis, matrix.names[:2]


def _matrix(sheet: Sheet) -> _Matrix | None:
    """Return the matrix that a sheet holds; None if it holds none or anything below it."""
    if sheet.hidden or sheet.hidden_rows or sheet.hidden_columns or sheet.text_numbers:
        return None
    for number, row in enumerate(sheet.rows):
        width = _width_of_axis(row)
        if width < _FEWEST_COLUMNS:
            if sum(map(is_number, row)) >= _FEWEST_COLUMNS:
                return None  # a table begins
            continue
        body = [below for below in sheet.rows[number + 1 :] if any(below)]
        if not _is_body(body, width):
            return None
        cells = tuple(tuple(_padded(below, width)) for below in body)
        above = [cell for line in sheet.rows[:number] for cell in line[:1] if cell]
        return _Matrix(
            tuple(below[0] for below in body),
            tuple(row[1 : width + 1]),
            cells,
            (row[0], *reversed(above)),
            sheet.name,
        )
    return None


def _width_of_axis(row: Sequence[str]) -> int:
    """Return how many numbers an axis along a header has; 0 if the row is none."""
    if not row or is_number(row[0]):
        return 0
    filled = list(row[1:])
    while filled and not filled[-1]:
        filled.pop()
    if not _rises_or_falls(filled):
        return 0
    return len(filled)


def _is_body(body: Sequence[Sequence[str]], width: int) -> bool:
    """Return whether rows are those of a matrix: an axis, and numbers or gaps behind it."""
    if len(body) < _FEWEST_ROWS or not _rises_or_falls([row[0] for row in body]):
        return False
    for row in body:
        if any(row[width + 1 :]):
            return False
        if any(cell and not is_number(cell) for cell in row[1:]):
            return False
    return True


def _padded(row: Sequence[str], width: int) -> list[str]:
    """Return the cells of a row behind its axis, as many as the other axis has numbers."""
    cells = list(row[1 : width + 1])
    return cells + [""] * (width - len(cells))


def _rises_or_falls(cells: Sequence[str]) -> bool:
    """Return whether cells are numbers that all rise or all fall."""
    if not cells or not all(map(is_number, cells)):
        return False
    steps = np.diff(_numbers(cells))
    return bool(np.all(steps > 0.0) or np.all(steps < 0.0))


def _numbers(cells: Sequence[str]) -> Array:
    """Return numbers with a decimal point or, where that reads none, a decimal comma."""
    values = [parsed(cell, False)[0] for cell in cells]
    if not np.all(np.isfinite(values)):
        values = [parsed(cell, True)[0] for cell in cells]
    return np.array(values)


def _named(matrix: _Matrix, given: Sequence[str], source: str) -> _Matrix | None:
    """Return a matrix with the names of its axes and cells; None where they are open."""
    if given:
        rows, columns, cells = (name.strip() for name in given)
        return replace(matrix, names=(rows, columns, cells), reason="as given")
    for text in matrix.texts:
        parts = _CELLS_AND_AXES.fullmatch(text)
        axes: tuple[str, ...] = ()
        cells = ""
        if parts is not None:
            axes = _names_of_axes(parts["axes"], matrix)
            cells = parts["cells"].strip()
        if not axes:
            axes = _names_of_axes(text, matrix)
            cells = ""
        if not axes:
            continue
        reason = f"by {text!r}"
        if not cells:
            cells, where = _name_of_cells(matrix, text, source)
            reason += f" and {where}"
        if not cells:
            return None
        return replace(matrix, names=(axes[0], axes[1], cells), reason=reason)
    return None


def _names_of_axes(text: str, matrix: _Matrix) -> tuple[str, ...]:
    r"""Return the names of the row axis and the column axis that a text gives; () if open.

    The first name is of the rows, as in `rows \\ columns`, where the sizes of the numbers exclude
    the other order, or a backslash says it.
    """
    parts = _BETWEEN_AXES.split(text.strip())
    if len(parts) != 2:
        return ()
    first, second = (_with_kind(part) for part in parts)
    meanings = (meaning_of(first), meaning_of(second))
    if not all(_names_axis(meaning) for meaning in meanings):
        return ()
    if meanings[0].kind == meanings[1].kind:
        return ()
    rows = _numbers(matrix.row_axis)
    columns = _numbers(matrix.column_axis)
    fits = _fits(meanings[0], rows) and _fits(meanings[1], columns)
    exchanged = _fits(meanings[0], columns) and _fits(meanings[1], rows)
    if not fits or (exchanged and "\\" not in text):
        return ()
    return first, second


def _names_axis(meaning: Meaning) -> bool:
    """Return whether a name, understood in every word, is that of an axis of a map."""
    return meaning.kind in _KINDS_OF_AXES and not meaning.unknown


def _with_kind(text: str) -> str:
    """Return the name of an axis; a unit alone names a speed or a torque."""
    unit = usual_unit(text.strip("[]() "))
    if unit is not None and unit.kind in SHAFT_KINDS:
        return f"{unit.kind} [{unit.name}]"
    return text.strip()


def _fits(meaning: Meaning, values: Array) -> bool:
    """Return whether numbers can be what an axis names, in its unit or in any usual one."""
    if meaning.kind not in _LARGEST:
        return True
    units = ["rpm", "rad/s"] if meaning.kind == "speed" else ["N m"]
    if meaning.unit is not None and meaning.unit.kind == meaning.kind:
        units = [meaning.unit.name]
    least, most = _LARGEST[meaning.kind]
    largest = float(np.max(np.abs(values)))
    return any(
        least <= to_si(meaning.kind, unit)[0] * largest <= most for unit in units
    )


def _name_of_cells(matrix: _Matrix, text: str, source: str) -> tuple[str, str]:
    """Return the name of the cells by a line above, the sheet or the file, and what says it."""
    lines = [line for line in matrix.texts if line != text]
    for line in lines:
        meaning = meaning_of(line)
        if meaning.quantity and not meaning.unknown:
            return line, repr(line)
    for kind, name in (("sheet", matrix.sheet), ("file", Path(source).stem)):
        if file_says_efficiency(name):
            return "efficiency", f"the name of the {kind}"
    return "", ""


def _points(matrices: Sequence[_Matrix]) -> tuple[Sheet, str]:
    """Return the points of matrices over the same axes as a sheet, and what was read."""
    first = matrices[0]
    header = [*first.names[:2], *(matrix.names[2] for matrix in matrices)]
    rows = [header]
    left_out = 0
    for number, row in enumerate(first.row_axis):
        for position, column in enumerate(first.column_axis):
            cells = [matrix.cells[number][position] for matrix in matrices]
            if _is_gap(cells, header[2:]):
                left_out += 1
            else:
                rows.append([row, column, *cells])
    reasons = dict.fromkeys(matrix.reason for matrix in matrices)
    text = (
        f"a matrix, with {header[0]!r} down its rows, {header[1]!r} along its columns and "
        f"{' and '.join(map(repr, header[2:]))} in its cells ({'; '.join(reasons)}), read as "
        f"{len(rows) - 1} points, numbered row by row from 2"
    )
    if left_out:
        text += f"; {left_out} cells without a point left out"
    name = " + ".join(matrix.sheet for matrix in matrices if matrix.sheet)
    return Sheet(name, rows), text


def _is_gap(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether a map has no point: all cells are empty, or an efficiency is 0."""
    if not any(cells):
        return True
    for cell, name in zip(cells, names, strict=True):
        if (
            meaning_of(name).kind == "efficiency"
            and cell
            and _numbers([cell])[0] == 0.0
        ):
            return True
    return False
