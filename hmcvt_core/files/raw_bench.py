# SPDX-License-Identifier: Apache-2.0
"""Bench samples from the table of any bench: names and units of its own, torques of both shafts."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..transmission.ranges import BENCH_COLUMNS, EFFICIENCY, LOAD_TORQUE, RPM, Range
from .bench import BenchSamples
from .columns import Cells, column_name, decimal_points, holds_units, read_cells

Array = NDArray[np.float64]

_SPEED = {"rad/s": 1.0, "rpm": RPM, "r/min": RPM, "1/min": RPM, "U/min": RPM}
_TORQUE = {"N m": 1.0, "Nm": 1.0, "kNm": 1e3}
_PART = {"-": 1.0, "%": 0.01}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType({
    "displacement_ratio": _PART,
    "engine_speed": _SPEED,
    "output_speed": _SPEED,
    "engine_torque": _TORQUE,
    "output_torque": _TORQUE,
    "load_torque": _TORQUE,
    "efficiency": _PART,
    "efficiency_std": _PART,
    "oil_temperature": {"deg C": 1.0, "degC": 1.0, "C": 1.0, "\N{DEGREE SIGN}C": 1.0},
    "stamp": {"s": 1.0, "ms": 1e-3},
})
"""Size of the units of every quantity in the one that hmcvt keeps it in, which is the first."""

_KEPT = {column.name: column for column in BENCH_COLUMNS}
_RANGES = {**_KEPT, **{name: Range(name, 0.1, 20_000.0, "N m", "positive in forward driving")
                       for name in ("engine_torque", "output_torque")}}


class _Column(NamedTuple):
    """Name of a column, its unit, and the size of that in the one that hmcvt keeps."""

    name: str
    unit: str
    factor: float


def read_raw_bench(
    path: str | os.PathLike[str], columns: Mapping[str, str], *, header_row: int | None = None
) -> BenchSamples:
    """Read bench samples from a table with column names and units of its own.

    Efficiency and load torque are computed where no column holds them: output power / engine power,
    and output power / engine speed. A row of units below the header is left out. Columns that
    `columns` does not name are kept; one with the name of a bench column as `raw <name>`.

    Args:
        path: CSV file, separated by commas, semicolons or tabs; UTF-8, or else Windows-1252.
        columns: where each quantity of `UNITS` stands, as `COLUMN` or `COLUMN:UNIT`, such as
            `{"engine_speed": "n_engine:rpm"}`.
        header_row: line of the header, from 1; the first that is neither empty nor a comment when
            left out.

    Raises:
        InputError: the file cannot be read, a column is missing or named twice, a unit is unknown,
            quantities are missing or say the same twice, or a value is no number or outside its
            range; file, row and field are named.
    """
    _require_enough(columns)
    cells = read_cells(path, (), _distinct(), header_row=header_row,
                       encodings=("utf-8-sig", "cp1252"))
    chosen = {quantity: _column(quantity, text, cells)
              for quantity, text in columns.items()}
    names = [column.name for column in chosen.values()]
    for quantity, column in chosen.items():
        if names.count(column.name) > 1:
            raise InputError(f"{quantity}: column {column.name!r} is named twice")
    if holds_units([cells.columns[name][0] for name in names]):
        cells = cells._replace(columns={name: column[1:] for name, column in cells.columns.items()},
                               rows=cells.rows[1:])
    cells = decimal_points(cells, names)
    values = {}
    for quantity, column in chosen.items():
        values[quantity] = column.factor * cells.numbers(column.name)
        cells.require_range(
            values[quantity], _RANGES[quantity],
            f"; column {column.name!r} is taken as {column.unit}: another unit is written "
            f"{column.name}:UNIT, one of {', '.join(UNITS[quantity])}")
    _derive(values, cells)
    extra = {name if column_name(name) not in _KEPT else f"raw {name}": tuple(column)
             for name, column in cells.columns.items() if name not in names}
    return BenchSamples(**{name: values[name] for name in _KEPT if name in values}, extra=extra,
                        source=cells.source, sha256=cells.sha256)


def _require_enough(columns: Mapping[str, str]) -> None:
    unknown = [name for name in columns if name not in UNITS]
    if unknown:
        raise InputError(f"{unknown[0]} is no quantity of a bench; there is {', '.join(UNITS)}")
    for one, other in (("efficiency", "engine_torque"), ("load_torque", "output_torque")):
        if one in columns and other in columns:
            raise InputError(f"{one} and {other} say the same twice: name one")
    missing = [name for name in ("displacement_ratio", "engine_speed") if name not in columns]
    load = [] if "load_torque" in columns else [
        name for name in ("output_torque", "output_speed") if name not in columns]
    if load:
        missing.append(f"load_torque (or {' and '.join(load)})")
    if not {"efficiency", "engine_torque"} & set(columns):
        missing.append("efficiency (or engine_torque)")
    if missing:
        raise InputError(f"no column is named for {', '.join(missing)}")


def _distinct() -> Callable[[str], str]:
    """Return what gives the columns of one header names that are not empty and differ."""
    seen: Counter[str] = Counter()

    def name_of(cell: str) -> str:
        name = cell.strip() or "unnamed"
        seen[name] += 1
        return name if seen[name] == 1 else f"{name} ({seen[name]})"

    return name_of


def _column(quantity: str, text: str, cells: Cells) -> _Column:
    """Find `COLUMN` or `COLUMN:UNIT` in the header; a column may hold a colon itself."""
    units = UNITS[quantity]
    whole, (name, colon, unit) = text.strip(), text.rpartition(":")
    name, unit = name.strip(), unit.strip()
    if whole in cells.columns:
        return _Column(whole, *next(iter(units.items())))
    if colon and name in cells.columns:
        for known, factor in units.items():
            if unit.casefold() == known.casefold():
                return _Column(name, known, factor)
        raise InputError(f"{quantity}: {unit!r} is no unit of it; there is {', '.join(units)}")
    raise InputError(f"{cells.source}: {quantity}: column {name if colon else whole!r} is missing; "
                     f"there is {', '.join(cells.columns)}")


def _derive(values: dict[str, Array], cells: Cells) -> None:
    """Add load torque and efficiency where the shafts tell them."""
    told = "; computed from torques and speeds of the shafts: check their columns and units"
    if "load_torque" not in values:
        values["load_torque"] = (
            values["output_torque"] * values["output_speed"] / values["engine_speed"])
        cells.require_range(values["load_torque"], LOAD_TORQUE, told)
    if "efficiency" not in values:
        values["efficiency"] = values["load_torque"] / values["engine_torque"]
        cells.require_range(values["efficiency"], EFFICIENCY, told)
