# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The folder of one case, as every method reads it; imports nothing of hmcvt."""

import csv
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

FloatArray = npt.NDArray[np.float64]

EFFECTS_FILE = Path(__file__).parent / "effects.yaml"
NUISANCE = "nuisance:"
"""Prefix of the columns that are no effect: base parameters, and errors of the meters."""
RIG = "rig"
"""Beginning of the names of measured cases."""
LEFT_COLUMNS = ("channel", "row", "base", "linear")


@dataclass(frozen=True)
class Table:
    """A table of the served model; rows in the order of `channel` and `row`.

    Attributes:
        channel: `efficiency` [-], `output_speed` [rad/s] or `pressure` [Pa], shape (m,).
        row: number of the test or point from 0, shape (m,).
        base: readings of the base model refitted to the efficiency, shape (m,): the gap is
            efficiency - base.
        linear: readings of the base model refitted to all channels, meter errors adapting, at
            which the columns are taken, shape (m,).
        names: of the other columns.
        columns: what each changes in the reading, shape (m, k).
    """

    channel: npt.NDArray[np.str_]
    row: npt.NDArray[np.int_]
    base: FloatArray
    linear: FloatArray
    names: tuple[str, ...]
    columns: FloatArray


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        folder: of its files.
    """

    folder: Path

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.folder.name

    @cached_property
    def card(self) -> dict[str, Any]:
        """Machine, meters, licence, and what is known of the truth."""
        text = (self.folder / "card.yaml").read_text(encoding="utf-8")
        return dict(yaml.safe_load(text))

    @cached_property
    def tests(self) -> dict[str, Any]:
        """Columns of bench.csv: arrays of numbers, or tuples of text."""
        return read_columns(self.folder / "bench.csv")

    @cached_property
    def points(self) -> dict[str, Any]:
        """Columns of points.csv."""
        return read_columns(self.folder / "points.csv")

    @cached_property
    def model_at_tests(self) -> Table:
        """The served model at the tests, in every channel."""
        return read_table(self.folder / "model_tests.csv")

    @cached_property
    def model_at_points(self) -> Table:
        """The served model at the points; efficiency alone."""
        return read_table(self.folder / "model_points.csv")


def read_columns(path: Path) -> dict[str, Any]:
    """Read a CSV file by column; those that are not numbers stay text."""
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    columns: dict[str, Any] = {}
    for name, values in zip(header, zip(*rows, strict=True), strict=True):
        try:
            columns[name] = np.array([float(value) for value in values])
        except ValueError:
            columns[name] = values
    return columns


def read_table(path: Path) -> Table:
    """Read a table of the served model."""
    columns = read_columns(path)
    names = tuple(name for name in columns if name not in LEFT_COLUMNS)
    return Table(
        channel=np.array(columns["channel"]),
        row=columns["row"].astype(int),
        base=columns["base"],
        linear=columns["linear"],
        names=names,
        columns=np.stack([columns[name] for name in names], axis=1),
    )


def write_columns(path: Path, columns: dict[str, Any]) -> None:
    """Write a CSV file; numbers with nine digits, so that machines agree on them."""
    texts = []
    for values in columns.values():
        texts.append([v if isinstance(v, str) else f"{v:.9g}" for v in values])
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*texts, strict=True))


def effects() -> dict[str, dict[str, Any]]:
    """Return the effects that an answer may name: part, and forms that may be negative."""
    data = yaml.safe_load(EFFECTS_FILE.read_text(encoding="utf-8"))
    return dict(data["effects"])
