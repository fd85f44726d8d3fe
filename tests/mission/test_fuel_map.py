# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The fuel map between the speeds of its table."""

import numpy as np
import pytest

from hmcvt_core.files import data_path
from hmcvt_core.model.engine import Engine, load_engine
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.mission import Drive, Planned, read_cycle
from mission.drive_lines import DRIVE, beginning
from studies import engine_map

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
    assert np.abs(relative).max() < 1e-3


def test_fuel_at_the_rows_of_the_table_is_that_of_the_table():
    engine = load_engine(data_path("params/engine.yaml"))
    torque = engine.load * engine.full_load[:, None]
    fuel = engine.fuel_rate(engine.speed[:, None], torque)
    assert np.allclose(fuel, engine.fuel, rtol=1e-12)


FORMULAS = {"engine": willans, "engine_bowl": engine_map.fuel_rate}
"""What the shipped maps are made from."""


def fine(engine, formula):
    """Return an engine of the same full load whose table is ten times finer."""
    speed = np.arange(800.0, 2350.1, 10.0) * RPM
    full_load = engine.full_load_torque(speed)
    load = np.linspace(0.0, 1.0, 101)
    torque = full_load[:, None] * load
    return Engine(speed, full_load, load, formula(speed[:, None] + 0.0 * load, torque))


@pytest.mark.parametrize("name", FORMULAS)
@pytest.mark.parametrize(
    "work",
    [
        pytest.param("ploughing", marks=pytest.mark.long),
        "sowing",
        pytest.param("loader", marks=pytest.mark.long),
    ],
)
def test_bound_is_that_of_a_fine_map_within_its_stated_error(name, work):
    engine = load_engine(data_path(f"params/{name}.yaml"))
    demand = beginning(read_cycle(work, DRIVE.vehicle), 300)
    bounds = []
    for table in (engine, fine(engine, FORMULAS[name])):
        drive = Drive(DRIVE.model, table, DRIVE.vehicle)
        bounds.append(Planned.of(drive, demand, speed_step=40.0 * RPM).bound)
    shipped, exact = bounds
    miss = abs(shipped.fuel - exact.fuel)
    assert miss < 5e-4 * exact.fuel
    assert miss < shipped.map_error < 0.01 * exact.fuel
    assert shipped.error == shipped.grid_error + shipped.map_error


def test_second_engine_has_its_least_fuel_inside_the_map():
    engine = load_engine(data_path("params/engine_bowl.yaml"))
    row, column = np.unravel_index(
        int(np.nanargmin(engine.specific_fuel)), engine.specific_fuel.shape
    )
    assert 0 < row < len(engine.speed) - 1
    assert 0 < column < len(engine.load) - 1
    first = load_engine(data_path("params/engine.yaml"))
    assert np.allclose(engine.full_load, first.full_load_torque(engine.speed))


def test_second_engine_is_made_by_its_study():
    engine = load_engine(data_path("params/engine_bowl.yaml"))
    torque = engine.load * engine.full_load[:, None]
    made = engine_map.fuel_rate(engine.speed[:, None] + 0.0 * torque, torque)
    assert np.allclose(engine.fuel, made, rtol=1e-6)


def test_table_of_two_rows_states_no_interpolation_error():
    speed = np.array([100.0, 200.0])
    engine = Engine(
        speed, np.array([500.0, 500.0]), np.array([0.0, 1.0]), np.ones((2, 2))
    )
    assert engine.interpolation_error(150.0, 250.0) == 0.0
