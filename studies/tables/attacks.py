# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Things in tables that were once read wrong without a word, one a table.

Attacks on the columns change what the header says; attacks on the lines change what stands between
and below the tests. Each says whether an import still needs no question.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .headings import PUBLIC_OTHERS

Array = NDArray[np.float64]
Lines = list[list[str]]
RPM = np.pi / 30.0
_TORQUE_UNITS = {"Nm": "lb ft", "N\u00b7m": "lb ft", "lb-ft": "Nm", "kNm": "lb ft"}


@dataclass
class Column:
    """A column of a random table.

    Attributes:
        quantity: that it holds; `""` for none.
        name: in the header, without its unit.
        unit: text; `""` for none.
        cells: of the tests.
        numbers: of the cells, in the unit.
    """

    quantity: str
    name: str
    unit: str
    cells: list[str]
    numbers: Array


@dataclass
class Draft:
    """A table before it is written.

    Attributes:
        columns: in the order of the file.
        truth: SI values by quantity.
        written: writes a number with a count of digits in the style of the table.
        has_units: whether the header or a row of units states them.
    """

    columns: list[Column]
    truth: dict[str, Array]
    written: Callable[[float, int], str]
    has_units: bool

    def column(self, quantity: str) -> Column | None:
        """Return the column of a quantity, None without one."""
        for column in self.columns:
            if column.quantity == quantity:
                return column
        return None

    def rewrite(self, column: Column, numbers: Array) -> None:
        """Give a column other numbers."""
        column.numbers = numbers
        column.cells = [self.written(number, 4) for number in numbers]

    def add(self, name: str, unit: str, numbers: Array) -> None:
        """Add a column that holds no quantity."""
        cells = [self.written(number, 3) for number in numbers]
        self.columns.append(Column("", name, unit, cells, numbers))


def exchanged_names(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Exchange the names of the shafts, of all their quantities or of one kind."""
    kinds = [
        kind
        for kind in ("speed", "torque", "power")
        if draft.column(f"engine_{kind}") and draft.column(f"output_{kind}")
    ]
    if not kinds:
        return None
    if len(kinds) > 1 and rng.random() < 0.6:
        kinds = [str(rng.choice(kinds))]
    for kind in kinds:
        engine = draft.column(f"engine_{kind}")
        output = draft.column(f"output_{kind}")
        if engine is not None and output is not None:
            engine.name, output.name = output.name, engine.name
    return False


def neutral_in_the_middle(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Write the stroke from 0 to full, with the neutral in the middle."""
    stroke = draft.column("displacement_ratio")
    if stroke is None:
        return None
    full = 100.0 if stroke.unit == "%" else 1.0
    draft.rewrite(stroke, full * (0.5 + 0.5 * draft.truth["displacement_ratio"]))
    return False


PARTS = (
    *("Gear efficiency", "volumetric efficiency", "Motor efficiency", "eta_mh"),
    *("Wirkungsgrad Zahnrad", "Pumpenwirkungsgrad", "Hydrostatic efficiency", "eta_v"),
    *("Axle efficiency", "Rendement volum\u00e9trique", "engine efficiency"),
)


def efficiency_of_a_part(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Give the efficiency of a part where that of the transmission would stand."""
    efficiency = draft.column("efficiency")
    if efficiency is None or not draft.has_units:
        return None
    efficiency.name = str(rng.choice(PARTS))
    full = 100.0 if efficiency.unit == "%" else 1.0
    draft.rewrite(efficiency, full * rng.uniform(0.9, 0.98, len(efficiency.numbers)))
    efficiency.quantity = ""
    return False


STROKES_OF_THE_MOTOR = (
    *("Motor displacement", "Cylindr\u00e9e moteur", "Cilindrata motore"),
    *("Schwenkwinkel Hydromotor", "Cilindrada motor hidr\u00e1ulico"),
    *("Hub Motor", "motor swash angle", "\u9a6c\u8fbe\u6392\u91cf\u6bd4"),
)
FOREIGN_UNITS = {
    "speed": ("rpm", "1/min", "tr/min", "r/min"),
    "torque": ("Nm", "N\u00b7m"),
    "power": ("kW",),
}


def foreign_instead(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Give what is none of the quantities where a speed, torque, power or stroke would stand."""
    columns = [column for column in draft.columns if column.quantity]
    column = columns[int(rng.integers(len(columns)))]
    kind = column.quantity.rpartition("_")[2]
    if not draft.has_units or (kind not in FOREIGN_UNITS and kind != "ratio"):
        return None
    names = list(STROKES_OF_THE_MOTOR)
    if kind in FOREIGN_UNITS:
        names = []
        for header, _, _ in PUBLIC_OTHERS:
            name, _, unit = header.rstrip(")]").replace("(", "[").rpartition("[")
            if unit in FOREIGN_UNITS[kind]:
                names.append(name.strip())
    column.name = str(rng.choice(names))
    draft.rewrite(column, column.numbers * rng.uniform(0.6, 0.95))
    column.quantity = ""
    return False


FURTHER = (
    *("{} std", "{} sd", "{} set", "{} soll", "{} limit", "{} max", "{} target"),
    *("{} stdev", "{} setpoint", "{} sim", "{} ripple", "{} error", "\u0394 {}"),
)


def further_column(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Add set values or deviations next to a quantity."""
    column = _any_of_a_shaft(rng, draft)
    if column is None or not draft.has_units:
        return None
    name = str(rng.choice(FURTHER)).format(column.name)
    draft.add(name, column.unit, column.numbers * rng.uniform(0.05, 0.95))
    return True


def set_values_only(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Give set values or deviations where the measured ones would stand."""
    column = _any_of_a_shaft(rng, draft)
    if column is None or not draft.has_units:
        return None
    column.name = str(rng.choice(FURTHER)).format(column.name)
    draft.rewrite(column, column.numbers * rng.uniform(0.6, 0.95))
    return False


def torque_without_unit(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Leave the unit of torques in lb ft out, next to columns with units."""
    torques = [column for column in draft.columns if "torque" in column.quantity]
    if not torques or not draft.has_units:
        return None
    for column in torques:
        draft.rewrite(column, draft.truth[column.quantity] / 1.3558179483)
        column.unit = ""
    return False


def unit_changes(rng: np.random.Generator, draft: Draft) -> bool | None:
    """Write the second half of the speeds or strokes in another unit."""
    half = len(draft.truth["efficiency"]) // 2
    if rng.random() < 0.5:
        column = draft.column("engine_speed")
        factor = RPM if column is not None and column.unit != "rad/s" else 1.0 / RPM
    else:
        column = draft.column("displacement_ratio")
        factor = 0.01
    if column is None or half < 4 or column.unit not in ("rpm", "1/min", "%", "rad/s"):
        return None
    numbers = column.numbers.copy()
    numbers[half:] *= factor
    draft.rewrite(column, numbers)
    return False


def _any_of_a_shaft(rng: np.random.Generator, draft: Draft) -> Column | None:
    """Return a column of the engine or the load."""
    names = ("engine_speed", "load_torque", "engine_torque", "output_torque")
    columns = [column for column in draft.columns if column.quantity in names]
    if not columns:
        return None
    return columns[int(rng.integers(len(columns)))]


COLUMN_ATTACKS = (
    exchanged_names,
    neutral_in_the_middle,
    efficiency_of_a_part,
    foreign_instead,
    further_column,
    set_values_only,
    torque_without_unit,
    unit_changes,
)

LABELS = (
    *("Mean", "Mittelwert", "Max.", "min", "Std. dev.", "set values", "Sollwert"),
    *("Upper limit", "Grenzwert", "Target", "Moyenne", "Average of all tests", "Sum"),
)


def labelled_row(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Add a row below that says what it is, where tests are numbered or remarked."""
    free = [index for index, column in enumerate(draft.columns) if not column.quantity]
    if not free:
        return None
    row = []
    for column in draft.columns:
        low, high = float(np.min(column.numbers)), float(np.max(column.numbers))
        row.append(draft.written(float(rng.uniform(low, high)), 2))
    row[free[int(rng.integers(len(free)))]] = str(rng.choice(LABELS))
    lines.append(row)
    return True


def statistics_below(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Add rows of statistics below that do not say what they are."""
    statistics = (np.mean, np.std, np.min, np.max, np.median)
    count = int(rng.integers(1, 4))
    for index in sorted(rng.choice(len(statistics), count, replace=False)):
        row = []
        for column in draft.columns:
            numbered = not column.quantity and not column.unit
            value = float(statistics[index](column.numbers))
            row.append("" if numbered else draft.written(value, 3))
        lines.append(row)
    return True


def repeated_header(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Repeat the header between the tests, as pages do."""
    middle = int(rng.integers(first + 1, len(lines)))
    lines[middle:middle] = [list(line) for line in lines[first - 1 : first]]
    return True


def other_units_below(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Write a second row of units between the tests, and torques in those."""
    torques = []
    for index, column in enumerate(draft.columns):
        if "torque" in column.quantity and column.unit in _TORQUE_UNITS:
            torques.append(index)
    if not torques or first != 2:
        return None
    middle = first + (len(lines) - first) // 2
    sizes = {
        "Nm": 1.0,
        "N\u00b7m": 1.0,
        "lb-ft": 1.3558179483,
        "kNm": 1e3,
        "lb ft": 1.3558179483,
    }
    units = list(lines[first - 1])
    for index in torques:
        old = draft.columns[index].unit
        units[index] = _TORQUE_UNITS[old]
        factor = sizes[old] / sizes[units[index]]
        for position, line in enumerate(lines[middle:], middle - first):
            line[index] = draft.written(
                draft.columns[index].numbers[position] * factor, 4
            )
    lines.insert(middle, units)
    return False


def blank_lines(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Leave lines empty between and below the tests."""
    for _ in range(int(rng.integers(1, 4))):
        lines.insert(int(rng.integers(first, len(lines) + 1)), [""] * len(lines[0]))
    return True


def exchanged_axes(
    rng: np.random.Generator, lines: Lines, draft: Draft, first: int
) -> bool | None:
    """Write each quantity in a row."""
    lines[:] = [list(row) for row in zip(*lines, strict=True)]
    return False


LINE_ATTACKS = (
    labelled_row,
    statistics_below,
    repeated_header,
    other_units_below,
    blank_lines,
    exchanged_axes,
)
