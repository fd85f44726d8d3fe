# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Regions: where the estimated gap is large and certain."""

import numpy as np
import pytest
from core.test_several_stages import TRACTOR, bench

import hmcvt_core as hmcvt
from diagnosis.test_diagnose import AXES, CASES, diagnosed
from hmcvt_core.diagnosis.detection.regions import (
    Settings,
    candidate_regions,
    covering_boxes,
)
from hmcvt_core.diagnosis.settings import (
    MIN_REGION_FRACTION,
    REGION_SAMPLES,
    REGION_SIGNIFICANCE,
)

NOISE = 0.002
NO_SETTINGS = Settings(np.empty((0, 96), dtype=bool), ())


def inside(region, samples):
    """Return which samples a region holds."""
    held = np.ones(len(samples), dtype=bool)
    for axis in AXES:
        low, high = region.limits[axis]
        values = getattr(samples, axis)
        held &= (low <= values) & (values <= high)
    if "stage" in region.setting:
        held &= np.array(samples.extra["stage"]) == region.setting["stage"]
    return held


@pytest.mark.parametrize("name", CASES)
def test_regions_are_certain_and_large(name):
    found = diagnosed(name)
    means = [abs(region.mean_residual) for region in found.where]
    for region in found.where:
        assert region.p_value <= REGION_SIGNIFICANCE
        assert abs(region.mean_residual) >= MIN_REGION_FRACTION * max(means)
        assert abs(region.mean_residual) >= 1e-3, "0.1 points"
        assert region.samples >= REGION_SAMPLES
        assert region.samples == inside(region, found.samples).sum()
    assert (found.significant_region is None) == (found.where == ())


def test_mean_of_a_region_is_that_of_the_field():
    found = diagnosed("planetary mesh")
    region = found.where[0]
    held = inside(region, found.samples)
    point = [getattr(found.samples, axis)[held] for axis in AXES]
    mean, _ = found.gap_at(*point)
    assert region.mean_residual == pytest.approx(mean.mean(), rel=0.1)


def test_a_loss_in_one_stage_names_it():
    samples = bench(("HM1", "HM4"), 48, 1, noise=NOISE)
    stages = np.array(samples.extra["stage"])
    at_load = samples.load_torque > 200.0
    loss = 0.012 * ((stages == "HM4") & at_load)
    lossy = hmcvt.BenchSamples(
        samples.displacement_ratio,
        samples.engine_speed,
        samples.load_torque,
        samples.efficiency - loss,
        efficiency_std=samples.efficiency_std,
        extra=samples.extra,
    )
    found = hmcvt.diagnose(TRACTOR, lossy)
    first = found.where[0]
    assert first.setting == {"stage": "HM4"}
    assert first.mean_residual < -0.006
    held = inside(first, lossy)
    assert np.mean(held[loss > 0.0]) > 0.8
    assert found.to_dict()["where"][0]["stage"] == "HM4"


def corner(coordinates):
    return (coordinates[0] > 0.3) & (coordinates[1] < 0.45)


def random_coordinates(seed):
    return np.random.default_rng(seed).uniform(size=(2, 96))


def test_limits_move_to_the_target():
    coordinates = random_coordinates(1)
    target = corner(coordinates)
    boxes = candidate_regions(coordinates)
    (box,) = covering_boxes(coordinates, boxes, target, 5, NO_SETTINGS)
    held = box.members
    assert 2.0 * np.sum(held & target) / (held.sum() + target.sum()) > 0.95


def test_a_box_is_limited_to_a_setting():
    coordinates = random_coordinates(2)
    first = np.arange(96) < 48
    settings = Settings(np.stack([first, ~first]), (("gear", "1"), ("gear", "2")))
    target = corner(coordinates) & ~first
    boxes = candidate_regions(coordinates)
    (box,) = covering_boxes(coordinates, boxes, target, 5, settings)
    assert box.setting == {"gear": "2"}
    assert not (box.members & first).any()


def test_no_target_needs_no_box():
    coordinates = random_coordinates(3)
    nothing = np.zeros(96, dtype=bool)
    boxes = candidate_regions(coordinates)
    assert covering_boxes(coordinates, boxes, nothing, 5, NO_SETTINGS) == []


def test_last_digits_of_a_grid_give_no_further_edges():
    grid = np.stack(
        [row.ravel() for row in np.meshgrid(np.arange(5.0), np.arange(4.0))]
    )
    noise = 1e-9 * np.random.default_rng(0).standard_normal((2, 5, 20))
    repeated = np.tile(grid, 5)
    shaken = repeated * (1.0 + noise.reshape(2, -1))
    exact = candidate_regions(repeated)
    np.testing.assert_array_equal(candidate_regions(shaken).members, exact.members)
