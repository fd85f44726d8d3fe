# SPDX-License-Identifier: Apache-2.0
"""Bench samples from the table of any bench: names and units of its own, torques of both shafts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bench import BenchSamples
from .columns import Cells, numbers, read_cells, require_range
from .errors import InputError
from .ranges import BENCH_COLUMNS, EFFICIENCY, LOAD_TORQUE, RPM

Array = NDArray[np.float64]

_SPEED = {"rad/s": 1.0, "rpm": RPM, "r/min": RPM, "1/min": RPM}
_TORQUE = {"Nm": 1.0, "N m": 1.0, "kNm": 1e3}
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
    "oil_temperature": {"degC": 1.0},
    "stamp": {"s": 1.0, "ms": 1e-3},
})
"""Size of the units of every quantity in the one that hmcvt keeps it in, which is the first."""

_SHAFTS = ("engine_torque", "output_torque")
_KEPT = {column.name: column for column in BENCH_COLUMNS}


class _Column(NamedTuple):
    """Name of a column and size of its unit in the one that hmcvt keeps."""

    name: str
    factor: float


def read_raw_bench(
    path: str | os.PathLike[str], columns: Mapping[str, str]
) -> BenchSamples:
    """Read bench samples from a table with column names and units of its own.

    Efficiency and load torque are computed where no column holds them: output power / engine power,
    and output power / engine speed. Columns that `columns` does not name are kept as they are.

    Args:
        path: CSV file, separated by commas, semicolons or tabs.
        columns: where each quantity of `UNITS` stands, as `COLUMN` or `COLUMN:UNIT`, such as
            `{"engine_speed": "n_engine:rpm"}`.

    Raises:
        InputError: the file cannot be read, a column is missing or named twice, quantities are
            missing or say the same twice, or a value is no number or outside its range; file, row
            and field are named.
    """
    _require_enough(columns)
    chosen = {quantity: _column(quantity, text) for quantity, text in columns.items()}
    names = [column.name for column in chosen.values()]
    for quantity, column in chosen.items():
        if names.count(column.name) > 1:
            raise InputError(f"{quantity}: column {column.name!r} is named twice")
    cells = read_cells(path, names)
    cells.read_decimal_commas(names)
    values = {quantity: column.factor * numbers(cells.columns[column.name], cells.rows, column.name,
                                                cells.source)
              for quantity, column in chosen.items()}
    for quantity in set(values) & set(_KEPT):
        require_range(values[quantity], _KEPT[quantity], cells.rows, cells.source)
    _derive(values, cells)
    extra = {name: tuple(column) for name, column in cells.columns.items()
             if name not in names and name not in _KEPT}
    return BenchSamples(**{name: values[name] for name in _KEPT if name in values}, extra=extra,
                        source=cells.source, sha256=cells.sha256)


def _column(quantity: str, text: str) -> _Column:
    """Read `COLUMN` or `COLUMN:UNIT`; a column may hold a colon itself."""
    name, colon, unit = text.rpartition(":")
    factor = UNITS[quantity].get(unit.strip()) if colon else None
    column = _Column(text.strip(), 1.0) if factor is None else _Column(name.strip(), factor)
    if not column.name:
        raise InputError(f"{quantity}: {text!r} names no column: write COLUMN or COLUMN:UNIT, with "
                         f"one of {', '.join(UNITS[quantity])}")
    return column


def _require_enough(columns: Mapping[str, str]) -> None:
    unknown = [name for name in columns if name not in UNITS]
    if unknown:
        raise InputError(f"{unknown[0]} is no quantity of a bench; there is {', '.join(UNITS)}")
    missing = [name for name in ("displacement_ratio", "engine_speed") if name not in columns]
    for name, needed in (("load_torque", ("output_torque", "output_speed")),
                         ("efficiency", (*_SHAFTS, "output_speed"))):
        lacking = [each for each in needed if each not in columns]
        if name not in columns and lacking:
            missing.append(f"{name} (or {' and '.join(lacking)})")
    if missing:
        raise InputError(f"no column is named for {', '.join(missing)}")
    if "efficiency" in columns and "engine_torque" in columns:
        raise InputError("efficiency and engine_torque say the same twice: name one")
    if "load_torque" in columns and "output_torque" in columns:
        raise InputError("load_torque and output_torque say the same twice: name one")


def _derive(values: dict[str, Array], cells: Cells) -> None:
    """Add load torque and efficiency where the shafts tell them."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if "load_torque" not in values:
            values["load_torque"] = (
                values["output_torque"] * values["output_speed"] / values["engine_speed"])
            _require_derived(values, "load_torque", cells)
        if "efficiency" not in values:
            values["efficiency"] = values["load_torque"] / values["engine_torque"]
            _require_derived(values, "efficiency", cells)


def _require_derived(values: Mapping[str, Array], name: str, cells: Cells) -> None:
    limits = {"load_torque": LOAD_TORQUE, "efficiency": EFFICIENCY}[name]
    try:
        require_range(values[name], limits, cells.rows, cells.source)
    except InputError as error:
        raise InputError(f"{error}; computed from torques and speeds of the shafts: check their "
                         "columns and units") from None
