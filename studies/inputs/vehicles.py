# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A random vehicle file: keys with several units, some of them wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .drawing import RPM, Spelling, choice

UNITS: dict[str, tuple[Spelling, ...]] = {
    "mass": (Spelling("kg", 1.0), Spelling("t", 1e3), Spelling("lb", 0.45359237)),
    "tyre_radius": (Spelling("m", 1.0), Spelling("mm", 1e-3), Spelling("in", 0.0254)),
    "final_drive": (Spelling("-", 1.0),),
    "final_drive_efficiency": (Spelling("-", 1.0), Spelling("%", 0.01)),
    "rolling_resistance": (Spelling("-", 1.0), Spelling("%", 0.01)),
    "slip": (Spelling("-", 1.0), Spelling("%", 0.01)),
    "pto_efficiency": (Spelling("-", 1.0), Spelling("%", 0.01)),
    "pto_speed_low": (Spelling("r/min", RPM), Spelling("rpm", RPM)),
    "pto_speed_high": (Spelling("r/min", RPM), Spelling("rad/s", 1.0)),
}
RANGES = {
    "mass": (3000.0, 15_000.0),
    "tyre_radius": (0.5, 1.1),
    "final_drive": (10.0, 40.0),
    "final_drive_efficiency": (0.9, 0.99),
    "rolling_resistance": (0.02, 0.1),
    "slip": (0.01, 0.2),
    "pto_efficiency": (0.9, 0.99),
    "pto_speed_low": (1500.0 * RPM, 1900.0 * RPM),
    "pto_speed_high": (1950.0 * RPM, 2200.0 * RPM),
}
MISSPELT = ("Mass", "tire_radius", "tyre_radius_m", "slipp", "final_drive_ratio")
"""Keys that begin like a known one and are not; to be refused."""


@dataclass(frozen=True)
class RandomVehicle:
    """A vehicle file and its truth.

    Attributes:
        path: of the file.
        values: SI values by key.
        misspelt: key that is not known; `""` for none.
        features: units that were drawn.
    """

    path: Path
    values: dict[str, float]
    misspelt: str
    features: dict[str, Any] = field(default_factory=dict)


def random_vehicle(rng: np.random.Generator, folder: Path) -> RandomVehicle:
    """Write a random vehicle file.

    Args:
        rng: of all choices.
        folder: for the file.
    """
    lines = ["schema: hmcvt-vehicle/1", "name: drawn"]
    values = {}
    units = {}
    for key, (low, high) in RANGES.items():
        if rng.random() < 0.3:
            continue
        values[key] = float(rng.uniform(low, high))
        unit = choice(rng, UNITS[key])
        units[key] = unit.text
        number = values[key] / unit.size
        if unit.text == UNITS[key][0].text and rng.random() < 0.3:
            lines.append(f"{key}: {number:.9g}")
        else:
            lines.append(f'{key}: {{value: {number:.9g}, unit: "{unit.text}"}}')
    misspelt = ""
    if rng.random() < 0.2:
        misspelt = str(rng.choice(MISSPELT))
        lines.append(f"{misspelt}: 1.0")
    path = folder / "vehicle.yaml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return RandomVehicle(path, values, misspelt, units)
