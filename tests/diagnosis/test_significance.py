# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The search for a gap: p values that mean what they say."""

import numpy as np
import pytest
from scipy.stats import kstest

from hmcvt_core.diagnosis.regions import regions, significance

from .campaigns import NOISE, campaign, fitted

REPLICATES = 199
LEVEL = 0.05
CAMPAIGNS = [campaign(seed=1000 + seed, n=32) for seed in range(24)]


def _search(samples, stated=NOISE, replicates=REPLICATES, seed=0):
    known = fitted(samples, stated)
    return significance(known, regions(known.observed.place), seed, replicates)


@pytest.fixture(scope="module")
def without_gap():
    return np.array([_search(samples).p_value for samples in CAMPAIGNS])


def test_p_values_without_a_gap_are_uniform(without_gap):
    assert kstest(without_gap, "uniform", alternative="greater").pvalue > 0.01
    # At most 1 expected; 6 or more would come up once in 1000 times.
    assert np.sum(without_gap <= LEVEL) < 6


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_noise_stated_wrongly_raises_no_alarm(factor, without_gap):
    p = np.array([_search(samples, factor * NOISE).p_value for samples in CAMPAIGNS[::3]])
    assert np.sum(p <= LEVEL) < 3
    assert np.median(np.abs(p - without_gap[::3])) < 0.2, "nor does it hide much"


def test_a_loss_in_one_place_is_found_there():
    def loss(points):
        return 0.015 * (np.abs(points.engine_speed - 150.0) < 12.0)

    samples = campaign(seed=4, loss=loss)
    found = _search(samples)
    boxes = regions(fitted(samples).observed.place)
    assert found.p_value <= 0.02
    inside = np.abs(samples.engine_speed - 150.0) < 12.0
    common = (boxes.members & inside).sum(axis=1) / (boxes.members | inside).sum(axis=1)
    clear = found.region_p <= 0.02
    assert clear[np.argmax(common)]
    assert common[clear].mean() > 2.0 * common[~clear].mean()


def test_few_samples_far_off_the_noise_stated_are_a_gap():
    """Below sixteen samples the size of the scatter counts, believed as stated."""
    quiet = campaign(seed=6, n=8, speed_noise=None)
    assert _search(quiet).p_value > LEVEL
    loud = campaign(seed=6, n=8, speed_noise=None, noise=4.0 * NOISE)
    assert _search(loud).p_value <= LEVEL


def test_a_bench_twice_as_noisy_as_assumed_raises_no_alarm():
    """Few samples of which nobody stated the noise."""
    alarms = [_search(campaign(seed=500 + seed, n=8 + seed % 5, noise=0.016, speed_noise=None),
                      None, 99).p_value <= 0.02 for seed in range(12)]
    assert np.sum(alarms) <= 1


def test_the_p_values_follow_the_statistics_and_the_seed():
    found, again, other = (_search(CAMPAIGNS[0], replicates=99, seed=seed) for seed in (3, 3, 4))
    assert found.p_value == again.p_value
    np.testing.assert_array_equal(found.region_p, again.region_p)
    assert (found.region_p != other.region_p).any()
