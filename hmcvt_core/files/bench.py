# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples, and columns of numbers from CSV; every complaint names its place."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..transmission.ranges import BENCH_COLUMNS, REQUIRED_COLUMNS, OperatingPoints, Range
from .atomic import write_atomically
from .guess import holds_units

Array = NDArray[np.float64]
_MAX_BYTES = 256 * 1024 * 1024
_NAMES = frozenset(column.name for column in BENCH_COLUMNS)
_COMMA = re.compile(r"[+-]?(0?,\d+|\d+,(\d{1,2}|\d{4,}))([eE][+-]?\d+)?")
_POINT = re.compile(r"[+-]?(\d*\.\d+|\d+\.)([eE][+-]?\d+)?")


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
        return BenchSamples(**values, extra=extra, source=self.source, sha256=self.sha256,
                            rows=tuple(self.rows[i] for i in chosen) if self.rows else ())


def joined(parts: Sequence[BenchSamples]) -> BenchSamples:
    """Return bench samples of the same columns one after the other."""
    values: dict[str, Any] = {
        column.name: np.concatenate([getattr(part, column.name) for part in parts])
        for column in BENCH_COLUMNS if getattr(parts[0], column.name) is not None}
    extra = {name: tuple(chain.from_iterable(part.extra[name] for part in parts))
             for name in parts[0].extra}
    return BenchSamples(**values, extra=extra, source=parts[0].source)


def read_bench(path: str | os.PathLike[str]) -> BenchSamples:
    """Read bench samples from CSV (columns: see `BenchSamples`; the first four are required).

    Separated by commas, semicolons or tabs; UTF-8, or else Windows-1252.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a column is missing or
            doubled, or a value is not a number or outside its range; file, row and field are named.
    """
    values, extra, cells = read_columns(path, REQUIRED_COLUMNS)
    return BenchSamples(**values, extra=extra, source=cells.source, sha256=cells.sha256,
                        rows=tuple(cells.rows))


def write_bench(path: str | os.PathLike[str], samples: BenchSamples) -> None:
    """Write bench samples as CSV, whole or not at all; `read_bench` gives the same values."""
    columns = {column.name: map(repr, values.tolist()) for column in BENCH_COLUMNS
               if (values := getattr(samples, column.name)) is not None}
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*columns, *samples.extra])
    writer.writerows(zip(*columns.values(), *samples.extra.values(), strict=True))
    write_atomically(Path(path), buffer.getvalue())


class Cells(NamedTuple):
    """What a file holds, as text.

    Attributes:
        columns: one cell per sample, by column name.
        rows: line of each sample in the file, from 1.
        separator: of the columns.
        source, sha256: of the file.
    """

    columns: dict[str, list[str]]
    rows: list[int]
    separator: str
    source: str
    sha256: str

    def numbers(self, name: str, optional: bool = False) -> Array:
        """Return the numbers of a column; an `InputError` names the row of what is none."""
        values = np.empty(len(self.rows))
        for i, cell in enumerate(self.columns[name]):
            try:
                values[i] = float(cell.replace("_", "?"))  # Python reads 2_99 as 299
            except ValueError:
                cure = ": fill it in, or leave the column out" if optional and not cell else ""
                raise InputError(f"{self.source}: row {self.rows[i]}: "
                                 f"{no_number(name, cell)}{cure}") from None
        return values

    def require_range(self, values: Array, limits: Range) -> None:
        """Raise an `InputError` that names the row of the first value outside its range."""
        outside = np.flatnonzero(~limits.contains(values))
        if len(outside):
            raise InputError(f"{self.source}: row {self.rows[outside[0]]}: "
                             f"{limits.complaint(values[outside[0]])}")


def read_columns(
    path: str | os.PathLike[str], required: Sequence[str]
) -> tuple[dict[str, Any], dict[str, tuple[str, ...]], Cells]:
    """Read the columns of a bench file; the names of known ones may have capitals and spaces.

    Returns:
        Those that hmcvt knows, by name, shape (n,) each; the others, as text; the cells.

    Raises:
        InputError: as `read_cells`; or a column stands there twice or a value is no number or
            outside its range.
    """
    cells = decimal_points(
        read_cells(path, required, lambda header: list(map(column_name, header))), _NAMES)
    first = [cells.columns[name][0] for name in required]
    if holds_units(first):
        raise InputError(f"{cells.source}: row {cells.rows[0]}: {', '.join(first)} are no numbers; "
                         f"remove a row of units ({required[1]} is in rad/s, {required[2]} in N m)")
    known = {}
    for column in BENCH_COLUMNS:
        if column.name in cells.columns:
            known[column.name] = cells.numbers(column.name, column.name not in REQUIRED_COLUMNS)
            cells.require_range(known[column.name], column)
    extra = {name: tuple(column) for name, column in cells.columns.items() if name not in known}
    return known, extra, cells


def read_cells(
    path: str | os.PathLike[str], required: Sequence[str],
    names_of: Callable[[list[str]], list[str]],
) -> Cells:
    """Read a CSV file with a header, separated by commas, semicolons or tabs.

    Text is UTF-8, or else Windows-1252. Lines above the header that begin with # are left out.

    Args:
        path: of the file.
        required: columns that must be there.
        names_of: gives the names of the columns from the cells of the header.

    Raises:
        InputError: the file is missing, empty, too large or not CSV, a required column is
            missing or a column doubled.
    """
    text, sha256 = file_text(Path(path))
    line = next((line for line in io.StringIO(text) if line.strip() and line[0] != "#"), "")
    separator = max(",;\t", key=line.count)  # what stands there most, first a comma
    rows = split(text, separator, str(path))
    # Above the header only: below it a cell may well begin like that.
    top = next((i for i, row in enumerate(rows, 1) if any(row) and row[0][:1] != "#"), None)
    if top is None:
        needs = f"; needs columns {', '.join(required)}" if required else ""
        raise InputError(f"{path}: is empty{needs}")
    header = names_of(rows[top - 1])
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{path}: row {top}: column {name!r} stands there twice")
    missing = [name for name in required if name not in header]
    if missing:
        raise InputError(f"{path}: row {top}: column {', '.join(missing)} is missing; "
                         f"there is {', '.join(header)} (`hmcvt import` takes other names)")
    body, broken = below(rows, top, len(header), str(path))
    for number, told in broken.items():
        raise InputError(f"{path}: row {number}: {told}")
    columns = {name: [row[i] for _, row in body] for i, name in enumerate(header)}
    return Cells(columns, [number for number, _ in body], separator, str(Path(path)), sha256)


def split(text: str, separator: str, source: str) -> list[list[str]]:
    """Return the cells of every line of CSV, without blanks around them."""
    try:
        return [[cell.strip() for cell in row]
                for row in csv.reader(io.StringIO(text), delimiter=separator, strict=True)]
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None


def below(
    rows: Sequence[list[str]], top: int, width: int, source: str
) -> tuple[list[tuple[int, list[str]]], dict[int, str]]:
    """Rows below a header in row `top`, by number, and what is wrong with those of another width.

    Raises:
        InputError: there are none.
    """
    body, broken = [], {}
    for number, row in enumerate(rows[top:], top + 1):
        while len(row) > width and not row[-1]:
            row = row[:-1]  # separators at the end of a line
        if len(row) == width and any(row):
            body.append((number, row))
        elif any(row):
            broken[number] = (f"{len(row)} fields, the header has {width} (decimal comma, other "
                              "separator, a comment, or lines above the header?)")
    if not body and not broken:
        raise InputError(f"{source}: holds a header but no samples")
    return body, broken


def file_bytes(path: Path) -> tuple[bytes, str]:
    """Return what a file holds and its SHA-256; `InputError` where that cannot be."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a bench log")
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return raw, hashlib.sha256(raw).hexdigest()


def file_text(path: Path) -> tuple[str, str]:
    """Return the text of a file and its SHA-256; `InputError` where that cannot be."""
    raw, sha256 = file_bytes(path)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in raw:
            raise InputError(f"{path}: not UTF-8 text at byte {error.start}: save it as "
                             "'CSV UTF-8'") from None
        text = raw.decode("cp1252", "replace")
    if "\n" not in text:
        text = text.replace("\r", "\n")  # line ends of old programs
    return text, sha256


def commas_are_points(cells: Sequence[str]) -> bool:
    """Whether nothing but decimal commas can be meant.

    That is where no number has a point, and some comma cannot set thousands apart: 0,643 or 78,54.
    """
    return any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))


def decimal_points(cells: Cells, names: Collection[str]) -> Cells:
    """Turn decimal commas into points, where commas do not part the columns.

    Args:
        cells: of a file.
        names: of the columns that hold numbers.
    """
    numbers = {name: column for name, column in cells.columns.items() if name in names}
    if cells.separator == "," or not commas_are_points([*chain(*numbers.values())]):
        return cells
    return cells._replace(columns=cells.columns | {
        name: [cell.replace(",", ".") for cell in column] for name, column in numbers.items()})


def column_name(cell: str) -> str:
    """Return the name of a column that hmcvt knows also where it is spelled another way."""
    plain = re.sub("[ -]+", "_", cell.strip().lower())
    return plain if plain in _NAMES else cell.strip()


def no_number(name: str, cell: str) -> str:
    """Say what is wrong with a cell of a column that holds no number."""
    cure = ": write a decimal point, and nothing between thousands" if "," in cell else ""
    return f"{name} {f'{cell!r} is not a number' if cell else 'is empty'}{cure}"
