# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Readings of a rig whose faults are known, in the form of `zema_pump.csv`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPEED = 1450.0 * 2.0 * np.pi / 60.0
"""Speed of a pump whose rig reads none [rad/s]: four poles at 50 Hz with slip."""
FLOW_WITHOUT_PRESSURE = 8.65 / 6e4
"""Flow of that pump without pressure [m3/s], by which its displacement is reckoned."""
FAULT_COLUMN = "pump_leak"
"""Column that makes a table one of a rig; 0 is sound."""
SOUND_COOLER = 100.0
"""Setting of a sound cooler [%]."""
BAR = 1e5
LITRE_PER_MINUTE = 1.0 / 6e4


@dataclass(frozen=True)
class Setting:
    """Windows of a rig that run alike.

    Attributes:
        cooler: set efficiency [%].
        accumulator: pressure of its gas [bar].
    """

    cooler: float
    accumulator: float

    def __str__(self) -> str:
        return f"cooler {self.cooler:g} %, accumulator {self.accumulator:g} bar"


@dataclass(frozen=True, eq=False)
class Rig:
    """Steady windows of one pump on a rig; every array has shape (n,).

    Attributes:
        name: of the file.
        pressure: [Pa].
        flow: delivered [m3/s].
        oil_temperature: [deg C].
        fault: severity of the leak; 0 is sound.
        cooler: set efficiency [%].
        accumulator: pressure of its gas [bar].
    """

    name: str
    pressure: Array
    flow: Array
    oil_temperature: Array
    fault: Array
    cooler: Array
    accumulator: Array

    @property
    def sound(self) -> Mask:
        """Windows of the sound pump."""
        return np.asarray(self.fault == 0.0)

    def settings(self) -> list[Setting]:
        """Return the settings of cooler and accumulator, in order."""
        pairs = zip(self.cooler.tolist(), self.accumulator.tolist(), strict=True)
        return [Setting(*pair) for pair in sorted(set(pairs), reverse=True)]

    def at(self, setting: Setting) -> Mask:
        """Return the windows of a setting."""
        same_cooler = self.cooler == setting.cooler
        return np.asarray(same_cooler & (self.accumulator == setting.accumulator))

    def samples(self, mask: Mask, with_temperature: bool = True) -> UnitSamples:
        """Return windows as samples of a pump that runs at one speed.

        Args:
            mask: windows to take.
            with_temperature: whether the oil temperature counts as read.
        """
        n = int(mask.sum())
        displacement = FLOW_WITHOUT_PRESSURE / SPEED
        temperature = self.oil_temperature[mask] if with_temperature else None
        return UnitSamples(
            kind="pump",
            displacement=displacement,
            displacement_ratio=np.ones(n),
            speed=np.full(n, SPEED),
            pressure=self.pressure[mask],
            flow_loss=FLOW_WITHOUT_PRESSURE - self.flow[mask],
            torque_loss=None,
            oil_temperature=temperature,
            source=self.name,
        )


def is_rig(path: Path) -> bool:
    """Return whether a table is one of a rig with known faults."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            return FAULT_COLUMN in line.split(",")
    return False


def read_rig(path: Path) -> Rig:
    """Read the windows of a rig.

    Raises:
        InputError: a column is missing.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))

    def column(name: str) -> Array:
        if not rows or name not in rows[0]:
            raise InputError(f"{path}: column {name} is missing")
        return np.array([float(row[name]) for row in rows])

    return Rig(
        name=path.name,
        pressure=BAR * column("pressure_bar"),
        flow=LITRE_PER_MINUTE * column("flow_L/min"),
        oil_temperature=column("oil_temperature"),
        fault=column(FAULT_COLUMN),
        cooler=column("cooler"),
        accumulator=column("accumulator"),
    )
