# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tests that are advised: different, worth making, and such that the machine can run them."""

from dataclasses import replace

import numpy as np
import pytest
from core.test_several_stages import TRACTOR, bench

import hmcvt_core as hmcvt
from diagnosis.campaigns import BASE, NOISE, campaign
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.benches.transmission.channels import by_name
from hmcvt_core.benches.transmission.system import (
    HIGHEST_PRESSURE,
    MIN_OUTPUT_FRACTION,
)
from hmcvt_core.diagnosis.design import advice as wording
from hmcvt_core.diagnosis.design.advice import NextTest
from hmcvt_core.diagnosis.design.next_test import within_range
from hmcvt_core.diagnosis.pipeline import with_tests_in_range
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.settings import MIN_TEST_GAIN
from hmcvt_core.diagnosis.system import Axis
from hmcvt_core.physics.effects.actuator import DisplacementDeadBand
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.physics.effects.mechanical import (
    ChargePump,
    Churning,
    ClutchDrag,
    PlanetaryMesh,
)
from hmcvt_core.transmission import ranges

AXES = ("displacement_ratio", "engine_speed", "load_torque")
EFFECTS = {
    "nothing": (),
    "mesh": (PlanetaryMesh(0.03),),
    "leakage": (PressureLeakage(1e-11, 1.5),),
    "dead band": (DisplacementDeadBand(0.03),),
    "pump": (ChargePump(6.0),),
    "two": (Churning(10.0, 2.0), PressureLeakage(1e-11, 1.5)),
}
COUNTS = (8, 12, 20)
IN_MAKE_TEST = (("mesh", 8), ("dead band", 12))
FEW = []
for name in EFFECTS:
    for n in COUNTS:
        # `make test-long` runs the others.
        repeated = [] if (name, n) in IN_MAKE_TEST else [pytest.mark.long]
        FEW.append(pytest.param(name, n, marks=repeated))


def check(model, samples, tests):
    """Assert what holds of every list of tests."""
    keys = [(*(test.point or {}).values(), *test.setting.values()) for test in tests]
    keys = [(key, test.measure) for key, test in zip(keys, tests, strict=True)]
    assert len(set(keys)) == len(keys), "no test is listed twice"
    for test in tests:
        assert test.gain >= MIN_TEST_GAIN
        if test.point is None:
            assert test.measure
            assert test.repeats == 1
            continue
        stage = test.setting.get("stage")
        check_point(model.in_stage(stage), test, samples)


def check_point(model, test, samples):
    """Assert that a machine can run a test."""
    point = [np.array([test.point[axis]]) for axis in AXES]
    for value, within in zip(
        point,
        (ranges.DISPLACEMENT_RATIO, ranges.ENGINE_SPEED, ranges.LOAD_TORQUE),
        strict=True,
    ):
        assert within.contains(value)
    low, high = ranges.ENGINE_SPEED_LIMITS
    speeds = samples.engine_speed
    assert min(low, speeds.min()) <= point[1] <= max(high, speeds.max())
    read = model.readings_at(ranges.OperatingPoints(*point))
    assert np.isfinite(read["efficiency"])
    assert read["output_speed"] > 0.0, "the output turns as in the campaign"
    assert abs(read["pressure"]) < 1.1 * HIGHEST_PRESSURE


@pytest.mark.parametrize(("name", "n"), FEW)
def test_tests_differ_and_can_be_run(name, n):
    samples = campaign(EFFECTS[name], seed=n, n=n)
    advice = hmcvt.next_test(BASE, samples, noise=NOISE)
    assert advice.stop or advice.tests
    check(BASE, samples, advice.next_tests)


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.long)])
def test_no_test_lies_where_the_stage_reverses(seed):
    """The lowest stage of the tractor turns backwards at one end of the stroke."""
    worn = replace(TRACTOR, effects=(ClutchDrag(8.0),))
    everything = bench(("HM1", "HM4"), 24, seed, worn)
    point = [getattr(everything, axis) for axis in AXES]
    stages = np.array(everything.extra["stage"])
    speed = TRACTOR.output_speed(*point, stage=stages)
    samples = everything.select(np.flatnonzero(speed > 0.0)[:24])
    advice = hmcvt.next_test(TRACTOR, samples, noise=0.004)
    check(TRACTOR, samples, advice.next_tests)
    stage = advice.to_dict()["test"]["stage"]
    assert stage in ("HM1", "HM4")
    assert f"stage {stage}" in words.advice(advice)


def test_candidates_keep_away_from_the_reversal():
    samples = bench(("HM1", "HM4"), 24, 1)
    system = Transmission(TRACTOR)
    points = {axis: getattr(samples, axis) for axis in AXES}
    stages = list(TRACTOR.stages)
    names = samples.extra["stage"]
    points["stage"] = np.array([float(stages.index(name)) for name in names])
    base = system.base.mean
    possible = system.candidates(points, base)
    measured = by_name(system.predict(base, (), points))
    predicted = by_name(system.predict(base, (), possible))
    for number in np.unique(points["stage"]):
        usual = np.nanmedian(measured["output_speed"][points["stage"] == number])
        of_stage = predicted["output_speed"][possible["stage"] == number]
        assert (of_stage * np.sign(usual) >= MIN_OUTPUT_FRACTION * abs(usual)).all()
    highest = max(HIGHEST_PRESSURE, np.nanmax(measured["pressure"]))
    assert np.abs(predicted["pressure"]).max() <= highest


def test_one_possible_test_is_repeated():
    samples = campaign(EFFECTS["mesh"], seed=8, n=8)
    one = samples.select(np.array([3]))
    advice = hmcvt.next_test(BASE, samples, noise=NOISE, possible=one)
    (test,) = advice.tests
    assert test.repeats > 1
    assert f", {test.repeats} times" in advice.report()
    assert advice.to_dict()["test"]["repeats"] == test.repeats


def test_one_reading_needs_no_number():
    point = dict.fromkeys(AXES, 100.0)
    test = NextTest(point, ("a", "b"), 1.0)
    axes = [axis for axis in Transmission(BASE).axes if axis.name in AXES]
    assert "times" not in wording.test_in_words(test, axes)


def test_tests_within_the_range_of_the_readings_of_their_stage():
    speed = Axis.of("speed", "rad/s")
    stage = replace(Axis.of("stage"), steered=False, labels=("one", "two"))
    measured = {
        "speed": np.array([100.0, 150.0, 200.0, 220.0]),
        "stage": np.array([0.0, 0.0, 1.0, 1.0]),
    }
    possible = {
        "speed": np.array([90.0, 100.0, 160.0, 210.0, 210.0, 230.0, 120.0]),
        "stage": np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0]),
    }
    inside = within_range(possible, measured, (speed, stage))
    assert inside["speed"].tolist() == [100.0, 210.0]
    assert inside["stage"].tolist() == [0.0, 1.0]
    alone = within_range(
        {"speed": possible["speed"]}, {"speed": measured["speed"]}, (speed,)
    )
    assert alone["speed"].tolist() == [100.0, 160.0, 210.0, 210.0, 120.0]


def test_next_tests_can_be_kept_within_the_samples():
    samples = campaign(EFFECTS["two"], 2, n=20)
    narrow = samples.select(np.flatnonzero(samples.engine_speed < 190.0))
    found = hmcvt.diagnose(BASE, narrow, noise=NOISE)
    assert not all(_is_within(narrow, test) for test in found.advice.tests)
    inside = with_tests_in_range(found)
    assert inside.advice.tests
    assert all(_is_within(narrow, test) for test in inside.advice.tests)
    assert inside.next_tests == inside.advice.next_tests
    assert inside.advice.candidates == found.advice.candidates


def _is_within(samples, test):
    """Whether a test lies within the range of samples along each axis."""
    within = []
    for name in AXES:
        values = getattr(samples, name)
        within.append(values.min() <= test.point[name] <= values.max())
    return all(within)
