# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Missions: energy, strategies, demands that cannot be met."""

import re
from dataclasses import replace

import pytest

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.mission import CYCLES, Drive, Limits, Planned, Vehicle, read_cycle
from hmcvt_tools.mission.knowledge import Worth, in_transmission
from mission.drive_lines import COARSE, DRIVE, cycle, limits_hold

SPEED_AND_POWER = "output_speed,output_power"


def planned(demand, drive=DRIVE):
    return Planned.of(drive, demand, with_bound=False, speed_step=COARSE)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name != "sowing"))
        for name in CYCLES
    ],
)
def test_energy_is_closed_and_no_limit_broken(name):
    plan = Planned.of(DRIVE, read_cycle(name, DRIVE.vehicle), speed_step=COARSE)
    mission = plan.mission("causal")
    energy = mission.energy
    assert abs(energy.imbalance) < 1e-9
    assert energy.lost == pytest.approx(
        energy.engine - sum(energy.useful.values()), rel=1e-9
    )
    assert not mission.unmet and not mission.broken and not mission.replaced
    assert limits_hold(mission, DRIVE.vehicle.limits)
    assert 0.0 <= mission.above_bound + 1e-12 <= 0.005


@pytest.mark.parametrize(
    ("expected", "needed", "words"),
    [
        (10.0, 9.97, "needs 0.04 l/h less than the model says (-0.030 kg/h, -0.3 %)."),
        (10.0, 10.3, "needs 0.36 l/h more than the model says (+0.300 kg/h, +3.0 %)."),
    ],
)
def test_what_knowledge_is_worth_in_words(expected, needed, words):
    worth = Worth("ploughing", expected, needed, needed, unmet=0, steps=100)
    first, second = worth.report().splitlines()
    assert first == f"On the cycle ploughing the tractor {words}"
    assert "need 0.000 l/h" in second


def test_engine_line_needs_more_on_ploughing():
    plan = planned(read_cycle("ploughing", DRIVE.vehicle))
    line = plan.mission("engine_line")
    assert plan.mission("causal").fuel < 0.97 * line.fuel


def test_a_demand_beyond_the_engine_is_named_and_the_rest_goes_on(tmp_path):
    rows = [(60, 40e3), (60, 140e3), (60, 40e3)]
    mission = planned(cycle(tmp_path, SPEED_AND_POWER, *rows)).mission("causal")
    assert [item.time for item in mission.unmet] == [1.0]
    assert mission.unmet[0].reason.startswith("beyond the engine: 1.")
    assert mission.stage[0] == mission.stage[2] != mission.stage[1] == ""
    assert mission.fuel_rate[1] == 0.0 < mission.fuel_rate[2]
    assert abs(mission.energy.imbalance) < 1e-9


def test_a_cycle_that_ends_in_reverse(tmp_path):
    rows = [(20, 5e3), (8, 3e3), (0, 0), (-6, 3e3), (-9, 3e3), (-90, 3e3)]
    mission = planned(cycle(tmp_path, SPEED_AND_POWER, *rows)).mission("causal")
    assert mission.stage[2:5] == ["neutral", "H0", "H0"]
    assert mission.displacement_ratio[4] < 0.0
    (unmet,) = mission.unmet
    assert (unmet.time, unmet.reason) == (5.0, "no stage holds -90.0 rad/s in reverse")


def test_other_demands_that_cannot_be_met(tmp_path):
    rows = [(60, 40e3), (0, 9e3), ("", 1e3), (900, 1e3)]
    mission = planned(cycle(tmp_path, SPEED_AND_POWER, *rows)).mission("causal")
    reasons = [item.reason for item in mission.unmet]
    assert reasons[0] == "asks for 9.0 kW at standstill"
    assert reasons[1] == "the demand is not stated"
    assert reasons[2].startswith("no stage holds 1.0 kW at 900.0 rad/s")


def test_a_jump_that_the_machine_cannot_follow_is_named(tmp_path):
    rows = [(150, 9e3), (150, 9e3), (260, 40e3), (260, 40e3)]
    limits = Limits(displacement_rate=0.05, engine_speed_rate=20.0 * RPM)
    drive = Drive(DRIVE.model.stages["HM4"], DRIVE.engine, Vehicle(limits=limits))
    plan = Planned.of(drive, cycle(tmp_path, SPEED_AND_POWER, *rows), speed_step=COARSE)
    mission = plan.mission("causal")
    (broken,) = mission.broken
    assert broken.time == 2.0
    assert re.search(
        r"in stage HM4, the engine speed would have to change by \d+ r/min, of at most 20$",
        broken.reason,
    ) or re.search(
        r"the displacement ratio would have to change by \d\.\d+, of at most 0\.05",
        broken.reason,
    )
    assert [item.time for item in plan.best().broken] == [2.0]


def test_a_change_of_direction_at_speed_is_named(tmp_path):
    rows = [(60, 9e3), (60, 9e3), (-60, 9e3), (-60, 9e3)]
    remark = cycle(tmp_path, SPEED_AND_POWER, *rows).remarks[0]
    assert "without standstill at 1 steps, first at 2 s, from 60.0 to -60.0" in remark
    through_zero = [(60, 9e3), (1, 0), (-1, 0), (-60, 9e3)]
    remarks = cycle(tmp_path, SPEED_AND_POWER, *through_zero).remarks
    assert not any("direction" in remark for remark in remarks)


def test_the_loss_of_a_stage_change_is_counted(tmp_path):
    demand = cycle(tmp_path, SPEED_AND_POWER, *[(30 + 20 * i, 25e3) for i in range(8)])
    limits = Limits(stage_change_loss=50e3)
    drive = DRIVE._replace(vehicle=Vehicle(limits=limits))
    mission = planned(demand, drive).mission("causal")
    assert mission.shifts > 0
    assert mission.energy.losses["stage_changes"] == pytest.approx(
        50e3 * mission.shifts
    )
    assert abs(mission.energy.imbalance) < 1e-9


def test_hysteresis_keeps_the_stage():
    demand = read_cycle("ploughing", DRIVE.vehicle)
    assert planned(demand).mission("causal").shifts < 12


STRATEGY = """
import math

def choose(now):
    if now.time == 1.0:
        return "HM9", 150.0
    if now.time == 2.0:
        raise RuntimeError("no idea")
    if now.time == 3.0:
        return "HM2", math.nan
    if now.time == 4.0:
        return "HM4", 90.0
    if now.time == 5.0:
        return None
    return "HM2", 160.0
"""


def test_a_strategy_of_a_user_that_asks_for_what_is_impossible(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(STRATEGY)
    demand = cycle(tmp_path, SPEED_AND_POWER, *[(60, 40e3)] * 7)
    mission = planned(demand).mission(str(path))
    named = {item.time: item.reason for item in mission.replaced}
    assert list(named) == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert "stage 'HM9' is not known" in named[1.0]
    assert "RuntimeError: no idea" in named[2.0]
    assert "not finite" in named[3.0]
    assert "asked for HM4 at 859 r/min, which is not possible; taken: " in named[4.0]
    assert "is not a stage and an engine speed" in named[5.0]
    assert mission.stage[6] == "HM2"
    assert mission.engine_speed[6] == pytest.approx(160.0, abs=COARSE)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("best", None, "strategy 'best' is not known; there is causal"),
        ("a.py", "x = 1", "holds no function choose"),
        ("a.py", "1 / 0", "cannot be loaded: ZeroDivisionError"),
        ("b.py", None, "cannot be loaded: FileNotFoundError"),
    ],
)
def test_strategies_that_cannot_be_used(tmp_path, name, text, complaint):
    if text is not None:
        (tmp_path / name).write_text(text)
    if name.endswith(".py"):
        name = str(tmp_path / name)
    demand = cycle(tmp_path, SPEED_AND_POWER, (60, 40e3), (60, 40e3))
    with pytest.raises(hmcvt.InputError, match=complaint):
        planned(demand).mission(name)


def test_a_step_too_short_for_a_stage_change_is_refused(tmp_path):
    demand = cycle(tmp_path, SPEED_AND_POWER, (60, 4e4), (60, 4e4), step=0.2)
    with pytest.raises(hmcvt.InputError, match=r"takes 0\.3 s, which is longer than"):
        planned(demand).mission("causal")


def test_a_strategy_with_another_model_drives_the_tractor_as_it_is(tmp_path):
    demand = read_cycle("sowing", DRIVE.vehicle)
    leaky = replace(
        DRIVE.model,
        parameters=replace(
            DRIVE.model.parameters, leakage=3.0 * DRIVE.model.parameters.leakage
        ),
    )
    known = planned(demand)
    wrong = planned(demand, DRIVE._replace(model=leaky)).points
    mission = known.mission("causal", wrong)
    assert mission.fuel > known.mission("causal").fuel
    assert abs(mission.energy.imbalance) < 1e-9
    assert not mission.broken


def test_a_diagnosed_stage_brings_its_gear_loss_to_the_whole_transmission():
    bench = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    diagnosed = replace(bench, stage=bench.stage.with_gear_loss(-0.0005))
    tractor = in_transmission(diagnosed, DRIVE.model)
    assert list(tractor.stages) == list(DRIVE.model.stages)
    point = {"displacement_ratio": 0.3, "engine_speed": 150.0, "load_torque": 200.0}
    assert tractor.stages["HM4"].efficiency(**point) == pytest.approx(
        diagnosed.efficiency(**point), rel=1e-12
    )
    for name, model in tractor.stages.items():
        listed = DRIVE.model.stages[name].stage.gear_pairs
        for pair, as_listed in zip(model.stage.gear_pairs, listed, strict=True):
            assert pair.efficiency == pytest.approx(1.0005 * as_listed.efficiency)


def test_a_stage_with_other_gear_losses_is_not_of_the_transmission():
    stage = DRIVE.model.stages["HM4"].stage
    worn = replace(stage.output.gear_pairs[0], efficiency=0.9)
    output = replace(stage.output, gear_pairs=(worn, *stage.output.gear_pairs[1:]))
    model = replace(DRIVE.model.stages["HM4"], stage=replace(stage, output=output))
    assert in_transmission(model, DRIVE.model) is model
