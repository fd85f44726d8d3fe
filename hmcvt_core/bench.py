# SPDX-License-Identifier: Apache-2.0
"""Bench samples: steady working points with measured efficiency, as values and as CSV."""

from __future__ import annotations

import csv
import hashlib
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .atomic import write_atomically
from .errors import InputError
from .ranges import BENCH_COLUMNS, REQUIRED_COLUMNS

Array = NDArray[np.float64]
_MAX_BYTES = 256 * 1024 * 1024


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
        extra: columns that hmcvt does not know, as text.
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
            array = np.atleast_1d(column.check(value, self.source))
            if array.shape != (len(np.atleast_1d(self.displacement_ratio)),):
                raise InputError(f"{self.source}: {column.name} has shape {array.shape}, "
                                 f"displacement_ratio has {len(self.displacement_ratio)} values")
            array = array.copy()
            array.flags.writeable = False
            object.__setattr__(self, column.name, array)
        if len(self) == 0:
            raise InputError(f"{self.source}: holds no samples")

    def __len__(self) -> int:
        return len(self.displacement_ratio)

    def select(self, index: ArrayLike) -> BenchSamples:
        """Return the samples at an index array or mask, in that order."""
        chosen = np.asarray(index)
        if chosen.dtype == bool:
            chosen = np.flatnonzero(chosen)
        values: dict[str, Any] = {
            column.name: None if (value := getattr(self, column.name)) is None
            else value[chosen] for column in BENCH_COLUMNS}
        extra = {name: tuple(column[i] for i in chosen) for name, column in self.extra.items()}
        return BenchSamples(**values, extra=extra, source=self.source, sha256=self.sha256)


def read_bench(path: str | os.PathLike[str]) -> BenchSamples:
    """Read bench samples from CSV (columns: see `BenchSamples`; the first four are required).

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a column is missing or
            doubled, or a value is not a number or outside its range; file, row and field are named.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a bench log")
        raw = path.read_bytes()
        text = raw.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text at byte {error.start}") from None
    return _parse(text, str(path), hashlib.sha256(raw).hexdigest())


def _parse(text: str, source: str, digest: str) -> BenchSamples:
    try:
        rows = list(csv.reader(io.StringIO(text), strict=True))
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None
    numbered = [(number, row) for number, row in enumerate(rows, 1)
                if any(cell.strip() for cell in row)]
    if not numbered:
        raise InputError(f"{source}: is empty; needs columns {', '.join(REQUIRED_COLUMNS)}")
    header = [cell.strip() for cell in numbered[0][1]]
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{source}: row {numbered[0][0]}: column {name!r} stands there twice")
    missing = [name for name in REQUIRED_COLUMNS if name not in header]
    if missing:
        raise InputError(f"{source}: row {numbered[0][0]}: column {', '.join(missing)} is missing; "
                         f"there is {', '.join(header)}")
    body = numbered[1:]
    if not body:
        raise InputError(f"{source}: holds a header but no samples")
    for number, row in body:
        if len(row) != len(header):
            raise InputError(f"{source}: row {number}: {len(row)} fields, "
                             f"the header has {len(header)}")
    cells = {name: [row[i].strip() for _, row in body] for i, name in enumerate(header)}
    numbers = [number for number, _ in body]
    known = {column.name: _numbers(cells.pop(column.name), numbers, column.name, source)
             for column in BENCH_COLUMNS if column.name in cells}
    for column in BENCH_COLUMNS:
        if column.name in known:
            inside = column.contains(known[column.name])
            if not inside.all():
                first = int(np.flatnonzero(~inside)[0])
                raise InputError(f"{source}: row {numbers[first]}: "
                                 f"{column.complaint(known[column.name][first])}")
    extra = {name: tuple(column) for name, column in cells.items()}
    return BenchSamples(**known, extra=extra, source=source, sha256=digest)


def _numbers(cells: list[str], rows: list[int], name: str, source: str) -> Array:
    values = np.empty(len(cells))
    for i, cell in enumerate(cells):
        try:
            values[i] = float(cell)
        except ValueError:
            what = f"{cell!r} is not a number" if cell else "is empty"
            raise InputError(f"{source}: row {rows[i]}: {name} {what}") from None
    return values


def write_bench(path: str | os.PathLike[str], samples: BenchSamples) -> None:
    """Write bench samples as CSV, whole or not at all; `read_bench` gives the same values."""
    names = [column.name for column in BENCH_COLUMNS if getattr(samples, column.name) is not None]
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*names, *samples.extra])
    for i in range(len(samples)):
        values = [repr(float(getattr(samples, name)[i])) for name in names]
        writer.writerow([*values, *(column[i] for column in samples.extra.values())])
    write_atomically(Path(path), buffer.getvalue())


