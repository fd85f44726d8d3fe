# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The fuel map between the speeds of its table."""

import numpy as np

from hmcvt_core.files import data_path
from hmcvt_core.model.engine import load_engine

HEATING = 42.7e6
"""Of diesel [J/kg], and the Willans line from which `params/engine.csv` is made."""
INNER_EFFICIENCY = 0.43


def willans(speed, torque):
    """Return the fuel of the line that the shipped map is made from [kg/s]."""
    friction = 60.0 + 6e-4 * speed**2
    return (torque + friction) * speed / (INNER_EFFICIENCY * HEATING)


def test_fuel_between_speeds_is_that_of_the_willans_line():
    engine = load_engine(data_path("params/engine.yaml"))
    rng = np.random.default_rng(3)
    speed = rng.uniform(engine.speed[0], engine.speed[-1], 2000)
    torque = engine.full_load_torque(speed) * rng.uniform(0.2, 1.0, 2000)
    relative = engine.fuel_rate(speed, torque) / willans(speed, torque) - 1.0
    assert np.abs(relative).max() < 2e-3


def test_fuel_at_the_rows_of_the_table_is_that_of_the_table():
    engine = load_engine(data_path("params/engine.yaml"))
    torque = engine.load * engine.full_load[:, None]
    fuel = engine.fuel_rate(engine.speed[:, None], torque)
    assert np.allclose(fuel, engine.fuel, rtol=1e-12)
