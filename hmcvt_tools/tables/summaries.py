# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Rows that are no tests: means and limits below a table, set values, repeated headers.

A row is a summary where a cell says so (`Mean`, `Sollwert`, `Upper limit`), where text or nothing
stands in a column that numbers the tests, where it lacks what all other rows have, or where its
numbers are the mean, median, deviation, least, largest or sum of the rows above.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.numbers import is_number
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.transmission.units import plain_text

from .header import RawTable
from .numbers import last_digit, not_available, read_numbers
from .rules import meaning_of, names_quantity
from .units import holds_units, unit_of

_MEAN_WORDS = (
    "mean average avg mittel mittelwert mittelwerte durchschnitt moyenne media medio "
    "promedio"
)
_SUMMARY_WORDS = (
    "min minimum max maximum median std stddev stdev sd sum total rms cv variance sigma "
    "deviation summe gesamt streuung standardabweichung abweichung mediane ecart totale "
    "somme suma set setpoint setpoints target targets soll sollwert sollwerte vorgabe "
    "zielwert limit limits grenzwert grenzwerte tolerance toleranz spec specification "
    "consigne limite limites objetivo obiettivo uncertainty unsicherheit count anzahl "
    "quantile percentile spread span spannweite"
)
"""Words that alone say that a row summarises others, or states what they were to be."""
_VALUE_WORDS = "value values wert werte valeur valeurs valor valores"
_WEAK_WORDS = "nominal reference rated nenn design expected required desired"
"""Words that say so only with a word such as `values`: a test may be a reference."""
_FILL_WORDS = (
    "of all the tests test rows row runs and der aller des les type standard st dev upper "
    "lower oberer unterer untere obere allowed permissible zulaessig zul point"
)
_MEAN = frozenset(_MEAN_WORDS.split())
_SUMMARY = _MEAN | frozenset(_SUMMARY_WORDS.split())
_VALUE = frozenset(_VALUE_WORDS.split())
_WEAK = frozenset(_WEAK_WORDS.split())
_ALL = _SUMMARY | _VALUE | _WEAK | frozenset(_FILL_WORDS.split())
_MAX_SUMMARIES = 8
"""Rows at the end of a table that are compared with statistics of those above."""
_FEWEST_ROWS = 3
_FEWEST_NUMBERED = 5
"""Tests numbered 1, 2, 3, ... from which a row without a number stands out."""
_FEWEST_LACKING = 2
"""Columns whose last cells are empty from which the last rows are no tests."""
_FEWEST_COLUMNS = 3
_WIDTH = 2e-3
"""Fraction of the spread of a column by which a statistic of it may be rounded."""
_CHANCE = 1e-4
"""Probability from which rows meet statistics by chance; chosen on development tables."""
_LARGEST_CHANCE = 0.02
"""The same of a single one of several such rows."""


def summary_rows(table: RawTable) -> dict[int, str]:
    """Return rows that summarise others, each with the reason."""
    summaries: dict[int, str] = {}
    for name, cells in table.columns.items():
        reasons = _labelled(cells) | _without_number(name, cells)
        for index, reason in reasons.items():
            summaries.setdefault(table.rows[index], reason)
    for index, reason in _incomplete_at_the_end(table).items():
        summaries.setdefault(table.rows[index], reason)
    labelled = set(summaries)
    kept = [index for index, row in enumerate(table.rows) if row not in labelled]
    for index, reason in _statistics_below(table, kept).items():
        summaries.setdefault(table.rows[index], reason)
    return summaries


def _labelled(cells: Sequence[str]) -> dict[int, str]:
    """Return the cells of a column that say that their row is no test."""
    texts = {cell for cell in set(cells) if _is_text(cell)}
    if not texts:
        return {}
    summaries = {text for text in texts if says_summary(text)}
    if len(cells) > 1 and all(cell in summaries for cell in cells):
        # Where every row is a statistic, those of a mean are the tests.
        summaries = {text for text in summaries if not _says_mean(text)}
    words = set()
    if _holds_numbers(cells):
        words = {text for text in texts if text.replace(" ", "").isalpha()}
    reasons = {}
    for index, cell in enumerate(cells):
        if cell in summaries:
            reasons[index] = f"{cell!r} is no test"
        elif cell in words:
            reasons[index] = f"{cell!r} stands where other rows have a number"
    return reasons


def _without_number(name: str, cells: Sequence[str]) -> dict[int, str]:
    """Return the last cells that are empty in a column that numbers the tests 1, 2, 3, ..."""
    numbered = len(cells)
    while numbered and not cells[numbered - 1]:
        numbered -= 1
    count = len(cells) - numbered
    if numbered < _FEWEST_NUMBERED or not 0 < count <= _MAX_SUMMARIES:
        return {}
    if list(cells[:numbered]) != [str(number) for number in range(1, numbered + 1)]:
        return {}
    reason = f"has no number in column {name!r}, which numbers the tests"
    return dict.fromkeys(range(numbered, len(cells)), reason)


def _incomplete_at_the_end(table: RawTable) -> dict[int, str]:
    """Return the last rows that lack what every other row has, in several columns.

    A statistic is made of some columns only; a test has readings of all meters.
    """
    columns = list(table.columns.values())
    height = len(table.rows)
    lacking = [0] * height
    for cells in columns:
        last = height
        while last and not cells[last - 1]:
            last -= 1
        if last >= _FEWEST_NUMBERED and all(cells[:last]):
            for index in range(last, height):
                lacking[index] += 1
    count = sum(cells >= _FEWEST_LACKING for cells in lacking)
    if not 0 < count <= _MAX_SUMMARIES:
        return {}
    reason = "lacks cells in columns that all rows above fill"
    return dict.fromkeys(range(height - count, height), reason)


def _is_text(cell: str) -> bool:
    """Return whether a cell holds text and neither a number nor a code for no value."""
    return bool(cell) and not is_number(cell) and not not_available(cell)


def _holds_numbers(cells: Sequence[str]) -> bool:
    """Return whether most cells of a column are numbers."""
    numbers = sum(map(is_number, cells))
    return numbers >= _FEWEST_ROWS and numbers > len(cells) / 2


def _words(text: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", plain_text(text).lower())


def says_summary(text: str) -> bool:
    """Return whether a text says that its row summarises others, as `Mean of all tests`."""
    words = set(_words(text))
    if re.search(r"\d", text) and words.isdisjoint(_MEAN):
        return False
    if words & _WEAK and not words & _VALUE:
        return False
    if not words & (_SUMMARY | _WEAK):
        return False
    return words <= _ALL


def _says_mean(text: str) -> bool:
    return not _MEAN.isdisjoint(_words(text))


class _Match(NamedTuple):
    """A statistic that a row is, and the probability that it is that by chance."""

    name: str
    chance: float


class _Numbers(NamedTuple):
    """A column of numbers, its cells, and whether their decimal sign is a comma."""

    values: Array
    cells: Sequence[str]
    comma: bool


def _statistics_below(table: RawTable, kept: Sequence[int]) -> dict[int, str]:
    """Return the last rows whose numbers are statistics of the rows above.

    Args:
        table: as text.
        kept: positions of the rows that no cell names a summary.
    """
    if len(kept) <= _FEWEST_ROWS:
        return {}
    columns = []
    for name, cells in table.columns.items():
        kept_cells = [cells[index] for index in kept]
        comma = table.styles[name].comma
        values = read_numbers(kept_cells, comma).values
        if np.isfinite(values).mean() > 0.5:
            columns.append(_Numbers(values, kept_cells, comma))
    for count in range(min(_MAX_SUMMARIES, len(kept) - _FEWEST_ROWS), 0, -1):
        first = len(kept) - count
        matches = [_match(columns, first, row) for row in range(first, len(kept))]
        chance = math.prod(match.chance for match in matches)
        if chance < _CHANCE and all(
            match.chance < _LARGEST_CHANCE for match in matches
        ):
            reasons = [f"is the {match.name} of the rows above" for match in matches]
            return dict(zip(kept[first:], reasons, strict=True))
    return {}


def _match(columns: Sequence[_Numbers], first: int, position: int) -> _Match:
    """Return which statistic of the rows above a row is in all its columns.

    Args:
        columns: of numbers.
        first: rows above it are summarised.
        position: of the row.
    """
    chances: dict[str, float] | None = None
    compared = 0
    for values, cells, comma in columns:
        above = values[:first]
        known = above[np.isfinite(above)]
        if len(known) < _FEWEST_ROWS or not np.isfinite(values[position]):
            continue
        if np.ptp(known) == 0.0:
            continue
        gaps = len(above) - len(known)
        compared_cells = [cells[position], *cells[:_FORMATTED]]
        digit = max(last_digit(cell, comma) for cell in compared_cells)
        met = _met(known, values[position], digit, gaps)
        compared += 1
        if chances is None:
            chances = met
        else:
            chances = {
                name: met[name] * chances[name] for name in met if name in chances
            }
        if not chances:
            return _Match("", 1.0)
    if chances is None or compared < _FEWEST_COLUMNS:
        return _Match("", 1.0)
    best = min(chances, key=lambda name: chances[name])
    return _Match(best, chances[best])


def _met(known: Array, value: float, digit: float, gaps: int) -> dict[str, float]:
    """Return the statistics of a column that a value is, with the probability of each.

    Args:
        known: readings of the column.
        value: of the cell.
        digit: size of the last digit of the cells.
        gaps: readings that are missing; a statistic may be of them too.
    """
    spread = float(np.ptp(known))
    rounding = 0.6 * digit
    repeated = len(np.unique(known)) < _DISTINCT * len(known)
    met = {}
    for name, statistic in _statistics(known).items():
        beyond = value < statistic if name == "least" else value > statistic
        if gaps and name in _OF_ONE_READING and beyond:
            met[name] = 1.0  # it may be of a reading that is missing
            continue
        width = rounding + 2.0 * spread * gaps / (len(known) + gaps)
        if name not in _OF_ONE_READING:
            width += _WIDTH * spread
        if abs(value - statistic) > width:
            continue
        chance = min(1.0, 2.0 * width / spread)
        if name in _OF_ONE_READING and repeated:
            chance = max(chance, 1.0 / len(np.unique(known)))
        met[name] = chance
    return met


_OF_ONE_READING = ("least", "largest")
_FORMATTED = 20
"""Cells by which the last digit of a column is judged."""
_DISTINCT = 0.9
"""Share of different readings below which a column holds set values, which tests repeat."""


def _statistics(values: Array) -> Mapping[str, float]:
    """Return the statistics that tables have below their rows."""
    return {
        "mean": float(values.mean()),
        "median": float(np.median(values)),
        "least": float(values.min()),
        "largest": float(values.max()),
        "deviation": float(values.std(ddof=1)),
        "deviation (of n)": float(values.std()),
        "sum": float(values.sum()),
    }


def header_rows(table: RawTable, rows: Sequence[int]) -> dict[int, str]:
    """Return rows that repeat the header or the row of units.

    Args:
        table: as text.
        rows: positions of the rows with a cell that holds no number where a quantity needs one.

    Raises:
        InputError: a row names other columns or units, so that those below mean something else.
    """
    repeated = {}
    for index in rows:
        cells = {name: column[index] for name, column in table.columns.items()}
        filled = {name: cell for name, cell in cells.items() if cell}
        if len(filled) < 2 or any(map(is_number, filled.values())):
            continue
        number = table.rows[index]
        if all(_same_name(name, cell) for name, cell in filled.items()):
            repeated[number] = "repeats the header"
        elif holds_units(list(filled.values())):
            _refuse_other_units(table, number, filled)
            repeated[number] = "repeats the units"
        elif sum(bool(names_quantity(cell)) for cell in filled.values()) > 1:
            raise InputError(
                f"{table.source}: row {number} is a second header "
                f"({', '.join(filled.values())}): the rows below it are another table, "
                "which belongs in a file of its own"
            )
    return repeated


def _same_name(name: str, cell: str) -> bool:
    """Return whether a cell is the name of its column, which the reader may have numbered."""
    return name == cell or re.fullmatch(rf"{re.escape(cell)} \(\d+\)", name) is not None


def _refuse_other_units(table: RawTable, number: int, cells: Mapping[str, str]) -> None:
    for name, cell in cells.items():
        unit = unit_of(cell)
        stated = meaning_of(name, table.units.get(name, "")).unit
        if unit is None or unit.name == "-" or unit == stated:
            continue
        if stated is None and not meaning_of(name, cell).kind:
            continue
        raise InputError(
            f"{table.source}: row {number} is a row of units, and {cell!r} in column "
            f"{name!r} is not that of the rows above it: the rows below it belong in a file "
            "of their own"
        )
