# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Gear trains from YAML: the paper's (Table 1, eqs (5), (8)), a made-up one by hand, wrong ones."""

import copy
import csv
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import yaml
from hypothesis import given

import hmcvt_core as hmcvt
from hmcvt_core.physics import published
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_core.transmission.stage import speed_ratio, stages_to_mapping

from .strategies import stages

MADE_UP = """
schema: hmcvt-transmission/1
gear_pairs: {A: 2.0, B: 0.5, C: 4.0, D: 0.5}
gear_efficiency: {A: 0.9, B: 0.95, C: 0.9, D: 0.8}
planetary_rows: {k2: 3.0}
pump_motor:
  pump_displacement_cm3_per_rev: 30.0
  motor_displacement_cm3_per_rev: 60.0
  pump_friction: 0.01
  motor_friction: 0.02
stages:
  X1:
    planetary_row: k2
    mechanical: {gear_pairs: [A], member: ring}
    pump: {gear_pairs: [B]}
    motor: {gear_pairs: [C], member: sun, direction: -1}
    output: {gear_pairs: [D], member: carrier}
"""

# By hand, engine at 100 rad/s. Ring 100 / 2 = 50, pump 100 / 0.5 = 200, sun = -motor / 4.
# Eq. (4): carrier = (sun + 3 ring) / 4, so output = 2 carrier = 75 - motor / 8.
# 30 cm3 of the pump feed 60 cm3 of the motor: a tight motor turns 200 eps / 2.
V_MOTOR = 60e-6 / (2.0 * math.pi)
F_MOTOR = 0.05


def made_up_stage(tmp_path, text=MADE_UP):
    path = tmp_path / "transmission.yaml"
    path.write_text(text, encoding="utf-8")
    return hmcvt.load_stage(path)


def test_motor_that_drives_by_hand(tmp_path):
    """Stroke -0.5: the motor turns back, which here speeds the output up."""
    motor_speed = -40.0  # 10 rad/s short of the tight -50: leakage, chosen below
    output_speed = 75.0 + 5.0
    output_power = 8000.0  # so load torque 80 N m at the engine, 100 N m at the output
    carrier_torque = (
        output_power / 0.8 / (output_speed / 2.0)
    )  # pair D; 250 N m at 40 rad/s
    # The row in equilibrium, sun : ring : carrier = 1 : 3 : 4.
    sun_torque, ring_torque = carrier_torque / 4.0, carrier_torque * 3.0 / 4.0
    assert (sun_torque, ring_torque) == pytest.approx((62.5, 187.5))
    sun_power, ring_power = sun_torque * 10.0, ring_torque * 50.0
    assert sun_power + ring_power == pytest.approx(output_power / 0.8)
    motor_torque = sun_power / 0.9 / 40.0  # pair C
    pressure = (motor_torque + F_MOTOR * 40.0) / (
        0.98 * V_MOTOR
    )  # eq. (14), c_fm = 0.02
    leakage = 10.0 * V_MOTOR / pressure  # eq. (13)
    # Eq. (15): half the displacement, half the stroke, 1 % friction, f_p = 0.02 at 200 rad/s.
    pump_torque = pressure * V_MOTOR / 4.0 * 1.01 + 0.02 * 200.0
    engine_power = ring_power / 0.9 + pump_torque * 200.0 / 0.95  # pairs A and B

    model = hmcvt.EfficiencyModel(
        made_up_stage(tmp_path), hmcvt.HydraulicParameters(leakage, F_MOTOR, 0.02)
    )
    assert model.output_speed(-0.5, 100.0, 80.0) == pytest.approx(
        output_speed, rel=1e-12
    )
    assert model.efficiency(-0.5, 100.0, 80.0) == pytest.approx(
        8000.0 / engine_power, rel=1e-12
    )
    watts = model.breakdown(-0.5, 100.0, 80.0).losses
    assert watts["gear_pair_D"] == pytest.approx(output_power / 0.8 - output_power)
    assert watts["gear_pair_C"] == pytest.approx(sun_power / 0.9 - sun_power)
    assert watts["gear_pair_A"] == pytest.approx(ring_power / 0.9 - ring_power)
    assert watts["motor_damping"] == pytest.approx(F_MOTOR * motor_speed**2)
    assert watts["leakage"] == pytest.approx(pressure * 10.0 * V_MOTOR)
    assert watts["pump_damping"] == pytest.approx(0.02 * 200.0**2)


def test_published_formulas_follow_the_members(tmp_path):
    """Where the paths hold no ratio, e_H of (8) is the motor's share of a lossless row."""
    text = MADE_UP.replace(
        "{A: 2.0, B: 0.5, C: 4.0, D: 0.5}", "{A: 1.0, B: 0.5, C: 4.0, D: 1.0}"
    )
    stage = made_up_stage(tmp_path, text).with_gear_efficiency(1.0)
    # By hand at eps = -0.5: ring 100, motor -50, sun 12.5, carrier 312.5 / 4; the torque of the
    # sun is a quarter of the carrier's, so its share is 12.5 / 4 / (312.5 / 4) = 0.04.
    assert published.hydraulic_split_ratio(stage, np.array([-0.5]))[0] == pytest.approx(
        0.04
    )
    _, flow = BalanceSolver(stage, hmcvt.HydraulicParameters(1e-16, 0.0, 0.0)).flow(
        OperatingPoints(np.array([-0.5]), np.array([100.0]), np.array([50.0]))
    )
    share = flow.torques["motor"][0] * flow.state.motor_speed / flow.output_power
    assert share[0] == pytest.approx(0.04, rel=1e-6)


def test_which_stage_must_be_said_when_there_are_two(tmp_path):
    data = yaml.safe_load(MADE_UP)
    data["stages"]["X2"] = copy.deepcopy(data["stages"]["X1"])
    with pytest.raises(hmcvt.InputError, match="stages holds X1, X2: say which one"):
        hmcvt.Stage.from_mapping(data)
    assert hmcvt.Stage.from_mapping(data, "X2").name == "X2"
    with pytest.raises(
        hmcvt.InputError, match=r"stages\.X9 is missing; there is X1, X2"
    ):
        hmcvt.Stage.from_mapping(data, "X9")


@given(stages())
def test_mapping_round_trip(stage):
    again = hmcvt.Stage.from_mapping(stages_to_mapping([stage]))
    units, kept = again.pump_motor, stage.pump_motor
    # The displacement passes through cm3 per revolution, rounded to twelve digits.
    assert units.pump_displacement == pytest.approx(kept.pump_displacement, rel=1e-11)
    assert units.motor_displacement == pytest.approx(kept.motor_displacement, rel=1e-11)
    assert replace(again, pump_motor=kept) == replace(stage, name=again.name)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("A: 2.0", "A: 0.0", r"gear_pairs\.A = 0 is outside 0\.01 to 100"),
        ("A: 2.0", "A: two", r"gear_pairs\.A = 'two' is not a finite number"),
        ("A: 2.0", "A: .inf", r"gear_pairs\.A = inf is not a finite number"),
        ("A: 0.9", "A: 98", r"gear_efficiency\.A = 98 is outside 0\.5 to 1"),
        ("A: 2.0", "E: 2.0", r"gear_pairs\.A is missing; there is E, B, C, D"),
        ("[A]", "A", r"stages\.X1\.mechanical\.gear_pairs = 'A' is not a list"),
        ("[A]", "[[A]]", r"gear_pairs\.\['A'\] is not a name"),
        (
            "k2: 3.0",
            "k2: 0.5",
            r"planetary constant = 0\.5 is not allowed; allowed: more than 1",
        ),
        ("row: k2", "row: k7", r"planetary_rows\.k7 is missing; there is k2"),
        (
            "member: ring",
            "member: planet",
            r"stage X1: members = .*sun, ring and carrier, each once",
        ),
        (
            "direction: -1",
            "direction: 2",
            r"stages\.X1\.motor\.direction = 2 is not allowed",
        ),
        (
            "member: ring",
            "member: ring, direction: -1",
            r"more than 0; check the directions",
        ),
        (
            "motor_friction: 0.02",
            "motor_friction: 1",
            r"pump_motor: motor_friction = 1 is outside",
        ),
        (
            "rev: 30.0",
            "rev: 30000",
            r"pump_motor: pump_displacement = .* 1e-07 to 0\.001 m3/rad",
        ),
        ("pump: {", "pumpe: {", r"stages\.X1\.pump is missing"),
    ],
)
def test_wrong_field_is_named(tmp_path, old, new, message):
    assert old in MADE_UP
    with pytest.raises(hmcvt.InputError, match=message) as caught:
        made_up_stage(tmp_path, MADE_UP.replace(old, new, 1))
    assert str(caught.value).startswith(f"{tmp_path / 'transmission.yaml'}: ")


# Table 1, typed here a second time so that a typing error in either place shows.
TABLE_1 = {
    "i1": "1.439",
    "i2": "0.969",
    "i3": "1.484",
    "i4": "0.678",
    "i5": "1.96",
    "i6": "0.982",
    "i7": "3.52",
    "i8": "2.767",
    "i9": "0.794",
    "i10": "2.767",
    "i11": "0.823",
    "i12": "1.093",
    "k1": "2.56",
    "k2": "3.56",
}
STROKES = [-1.0, -0.73, 0.0, 0.73, 1.0]


def equation_5(displacement_ratio):
    """Eq. (5) in exact fractions."""
    i = {name: Fraction(value) for name, value in TABLE_1.items()}
    k, eps = i["k1"], Fraction(displacement_ratio)
    return float(
        ((1 + k) * i["i4"] * i["i5"] + eps * i["i2"] * i["i3"])
        / (k * i["i2"] * i["i3"] * i["i4"] * i["i5"] * i["i6"] * i["i11"])
    )


def test_table_1_stands_in_the_data_and_in_the_transmission_file():
    with hmcvt.data_path("data/table1.csv").open(encoding="utf-8") as file:
        assert {row["symbol"]: row["value"] for row in csv.DictReader(file)} == TABLE_1
    data = yaml.safe_load(
        hmcvt.data_path("params/transmission.yaml").read_text(encoding="utf-8")
    )
    assert (
        {f"i{name}": ratio for name, ratio in data["gear_pairs"].items()}
        | data["planetary_rows"]
    ) == {name: float(value) for name, value in TABLE_1.items()}


def test_speed_ratio_is_equation_5(hm4):
    found = speed_ratio(hm4, np.array(STROKES))
    np.testing.assert_allclose(
        found, [equation_5(str(eps)) for eps in STROKES], rtol=1e-14
    )
    # The digits of docs/theory.md
    np.testing.assert_allclose(
        found, [0.83286, 0.93107, 1.19658, 1.46209, 1.56029], atol=5e-6
    )
