# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The model as users hold it: shapes, input checks, standard errors, domain, map."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.transmission.parameters import PARAMETER_NAMES
from hmcvt_core.transmission.ranges import OperatingPoints

POINT = (0.5, 150.0, 200.0)


def test_floats_give_floats_and_arrays_broadcast(model):
    assert isinstance(model.efficiency(*POINT), float)
    assert isinstance(model.output_speed(*POINT), float)
    stroke, speed = np.linspace(-1.0, 1.0, 5)[:, None], np.array([80.0, 150.0, 230.0])
    found = model.efficiency(stroke, speed, 100.0)
    alone = [[model.efficiency(each, w, 100.0) for w in speed] for each in stroke[:, 0]]
    np.testing.assert_allclose(found, alone, rtol=1e-13)
    watts = model.breakdown(stroke[:3], speed, 100.0)
    np.testing.assert_allclose(
        watts.output_power / watts.input_power, found[:3], rtol=1e-12
    )
    assert model.efficiency([0.0, 1.0], 100.0, 100.0).shape == (2,)
    assert {
        model.efficiency([], 100.0, 100.0, stage=none).shape for none in (None, [])
    } == {(0,)}


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (
            (1.3, 150.0, 200.0),
            r"displacement_ratio = 1\.3 is outside -1 to 1 \(a fraction of full",
        ),
        (
            (0.5, 1500.0, 200.0),
            r"engine_speed = 1500 is outside 10 to 320 rad/s \(is it in r/min\?\)",
        ),
        ((0.5, 150.0, -9e3), r"load_torque = -9000 is outside -5000 to 5000 N m"),
        (
            (math.nan, 150.0, 200.0),
            r"displacement_ratio = nan is not finite; allowed -1 to 1",
        ),
        (
            (0.5, math.inf, 200.0),
            r"engine_speed = inf is not finite; allowed 10 to 320 rad/s",
        ),
        ((0.5, 150.0, -math.inf), r"load_torque = -inf is not finite"),
        (([0.0, 0.1, 1.3], 150.0, 200.0), r"displacement_ratio\[2\] = 1\.3 is outside"),
        ((0.5, "fast", 200.0), r"engine_speed = 'fast' is not a number"),
        ((0.5, None, 200.0), r"engine_speed = nan is not finite"),
        (
            ([0.1, 0.2], [100.0, 110.0, 120.0], 200.0),
            r"shapes \(2,\), \(3,\), \(\) do not broadcast",
        ),
    ],
)
@pytest.mark.parametrize(
    "method", ["efficiency", "output_speed", "predict", "breakdown"]
)
def test_bad_points_are_named(model, method, point, message):
    with pytest.raises(hmcvt.InputError, match=message) as caught:
        getattr(model, method)(*point)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, 0.1, 0.1), "parameters: leakage = 0 is outside 1e-16 to 1e-08"),
        (
            (1e-11, -0.1, 0.1),
            "parameters: motor_damping = -0.1 is outside 0 to 10 N m s/rad",
        ),
        ((1e-11, 0.1, math.nan), "parameters: pump_damping = nan is not finite"),
    ],
)
def test_parameters_are_checked(values, message):
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.HydraulicParameters(*values)


def test_standard_error_is_the_propagated_covariance(model):
    """Against the spread of the efficiency under parameters drawn from that covariance."""
    small = {
        name: 0.02 * error for name, error in model.standard_errors.items()
    }  # linear range
    careful = replace(model, standard_errors=small)
    errors = np.array([small[name] for name in PARAMETER_NAMES])
    covariance = careful.correlation * np.outer(errors, errors)
    rng = np.random.default_rng(0)
    scale = np.diag(
        1.0 / errors
    )  # SVD of a matrix that spans twenty decades loses its small end
    drawn = (
        rng.multivariate_normal(np.zeros(3), scale @ covariance @ scale, size=4000)
        * errors
    )
    stroke = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    spread = np.std(
        model.efficiency_of_candidates(
            model.parameters.to_array() + drawn,
            OperatingPoints(stroke, np.full(5, 120.0), np.full(5, 180.0)),
        ),
        axis=0,
    )
    stated = careful.predict(stroke, 120.0, 180.0).standard_error
    # The spread of 4000 draws is known to 1.1 %; the band is five times that.
    np.testing.assert_allclose(stated, spread, rtol=0.055)


def test_prediction_at_a_point_is_that_of_arrays(model):
    for point in (
        POINT,
        (0.03, 80.0, 40.0),
        (-1.0, 230.0, 400.0),
        (-1.0, 20.0, 5000.0),
    ):
        alone, among = model.predict(*point), model.predict([point[0]], *point[1:])
        assert alone.efficiency == pytest.approx(
            among.efficiency[0], rel=1e-12, nan_ok=True
        )
        assert alone.standard_error == pytest.approx(
            among.standard_error[0], rel=1e-6, nan_ok=True
        )
        assert alone.inside_domain == among.inside_domain[0]


@pytest.mark.parametrize("name", ["motor_damping", "pump_damping"])
def test_standard_error_at_the_end_of_a_permitted_range(model, name):
    top = replace(model, parameters=replace(model.parameters, **{name: 10.0}))
    below = replace(model, parameters=replace(model.parameters, **{name: 9.999}))
    point = (0.5, 150.0, 600.0)
    assert top.predict(*point).standard_error == pytest.approx(
        below.predict(*point).standard_error, rel=1e-2
    )


def test_published_formulas_state_no_error_at_zero_stroke(fitted_published):
    found = fitted_published.model.predict([0.0, 0.6], 126.19, 340.76)
    assert np.isfinite(found.efficiency).all()
    assert np.isnan(found.standard_error[0]) and found.standard_error[1] > 0.0


def test_prediction_says_whether_the_data_cover_the_point(model):
    # Box of tests 1, 2, 4, 5, 6: eps -1..1, 78.54..146.61 rad/s, 101.86..292.85 N m.
    inside = model.predict(
        [-1.0, 1.0, 0.0, 0.0],
        [78.54, 146.61, 100.0, 100.0],
        [101.86, 292.85, 100.0, 300.0],
    ).inside_domain
    np.testing.assert_array_equal(inside, [True, True, False, False])
    found = model.predict(0.0, 100.0, 200.0)
    assert found.inside_domain is True
    assert found.efficiency == model.efficiency(0.0, 100.0, 200.0)
    assert found.standard_error > 0.0
    bare = hmcvt.EfficiencyModel(model.stage, model.parameters).predict(
        0.0, 100.0, 200.0
    )
    assert math.isnan(bare.standard_error) and bare.inside_domain is False


def test_data_cover_a_range_of_oil_temperatures_where_an_effect_reads_it(model):
    domain = replace(model.domain, oil_temperature=(70.0, 90.0))
    oily = replace(model, effects=(OilTemperature(1.0),), domain=domain)
    point = (0.5, 100.0, 200.0)
    for temperature, inside in ((70.0, True), (80, True), (35.0, False), (95.0, False)):
        assert oily.predict(*point, temperature).inside_domain is inside
        assert bool(oily.departures(*point, temperature)) is not inside
    found = oily.predict(*point, [80.0, 35.0]).inside_domain
    np.testing.assert_array_equal(found, [True, False])
    # Without an oil temperature the answer is for 60 deg C.
    assert oily.predict(*point).inside_domain is False
    assert oily.departures(*point) == [
        "oil_temperature 60 deg C is not in 70 to 90 deg C"
    ]
    assert not oily.efficiency_map([0.5], [100.0], [200.0]).inside_domain.any()
    # A model that does not read it, and one that does not know its range.
    for unaffected in (replace(oily, effects=()), replace(oily, domain=model.domain)):
        assert unaffected.predict(*point, 20.0).inside_domain is True
        assert unaffected.predict(*point, [20.0]).inside_domain.all()
        assert unaffected.departures(*point, 20.0) == []


def test_fingerprint_follows_the_physics(model, hm4):
    bare = hmcvt.EfficiencyModel(model.stage, model.parameters)
    assert bare.fingerprint == model.fingerprint
    other = replace(
        model.parameters, pump_damping=model.parameters.pump_damping * 1.001
    )
    assert replace(bare, parameters=other).fingerprint != model.fingerprint
    assert (
        replace(bare, stage=hm4.with_gear_efficiency(0.97)).fingerprint
        != model.fingerprint
    )


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (([], [100.0], [100.0]), r"map axis displacement_ratio has shape \(0,\)"),
        (([0.0], [[100.0]], [100.0]), r"map axis engine_speed has shape \(1, 1\)"),
        (([0.0], [100.0], [9999.0]), r"load_torque\[0\] = 9999 is outside"),
    ],
)
def test_map_axes_are_checked(model, axes, message):
    with pytest.raises(hmcvt.InputError, match=message):
        model.efficiency_map(*axes)


@pytest.mark.parametrize("low", [2.0, math.nan])
def test_domain_is_checked(low):
    message = rf"domain\.engine_speed = \[{low}, 1\.0\]: needs two rising numbers"
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.Domain((-1.0, 1.0), (low, 1.0), (1.0, 2.0))


def test_a_breakdown_reports_its_stage(model):
    watts = model.breakdown(*POINT)
    lines = watts.report().splitlines()
    assert lines[0] == "stage HM4"
    assert lines[1].split() == [
        "from",
        "the",
        "engine",
        f"{watts.input_power:.0f}",
        "W",
    ]
    data = json.loads(json.dumps(watts.to_dict(), allow_nan=False))
    assert data["stage"] == "HM4"
    assert sum(data["losses"].values()) == pytest.approx(model.power_loss(*POINT))
    axes = watts.plot().axes[0]
    assert axes.get_title(loc="left") == "Where the power goes, stage HM4"
    assert len(axes.patches) == len(watts.losses)


def test_a_breakdown_of_points_reports_the_mean_of_those_with_an_answer(model):
    watts = model.breakdown([0.5, 0.5, 0.01], 100.0, [100.0, 200.0, 5000.0])
    assert np.isnan(watts.input_power[2])
    mean = np.mean(watts.losses["leakage"][:2])
    assert watts.mean_losses()["leakage"] == pytest.approx(mean)
    assert watts.report().startswith("stage HM4, mean of 2 of 3 points\n")
    assert watts.to_dict()["input_power"][2] is None
    unanswered = model.breakdown(0.01, 100.0, 5000.0)
    assert unanswered.report() == "stage HM4: no answer"


def test_a_domain_reports_its_axes():
    domain = hmcvt.Domain((-1.0, 1.0), (80.0, 230.0), (10.0, 20.0))
    assert domain.report().splitlines() == [
        "displacement ratio -1 to 1",
        "engine speed       80 to 230 rad/s",
        "load torque        10 to 20 N m",
    ]
    oil = replace(domain, oil_temperature=(40.0, 90.0))
    assert oil.report().splitlines()[3:] == ["oil temperature    40 to 90 deg C"]
