# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is known of readings: their noise, which repeat a point, which copy another."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import observe
from hmcvt_core.diagnosis.observations import pure_error, replicate_groups

from .campaigns import BASE, campaign, with_column


def _groups(samples):
    observed = observe(samples)
    return replicate_groups(observed.axes, observed.points)


@pytest.mark.parametrize("seed", [0, 2])
def test_points_set_again_by_a_real_bench_are_repeats(seed):
    rng = np.random.default_rng(seed)
    exact = campaign(seed=seed, n=10, noise=0.0).select(np.repeat(np.arange(10), 4))
    samples = with_column(  # as closely as a bench sets them
        exact,
        engine_speed=exact.engine_speed + 0.05 * rng.standard_normal(40),
        load_torque=exact.load_torque + 0.05 * rng.standard_normal(40),
        efficiency=exact.efficiency + 0.004 * rng.standard_normal(40),
    )
    groups = _groups(samples)
    np.testing.assert_array_equal([len(set(part)) for part in groups.reshape(10, 4)], 1)
    observed = observe(samples)
    assert observed.noise_source == "repeated points"
    assert observed.deviation[0, 0] == pytest.approx(0.004, rel=0.35)
    order = np.random.default_rng(2).permutation(len(samples))
    np.testing.assert_array_equal(groups[order], _groups(samples.select(order)))


def test_other_points_are_no_repeats():
    assert len(np.unique(_groups(campaign(seed=1)))) >= 95
    twice = campaign(seed=1, n=10).select(np.repeat(np.arange(10), 2))
    warm = with_column(twice, oil_temperature=np.tile([50.0, 80.0], 10))
    assert len(np.unique(_groups(warm))) == 20


def test_a_slow_sweep_is_no_single_point():
    samples = campaign(seed=1, n=1000)
    sweep = with_column(
        samples,
        engine_speed=np.sort(samples.engine_speed),
        displacement_ratio=np.full(1000, 0.1),
        load_torque=np.full(1000, 200.0),
    )
    groups = _groups(sweep)
    width = max(
        float(np.ptp(sweep.engine_speed[groups == i])) for i in np.unique(groups)
    )
    assert width <= 2.0 * 0.002 * float(np.ptp(sweep.engine_speed)) * 1.001


def test_pure_error_is_the_pooled_deviation():
    group = np.array([0, 0, 0, 1, 1, 1, 2, 2])
    measured = np.array([1.0, 2.0, 3.0, 5.0, 5.0, 8.0, 1.0, 3.0])
    deviation, free = pure_error(group, measured)
    assert free == 5.0
    assert deviation == pytest.approx(np.sqrt((2.0 + 6.0 + 2.0) / 5.0))
    assert pure_error(group[:6], measured[:6]) is None, (
        "four degrees of freedom are too few"
    )
    assert pure_error(group, np.ones(8)) is None, "filled in, not read"


def test_where_the_noise_comes_from():
    samples = campaign(seed=1, n=20)
    stated = with_column(samples, efficiency_std=np.linspace(0.0, 0.01, 20).clip(1e-6))
    given, column, assumed = observe(stated, 0.003), observe(stated), observe(samples)
    np.testing.assert_array_equal(given.deviation[0], 0.003)
    assert column.deviation[0].min() == 1e-5, "a meter resolves no less"
    assert column.deviation[0].max() == 0.01
    np.testing.assert_allclose(assumed.deviation[0], 0.0112 * samples.efficiency)
    np.testing.assert_allclose(assumed.deviation[1], 0.001 * samples.output_speed)
    of_power, of_speed = (
        given.unit_discrepancy
    )  # what is lost of the speed is lost of the power too
    np.testing.assert_allclose(of_power, [[1.0 / 0.003] * 20, [0.0] * 20])
    np.testing.assert_allclose(
        of_speed, [samples.efficiency / 0.003, [1.0 / 0.001] * 20]
    )
    assert [item.noise_source for item in (given, column, assumed)] == [
        "given",
        "column efficiency_std",
        "assumed, 1.12 % (paper, eq. (3))",
    ]
    assert [item.assumed for item in (given, column, assumed)] == [False, False, True]
    assert [item.prior_dof[0] for item in (given, column, assumed)] == [8.0, 8.0, 1.0]
    few = np.arange(15)
    assert [
        observe(item.select(few), noise).prior_dof.tolist()
        for item, noise in ((stated, None), (samples, None))
    ] == [[30.0, 3.0], [3.0, 3.0]]
    again = assumed.with_stated_noise(0.004)
    assert (again.stated_noise, again.assumed, again.prior_dof[0]) == (
        pytest.approx(0.004),
        False,
        8.0,
    )


@pytest.mark.long
def test_copies_are_dropped_and_repeated_readings_kept():
    quiet = campaign(seed=2, n=12)
    thrice = hmcvt.diagnose(BASE, quiet.select(np.tile(np.arange(12), 3)))
    once = hmcvt.diagnose(BASE, quiet)
    assert thrice.gap == once.gap
    assert (
        "24 of 36 rows copy another one in every column and were left out"
        in thrice.notes
    )
    assert thrice.notes[1:] == once.notes
    # The first of each stays, and a column that nobody uses can tell rows apart.
    twice = with_column(
        quiet.select(np.repeat(np.arange(12), 2)),
        extra={"run": ["a", "a", *["a", "b"] * 11]},
    )
    found = hmcvt.diagnose(BASE, twice)
    assert (
        "1 of 24 rows copy another one in every column and were left out" in found.notes
    )
    assert found.samples.extra["run"][:3] == ("a", "a", "b")
