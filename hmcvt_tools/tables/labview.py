# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""LabVIEW measurement files (.lvm): keys of the file, then segments of keys, names and numbers.

Each segment begins with its keys (`Channels`, `Samples`, `Y_Unit_Label`, ...) up to a mark; the row
of names follows, with `X_Value` first. `X_Value` counts from the start of the file in all segments.
"""

from collections.abc import Sequence

from hmcvt_core.errors import InputError

_START = "LabVIEW Measurement"
_FIRST_KEY = "Channels"
_FIRST_NAME = "X_Value"
_SEPARATORS = {"Tab": "\t", "Comma": ","}
_KEYS = 60
"""Rows among which the keys of the file and of the first segment stand."""


def stated_separator(text: str) -> str:
    """Return the separator that a LabVIEW measurement file states; `""` for other files."""
    if not text.startswith(_START):
        return ""
    for line in text.splitlines()[:_KEYS]:
        words = line.replace(",", "\t").split("\t")
        if words[0] == "Separator" and len(words) > 1:
            return _SEPARATORS.get(words[1].strip(), "")
    return ""


def names_row(rows: Sequence[Sequence[str]]) -> int:
    """Return the row of the names of the first segment, from 1; 0 for other files.

    Args:
        rows: of the file.
    """
    if not rows or rows[0][:1] != [_START]:
        return 0
    for number, row in enumerate(rows[:_KEYS], 1):
        if row[:1] == [_FIRST_NAME]:
            return number
    return 0


def stated_units(rows: Sequence[Sequence[str]], top: int) -> list[str]:
    """Return the units that the keys of a segment state, by column; `X_Value` of times is in s.

    Args:
        rows: of the file.
        top: row of the names of the segment, from 1.
    """
    units = [""]
    x_unit = ""
    for row in reversed(rows[: top - 1]):
        if row[:1] == ["Y_Unit_Label"]:
            units = ["", *row[1:]]
        if row[:2] == ["X_Dimension", "Time"]:
            x_unit = "s"
        if row[:1] == [_FIRST_KEY]:
            break
    return [x_unit, *units[1:]]


def without_segment_keys(
    rows: Sequence[list[str]], top: int, source: str
) -> list[list[str]]:
    """Return the rows with those of keys and names of later segments empty.

    Args:
        rows: of the file.
        top: row of the names of the first segment, from 1.
        source: name of the file, for messages.

    Raises:
        InputError: a later segment has other names or units.
    """
    numbers: list[list[str]] = list(rows[:top])
    names = rows[top - 1]
    units = stated_units(rows, top)
    among_keys = False
    for number, row in enumerate(rows[top:], top + 1):
        if row[:1] == [_FIRST_KEY]:
            among_keys = True
        if row[:1] == [_FIRST_NAME]:
            if row != names or stated_units(rows, number) != units:
                raise InputError(
                    f"{source}: the segment below row {number} has other channels than "
                    "the one above: import each segment from a file of its own"
                )
            among_keys = False
            row = []
        numbers.append([] if among_keys else row)
    return numbers
