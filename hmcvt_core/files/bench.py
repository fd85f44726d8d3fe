# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples: steady working points with measured efficiency, as values and as CSV.

The table of any bench is read too, with names and units of its own and torques of both shafts.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..transmission.ranges import BENCH_COLUMNS, REQUIRED_COLUMNS, RPM, OperatingPoints, Range
from .atomic import write_atomically
from .columns import Cells, column_name, decimal_points, holds_units, read_cells, read_columns

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
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757},
})
"""Size of the units of every quantity in the one that hmcvt keeps it in, which is the first."""

_KEPT = {column.name: column for column in BENCH_COLUMNS}
_RANGES = {**_KEPT, **{name: Range(name, 0.1, 20_000.0, "N m", "positive in forward driving")
                       for name in ("engine_torque", "output_torque")}}


@dataclass(frozen=True, eq=False)
class BenchSamples:
    """Bench samples; every array has shape (n,).

    Attributes:
        displacement_ratio: pump stroke commanded [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        efficiency: output power / engine power [-].
        output_speed: [rad/s], or None.
        oil_temperature: [deg C], or None.
        efficiency_std: standard deviation of `efficiency` [-], or None.
        stamp: time of the sample [s], or None.
        pressure: over the motor, high minus low side, positive where it drives the output forward
            [Pa], or None.
        extra: the other columns, as text; `stage` names the stage engaged.
        source: where they come from, for messages and provenance.
        sha256: of the file they were read from; empty when not from a file.

    Raises:
        InputError: a value is outside its range or lengths differ; the place is named.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    efficiency: Array
    output_speed: Array | None = None
    oil_temperature: Array | None = None
    efficiency_std: Array | None = None
    stamp: Array | None = None
    pressure: Array | None = None
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    source: str = "samples"
    sha256: str = ""

    def __post_init__(self) -> None:
        for column in BENCH_COLUMNS:
            value = getattr(self, column.name)
            if value is None:
                if column.name in REQUIRED_COLUMNS:
                    raise InputError(f"{self.source}: {column.name} is missing")
                continue
            array = np.array(column.check(value, self.source), ndmin=1)
            if array.shape != (len(np.atleast_1d(self.displacement_ratio)),):
                raise InputError(f"{self.source}: {column.name} has shape {array.shape}, "
                                 f"displacement_ratio has {len(self.displacement_ratio)} values")
            array.flags.writeable = False
            object.__setattr__(self, column.name, array)
        if len(self) == 0:
            raise InputError(f"{self.source}: holds no samples")

    def __len__(self) -> int:
        return len(self.displacement_ratio)

    @property
    def points(self) -> OperatingPoints:
        """Where the samples were taken; a column `stage` says in which one."""
        stage = self.extra.get("stage")
        return OperatingPoints(self.displacement_ratio, self.engine_speed, self.load_torque,
                               self.oil_temperature, None if stage is None else np.array(stage))

    def select(self, index: ArrayLike) -> BenchSamples:
        """Return the samples at an index array or mask, in that order."""
        chosen = np.arange(len(self))[np.asarray(index)]
        values: dict[str, Any] = {
            column.name: None if (value := getattr(self, column.name)) is None
            else value[chosen] for column in BENCH_COLUMNS}
        extra = {name: tuple(column[i] for i in chosen) for name, column in self.extra.items()}
        return BenchSamples(**values, extra=extra, source=self.source, sha256=self.sha256)


def read_bench(path: str | os.PathLike[str]) -> BenchSamples:
    """Read bench samples from CSV (columns: see `BenchSamples`; the first four are required).

    Separated by commas, semicolons or tabs; UTF-8, or else Windows-1252.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a column is missing or
            doubled, or a value is not a number or outside its range; file, row and field are named.
    """
    values, extra, cells = read_columns(path, REQUIRED_COLUMNS)
    return BenchSamples(**values, extra=extra, source=cells.source, sha256=cells.sha256)


def read_raw_bench(
    path: str | os.PathLike[str], columns: Mapping[str, str], *, header_row: int | None = None
) -> BenchSamples:
    """Read bench samples from a table with column names and units of its own.

    Efficiency and load torque are computed where no column holds them: output power / engine power,
    and output power / engine speed. A row of units below the header is left out. Columns that
    `columns` does not name are kept; one with the name of a bench column as `raw <name>`.

    Args:
        path: CSV file, as `read_bench` takes it.
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
    cells = read_cells(path, (), _distinct, header_row)
    chosen = {quantity: _column(quantity, text, cells) for quantity, text in columns.items()}
    names = [name for name, _ in chosen.values()]
    for quantity, (name, _) in chosen.items():
        if names.count(name) > 1:
            raise InputError(f"{quantity}: column {name!r} is named twice")
    if holds_units([cells.columns[name][0] for name in names]):
        cells = cells._replace(columns={name: column[1:] for name, column in cells.columns.items()},
                               rows=cells.rows[1:])
    cells = decimal_points(cells, names)
    values = {}
    for quantity, (name, unit) in chosen.items():
        values[quantity] = UNITS[quantity][unit] * cells.numbers(name)
        cells.require_range(
            values[quantity], _RANGES[quantity], f"; column {name!r} is taken as {unit}: another "
            f"unit is written {name}:UNIT, one of {', '.join(UNITS[quantity])}")
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


def _distinct(header: list[str]) -> list[str]:
    """Name the columns of a header so that no name is empty and all differ."""
    names = [cell.strip() or "unnamed" for cell in header]
    again = [names[:i].count(name) + 1 for i, name in enumerate(names)]
    return [name if number == 1 else f"{name} ({number})"
            for name, number in zip(names, again, strict=True)]


def _column(quantity: str, text: str, cells: Cells) -> tuple[str, str]:
    """Name and unit of `COLUMN` or `COLUMN:UNIT`; a column may hold a colon itself."""
    units = list(UNITS[quantity])
    whole, (name, colon, unit) = text.strip(), text.rpartition(":")
    name, unit = name.strip(), unit.strip()
    if whole in cells.columns:
        return whole, units[0]
    if colon and name in cells.columns:
        for known in units:
            if unit.casefold() == known.casefold():
                return name, known
        raise InputError(f"{quantity}: {unit!r} is no unit of it; there is {', '.join(units)}")
    raise InputError(f"{cells.source}: {quantity}: column {name if colon else whole!r} is missing; "
                     f"there is {', '.join(cells.columns)}")


def _derive(values: dict[str, Array], cells: Cells) -> None:
    """Add load torque and efficiency where the shafts tell them."""
    told = "; computed from torques and speeds of the shafts: check their columns and units"
    if "load_torque" not in values:
        values["load_torque"] = (
            values["output_torque"] * values["output_speed"] / values["engine_speed"])
        cells.require_range(values["load_torque"], _KEPT["load_torque"], told)
    if "efficiency" not in values:
        values["efficiency"] = values["load_torque"] / values["engine_torque"]
        cells.require_range(values["efficiency"], _KEPT["efficiency"], told)


def write_bench(path: str | os.PathLike[str], samples: BenchSamples) -> None:
    """Write bench samples as CSV, whole or not at all; `read_bench` gives the same values."""
    columns = {column.name: map(repr, values.tolist()) for column in BENCH_COLUMNS
               if (values := getattr(samples, column.name)) is not None}
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*columns, *samples.extra])
    writer.writerows(zip(*columns.values(), *samples.extra.values(), strict=True))
    write_atomically(Path(path), buffer.getvalue())
