# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The search for a gap: p values that mean what they say, and the regions that are searched."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import observe
from hmcvt_core.benches.transmission.channels import AXES
from hmcvt_core.diagnosis.detection.regions import candidate_regions, covering
from hmcvt_core.diagnosis.detection.significance import significance
from hmcvt_core.diagnosis.observations import SmoothFunctions, scaled_to_extent
from hmcvt_core.diagnosis.preparation import uneven_noise
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import (
    BASE,
    NOISE,
    campaign,
    factorial_points,
    fitted,
    measure,
    random_points,
)

NAMES = [axis.name for axis in AXES[:2]]
REPLICATES = 199
LEVEL = 0.05
CAMPAIGNS = [campaign(seed=1000 + seed, n=16) for seed in range(24)]


def _search(samples, stated=NOISE, replicates=REPLICATES, seed=0):
    known = fitted(samples, stated)
    return significance(
        known, candidate_regions(known.observed.coordinates), seed, replicates
    )


@pytest.fixture(scope="module")
def without_gap():
    return np.array([_search(samples).p_value for samples in CAMPAIGNS])


def test_p_values_without_a_gap_are_uniform(without_gap):
    assert kstest(without_gap, "uniform", alternative="greater").pvalue > 0.01
    # At most 1 expected; 6 or more would come up once in 1000 times.
    assert np.sum(without_gap <= LEVEL) < 6


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_noise_stated_wrongly_raises_no_alarm(factor, without_gap):
    p = np.array(
        [_search(samples, factor * NOISE).p_value for samples in CAMPAIGNS[::3]]
    )
    assert np.sum(p <= LEVEL) < 3
    assert np.median(np.abs(p - without_gap[::3])) < 0.2, "nor does it hide much"


def test_a_loss_in_one_place_is_found():
    def loss(points):
        return 0.015 * (np.abs(points.engine_speed - 150.0) < 12.0)

    samples = campaign(seed=4, loss=loss)
    found = _search(samples)
    assert found.p_value <= 0.02


def test_few_samples_far_off_the_noise_stated_are_a_gap():
    """Below sixteen samples the size of the scatter counts, believed as stated."""
    quiet = campaign(seed=6, n=8, speed_noise=None)
    assert _search(quiet).p_value > LEVEL
    loud = campaign(seed=6, n=8, speed_noise=None, noise=4.0 * NOISE)
    assert _search(loud).p_value <= LEVEL


def test_a_bench_twice_as_noisy_as_assumed_raises_no_alarm():
    """Few samples of which nobody stated the noise."""
    alarms = [
        _search(
            campaign(seed=500 + seed, n=8 + seed % 5, noise=0.016, speed_noise=None),
            None,
            99,
        ).p_value
        <= 0.02
        for seed in range(12)
    ]
    assert np.sum(alarms) <= 1


def test_uneven_noise_is_taken_as_it_is_seen_where_nobody_states_it():
    points = random_points(5, 400)
    true = 0.01 * np.exp(-points.load_torque / 200.0)
    samples = measure(points, noise=true, loss=lambda at: 1e-4 * at.engine_speed)
    fit = fitted(samples, None)
    efficiency, speed = uneven_noise(fit)
    seen = np.log(fit.observed.deviation[0] * efficiency / true)
    assert np.ptp(seen) < 0.4 * np.ptp(np.log(true))
    assert np.ptp(speed) == 0.0
    # A statement is believed, and so few tell nothing.
    for even in (fitted(samples), fitted(samples.select(np.arange(40)), None)):
        assert np.ptp(uneven_noise(even)[0]) == 0.0


def test_one_test_made_many_times_does_not_pass_for_uneven_noise():
    """Once every other point was interpolated, and its noise called nil."""
    few = random_points(1, 24)
    crowd = [
        np.append(getattr(few, name), np.full(30, value))
        for name, value in (
            ("displacement_ratio", -1.0),
            ("engine_speed", 78.5),
            ("load_torque", 424.5),
        )
    ]
    fit = fitted(measure(OperatingPoints(*crowd), (PressureLeakage(3e-12, 2.0),), 1))
    np.testing.assert_array_equal(uneven_noise(fit), 1.0)


def test_the_p_values_follow_the_statistics_and_the_seed():
    found, again, other = (
        _search(CAMPAIGNS[0], replicates=99, seed=seed) for seed in (3, 3, 4)
    )
    assert found.p_value == again.p_value
    assert found.p_value != other.p_value


PLACES = {
    name: observe(samples).coordinates
    for name, samples in {
        "random 96": campaign(seed=1),
        "random 24": campaign(seed=2, n=24),
        "factorial 100": measure(factorial_points()),
        "five samples": campaign(seed=3, n=5),
    }.items()
}
stroke, _, load = PLACES["random 96"]


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES.keys())
def test_regions_differ_hold_enough_and_leave_enough_outside(place):
    boxes = candidate_regions(place)
    n, inside = place.shape[1], boxes.members.sum(axis=1)
    assert len({row.tobytes() for row in boxes.members}) == len(boxes) > 0
    least = 4 if n >= 32 else max(1, n // 8)
    assert inside.min() == least
    assert n - inside.max() >= least
    within = (place[None] >= boxes.low[..., None]) & (
        place[None] <= boxes.high[..., None]
    )
    np.testing.assert_array_equal(within.all(axis=1), boxes.members)


def test_how_many_there_are():
    assert [len(candidate_regions(place)) for place in PLACES.values()] == [
        1994,
        1034,
        525,
        25,
    ]


def test_an_axis_without_extent_gives_no_regions_of_its_own():
    boxes = candidate_regions(np.stack([stroke, np.full(96, 150.0), load]))
    assert len(boxes) > 0
    np.testing.assert_array_equal(boxes.low[:, 1], 150.0)
    np.testing.assert_array_equal(boxes.high[:, 1], 150.0)
    assert len(candidate_regions(np.ones((3, 12)))) == 0, "all samples at one point"


def test_regions_give_way_to_better_ones():
    members, everywhere = np.zeros((3, 12), bool), np.arange(12) < 8
    for row, (first, last) in zip(members, [(1, 7), (0, 4), (4, 8)], strict=True):
        row[first:last] = True
    assert sorted(covering(members, everywhere, 5)) == [1, 2], (
        "the first one alone is the best"
    )
    assert len(covering(members, everywhere, 1)) == 1


def test_smooth_functions_are_orthonormal_legendre_products():
    rng = np.random.default_rng(0)
    place = np.concatenate(
        [rng.uniform(2.0, 5.0, (2, 40_000)), [[2.0], [2.0]], [[5.0], [5.0]]], 1
    )
    smooth = SmoothFunctions(AXES[:2], dict(zip(NAMES, place, strict=True)))
    values = smooth.at_campaign
    assert smooth.degree.tolist() == [0] + [1] * 2 + [2] * 3 + [3] * 4
    np.testing.assert_allclose(values.T @ values / len(values), np.eye(10), atol=0.05)
    x = scaled_to_extent(place)[0]
    assert (x.min(), x.max()) == (-1.0, 1.0)
    (quadratic,) = np.flatnonzero((smooth.powers == [2, 0]).all(axis=1))
    np.testing.assert_allclose(
        values[:, quadratic], np.sqrt(5.0) * (1.5 * x**2 - 0.5), atol=1e-12
    )


def test_an_axis_that_is_only_recorded_takes_part_up_to_the_second_degree():
    place = np.random.default_rng(0).uniform(2.0, 5.0, (2, 9))
    recorded = replace(AXES[1], steered=False)
    smooth = SmoothFunctions((AXES[0], recorded), dict(zip(NAMES, place, strict=True)))
    with_it = smooth.powers[:, 1] > 0
    assert smooth.degree[with_it].tolist() == [1, 2, 2]
    assert smooth.degree[~with_it].tolist() == [0, 1, 2, 3]
    # Functions of one axis share an amplitude, and products another.
    assert smooth.family[smooth.powers.tolist().index([0, 2])] == 2
    assert smooth.family[smooth.powers.tolist().index([1, 1])] == 3


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))]
)
def test_a_few_speeds_far_beyond_their_meter_are_a_gap(seed):
    """Eight tests show no pattern, but no encoder scatters by a hundredth."""
    samples = campaign(seed=seed, n=8, noise=0.001, speed_noise=0.01)
    found = hmcvt.diagnose(BASE, samples, noise=0.001)
    assert found.verdict != "no_gap"
    assert any("output_speed scatters" in note for note in found.notes)
    usual = campaign(seed=seed, n=8, noise=0.001, speed_noise=0.001)
    assert hmcvt.diagnose(BASE, usual, noise=0.001).verdict == "no_gap"


@pytest.mark.long
def test_a_meter_far_off_is_said_first_where_there_is_no_gap():
    samples = campaign(seed=1, n=24, noise=0.001, speed_noise=0.01)
    found = hmcvt.diagnose(BASE, samples, noise=0.001)
    assert found.verdict == "no_gap"
    said = "The output speed scatters 10 times as much as its meter should: check that meter."
    assert found.report().startswith(said)
