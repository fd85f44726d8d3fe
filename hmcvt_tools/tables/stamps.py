# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Times in cells: dates, times of day, durations and numbers, as seconds.

Dates count from 1970 (UTC), times of day from midnight. A day and a month that can be exchanged
are asked, never assumed.
"""

import math
import re
from collections.abc import Sequence
from datetime import date
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array

from .numbers import not_available, read_numbers
from .units import to_si, unit_of

DATE_ORDERS = ("dmy", "mdy", "ymd")
"""What an option may say in place of a unit: the order of day, month and year."""
_MONTH_NAMES = (
    ("jan", "januar"),
    ("feb", "februar"),
    ("mar", "maerz", "mrz", "mars"),
    ("apr", "april", "avr"),
    ("may", "mai"),
    ("jun", "juni", "juin"),
    ("jul", "juli", "juil"),
    ("aug", "august", "aout"),
    ("sep", "sept", "september"),
    ("oct", "okt", "oktober"),
    ("nov", "november"),
    ("dec", "dez", "dezember"),
)
_MONTHS = {
    name: number for number, names in enumerate(_MONTH_NAMES, 1) for name in names
}
_CLOCK = r"(?P<clock>\d{1,3}:\d\d(?::\d\d)?(?:[.,:]\d+)?)\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_ZONE = r"\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
_DATED = re.compile(
    r"(?P<a>\d{1,4}|[A-Za-z]{3,9})[-./ ](?P<b>\d{1,2}|[A-Za-z]{3,9})[-./ ](?P<c>\d{1,4})"
    r"(?:[T ,]+" + _CLOCK + _ZONE + r")?"
)
_COMPACT = re.compile(r"(\d{4})(\d\d)(\d\d)[T_ ](\d\d):?(\d\d):?(\d\d)([.,]\d+)?Z?")
_DAYTIME = re.compile(_CLOCK + _ZONE)
_ELAPSED = re.compile(
    r"(?P<sign>-)?(?P<days>\d+) days?,? (?P<clock>\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)"
)
_DAY = 86400.0
_EXCEL_EPOCH = 25569.0  # 1970-01-01 as a day number of Excel
_EXCEL_DAYS = (32874.0, 62093.0)  # 1990 to 2069
# Since 1970, between 2001 and 2096, by the unit that loggers count in.
_EPOCHS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_EPOCH_RANGE = (1e9, 4e9)


class Times(NamedTuple):
    """A column of times.

    Attributes:
        seconds: NaN where a cell holds no time, shape (n,).
        unit: unit or date order by which they were read; `""` where the text needs none.
        question: what the cells leave open; `""` for nothing.
        choices: units or date orders that answer the question.
        unreadable: the first cell that holds text but no time; `""` for none.
        dated: whether the cells hold dates without a time of day.
        scale_known: whether a unit of numbers is known.
    """

    seconds: Array
    unit: str = ""
    question: str = ""
    choices: tuple[str, ...] = ()
    unreadable: str = ""
    dated: bool = False
    scale_known: bool = True


def read_times(cells: Sequence[str], unit: str, comma: bool) -> Times:
    """Read a column of times.

    Args:
        cells: text.
        unit: unit of numbers, or one of `DATE_ORDERS`; `""` if nothing says so.
        comma: whether the decimal sign of numbers is a comma.
    """
    numbers = read_numbers(cells, comma)
    if np.isfinite(numbers.values).mean() > 0.5:
        return _scaled(numbers.values, unit or "".join(numbers.units[:1]))
    filled = [cell for cell in cells if not not_available(cell)]
    if not filled:
        return Times(np.full(len(cells), math.nan))
    if any(":" in cell or _DATED.fullmatch(cell) for cell in filled[:20]):
        return _read_texts(cells, filled, unit)
    unread = 0
    for cell, value in zip(cells, numbers.values, strict=True):
        unread += math.isnan(value) and not not_available(cell)
    if unread > len(filled) / 2:
        return Times(numbers.values, unreadable=_first_unread(cells, numbers.values))
    return _scaled(numbers.values, unit or "".join(numbers.units[:1]))


def _scaled(values: Array, unit: str) -> Times:
    """Convert numbers to seconds; epochs and days of Excel are recognised by their size."""
    largest = float(np.nanmax(np.abs(values)))
    smallest = float(np.nanmin(values))
    for name, size in _EPOCHS.items():
        dated = _EPOCH_RANGE[0] < smallest * size <= largest * size < _EPOCH_RANGE[1]
        if dated and unit in ("", name):
            return Times(values * size, name)
    in_excel = _EXCEL_DAYS[0] < smallest and largest < _EXCEL_DAYS[1]
    if unit == "" and in_excel and np.any(values % 1.0):
        return Times((values - _EXCEL_EPOCH) * _DAY, "d")
    if unit == "":
        return Times(
            values,
            question="its numbers name no unit",
            choices=("s", "ms", "min", "h"),
            scale_known=False,
        )
    known = unit_of(unit)
    if known is None or known.kind != "time":
        raise InputError(f"{unit!r} is no unit of time; there is s, ms, min, h")
    if known.name == "d" and in_excel:
        return Times((values - _EXCEL_EPOCH) * _DAY, "d")
    return Times(values * to_si("time", known.name)[0], known.name)


def _read_texts(cells: Sequence[str], filled: Sequence[str], unit: str) -> Times:
    order = _date_order(filled)
    if unit in DATE_ORDERS:
        order = unit
    if order == "":
        return _open_times(cells, filled[0], "day and month", ("dmy", "mdy"))
    minutes_first = _minutes_first(filled, unit)
    if minutes_first is None:
        return _open_times(cells, filled[0], "minutes and hours", ("min", "h"))
    seconds = np.array([_seconds(cell, order, minutes_first) for cell in cells])
    unreadable = _first_unread(cells, seconds)
    if not any("-" in cell or "/" in cell or "." in cell[:5] for cell in filled[:3]):
        seconds = _past_midnight(seconds)
    dated = all(":" not in cell for cell in filled)
    stated = ""
    if unit in DATE_ORDERS:
        stated = unit
    return Times(seconds, stated, unreadable=unreadable, dated=dated)


def _open_times(
    cells: Sequence[str], example: str, words: str, choices: tuple[str, ...]
) -> Times:
    """Return times that stay unknown until a question is answered."""
    return Times(
        np.full(len(cells), math.nan),
        question=f"{example!r} does not say which are {words}",
        choices=choices,
    )


def _first_unread(cells: Sequence[str], values: Array) -> str:
    """Return the first cell that holds text but no value; `""` for none."""
    for cell, value in zip(cells, values, strict=True):
        if math.isnan(value) and not not_available(cell):
            return cell
    return ""


def joined_stamps(dates: Sequence[str], clocks: Sequence[str]) -> list[str] | None:
    """Join a column of dates and one of times of day to a column of both.

    Args:
        dates: cells without a time of day; a spreadsheet writes midnight behind them.
        clocks: cells with hours, minutes and seconds.

    Returns:
        None where the cells are of another form, or fall by a day where only the clock passes
        midnight.
    """
    joined = []
    for date_cell, clock in zip(dates, clocks, strict=True):
        day = date_cell.removesuffix(" 00:00:00")
        if not_available(day) or not_available(clock):
            joined.append("")
            continue
        dated = _DATED.fullmatch(day)
        daytime = _DAYTIME.fullmatch(clock)
        if dated is None or dated["clock"] is not None or daytime is None:
            return None
        if daytime["half"] is None and _may_count_minutes(daytime["clock"]):
            return None
        joined.append(f"{day} {clock}")
    seconds = read_times(joined, "", False).seconds
    known = seconds[np.isfinite(seconds)]
    if np.any(np.diff(known) < -_DAY / 2.0):
        return None
    return joined


def _may_count_minutes(clock: str) -> bool:
    """Return whether a clock without seconds may count minutes and seconds from the start."""
    if clock.count(":") > 1:
        return False
    return int(clock.split(":")[0]) > 23 or clock.startswith("00:00")


def _past_midnight(seconds: Array) -> Array:
    """Let times of day go on rising after midnight."""
    falls = np.diff(seconds, prepend=seconds[:1]) < -_DAY / 2.0
    return np.asarray(seconds + _DAY * np.cumsum(falls))


def _date_order(cells: Sequence[str]) -> str:
    """Return the order of day, month and year; `""` where day and month can be exchanged."""
    first = 0
    second = 0
    slashed = False
    for cell in cells:
        hit = _DATED.fullmatch(cell)
        if hit is None:
            continue
        if len(hit["a"]) == 4:
            return "ymd"
        if not hit["a"].isdigit():
            return "mdy"
        if not hit["b"].isdigit() or cell[len(hit["a"])] == ".":
            return "dmy"
        slashed = True
        first = max(first, int(hit["a"]))
        second = max(second, int(hit["b"]))
    if not slashed or first > 12:
        return "dmy"
    if second > 12:
        return "mdy"
    return ""


def _minutes_first(cells: Sequence[str], unit: str) -> bool | None:
    """Return whether `12:30` is minutes and seconds; None where nothing says so."""
    clocks = [cell for cell in cells if cell.count(":") == 1 and cell[0].isdigit()]
    bare = [cell for cell in clocks if re.fullmatch(r"\d{1,3}:\d\d(?:[.,]\d+)?", cell)]
    if not bare or unit in ("h", "hh:mm"):
        return False
    if unit in ("min", "mm:ss") or any("." in cell or "," in cell for cell in bare):
        return True
    if any(int(cell.split(":")[0]) > 23 for cell in bare):
        return True
    return None


def _seconds(cell: str, order: str, minutes_first: bool) -> float:
    elapsed = _ELAPSED.fullmatch(cell)
    if elapsed is not None:
        whole = _DAY * int(elapsed["days"])
        seconds = whole + _clock_seconds(elapsed["clock"], None, False)
        if elapsed["sign"]:
            return -seconds
        return seconds
    dated = _DATED.fullmatch(cell)
    if dated is not None:
        day = _day_seconds(dated["a"], dated["b"], dated["c"], order)
        if dated["clock"] is None:
            return day
        clock = _clock_seconds(dated["clock"], dated["half"], False)
        return day + clock - _zone_seconds(dated["zone"])
    compact = _COMPACT.fullmatch(cell)
    if compact is not None:
        day = _day_seconds(compact[1], compact[2], compact[3], "ymd")
        part = float((compact[7] or "0").replace(",", "."))
        clock = 3600.0 * int(compact[4]) + 60.0 * int(compact[5]) + int(compact[6])
        return day + clock + part
    daytime = _DAYTIME.fullmatch(cell)
    if daytime is not None:
        return _clock_seconds(daytime["clock"], daytime["half"], minutes_first)
    return math.nan


def _clock_seconds(text: str, half: str | None, minutes_first: bool) -> float:
    fields = text.replace(",", ".").split(":")
    if len(fields) == 4:  # a colon before the milliseconds
        fields = [*fields[:2], f"{fields[2]}.{fields[3]}"]
    parts = list(map(float, fields))
    if len(parts) == 2:
        size = 3600.0
        if minutes_first:
            size = 60.0
        return size * parts[0] + size / 60.0 * parts[1]
    hours, minutes, seconds = parts
    if half is not None:
        hours = hours % 12.0
        if half[0] in "pP":
            hours += 12.0
    if minutes >= 60.0 or seconds > 60.0:
        return math.nan
    return 3600.0 * hours + 60.0 * minutes + seconds


@lru_cache(maxsize=4096)
def _day_seconds(first: str, second: str, third: str, order: str) -> float:
    """Return the seconds from 1970 to a day; NaN for a day that does not exist."""
    fields = dict(zip(order, (first, second, third), strict=True))
    if not second.isdigit() or not first.isdigit():
        word, day = (second, first) if first.isdigit() else (first, second)
        fields = {"d": day, "m": word, "y": third}
    month_text = fields["m"].lower()
    try:
        month = int(month_text) if month_text.isdigit() else _MONTHS[month_text]
        year = int(fields["y"])
        if len(fields["y"]) <= 2:
            year += 2000 if year < 70 else 1900
        days = date(year, month, int(fields["d"])) - date(1970, 1, 1)
    except (KeyError, ValueError):
        return math.nan
    return days.total_seconds()


def _zone_seconds(zone: str | None) -> float:
    if zone is None or zone in ("Z", "UTC"):
        return 0.0
    sign = -1.0 if zone[0] == "-" else 1.0
    return sign * (3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:]))
