# SPDX-License-Identifier: Apache-2.0
"""Regions of the working space: all different, none too small, narrow where the data allow."""

import numpy as np
import pytest

from hmcvt_core.diagnosis.regions import regions
from hmcvt_core.model.domain import AXES

from .campaigns import campaign, factorial_points, measure

CAMPAIGNS = {
    "random 96": campaign(seed=1),
    "random 24": campaign(seed=2, n=24),
    "factorial 100": measure(factorial_points()),
    "five samples": campaign(seed=3, n=5),
}
every_campaign = pytest.mark.parametrize("samples", CAMPAIGNS.values(), ids=CAMPAIGNS.keys())


def _overlap(boxes, wanted):
    """Best (common samples) / (samples in either) of any box with a planted set."""
    common = (boxes.members & wanted).sum(axis=1)
    return float((common / (boxes.members | wanted).sum(axis=1)).max())


@every_campaign
def test_no_two_regions_hold_the_same_samples(samples):
    boxes = regions(samples)
    assert len(boxes) > 0
    assert len({row.tobytes() for row in boxes.members}) == len(boxes)


@every_campaign
def test_regions_hold_enough_samples_and_leave_enough_outside(samples):
    boxes = regions(samples)
    inside = boxes.members.sum(axis=1)
    least = 4 if len(samples) >= 32 else max(1, len(samples) // 8)
    assert inside.min() >= least
    assert (len(samples) - inside).min() >= least
    assert inside.min() <= 2 * least, "narrow ones are there too"


@every_campaign
def test_limits_hold_exactly_the_members(samples):
    boxes = regions(samples)
    values = np.stack([getattr(samples, axis) for axis in AXES], axis=1)
    inside = ((values[None] >= boxes.low[:, None]) & (values[None] <= boxes.high[:, None])).all(2)
    np.testing.assert_array_equal(inside, boxes.members)


def test_a_narrow_band_of_engine_speed_is_among_them():
    samples = CAMPAIGNS["random 96"]
    speeds = np.sort(samples.engine_speed)
    for start in (5, 40, 80):
        band = (samples.engine_speed >= speeds[start]) & (samples.engine_speed <= speeds[start + 9])
        assert _overlap(regions(samples), band) >= 0.7


@pytest.mark.parametrize("axis", AXES)
def test_a_level_of_a_factorial_plan_is_a_region(axis):
    samples = CAMPAIGNS["factorial 100"]
    boxes = regions(samples)
    for level in np.unique(getattr(samples, axis)):
        assert _overlap(boxes, getattr(samples, axis) == level) == 1.0


@pytest.mark.parametrize("low", [0.0, 0.4])
def test_a_corner_is_among_them(low):
    samples = CAMPAIGNS["random 96"]
    corner = (samples.displacement_ratio > low) & (samples.engine_speed < 140.0)
    assert _overlap(regions(samples), corner) >= 0.65
    upper = (samples.displacement_ratio < -low) & (samples.load_torque > 300.0)
    assert _overlap(regions(samples), upper) >= 0.65


def test_a_constant_column_gives_no_regions_of_its_own():
    samples = CAMPAIGNS["random 96"]
    flat = type(samples)(samples.displacement_ratio, np.full(len(samples), 150.0),
                         samples.load_torque, samples.efficiency)
    boxes = regions(flat)
    assert len(boxes) > 0
    np.testing.assert_array_equal(boxes.low[:, 1], 150.0)
    np.testing.assert_array_equal(boxes.high[:, 1], 150.0)


def test_samples_all_at_one_point_have_no_regions():
    samples = CAMPAIGNS["random 96"]
    assert len(regions(samples.select(np.zeros(12, dtype=int)))) == 0
