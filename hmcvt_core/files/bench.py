# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples, and columns of numbers from CSV; every complaint names its place."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..transmission.ranges import (
    BENCH_COLUMNS,
    REQUIRED_COLUMNS,
    Array,
    OperatingPoints,
)
from .atomic import write_atomically
from .table import Table, csv_text, read_plain
from .tables.units import holds_units

_NAMES = frozenset(column.name for column in BENCH_COLUMNS)


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
        rows: of that file, from 1, one for each sample; empty when not known.

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
    rows: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for column in BENCH_COLUMNS:
            value = getattr(self, column.name)
            if value is None:
                if column.name in REQUIRED_COLUMNS:
                    raise InputError(f"{self.source}: {column.name} is missing")
                continue
            array = np.array(column.check(value, self.source), ndmin=1)
            if array.shape != (len(np.atleast_1d(self.displacement_ratio)),):
                raise InputError(
                    f"{self.source}: {column.name} has shape {array.shape}, "
                    f"displacement_ratio has {len(self.displacement_ratio)} values"
                )
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
        return OperatingPoints(
            self.displacement_ratio,
            self.engine_speed,
            self.load_torque,
            self.oil_temperature,
            None if stage is None else np.array(stage),
        )

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of numbers that there are, by name."""
        return {
            column.name: values
            for column in BENCH_COLUMNS
            if (values := getattr(self, column.name)) is not None
        }

    def select(self, index: ArrayLike) -> BenchSamples:
        """Return the samples at an index array or mask, in that order."""
        chosen = np.arange(len(self))[np.asarray(index)]
        extra = {
            name: tuple(column[i] for i in chosen)
            for name, column in self.extra.items()
        }
        return replace(
            self,
            **{name: values[chosen] for name, values in self.columns.items()},
            extra=extra,
            rows=tuple(self.rows[i] for i in chosen) if self.rows else (),
        )


def joined(parts: Sequence[BenchSamples]) -> BenchSamples:
    """Return bench samples of the same columns one after the other."""
    values: dict[str, Any] = {
        name: np.concatenate([part.columns[name] for part in parts])
        for name in parts[0].columns
    }
    extra = {
        name: tuple(chain.from_iterable(part.extra[name] for part in parts))
        for name in parts[0].extra
    }
    return BenchSamples(**values, extra=extra, source=parts[0].source)


def read_bench(path: str | os.PathLike[str]) -> BenchSamples:
    """Read bench samples from CSV (columns: see `BenchSamples`; the first four are required).

    Separated by commas, semicolons or tabs; UTF-8, or else Windows-1252.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a column is missing or
            doubled, or a value is not a number or outside its range; file, row and field are named.
    """
    values, extra, table = read_columns(path, REQUIRED_COLUMNS)
    return BenchSamples(
        **values,
        extra=extra,
        source=table.source,
        sha256=table.sha256,
        rows=tuple(table.rows),
    )


def write_bench(path: str | os.PathLike[str], samples: BenchSamples) -> None:
    """Write bench samples as CSV, whole or not at all; `read_bench` gives the same values."""
    columns = {
        name: map(repr, values.tolist()) for name, values in samples.columns.items()
    }
    write_atomically(Path(path), csv_text({**columns, **samples.extra}))


def read_columns(
    path: str | os.PathLike[str], required: Sequence[str]
) -> tuple[dict[str, Any], dict[str, tuple[str, ...]], Table]:
    """Read the columns of a bench file; the names of known ones may have capitals and spaces.

    Returns:
        Those that hmcvt knows, by name, shape (n,) each; the others, as text; the whole table.

    Raises:
        InputError: as `read_plain`; or a value is no number or outside its range.
    """
    table = read_plain(path, required, column_name)
    first = [table.columns[name][0] for name in required]
    if holds_units(first):
        raise InputError(
            f"{table.source}: row {table.rows[0]}: {', '.join(first)} are no numbers; "
            f"remove a row of units ({required[1]} is in rad/s, {required[2]} in N m)"
        )
    known = {}
    for column in BENCH_COLUMNS:
        if column.name in table.columns:
            known[column.name] = table.numbers(
                column.name, column.name not in REQUIRED_COLUMNS
            )
            table.require_range(known[column.name], column)
    extra = {
        name: tuple(column)
        for name, column in table.columns.items()
        if name not in known
    }
    return known, extra, table


def column_name(cell: str) -> str:
    """Return the name of a column that hmcvt knows also where it is spelled another way."""
    plain = re.sub("[ -]+", "_", cell.strip().lower())
    return plain if plain in _NAMES else cell.strip()
