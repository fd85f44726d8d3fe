# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A few points, one by one in plain floats, against the same points in a large array."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from core.made_up_stages import made_up_model
from hmcvt_core.transmission.stage import LAYOUTS

MANY = 500  # above what is solved point by point


def points(seed, count=MANY):
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-1.0, 1.0, count)
    load = rng.uniform(-300.0, 500.0, count)
    stroke[::11] = 0.0
    load[::7] = 0.0
    return stroke, rng.uniform(60.0, 250.0, count), load


def same_bits(ours, theirs):
    return np.array_equal(np.asarray(ours).view(np.int64), theirs.view(np.int64))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_few_points_are_those_of_a_large_array_bit_by_bit(layout):
    rng = np.random.default_rng(5)
    for seed in range(6):
        model = made_up_model(rng, layout)
        at = points(seed)
        for function in (model.efficiency, model.output_speed):
            whole = function(*at)
            for start in range(0, MANY, 50):
                part = [axis[start : start + 50] for axis in at]
                assert same_bits(function(*part), whole[start : start + 50])


@pytest.mark.parametrize("count", [1, 2, 7])
def test_every_form_of_a_few_points_gives_the_same(count):
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    stage = tractor.stages["HM2"]
    speed = np.linspace(100.0, 200.0, count).round()
    expected = stage.efficiency(np.full(MANY, 0.5), np.resize(speed, MANY), 150.0)
    expected = expected[:count]
    half = np.full(count, 0.5, dtype=np.float32)
    forms = [
        stage.efficiency(half, speed, 150.0),
        stage.efficiency(0.5, speed.astype(int), 150),
        stage.efficiency([0.5] * count, speed.tolist(), np.float64(150.0)),
        tractor.efficiency(0.5, speed, 150.0, stage="HM2"),
        tractor.efficiency(0.5, speed, 150.0, stage=["HM2"] * count),
        stage.efficiency(half.reshape(1, -1), speed.reshape(1, -1), 150.0)[0],
    ]
    for form in forms:
        assert same_bits(form, expected)


def test_few_points_of_several_stages():
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    names = ["HM1", "HM3", "H0"]
    at = [axis[:3] for axis in points(3)]
    expected = [
        tractor.stages[name].efficiency(*point)
        for name, point in zip(names, np.array(at).T.tolist(), strict=True)
    ]
    assert same_bits(tractor.efficiency(*at, stage=names), np.array(expected))
    with pytest.raises(hmcvt.InputError, match="HM9"):
        tractor.efficiency(*at, stage=["HM1", "HM9", "H0"])


@pytest.mark.parametrize("position", [0, 1, 2])
def test_a_value_out_of_range_is_named(position):
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    at = [[0.1, 0.2], [150.0, 160.0], [100.0, 120.0]]
    at[position][1] = 1e6
    with pytest.raises(hmcvt.InputError, match=r"\[1\] = 1e\+06 is outside"):
        model.efficiency(*at)


def test_strings_and_truth_values_are_refused_in_lists():
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    for wrong in (["0.3"], [True], "0.3", True):
        with pytest.raises(hmcvt.InputError, match="not a number"):
            model.efficiency(wrong, 150.0, 100.0)


def test_an_oil_temperature_without_an_effect_changes_nothing():
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    plain = model.efficiency(0.3, 150.0, 200.0)
    assert model.efficiency(0.3, 150.0, 200.0, 60.0) == plain
    with pytest.raises(hmcvt.InputError, match="oil_temperature"):
        model.efficiency(0.3, 150.0, 200.0, 1e4)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_breakdown_of_a_point_is_that_of_an_array(layout):
    rng = np.random.default_rng(8)
    compared = 0
    for seed in range(6):
        model = made_up_model(rng, layout)
        at = points(seed, 60)
        whole = model.breakdown(*at)
        for i, point in enumerate(np.array(at).T.tolist()):
            one = model.breakdown(*point)
            if not np.isfinite(whole.input_power[i]):
                assert np.isnan(one.input_power)
                continue
            scale = max(abs(one.input_power), abs(one.output_power), 1.0)
            scale = max(scale, *map(abs, one.losses.values()))
            for part, watts in one.losses.items():
                assert watts == pytest.approx(whole.losses[part][i], abs=1e-9 * scale)
            lost = one.input_power - one.output_power
            assert sum(one.losses.values()) == pytest.approx(lost, abs=1e-9 * scale)
            compared += 1
    assert compared > 100


def test_prediction_of_a_point_is_that_of_an_array():
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    at = points(4)
    whole = model.predict(*at)
    for i, point in enumerate(np.array(at).T[:100].tolist()):
        one = model.predict(*point)
        assert np.array_equal(one.efficiency, whole.efficiency[i], equal_nan=True)
        assert one.standard_error == pytest.approx(
            whole.standard_error[i], rel=1e-9, nan_ok=True
        )
        assert one.inside_domain == whole.inside_domain[i]
