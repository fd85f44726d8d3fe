# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the meters that the readings of a session share."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core import BenchSamples, diagnose
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.benches.transmission.base import scaled_base
from hmcvt_core.benches.transmission.meters import (
    MIN_SESSION_SAMPLES,
    ZERO_DEVIATION,
    sessions_of,
    with_meter_errors,
)
from hmcvt_core.diagnosis.observations import SESSION
from hmcvt_core.transmission.quantities import BY_NAME
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import BASE, NOISE, campaign, with_column

SYSTEM = Transmission(BASE)
TRUE = scaled_base(SYSTEM.base, BASE.parameters)
QUIET = campaign(seed=1, n=24, noise=0.0)
STROKE = BY_NAME["displacement_ratio"].gauge


def _observed(samples):
    return with_meter_errors(observe(samples, NOISE), SYSTEM)


def _in_sessions(samples, names):
    return replace(samples, extra={"session": tuple(names)})


def test_sessions_by_name_by_pause_or_one():
    n = len(QUIET)
    halves = np.repeat([0, 1], [n // 2, n - n // 2])
    assert sessions_of(QUIET).count == 1
    assert not sessions_of(QUIET).phase.any()
    assert sessions_of(_in_sessions(QUIET, [None] * n)).count == 1
    named = sessions_of(_in_sessions(QUIET, np.array(["B", "C"])[halves]))
    assert named.index.tolist() == halves.tolist()
    # A night between samples that follow each other by two minutes.
    stamp = 120.0 * np.arange(n) + 40_000.0 * halves
    paused = sessions_of(with_column(QUIET, stamp=stamp))
    assert paused.index.tolist() == halves.tolist()
    assert paused.phase[[0, n // 2 - 1, n // 2, n - 1]].tolist() == [-1, 1, -1, 1]
    slow = sessions_of(with_column(QUIET, stamp=3600.0 * np.arange(n)))
    assert slow.count == 1, "a slow plan is no pause"


def test_a_zero_moves_the_efficiency_as_the_torques_do():
    observed = _observed(QUIET)
    efficiency = SYSTEM.predict(TRUE, (), observed.points)[0]
    engine_torque = QUIET.load_torque / efficiency
    zero = 1.5 * engine_torque.max() * ZERO_DEVIATION
    moved = QUIET.load_torque / (engine_torque + zero)
    np.testing.assert_allclose(
        observed.shared_errors[0, :, 0], moved - efficiency, rtol=0.02
    )
    assert not observed.shared_errors[1, :, 0].any(), "the speed is read elsewhere"


@pytest.mark.parametrize("speed_noise", [0.001, None])
def test_the_columns_hold_no_noise_of_the_readings(speed_noise):
    """A large zero would explain it: a sixth of the noise of a thousand samples."""
    quiet = _observed(campaign(seed=1, n=96, noise=0.0, speed_noise=speed_noise))
    noisy = _observed(campaign(seed=1, n=96, noise=0.02, speed_noise=speed_noise))
    noise = noisy.measured[0] - quiet.measured[0]
    difference = noisy.shared_errors[0] - quiet.shared_errors[0]
    # The base that is fitted first differs, smoothly.
    for column in difference.T[difference.any(axis=0)]:
        assert abs(np.corrcoef(column, noise)[0, 1]) < 0.3


def test_only_several_sessions_are_numbered_and_the_physics_ignore_them():
    assert SESSION not in _observed(QUIET).points
    names = ["A"] * 10 + ["B"] * (len(QUIET) - 12) + ["C"] * 2
    observed = _observed(_in_sessions(QUIET, names))
    assert MIN_SESSION_SAMPLES > 2
    assert observed.points[SESSION].tolist() == [
        {"A": 0.0, "B": 1.0, "C": -1.0}[name] for name in names
    ]
    without = {name: row for name, row in observed.points.items() if name != SESSION}
    np.testing.assert_array_equal(
        SYSTEM.predict(TRUE, (), observed.points),
        SYSTEM.predict(TRUE, (), without),
    )
    # The errors of a session are of its samples alone.
    of_a = observed.shared_errors[0, :, 0]
    assert of_a[:10].all() and not of_a[10:].any()


def test_one_sample_shares_nothing():
    assert _observed(QUIET.select(np.arange(1))).shared_count == 0


def test_the_errors_of_every_session_are_estimated_and_named():
    """A zero of 2 N m in one of two sessions; the other has none."""
    samples = campaign(seed=3, n=60, noise=0.0003)
    late = np.arange(60) >= 30
    engine_torque = samples.load_torque / samples.efficiency
    efficiency = samples.load_torque / (engine_torque + 2.0 * late)
    samples = replace(samples, efficiency=efficiency)
    samples = _in_sessions(samples, np.where(late, "night", "day"))
    diagnosis = diagnose(BASE, samples, noise=0.0003)
    errors = diagnosis.to_dict()["shared_errors"]
    zeros = {}
    for item in errors:
        assert item["standard_deviation"] <= 1.01 * item["expected"]
        if item["error"] == "zero of the engine meter":
            zeros[item["session"]] = item
    assert zeros.keys() == {"day", "night"}
    difference = zeros["night"]["value"] - zeros["day"]["value"]
    assert difference == pytest.approx(2.0, abs=0.6)
    assert {item["unit"] for item in errors} == {"N m", "-"}
    assert "zero of the engine meter, session night: +" in diagnosis.report()


def test_a_stroke_sensor_moves_every_reading_as_another_stroke_does():
    observed = _observed(QUIET)
    names = [error.name for error in observed.shared_names]
    zero = observed.shared_errors[..., names.index("zero of the stroke sensor")]
    gain = observed.shared_errors[..., names.index("gain of the stroke sensor")]
    stroke = QUIET.displacement_ratio
    step = 0.1 * STROKE.zero
    points = {**observed.points, "displacement_ratio": stroke - step}
    moved = SYSTEM.predict(TRUE, (), points)[:2]
    still = SYSTEM.predict(TRUE, (), observed.points)[:2]
    np.testing.assert_allclose(zero, 10.0 * (moved - still), rtol=0.05, atol=1e-5)
    np.testing.assert_allclose(gain, zero * stroke * STROKE.gain / STROKE.zero)


def _with_wrong_stroke(seed, n=96):
    """Tests of the exact base in two sessions, whose strokes are read with an error each."""
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-0.95, 0.95, n)
    speed = rng.uniform(80.0, 210.0, n)
    load = rng.uniform(80.0, 400.0, n)
    session = np.repeat([0, 1], n // 2)
    zero = np.array([0.004, -0.003])[session]
    gain = np.array([-0.004, 0.003])[session]
    true = (stroke - zero) / (1.0 + gain)
    readings = BASE.readings_at(OperatingPoints(true, speed, load))
    efficiency = readings["efficiency"] + NOISE * rng.standard_normal(n)
    output_speed = readings["output_speed"] * (1.0 + 1e-3 * rng.standard_normal(n))
    return BenchSamples(
        displacement_ratio=stroke,
        engine_speed=speed,
        load_torque=load,
        efficiency=efficiency,
        output_speed=output_speed,
        efficiency_std=np.full(n, NOISE),
        extra={"session": tuple(np.array(["Mon", "Tue"])[session])},
    )


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))]
)
def test_a_stroke_that_is_read_wrong_within_its_class_is_no_gap(seed):
    diagnosis = diagnose(BASE, _with_wrong_stroke(seed))
    assert diagnosis.verdict == "no_gap"
    zeros = [
        error
        for error in diagnosis.shared_errors
        if error.error == "zero of the stroke sensor"
    ]
    for zero, true in zip(zeros, (0.004, -0.003), strict=True):
        assert abs(zero.value - true) < 3.0 * zero.standard_deviation
        assert zero.standard_deviation < 0.6 * zero.expected
