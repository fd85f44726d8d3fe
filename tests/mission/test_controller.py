# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The causal strategy for a running tractor."""

import math

import pytest

from hmcvt_tools.mission.controller import Controller
from mission.drive_lines import DRIVE

CONTROLLER = Controller(DRIVE)


def test_it_keeps_the_limits_and_settles():
    limits = DRIVE.vehicle.limits
    state = ("HM2", 190.0, 0.9)
    speeds = []
    for _ in range(12):
        command = CONTROLLER.choose(60.0, 40e3, *state)
        assert abs(command.engine_speed - state[1]) <= 1.001 * limits.engine_speed_rate
        time = 1.0
        if command.stage != state[0]:
            time -= limits.stage_change_time
        change = abs(command.displacement_ratio - state[2])
        assert change <= 1.001 * limits.displacement_rate * time
        model = DRIVE.model.stages[command.stage]
        load = 40e3 / command.engine_speed
        reached = model.output_speed(
            command.displacement_ratio, command.engine_speed, load
        )
        assert reached == pytest.approx(60.0, rel=1e-6)
        state = tuple(command)
        speeds.append(command.engine_speed)
    assert len(set(speeds[-5:])) == 1
    best = DRIVE.model.optimal_drive(
        60.0, 40e3, engine=DRIVE.engine, torque_reserve=0.1
    )
    load = (
        40e3
        / state[1]
        / DRIVE.model.stages[state[0]].efficiency(state[2], state[1], 40e3 / state[1])
    )
    assert DRIVE.engine.fuel_rate(state[1], load) < 1.005 * best.fuel_rate


def test_it_does_not_hunt_where_the_demand_fluctuates():
    best = []
    state = tuple(CONTROLLER.choose(85.0, 30e3, "HM3", 150.0, 0.3))
    for i in range(20):
        power = 30e3 * (1.0 + 0.03 * (-1) ** i)
        state = tuple(CONTROLLER.choose(85.0, power, *state))
        best.append(state[0])
    assert len(set(best[5:])) == 1


def test_without_an_answer():
    now = ("HM3", 150.0, 0.3)
    assert CONTROLLER.choose(85.0, 300e3, *now) is None
    assert CONTROLLER.choose(0.0, 0.0, *now) is None
    assert CONTROLLER.choose(math.nan, 30e3, *now) is None
