# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A random work cycle, and what is demanded of the transmission at each second."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .drawing import (
    GRAVITY,
    RPM,
    Column,
    Spelling,
    choice,
    headed,
    texts,
    write_table,
)

NAMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "Time", "TIME", "t", "Zeit", "seconds", "elapsed time"),
    "ground_speed": (
        *("ground_speed", "Ground Speed", "ground speed", "GROUND_SPEED", "v"),
        *("vehicle speed", "Fahrgeschwindigkeit", "speed", "Vehicle_Speed"),
        *("actual speed", "v_ist", "vitesse", "velocidad", "GPS speed", "Speed"),
    ),
    "output_speed": ("output_speed", "Output Speed", "output speed", "n_output"),
    "output_power": ("output_power", "Output Power", "P_out", "OUTPUT_POWER"),
    "drawbar_force": (
        *("drawbar_force", "Drawbar Force", "drawbar force", "draft force"),
        *("Zugkraft", "drawbar pull", "draught", "F_drawbar"),
    ),
    "pto_power": (
        *("pto_power", "PTO Power", "PTO_Power", "PTO power", "P_pto", "PTO-Power"),
        *("Zapfwellenleistung", "ptoPower", "PTO"),
    ),
    "auxiliary_power": (
        *("auxiliary_power", "Auxiliary Power", "aux power", "AUXILIARY_POWER"),
        *("hydraulic power", "P_aux", "auxiliaries"),
    ),
    "slope": ("slope", "Slope", "grade", "Steigung", "road gradient", "road slope"),
    "slip": ("slip", "Slip", "wheel slip", "Schlupf"),
    "rolling_resistance": ("rolling_resistance", "Rolling Resistance", "rolling coeff"),
    "lowest_engine_speed": ("lowest_engine_speed", "Lowest Engine Speed"),
}
UNITS: dict[str, tuple[Spelling, ...]] = {
    "time": (Spelling("s", 1.0), Spelling("s", 1.0), Spelling("min", 60.0)),
    "ground_speed": (
        Spelling("km/h", 1.0 / 3.6),
        Spelling("kph", 1.0 / 3.6),
        Spelling("m/s", 1.0),
        Spelling("mph", 0.44704),
        Spelling("", 1.0 / 3.6, is_open=True),
    ),
    "output_speed": (
        Spelling("rpm", RPM),
        Spelling("1/min", RPM),
        Spelling("rad/s", 1.0),
        Spelling("1/s", 1.0, is_open=True),
    ),
    "output_power": (Spelling("kW", 1e3), Spelling("W", 1.0), Spelling("hp", 745.6999)),
    "drawbar_force": (
        Spelling("kN", 1e3),
        Spelling("N", 1.0),
        Spelling("daN", 10.0),
        Spelling("lbf", 4.448222),
        Spelling("", 1e3, is_open=True),
    ),
    "pto_power": (
        Spelling("kW", 1e3),
        Spelling("W", 1.0),
        Spelling("PS", 735.49875),
        Spelling("", 1e3, is_open=True),
    ),
    "auxiliary_power": (
        Spelling("kW", 1e3),
        Spelling("W", 1.0),
        Spelling("", 1e3, is_open=True),
    ),
    "slope": (
        Spelling("%", 0.01),
        Spelling("-", 1.0),
        Spelling("\u2030", 1e-3),
        Spelling("deg", np.nan),
        Spelling("", 0.01, is_open=True),
    ),
    "slip": (Spelling("%", 0.01), Spelling("-", 1.0)),
    "rolling_resistance": (Spelling("-", 1.0), Spelling("%", 0.01)),
    "lowest_engine_speed": (Spelling("rpm", RPM), Spelling("1/min", RPM)),
}
FOREIGN = (
    *("altitude [m]", "wind speed [m/s]", "remark", "gear", "fuel rate [kg/h]"),
    *("coolant temperature [degC]", "latitude", "ambient temperature [degC]"),
    *("PTO speed [rpm]", "engine speed [rpm]", "fan power [kW]", "id"),
    *("pto torque [Nm]", "auxiliary speed [rpm]", "output torque [Nm]"),
)
"""Columns that state no demand, or one that the reader has to name."""
MASS = 7500.0
RADIUS = 0.85
FINAL_DRIVE = 21.0
ROLLING = 0.06
SLIP = 0.08
FINAL_EFFICIENCY = 0.97


@dataclass(frozen=True)
class RandomCycle:
    """A cycle file and its truth.

    Attributes:
        path: of the file.
        demands: SI values by quantity at each second, shape (n,) each.
        headers: cell of the header by quantity.
        foreign: cells of columns that state no demand.
        open_quantities: quantities whose unit nobody can know.
        features: what was drawn.
    """

    path: Path
    demands: dict[str, Any]
    headers: dict[str, str]
    foreign: tuple[str, ...]
    open_quantities: frozenset[str]
    features: dict[str, Any] = field(default_factory=dict)

    @property
    def output(self) -> tuple[Any, Any]:
        """Speed [rad/s] and power [W] that are demanded at the output shaft, shape (n,) each."""
        values = self.demands
        count = len(values["time"])
        if "output_power" in values:
            return values["output_speed"], np.maximum(values["output_power"], 0.0)
        speed = values["ground_speed"]
        zero = np.zeros(count)
        slip = values.get("slip", zero + SLIP)
        rolling = values.get("rolling_resistance", zero + ROLLING)
        force = values.get("drawbar_force", zero) + rolling * MASS * GRAVITY
        power = force * np.abs(speed)
        power = power + MASS * GRAVITY * values.get("slope", zero) * speed
        power = power + np.diff(
            0.5 * MASS * speed**2, prepend=0.5 * MASS * speed[0] ** 2
        )
        driving = power / (1.0 - slip) / FINAL_EFFICIENCY
        turning = speed / (1.0 - slip) / RADIUS * FINAL_DRIVE
        return turning, np.where(power > 0.0, driving, 0.0)


def random_cycle(rng: np.random.Generator, folder: Path) -> RandomCycle:
    """Write a random cycle.

    Args:
        rng: of all choices.
        folder: for the file.
    """
    count = int(rng.integers(20, 60))
    at_ground = bool(rng.random() < 0.7)
    quantities = ["time"]
    if at_ground:
        quantities.append("ground_speed")
        if rng.random() < 0.7:
            quantities.append("drawbar_force")
        for name in ("slope", "slip", "rolling_resistance"):
            if rng.random() < 0.3:
                quantities.append(name)
    else:
        quantities += ["output_speed", "output_power"]
    for name in ("pto_power", "auxiliary_power", "lowest_engine_speed"):
        if rng.random() < 0.35:
            quantities.append(name)
    demands = _demands(rng, quantities, count)
    columns = []
    headers = {}
    unknown = set()
    for quantity in quantities:
        unit = choice(rng, UNITS[quantity])
        name = choice(rng, NAMES[quantity])
        headers[quantity] = headed(rng, name, unit.text)
        values = demands[quantity] / unit.size
        if unit.text == "deg":
            values = np.degrees(np.arctan(demands[quantity]))
        if unit.is_open:
            unknown.add(quantity)
        columns.append(Column(headers[quantity], texts(values, 8)))
    foreign = rng.choice(FOREIGN, int(rng.integers(0, 3)), replace=False).tolist()
    for header in foreign:
        columns.append(Column(header, texts(rng.uniform(1.0, 50.0, count), 2)))
    path = folder / "cycle.csv"
    features = write_table(rng, path, columns)
    open_quantities = frozenset(unknown)
    return RandomCycle(
        path, demands, headers, tuple(foreign), open_quantities, dict(features)
    )


def _demands(
    rng: np.random.Generator, quantities: list[str], count: int
) -> dict[str, Any]:
    """Return SI values at each second."""
    ranges = {
        "ground_speed": (1.0, 4.0),
        "output_speed": (50.0, 150.0),
        "output_power": (5e3, 6e4),
        "drawbar_force": (3e3, 2e4),
        "pto_power": (5e3, 4e4),
        "auxiliary_power": (1e3, 1e4),
        "slope": (-0.04, 0.08),
        "slip": (0.02, 0.15),
        "rolling_resistance": (0.03, 0.09),
        "lowest_engine_speed": (100.0, 180.0),
    }
    demands = {"time": np.arange(float(count))}
    for name in quantities:
        if name != "time":
            demands[name] = rng.uniform(*ranges[name], count)
    return demands
