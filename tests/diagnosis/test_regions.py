# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Regions of the working space: all different, none too small, narrow where the data allow."""

import numpy as np
import pytest

from hmcvt_core.benches.transmission import observe
from hmcvt_core.diagnosis.observations import scaled_to_extent, smooth_functions
from hmcvt_core.diagnosis.regions import regions

from .campaigns import campaign, factorial_points, measure

CAMPAIGNS = {name: observe(samples).place for name, samples in {
    "random 96": campaign(seed=1),
    "random 24": campaign(seed=2, n=24),
    "factorial 100": measure(factorial_points()),
    "five samples": campaign(seed=3, n=5),
}.items()}
stroke, _, load = CAMPAIGNS["random 96"]


@pytest.mark.parametrize("place", CAMPAIGNS.values(), ids=CAMPAIGNS.keys())
def test_regions_differ_hold_enough_and_leave_enough_outside(place):
    boxes = regions(place)
    n, inside = place.shape[1], boxes.members.sum(axis=1)
    assert len({row.tobytes() for row in boxes.members}) == len(boxes) > 0
    least = 4 if n >= 32 else max(1, n // 8)
    assert inside.min() == least
    assert n - inside.max() >= least
    within = (place[None] >= boxes.low[..., None]) & (place[None] <= boxes.high[..., None])
    np.testing.assert_array_equal(within.all(axis=1), boxes.members)


def test_how_many_there_are():
    assert [len(regions(place)) for place in CAMPAIGNS.values()] == [1994, 1034, 525, 25]


def test_an_axis_without_extent_gives_no_regions_of_its_own():
    boxes = regions(np.stack([stroke, np.full(96, 150.0), load]))
    assert len(boxes) > 0
    np.testing.assert_array_equal(boxes.low[:, 1], 150.0)
    np.testing.assert_array_equal(boxes.high[:, 1], 150.0)
    assert len(regions(np.ones((3, 12)))) == 0, "all samples at one point"


def test_smooth_functions_are_orthonormal_legendre_products():
    rng = np.random.default_rng(0)
    place = np.concatenate([rng.uniform(2.0, 5.0, (2, 40_000)), [[2.0], [2.0]], [[5.0], [5.0]]], 1)
    values, degree = smooth_functions(place, 2)
    assert degree.tolist() == [0, 1, 1, 2, 2, 2]
    np.testing.assert_allclose(values.T @ values / len(values), np.eye(6), atol=0.05)
    x = scaled_to_extent(place)[0]
    assert (x.min(), x.max()) == (-1.0, 1.0)
    np.testing.assert_allclose(values[:, -1], np.sqrt(5.0) * (1.5 * x**2 - 0.5), atol=1e-12)
