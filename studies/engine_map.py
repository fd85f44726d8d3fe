# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Build the second shipped engine from published coefficients.

    python -m studies.engine_map [FOLDER]

The extended Willans line of CO2MPAS, the simulator by which the European Union certifies the fuel
of cars, relates mean effective pressures by the mean piston speed c:

    pme = (a + b c + c2 c^2) pmf + a2 pmf^2 + l + l2 c^2

pme is that of the crankshaft, pmf that of the fuel. Since a2 is negative and the factor of pmf has
a maximum over c, the fuel per energy has its minimum inside the map: a bowl. Form and coefficients:
Fontaras et al., Applied Energy 226 (2018) 784-796; values for compression ignition as JRC publishes
them with CO2MPAS (EUPL 1.2). They are means of engines of cars, and hold for a tractor's diesel by
mean effective pressure and mean piston speed alone.
"""

import sys
from pathlib import Path

import numpy as np

from hmcvt_core.files import data_path
from hmcvt_core.files.table import csv_text
from hmcvt_core.model.engine import load_engine
from hmcvt_core.transmission.ranges import RPM, Array

FUEL_FACTOR = (0.391197, 0.028604, -0.00196)
"""a, b and c2 for compression ignition [-, s/m, s2/m2]."""
FUEL_SQUARE = -0.0012
"""a2 [1/bar]."""
LOSS = (-1.55291, -0.0076)
"""l and l2 [bar, bar s2/m2]."""
HEATING_VALUE = 43.1e6
"""Of diesel in CO2MPAS [J/kg]."""
DISPLACEMENT = 4.5e-3
"""Of a four-cylinder of this power [m3]; assumed."""
STROKE = 0.132
"""Of its pistons [m]; assumed."""
BAR = 1e5
SPEEDS = np.append(np.arange(800.0, 2301.0, 50.0), 2350.0)
"""Of the table [r/min]."""
LOADS = np.linspace(0.0, 1.0, 21)
"""Torque of the table by that of full load [-]."""
NAME = "engine_bowl.csv"
COMMENT = (
    "# Bowl-shaped fuel map: extended Willans line of CO2MPAS (Fontaras et al., Applied\n"
    "# Energy 226 (2018) 784-796) with its published coefficients for compression ignition\n"
    "# (JRC, EUPL 1.2), for 4.5 l and a stroke of 132 mm, both assumed; full load as in\n"
    "# engine.csv. Made by `python -m studies.engine_map`.\n"
)


def fuel_rate(engine_speed: Array, torque: Array) -> Array:
    """Return the fuel of the extended Willans line [kg/s].

    Args:
        engine_speed: [rad/s].
        torque: [N m]; broadcasts.
    """
    piston_speed = STROKE * engine_speed / np.pi
    work = 4.0 * np.pi * torque / DISPLACEMENT / BAR
    constant, linear, square = FUEL_FACTOR
    factor = constant + linear * piston_speed + square * piston_speed**2
    lost = LOSS[0] + LOSS[1] * piston_speed**2
    # The smaller root: with a2 -> 0 it is that of a straight line.
    root = np.sqrt(factor**2 - 4.0 * FUEL_SQUARE * (lost - work))
    fuel_pressure = (factor - root) / (-2.0 * FUEL_SQUARE) * BAR
    power = fuel_pressure * DISPLACEMENT * engine_speed / (4.0 * np.pi)
    return np.asarray(power / HEATING_VALUE)


def columns() -> dict[str, list[str]]:
    """Return the columns of the table."""
    shipped = load_engine(data_path("params/engine.yaml"))
    speed = np.repeat(SPEEDS * RPM, len(LOADS))
    torque = np.tile(LOADS, len(SPEEDS)) * shipped.full_load_torque(speed)
    return {
        "engine_speed [r/min]": [f"{value:g}" for value in speed / RPM],
        "torque [N m]": [f"{value:.12g}" for value in torque],
        "fuel [kg/h]": [f"{value:.7g}" for value in 3600.0 * fuel_rate(speed, torque)],
    }


def main() -> None:
    """Write the table."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "params")
    (folder / NAME).write_text(COMMENT + csv_text(columns()), encoding="utf-8")


if __name__ == "__main__":
    main()
