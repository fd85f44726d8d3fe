# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Readings against their stated noise, and what varied that was not recorded."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.statements.agreement import NOTHING_STATED, agreement_of
from studies.blind.bench.judge import Case as BenchCase
from studies.blind.bench.judge import draw, served
from studies.blind.bench.properties import Bench
from studies.driver import Case, judge, measured

from .campaigns import BASE, NOISE, campaign, fitted, with_column


def test_readings_agree_with_the_noise_they_have():
    agreement = agreement_of(fitted(campaign(seed=8)))
    assert agreement.stated and agreement.holds and agreement.looks == ()
    assert agreement.ratio == pytest.approx(1.0, abs=0.15)


def test_where_no_noise_is_stated_nothing_can_disagree():
    assert agreement_of(fitted(campaign(seed=8), noise=None)) == NOTHING_STATED


@pytest.mark.parametrize("ratio", [1.5, 3.0])
def test_noise_stated_too_small_disagrees_by_its_ratio(ratio):
    agreement = agreement_of(fitted(campaign(seed=8), noise=NOISE / ratio))
    assert not agreement.holds
    overall = next(look for look in agreement.looks if not look.part)
    assert overall.ratio == pytest.approx(ratio, rel=0.15)
    assert overall.p_value < 1e-3


def test_a_statement_for_every_sample_is_a_statement():
    samples = campaign(seed=8)
    stated = with_column(samples, efficiency_std=np.full(len(samples), NOISE / 2.0))
    found = hmcvt.diagnose(BASE, stated)
    assert found.verdict == "excess_scatter"
    assert "2" in found.report().split("\n\n")[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("quantity", "course", "time_scale", "seed"),
    [
        ("oil temperature", "random", "tests", 22),
        # A charge pressure by session is the zero of a torque meter.
        ("oil temperature", "session", "sessions", 23),
        ("air in the oil", "warming", "hours", 22),
    ],
)
def test_the_time_scale_of_what_varied_is_named(quantity, course, time_scale, seed):
    answer = judge(Case(quantity, course, True, seed))
    assert answer["verdict"] == "excess_scatter"
    assert answer["time_scale"] == time_scale


@pytest.mark.long
@pytest.mark.parametrize("seed", [95200011, 95200071])
def test_a_meter_whose_zero_leaves_its_class_is_no_agreement(seed):
    case = Case("torque meter", "session", True, seed)
    samples, _, zero_ratio = measured(case)
    assert zero_ratio > 3.0
    found = hmcvt.diagnose(BASE, samples)
    assert found.verdict == "excess_scatter"
    assert found.agreement.of_meters_alone
    parts = [look.part for look in found.agreement.looks]
    assert "the zero of the engine meter" in parts
    assert "check that meter" in found.report().split("\n\n")[0].replace("\n", " ")


@pytest.mark.long
def test_a_ratio_of_meters_is_not_said_of_the_noise():
    """The zero changes within 12 sessions as named here, so that readings scatter as well."""
    samples, _, _ = measured(Case("torque meter", "session", False, 700005))
    n = len(samples)
    sessions = tuple(f"day {number}" for number in 12 * np.arange(n) // n)
    found = hmcvt.diagnose(BASE, replace(samples, extra={"session": sessions}))
    agreement = found.agreement
    assert not agreement.of_meters_alone
    assert max(look.ratio for look in agreement.looks) > 5.0
    of_readings = max(look.ratio for look in agreement.readings)
    assert agreement.ratio == of_readings < 5.0
    report = found.report().replace("\n", " ")
    assert f"the noise is stated {of_readings:.2g} times too small" in report
    assert "errors of meters are larger than their class allows" in report


@pytest.mark.long
def test_half_the_drift_has_no_article():
    samples, _, _ = measured(Case("torque meter", "session", False, 700005))
    sessions = tuple("" if i % 3 else "a" for i in range(len(samples)))
    found = hmcvt.diagnose(BASE, replace(samples, extra={"session": sessions}))
    parts = [look.part for look in found.agreement.looks]
    assert "half the drift of the engine meter" in parts


def test_a_quantity_anew_in_each_test_varies_over_no_minutes():
    answer = judge(Case("charge pressure", "random", True, 95200025))
    assert answer["time_scale"] == "tests", "amplitudes are dense enough for the noise"


@pytest.mark.long
def test_a_charge_pressure_that_is_recorded_is_not_asked_for():
    samples, _, _ = measured(Case("charge pressure", "random", True, 22))
    found = hmcvt.diagnose(BASE, samples)
    assert "charge pressure" in dict(found.scatter.quantities)
    recorded = with_column(samples, charge_pressure=np.full(len(samples), 2e6))
    found = hmcvt.diagnose(BASE, recorded)
    assert "charge pressure" not in dict(found.scatter.quantities)


@pytest.mark.long
def test_a_loss_in_one_stage_is_no_agreement():
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    rng = np.random.default_rng(3)
    stage = np.array(["HM2", "HM3", "HM4"])[np.arange(90) % 3]
    stroke = rng.uniform(-0.9, 0.9, 90)
    speed = rng.uniform(90.0, 200.0, 90)
    load = rng.uniform(100.0, 350.0, 90)
    efficiency = np.array(
        [
            tractor.stages[name].efficiency(*point)
            for name, point in zip(
                stage, zip(stroke, speed, load, strict=True), strict=True
            )
        ]
    )
    efficiency = efficiency - 0.012 * (stage == "HM3")
    efficiency = efficiency + 0.0016 * rng.standard_normal(90)
    kept = np.flatnonzero(np.isfinite(efficiency))
    samples = hmcvt.BenchSamples(
        stroke[kept],
        speed[kept],
        load[kept],
        efficiency[kept],
        efficiency_std=np.full(len(kept), 0.0016),
        extra={"stage": [str(name) for name in stage[kept]]},
    )
    found = hmcvt.diagnose(tractor, samples)
    assert found.verdict != "no_gap"


@pytest.mark.long
def test_a_resonance_in_a_narrow_band_of_speed_is_no_scatter():
    """A few tests are off, and they lie side by side along one axis alone."""
    bench, _ = draw(BenchCase("unlisted", 99840117, Bench()))
    assert bench.truth.names == ("torsional_resonance",)
    found = hmcvt.diagnose(*served(bench))
    assert found.verdict == "unexplained"
    low, high = found.where[0].limits["engine_speed"]
    assert high - low < 40.0
