# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Dynamic programming against brute force, its limits and the error of its grid."""

import itertools
import math

import numpy as np
import pytest

from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.mission import Planned, read_cycle
from hmcvt_tools.mission.bound import least_fuel_path
from hmcvt_tools.mission.points import speed_grid, working_points
from mission.drive_lines import DRIVE, beginning, cycle, limits_hold

STAGES = tuple(DRIVE.model.stages)


def points_of(demand, distance):
    grid = speed_grid(
        STAGES, DRIVE.engine, DRIVE.vehicle.limits, demand.step, distance * RPM
    )
    return working_points(DRIVE, demand, grid)


def brute_force(demand, points):
    """Least fuel of all ways through the working points, tried one by one."""
    limits = DRIVE.vehicle.limits
    choices = []
    for k in range(len(demand)):
        choices.append(list(zip(*np.nonzero(np.isfinite(points.fuel[k])), strict=True)))
    least = math.inf
    tried = 0
    for way in itertools.product(*choices):
        tried += 1
        fuel = points.fuel[(0, *way[0])]
        for k in range(1, len(way)):
            before = (k - 1, *way[k - 1])
            now = (k, *way[k])
            moving = points.grid.neutral not in (before[1], now[1])
            changed = moving and before[1] != now[1]
            speed = abs(points.engine_speed[now] - points.engine_speed[before])
            stroke = abs(points.stroke[now] - points.stroke[before])
            time = demand.step - (limits.stage_change_time if changed else 0.0)
            if speed > limits.engine_speed_rate * demand.step * (1 + 1e-9):
                break
            if moving and stroke > limits.displacement_rate * time * (1 + 1e-9):
                break
            fuel += points.fuel_changing[now] if changed else points.fuel[now]
        else:
            least = min(least, fuel)
    return least * demand.step, tried


@pytest.mark.parametrize(
    "rows",
    [
        [(60, 40e3), (75, 50e3), (90, 60e3), (80, 30e3)],
        [(0, 0), (8, 4e3), (22, 12e3), (30, 20e3)],
        [(30, 40e3), (0, 0), (-9, 4e3)],
        [(150, 60e3), (130, 20e3), (110, 5e3), (100, 70e3)],
    ],
)
def test_agrees_with_brute_force(tmp_path, rows):
    demand = cycle(tmp_path, "output_speed,output_power", *rows)
    points = points_of(demand, 150.0)
    least, tried = brute_force(demand, points)
    assert 100 < tried < 300_000
    path = least_fuel_path(DRIVE, demand, points)
    assert path.fuel == pytest.approx(least, rel=1e-12)


def test_refinement_halves_the_stated_error():
    errors = []
    for name in ("ploughing", "transport", "sowing"):
        demand = beginning(read_cycle(name, DRIVE.vehicle), 300)
        fuels = []
        for distance in (80.0, 40.0, 20.0):
            fuels.append(
                least_fuel_path(DRIVE, demand, points_of(demand, distance)).fuel
            )
        errors.append(np.abs(np.diff(fuels)))
    coarse, fine = np.array(errors).T
    assert (fine <= 0.5 * coarse).all(), errors


def test_the_way_keeps_the_limits_and_no_strategy_needs_less():
    planned = Planned.of(
        DRIVE, beginning(read_cycle("loader", DRIVE.vehicle), 400), True, 20.0 * RPM
    )
    best = planned.best()
    assert best.fuel == pytest.approx(planned.bound.fuel, rel=1e-12)
    assert limits_hold(best, DRIVE.vehicle.limits)
    for name in ("causal", "least_fuel", "engine_line", "fixed_speed"):
        mission = planned.mission(name)
        assert not mission.broken
        assert limits_hold(mission, DRIVE.vehicle.limits)
        assert mission.above_bound > -1e-12


def test_points_hold_the_demand(tmp_path):
    """Against the model itself, which takes the displacement ratio and gives the speed."""
    demand = cycle(
        tmp_path,
        "output_speed,output_power,pto_power,auxiliary_power",
        (60, 40e3, 0, 2e3),
        (120, 60e3, 5e3, 0),
    )
    points = points_of(demand, 50.0)
    for k, i, j in zip(*np.nonzero(np.isfinite(points.fuel)), strict=True):
        stage = DRIVE.model.stages[points.grid.stages[i]]
        speed = float(points.engine_speed[k, i, j])
        load = float(demand.output_power[k]) / speed
        stroke = float(points.stroke[k, i, j])
        assert stage.output_speed(stroke, speed, load) == pytest.approx(
            demand.output_speed[k], rel=1e-8
        )
        shafts = demand.pto_power[k] / 0.95 + demand.auxiliary_power[k]
        torque = load / stage.efficiency(stroke, speed, load) + shafts / speed
        assert points.engine_torque[k, i, j] == pytest.approx(torque, rel=1e-8)
        assert points.fuel[k, i, j] == pytest.approx(
            DRIVE.engine.fuel_rate(speed, torque)
        )
        assert torque <= 0.9 * DRIVE.engine.full_load_torque(speed) * (1 + 1e-6)
    (works,) = np.nonzero(np.isfinite(points.fuel[1]).any(axis=0))
    allowed = points.engine_speed[1, :, works] / RPM
    assert allowed.min() > 1849.9 and allowed.max() < 2050.1
