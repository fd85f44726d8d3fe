# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples, and columns of numbers from CSV; every error names file, row and field."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..transmission.ranges import (
    BENCH_COLUMNS,
    REQUIRED_COLUMNS,
    Array,
    OperatingPoints,
)
from .atomic import write_atomically
from .checks import is_dataframe, is_path, require_path, wrong_type
from .table import Table, csv_text, read_plain

_NAMES = tuple(column.name for column in BENCH_COLUMNS)

if TYPE_CHECKING:

    @dataclass(frozen=True, eq=False)
    class _Columns:
        """The columns of the registry as type checkers see them; a test compares both."""

        displacement_ratio: Array
        engine_speed: Array
        load_torque: Array
        efficiency: Array
        output_speed: Array | None = None
        oil_temperature: Array | None = None
        efficiency_std: Array | None = None
        stamp: Array | None = None
        pressure: Array | None = None
        charge_pressure: Array | None = None

else:
    _Columns = make_dataclass(
        "_Columns",
        [
            (name, Array) if name in REQUIRED_COLUMNS else (name, Array | None, None)
            for name in _NAMES
        ],
        namespace={"__module__": __name__},
        frozen=True,
        eq=False,
    )
_NUMERIC = re.compile(r"[+-]?([.,]?\d|nan|inf)", re.IGNORECASE)
"""Beginning of a cell that is meant as a number; a row without any holds units or names."""


@dataclass(frozen=True, eq=False)
class BenchSamples(_Columns):
    """Bench samples: one array of shape (n,) for each column of a bench file.

    The columns are attributes: `displacement_ratio`, `engine_speed`, `load_torque`, `efficiency`,
    and those that bench files may lack, such as `output_speed`, which are None then.
    `hmcvt_core.interface.BENCH_COLUMNS` and docs/files.md list them with units and ranges.

    Attributes:
        extra: the other columns, as text; `stage` names the stage engaged.
        source: where they come from, for messages and provenance.
        sha256: of the file they were read from; empty when not from a file.
        rows: of that file, from 1, one for each sample; empty when not known.

    Raises:
        InputError: a value is outside its range or lengths differ; the column is named.
    """

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
        for name, texts in self.extra.items():
            if len(texts) != len(self):
                raise InputError(
                    f"{self.source}: column {name} has {len(texts)} texts, "
                    f"displacement_ratio has {len(self)} values"
                )

    def __len__(self) -> int:
        return len(self.displacement_ratio)

    @classmethod
    def from_dataframe(cls, frame: Any, source: str = "samples") -> BenchSamples:
        """Return the rows of a pandas DataFrame as bench samples.

        Args:
            frame: its columns are named as those of a bench file, in SI units; others are kept as
                text, a missing one as the empty text.
            source: where they come from, for messages and provenance.

        Raises:
            InputError: `frame` is no DataFrame, a column is missing or doubled, or a value is
                outside its range.
        """
        if not is_dataframe(frame):
            hint = "read it by read_bench(path)" if is_path(frame) else ""
            raise wrong_type("frame", "a pandas DataFrame", frame, hint)
        values: dict[str, Any] = {}
        extra: dict[str, tuple[str, ...]] = {}
        for position, label in enumerate(frame.columns):
            name = column_name(str(label))
            if name in values or name in extra:
                raise InputError(f"{source}: column {name} occurs twice")
            column = frame.iloc[:, position]
            if name in _NAMES:
                values[name] = column.to_numpy()
            else:
                # A missing text is an empty cell, as in a file.
                texts = column.astype(object).where(column.notna(), "")
                extra[name] = tuple(str(cell) for cell in texts)
        for name in REQUIRED_COLUMNS:
            if name not in values:
                raise InputError(
                    f"{source}: column {name} is missing; there is "
                    f"{', '.join(map(str, frame.columns))}"
                )
        return cls(**values, extra=extra, source=source)

    def to_dataframe(self) -> Any:
        """Return the samples as a pandas DataFrame, one column each.

        Raises:
            InputError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise InputError(
                'a DataFrame needs pandas: pip install ".[tools]"'
            ) from None
        return pandas.DataFrame(
            {**self.columns, **{name: list(text) for name, text in self.extra.items()}}
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the samples as plain data for JSON, one list for each column."""
        numbers = {name: values.tolist() for name, values in self.columns.items()}
        return {**numbers, **{name: list(text) for name, text in self.extra.items()}}

    @property
    def stage(self) -> NDArray[np.str_] | None:
        """Name of the stage engaged at each sample, shape (n,); None without such a column."""
        names = self.extra.get("stage")
        return None if names is None else np.array(names)

    @property
    def points(self) -> OperatingPoints:
        """Operating points of the samples, with their stages where a column names them."""
        return OperatingPoints(
            self.displacement_ratio,
            self.engine_speed,
            self.load_torque,
            self.oil_temperature,
            self.stage,
        )

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of numbers that the samples have, by name."""
        columns = {}
        for column in BENCH_COLUMNS:
            values = getattr(self, column.name)
            if values is not None:
                columns[column.name] = values
        return columns

    def label(self, index: int) -> str:
        """Return how a sample is named in messages: by its row in the file, or its number."""
        if self.rows:
            return f"row {self.rows[index]}"
        return f"sample {index + 1}"

    def select(self, index: ArrayLike) -> BenchSamples:
        """Return the samples at an index array or mask, in that order.

        Raises:
            InputError: a mask is of another length, or an index does not exist.
        """
        try:
            chosen = np.arange(len(self))[np.asarray(index)]
        except IndexError as error:
            raise InputError(
                f"{self.source}: select of {len(self)} samples: {error}"
            ) from None
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
    hint = ""
    if is_dataframe(path):
        hint = "convert it by BenchSamples.from_dataframe(frame)"
    require_path(path, "path", "a bench file", hint)
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
    if not isinstance(samples, BenchSamples):
        raise wrong_type(
            "samples", "BenchSamples", samples, "the order is (path, samples)"
        )
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
    if any(first) and not any(map(_NUMERIC.match, first)):
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
