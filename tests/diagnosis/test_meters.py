# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the torque meters that the readings of a session share."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core import diagnose
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.benches.transmission.meters import (
    MIN_SESSION_SAMPLES,
    ZERO_DEVIATION,
    sessions_of,
    with_meter_errors,
)
from hmcvt_core.diagnosis.observations import SESSION

from .campaigns import BASE, NOISE, campaign, with_column

SYSTEM = Transmission(BASE)
QUIET = campaign(seed=1, n=24, noise=0.0)


def _observed(samples):
    return with_meter_errors(observe(samples, NOISE), SYSTEM)


def _in_sessions(samples, names):
    return replace(samples, extra={"session": tuple(names)})


def test_sessions_by_name_by_pause_or_one():
    n = len(QUIET)
    halves = np.repeat([0, 1], [n // 2, n - n // 2])
    assert sessions_of(QUIET).count == 1
    assert not sessions_of(QUIET).phase.any()
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
    efficiency = SYSTEM.predict(SYSTEM.base.mean, (), observed.points)[0]
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
    rows = []
    for noise in (0.0, 0.02):
        samples = campaign(seed=1, n=24, noise=noise, speed_noise=speed_noise)
        observed = _observed(samples)
        rows.append(
            observed.shared_errors[0] / np.abs(observed.shared_errors[0]).max(0)
        )
    np.testing.assert_allclose(rows[0], rows[1], rtol=1e-9, atol=1e-12)


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
        SYSTEM.predict(SYSTEM.base.mean, (), observed.points),
        SYSTEM.predict(SYSTEM.base.mean, (), without),
    )
    # The errors of a session are of its samples alone.
    of_a = observed.shared_errors[0, :, 0]
    assert of_a[:10].all() and not of_a[10:].any()


def test_one_sample_shares_nothing():
    assert _observed(QUIET.select(np.arange(1))).shared_count == 0


def test_the_errors_of_every_session_are_estimated_and_named():
    """A zero of 4 N m in one of two sessions; the other has none."""
    samples = campaign(seed=3, n=60, noise=0.001)
    late = np.arange(60) >= 30
    engine_torque = samples.load_torque / samples.efficiency
    efficiency = samples.load_torque / (engine_torque + 4.0 * late)
    samples = replace(samples, efficiency=efficiency)
    samples = _in_sessions(samples, np.where(late, "night", "day"))
    diagnosis = diagnose(BASE, samples, noise=0.001)
    errors = diagnosis.to_dict()["shared_errors"]
    zeros = {}
    for item in errors:
        assert item["standard_deviation"] <= 1.01 * item["expected"]
        if item["error"] == "zero of the engine meter":
            zeros[item["session"]] = item
    assert zeros.keys() == {"day", "night"}
    difference = zeros["night"]["value"] - zeros["day"]["value"]
    assert difference == pytest.approx(4.0, abs=1.0)
    assert {item["unit"] for item in errors} == {"N m", "-"}
    assert "zero of the engine meter, session night: +" in diagnosis.report()
