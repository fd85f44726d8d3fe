# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers in cells: what is one, and what is wrong with a cell that holds none."""

import re

SENTINELS: tuple[float, ...] = (
    *(-999.0, -999.25, -9999.0, -99999.0, 9999.0, 99999.0),
    *(65535.0, 65534.0, 32767.0, -32768.0, 8191.875, 1e30, -1e30),
    *(6553.5, 655.35, 3276.7, -3276.8, 327.67, -327.68, -9999.99, 9.9e37, 9.91e37),
)
"""Numbers that loggers write for "no value"."""
NUMBER = re.compile(
    r"([+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eEdD][+-]?\d+)?)(?:\s*([^\d\s.,].*))?"
)
"""A number, and what stands behind it."""
BLANKS = re.compile(r"(?<=\d)[ '\u2019\u00a0\u202f](?=\d{3}(?!\d))")
"""Blanks between thousands."""
_GROUPED_POINTS = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")
_GROUPED_COMMAS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def with_point(number: str, comma: bool) -> str:
    """Write a number with a decimal point and nothing between thousands."""
    if comma:
        if "," in number:
            whole, _, part = number.partition(",")
            if "." in whole and not _GROUPED_POINTS.fullmatch(whole):
                return "?"
            return f"{whole.replace('.', '')}.{part}"
        if _GROUPED_POINTS.fullmatch(number):
            return number.replace(".", "")
        return number
    whole, point, part = number.partition(".")
    if "," in part:
        return "?"
    if "," in whole:
        if not _GROUPED_COMMAS.fullmatch(whole):
            return "?"
        whole = whole.replace(",", "")
    return f"{whole}{point}{part}"


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, in either decimal style, and nothing else."""
    hit = NUMBER.fullmatch(BLANKS.sub("", cell.strip()))
    return hit is not None and not hit[2]


def no_number(name: str, cell: str) -> str:
    """Return what is wrong with a cell of a column that holds no number."""
    if not cell:
        return f"{name} is empty"
    if cell.startswith("="):
        return (
            f"{name} {cell!r} is a formula without a stored value: open the file in a "
            "spreadsheet program and save it"
        )
    if cell.startswith("#"):
        return f"{name} {cell!r} is an error or a gap of the spreadsheet"
    if _stands_for_no_value(cell):
        return f"{name} {cell!r} is a code for no value"
    cure = ""
    if re.search(r"\d[.,]\d", cell):
        cure = ": write a decimal point, and nothing between thousands"
    return f"{name} {cell!r} is not a number{cure}"


def _stands_for_no_value(cell: str) -> bool:
    """Return whether a cell holds a number that loggers write for "no value"."""
    hit = NUMBER.fullmatch(BLANKS.sub("", cell.strip()))
    if hit is None or hit[2]:
        return False
    try:
        return float(with_point(hit[1], comma=False)) in SENTINELS
    except ValueError:
        return False
