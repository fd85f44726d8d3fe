# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An estimate of a machine that is not as identified: cold oil, wear, working hydraulics."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.errors import InputError
from hmcvt_core.physics.effects.hydraulic import OilTemperature, walther_log_viscosity
from hmcvt_core.physics.effects.mechanical import FanDrive, ViscousBearingDrag
from hmcvt_core.transmission.parameters import HydraulicParameters
from hmcvt_tools.estimation import EstimateSettings
from hmcvt_tools.estimation.condition import moves, outside_identified
from hmcvt_tools.estimation.log import _condition_notes, _oil_notes
from hmcvt_tools.estimation.solving import StageSolver

SPEED = np.full(40, 150.0)
OUTPUT = np.linspace(60.0, 200.0, 40)
TORQUE = np.full(40, 250.0)


@pytest.fixture(scope="module")
def identified():
    samples = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    return hmcvt.identify(samples.select(np.arange(24))).model


@pytest.fixture(scope="module")
def solved(identified):
    return StageSolver(identified).solve(SPEED, OUTPUT, TORQUE)


def load_of(model, leakage, dampings):
    """Return the load of a machine whose parameters are multiplied."""
    values = model.parameters
    changed = HydraulicParameters(
        leakage * values.leakage,
        dampings * values.motor_damping,
        dampings * values.pump_damping,
    )
    changed = replace(model, parameters=changed)
    return StageSolver(changed).solve(SPEED, OUTPUT, TORQUE).load_torque


def test_cold_oil_moves_the_load_to_that_of_the_cold_machine(identified, solved):
    settings = EstimateSettings(oil_temperature=60.0)
    cold = np.full(40, 40.0)
    change = walther_log_viscosity(np.array(40.0)) - walther_log_viscosity(
        np.array(60.0)
    )
    truth = load_of(identified, np.exp(-change), np.exp(change))
    moved = moves(identified, solved, cold, settings)
    known = np.isfinite(truth) & np.isfinite(solved.load_torque)
    assert known.sum() > 20
    before = np.abs(solved.load_torque - truth)[known]
    after = np.abs(solved.load_torque + moved.load - truth)[known]
    assert after.mean() < 0.4 * before.mean()
    assert (after <= 1.645 * np.abs(moved.oil_deviation[known]) + 1.0).mean() > 0.8


@pytest.mark.parametrize("leakage", [1.0, 1.5, 2.0])
def test_wear_in_use_covers_up_to_twice_the_leakage(identified, solved, leakage):
    moved = moves(identified, solved, None, EstimateSettings())
    truth = load_of(identified, leakage, 1.0)
    known = np.isfinite(truth) & np.isfinite(solved.load_torque)
    missed = np.abs(solved.load_torque + moved.load - truth)[known]
    assert (missed <= 1.645 * np.abs(moved.wear_deviation[known]) + 0.5).mean() > 0.8


def test_nothing_moves_a_machine_as_identified(identified, solved):
    settings = EstimateSettings(wear=0.0)
    assert not np.any(moves(identified, solved, np.full(40, 20.0), settings))


def test_leakage_within_its_error_keeps_a_stage_in_reach(identified):
    """A stage that less leakage brings within full stroke may be the one engaged."""
    speed, torque = np.full(60, 150.0), np.full(60, 450.0)
    output = np.linspace(60.0, 260.0, 60)
    solver = StageSolver(identified)
    sharp = replace(
        identified,
        standard_errors={n: 1e-3 * e for n, e in identified.standard_errors.items()},
    )
    wide = solver.solve(speed, output, torque)
    narrow = StageSolver(sharp).solve(speed, output, torque)
    answered = np.isfinite(wide.load_torque)
    more = answered & np.isnan(narrow.load_torque)
    assert (
        0 < more.sum() < 10 and not (np.isfinite(narrow.load_torque) & ~answered).any()
    )
    assert (np.abs(wide.displacement_ratio[more]) == 1.0).all()


def test_seconds_outside_count_from_five_degrees():
    outside = outside_identified(
        np.array([54.0, 56.0, 64.0, 66.0, np.nan]), (60.0, 60.0)
    )
    assert outside.tolist() == [True, False, False, True, False]


@pytest.mark.parametrize("text", ["6kW", "6..0kW", "-1..6kW", "0..6 hp"])
def test_a_range_of_hydraulics_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "drive.log").write_text("")
    done = run("estimate", tmp_path / "drive.log", f"--hydraulics={text}")
    assert done.code == 2
    assert "hydraulics" in done.err


def test_drags_follow_the_oil_of_the_log(identified):
    """Every row of the log has the load of a machine that is solved at its temperature."""
    model = replace(
        identified, effects=(ViscousBearingDrag(torque=8.0), FanDrive(torque=15.0))
    )
    oil = np.where(np.arange(40) % 2, 20.0, 80.0)
    oil[::5] = np.nan
    solver = StageSolver(model)
    mixed = solver.solve(SPEED, OUTPUT, TORQUE, oil)
    without = solver.solve(SPEED, OUTPUT, TORQUE)
    for temperature in (20.0, 80.0, np.nan):
        rows = np.isclose(oil, temperature, equal_nan=True)
        if np.isnan(temperature):
            assert np.array_equal(
                mixed.load_torque[rows], without.load_torque[rows], equal_nan=True
            )
            continue
        answered = rows & np.isfinite(mixed.load_torque)
        assert answered.sum() > 8
        torque = mixed.load_torque[answered] + model.power_loss(
            mixed.displacement_ratio[answered],
            150.0,
            mixed.load_torque[answered],
            temperature,
        ) / (150.0)
        assert torque == pytest.approx(TORQUE[answered], abs=0.1)
    cold = np.isclose(oil, 20.0)
    apart = np.abs(mixed.load_torque - without.load_torque)[cold]
    assert np.nanmedian(apart) > 5.0


def test_oil_does_not_act_twice(identified, solved):
    model = replace(identified, effects=(OilTemperature(1.0),))
    settings = EstimateSettings(oil_temperature=60.0, wear=0.0)
    assert not np.any(moves(model, solved, np.full(40, 20.0), settings))


def test_drags_with_the_oil_are_noted(identified):
    drags = (ViscousBearingDrag(torque=5.0), FanDrive(torque=5.0))
    model = replace(identified, effects=drags)
    assert _oil_notes(model, has_temperature=False) == [
        "effect bearing_drag is taken at 60 deg C",
        "effect fan_drive is off",
    ]
    assert _oil_notes(model, has_temperature=True) == [
        "effect bearing_drag follows the oil temperature of the log",
        "effect fan_drive follows the oil temperature of the log",
    ]
    warm = replace(identified, effects=(OilTemperature(1.0),))
    assert not _oil_notes(warm, has_temperature=False)


def test_oil_temperature_of_settings_is_checked():
    with pytest.raises(InputError, match="oil_temperature"):
        EstimateSettings(oil_temperature=350.0)


@pytest.mark.parametrize("temperature", [None, 60.0])
@pytest.mark.parametrize("has_signal", [True, False])
def test_notes_name_what_is_not_in_the_intervals(identified, has_signal, temperature):
    model = replace(identified, standard_errors={}, correlation=None)
    selection = SimpleNamespace(quantities={"oil_temperature"} if has_signal else set())
    settings = EstimateSettings(oil_temperature=temperature)
    notes = _condition_notes(selection, model, settings, 0.0)
    for missing in ("cold or hot oil is", "wear is", "working hydraulics are"):
        assert any(f"{missing} not in the intervals" in note for note in notes)


@pytest.mark.parametrize("wrong", ["1", True, math.nan, -1.0])
def test_numbers_of_settings_are_checked(wrong):
    with pytest.raises(InputError, match="wear = "):
        EstimateSettings(wear=wrong)


@pytest.mark.parametrize("wrong", ["0.08", True, math.nan, 8.0])
def test_a_friction_in_python_is_a_fraction(identified, tmp_path, wrong):
    path = tmp_path / "drive.log"
    path.write_text("(1.0) can0 0CF00400#FF7D7D000FFFFFFF\n")
    with pytest.raises(InputError, match="friction_torque"):
        hmcvt_tools.estimate(path, identified, friction_torque=wrong)
