# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Reduce the public recordings of the condition-monitoring rig to steady windows.

    python -m studies.real.reduce FOLDER_OR_ZIP --out rig.csv

Reads UCI data set 447, "Condition monitoring of hydraulic systems": `PS1.txt` (pressure [bar], 100
Hz), `FS1.txt` (flow [L/min], 10 Hz), `EPS1.txt` (motor power [W], 100 Hz), `TS1.txt` (oil
temperature [deg C], 1 Hz) and `profile.txt` (states of each cycle of 60 s). Every state of pump,
cooler, accumulator and valve is kept, unless the cycle is marked as not settled.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.table import csv_text

Array = NDArray[np.float64]

SECONDS = 60
"""Length of a cycle."""
SENSORS = {
    "pressure_bar": "PS1.txt",
    "flow_L/min": "FS1.txt",
    "motor_power_W": "EPS1.txt",
    "oil_temperature": "TS1.txt",
}
"""File of each column."""
PROFILE = "profile.txt"
STATES = ("cooler", "valve", "pump_leak", "accumulator", "unsettled")
"""Columns of the profile; the last is 1 where conditions were not reached."""
STEADY_RANGE = 0.5
"""Largest range of the means over a second within a window [bar].

About three times the scatter of such means at constant load in the shipped windows.
"""
WINDOW = 5
"""Length of a window [s]: that of the shipped windows, whose means are of 5 to 6 s."""


def read_matrix(source: Path, name: str) -> Array:
    """Read a file of the data set from a folder or an archive, a row a cycle.

    Raises:
        InputError: the file is missing, or is no table of numbers.
    """
    try:
        if source.is_dir():
            text = (source / name).read_text(encoding="utf-8")
        else:
            with zipfile.ZipFile(source) as archive:
                text = archive.read(name).decode()
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{source}: {name} cannot be read: {error}") from error
    try:
        return np.loadtxt(io.StringIO(text), ndmin=2)
    except ValueError as error:
        raise InputError(f"{source}: {name}: {error}") from error


def by_second(matrix: Array, name: str) -> Array:
    """Return means over each second, shape (cycles, 60)."""
    cycles, count = matrix.shape
    if count % SECONDS:
        raise InputError(f"{name}: {count} columns are no multiple of {SECONDS} s")
    return np.asarray(matrix.reshape(cycles, SECONDS, -1).mean(axis=2))


def steady_windows(pressure: Array) -> list[slice]:
    """Return the seconds of each steady window of a cycle, in the order of time.

    Args:
        pressure: means over each second [bar], shape (60,).
    """
    windows = []
    start = 0
    while start + WINDOW <= len(pressure):
        seconds = slice(start, start + WINDOW)
        if np.ptp(pressure[seconds]) <= STEADY_RANGE:
            windows.append(seconds)
            start += WINDOW
        else:
            start += 1
    return windows


def reduced(source: Path) -> dict[str, list[float]]:
    """Return the steady windows of all settled cycles, by column."""
    profile = read_matrix(source, PROFILE)
    if profile.shape[1] != len(STATES):
        raise InputError(
            f"{source}: {PROFILE} has {profile.shape[1]} columns, not {len(STATES)}"
        )
    sensors = {
        name: by_second(read_matrix(source, file), file)
        for name, file in SENSORS.items()
    }
    for name, values in sensors.items():
        if len(values) != len(profile):
            raise InputError(
                f"{source}: {SENSORS[name]} has {len(values)} cycles, {PROFILE} has "
                f"{len(profile)}"
            )
    columns: dict[str, list[float]] = {}
    for row in _rows(profile, sensors):
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    return columns


def _rows(profile: Array, sensors: Mapping[str, Array]) -> Iterator[dict[str, float]]:
    for cycle, values in enumerate(profile):
        states = dict(zip(STATES, values.tolist(), strict=True))
        if states.pop("unsettled"):
            continue
        windows = steady_windows(sensors["pressure_bar"][cycle])
        for window, seconds in enumerate(windows):
            row = {"cycle": float(cycle), "window": float(window), **states}
            for name, means in sensors.items():
                row[name] = float(np.round(means[cycle, seconds].mean(), 3))
            yield row


@click.command("reduce")
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), required=True)
def command(source: Path, out: Path) -> None:
    """Write the steady windows of SOURCE, a folder or the archive of the data set."""
    columns = reduced(source)
    texts = {name: [f"{value:g}" for value in row] for name, row in columns.items()}
    write_atomically(out, csv_text(texts))
    click.echo(f"{len(columns['cycle'])} windows written to {out}")


if __name__ == "__main__":
    command()
