# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Any simulator as a system: a function whose arguments switch effects on."""

import runpy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import hmcvt_core as hmcvt
from tests.cli.running import ROOT

SCRIPT = ROOT / "examples" / "electric_drive.py"


@cache
def drive():
    return runpy.run_path(str(SCRIPT))


def observed(**hidden):
    points, readings = drive()["campaign"](seed=1, **hidden)
    return hmcvt.observe_system(
        drive()["system"], {**points, **readings}, noise=drive()["CHANNEL_NOISE"]
    )


def drive_campaign():
    points, readings = drive()["campaign"](seed=1)
    return dict(points), dict(readings)


def drive_diagnosis(points, readings):
    samples = hmcvt.observe_system(
        drive()["system"], {**points, **readings}, noise=drive()["CHANNEL_NOISE"]
    )
    return hmcvt.diagnose_system(drive()["system"], samples)


@cache
def diagnosed():
    return hmcvt.diagnose_system(drive()["system"], observed(magnet_weakening=0.04))


def test_switched_argument_is_found():
    diagnosis = diagnosed()
    assert diagnosis.verdict == "cause_found"
    assert diagnosis.sets[0].effects == ("magnet_weakening",)
    size = diagnosis.causes[0].parameters["magnet_weakening"]
    assert size["value"] == pytest.approx(0.04, abs=3.0 * size["standard_error"])
    arguments = diagnosis.model["arguments"]
    assert set(arguments) == {"resistance", "iron_loss", "magnet_weakening"}
    assert arguments["magnet_weakening"] == pytest.approx(size["value"], rel=0.1)


def test_nothing_hidden_is_no_gap():
    diagnosis = hmcvt.diagnose_system(drive()["system"], observed())
    assert diagnosis.verdict == "no_gap"


def test_what_the_base_model_cannot_be_off_by_is_an_unlisted_loss():
    points, readings = drive_campaign()
    # Iron saturates above a torque, many times the noise: partly like weaker magnets.
    excess = np.maximum(points["torque"] - 50.0, 0.0)
    readings["phase_current"] = readings["phase_current"] * (1.0 + 0.005 * excess)
    diagnosis = drive_diagnosis(points, readings)
    assert diagnosis.verdict in ("unexplained", "other_form")


def test_a_smooth_loss_of_thirty_deviations_is_no_base_a_little_off():
    points, readings = drive_campaign()
    speed = (points["speed"] - 325.0) / 275.0
    torque = (points["torque"] - 42.5) / 37.5
    readings["battery_power"] = readings["battery_power"] + 450.0 * speed * torque
    diagnosis = drive_diagnosis(points, readings)
    assert diagnosis.verdict == "unexplained"
    assert "slightly off" not in diagnosis.report()


def test_a_unit_that_no_model_reaches_is_refused():
    points, readings = drive_campaign()
    readings["battery_power"] = readings["battery_power"] * 1e6
    with pytest.raises(hmcvt.InputError, match=r"battery_power lies .* its unit \(W\)"):
        drive_diagnosis(points, readings)


def test_an_axis_in_another_unit_is_refused():
    points, readings = drive_campaign()
    points["speed"] = points["speed"] * 1e8
    with pytest.raises(hmcvt.InputError, match="iron_loss changes the readings"):
        drive_diagnosis(points, readings)


def test_a_base_parameter_far_from_its_prior_is_named():
    points, readings = drive_campaign()
    further = 1.5 * 0.010 * readings["phase_current"] ** 2  # more copper resistance
    readings["battery_power"] = readings["battery_power"] + further
    diagnosis = drive_diagnosis(points, readings)
    assert "resistance" in diagnosis.report().split("\n")[0]
    assert any("resistance of the base model lies" in n for n in diagnosis.notes)


def test_without_a_power_none_is_stated():
    silent = replace(drive()["system"], power=None)
    diagnosis = hmcvt.diagnose_system(silent, observed(bearing_drag=1.0))
    assert diagnosis.lost_power is None
    for words in ("nan", " W lost", "any power"):
        assert words not in diagnosis.report()


def test_effects_of_two_kinds_and_the_base_reach_the_function():
    received = {}

    def function(points, **arguments):
        received.update(arguments)
        return {"battery_power": points["speed"], "phase_current": points["speed"]}

    system = replace(drive()["system"], function=function)
    on = system.library[1].with_values({"bearing_drag": 0.7})
    system.predict(np.array([1.0, 0.0]), (on,), {"speed": np.ones(3)})
    assert received["bearing_drag"] == 0.7
    assert received["windage"] == 0.0
    assert received["resistance"] == pytest.approx(0.022)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ({"phase_current": [1.0]}, "returns no channel battery_power"),
        (
            {"phase_current": [1.0], "battery_power": [1.0, 2.0]},
            r"battery_power of shape \(2,\), not \(1,\)",
        ),
    ],
)
def test_wrong_answer_of_the_function_is_named(answer, message):
    system = replace(drive()["system"], function=lambda points, **arguments: answer)
    with pytest.raises(hmcvt.InputError, match=message):
        system.predict(np.zeros(2), (), {"speed": np.ones(1)})


def test_wrong_statements_are_refused():
    with pytest.raises(hmcvt.InputError, match=r"spread 0\.0 is not > 0"):
        hmcvt.Parameter("resistance", "ohm", 1.0, 0.0)
    with pytest.raises(hmcvt.InputError, match=r"mean 1\.0 is not within 2\.0"):
        hmcvt.Parameter("resistance", "ohm", 1.0, 1.0, low=2.0)
    with pytest.raises(hmcvt.InputError, match="does not hold 0"):
        hmcvt.Switch("drag", "N m", 1.0, 0.5, 2.0)
    with pytest.raises(hmcvt.InputError, match=r"typical size 3\.0"):
        hmcvt.Switch("drag", "N m", 3.0, 0.0, 2.0)
    system = drive()["system"]
    doubled = (*system.effects, hmcvt.Switch("resistance", "ohm", 1.0, 0.0, 2.0))
    with pytest.raises(hmcvt.InputError, match="argument resistance belongs to two"):
        replace(system, effects=doubled)
    with pytest.raises(hmcvt.InputError, match="parameters is empty"):
        replace(system, parameters=())


def test_candidates_lie_in_the_range_of_the_campaign():
    system = drive()["system"]
    points = observed().points
    possible = system.candidates(points, np.zeros(2))
    for name in ("speed", "torque"):
        assert points[name].min() <= possible[name].min()
        assert possible[name].max() <= points[name].max()
        assert np.ptp(possible[name]) > 0.9 * np.ptp(points[name])
