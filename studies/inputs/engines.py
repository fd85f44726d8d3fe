# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A random engine map: a Willans line at each speed, under many names and units."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .drawing import RPM, Column, Spelling, choice, headed, texts, write_table

NAMES: dict[str, tuple[str, ...]] = {
    "speed": (
        *("engine_speed", "Engine Speed", "engine speed", "speed", "n", "RPM"),
        *("Drehzahl", "Motordrehzahl", "r\u00e9gime moteur", "Engine speed actual"),
    ),
    "torque": (
        *("torque", "Torque", "engine torque", "M", "Drehmoment", "couple moteur"),
        *("brake torque", "T", "Motordrehmoment"),
    ),
    "fuel": (
        *("fuel", "Fuel", "fuel rate", "fuel_rate", "fuel consumption", "Verbrauch"),
        *("Kraftstoffverbrauch", "fuel mass flow", "FC"),
    ),
}
UNITS: dict[str, tuple[Spelling, ...]] = {
    "speed": (
        Spelling("r/min", RPM),
        Spelling("rpm", RPM),
        Spelling("1/min", RPM),
        Spelling("min-1", RPM),
        Spelling("rad/s", 1.0),
        Spelling("1/s", 1.0, is_open=True),
        Spelling("", RPM, is_open=True),
    ),
    "torque": (
        Spelling("N m", 1.0),
        Spelling("Nm", 1.0),
        Spelling("kNm", 1e3),
        Spelling("lb ft", 1.3558179483),
        Spelling("", 1.3558179483, is_open=True),
    ),
    "fuel": (
        Spelling("kg/h", 1.0 / 3600.0),
        Spelling("g/s", 1e-3),
        Spelling("g/h", 1e-3 / 3600.0),
        Spelling("g/kWh", np.nan),
        Spelling("lb/h", 0.45359237 / 3600.0),
        Spelling("mg/s", 1e-6),
        Spelling("L/h", 0.832 / 3600.0, is_open=True),
    ),
}
FOREIGN = (
    *("oil temperature [degC]", "remark", "intake pressure [kPa]", "NOx [ppm]"),
    *("load [%]", "fuel temperature [degC]", "torque limit [Nm]", "id"),
    *("friction torque [Nm]", "power [kW]", "speed setpoint [rpm]"),
)


@dataclass(frozen=True)
class RandomEngine:
    """An engine map and its truth.

    Attributes:
        path: of the file.
        speed: of its rows [rad/s], shape (n,).
        torque: of its rows [N m], shape (n,).
        fuel: of its rows [kg/s], shape (n,).
        is_open: whether a unit is open.
        features: what was drawn.
    """

    path: Path
    speed: Any
    torque: Any
    fuel: Any
    is_open: bool
    features: dict[str, Any] = field(default_factory=dict)


def random_engine(rng: np.random.Generator, folder: Path) -> RandomEngine:
    """Write a random engine map.

    Args:
        rng: of all choices.
        folder: for the file.
    """
    speeds = np.sort(rng.choice(np.arange(800.0, 2300.0, 100.0), 6, replace=False))
    loads = np.linspace(0.1, 1.0, 7)
    peak = rng.uniform(400.0, 900.0)
    speed = np.repeat(speeds * RPM, len(loads))
    full = peak * (1.0 - 0.3 * ((speed / RPM - 1500.0) / 1000.0) ** 2)
    torque = full * np.tile(loads, len(speeds))
    friction = 60.0 + 6e-4 * speed**2
    fuel = (torque + friction) * speed / (0.43 * 42.8e6)
    if rng.random() < 0.3:
        # A bench holds its speed within some r/min.
        speed = speed * (1.0 + 5e-4 * rng.uniform(-1.0, 1.0, len(speed)))
    values = {"speed": speed, "torque": torque, "fuel": fuel}
    columns = []
    units = {}
    for quantity, column in values.items():
        unit = choice(rng, UNITS[quantity])
        units[quantity] = unit
        written = column / unit.size
        if unit.text == "g/kWh":
            written = fuel / (speed * torque) * 3.6e9
        name = choice(rng, NAMES[quantity])
        columns.append(Column(headed(rng, name, unit.text), texts(written, 7)))
    for header in rng.choice(FOREIGN, int(rng.integers(0, 3)), replace=False).tolist():
        cells = texts(rng.uniform(10.0, 90.0, len(speed)), 2)
        columns.append(Column(header, cells))
    path = folder / "engine.csv"
    features = dict(write_table(rng, path, columns))
    features["headers"] = [column.header for column in columns]
    is_open = any(unit.is_open for unit in units.values())
    return RandomEngine(path, speed, torque, fuel, is_open, features)
