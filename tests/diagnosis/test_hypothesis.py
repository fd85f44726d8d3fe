# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Refits find the truth in exact data, and stay within their bounds."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core.benches.transmission import CHANNELS, Transmission, observe
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import linearise, refit, with_free_shapes
from hmcvt_core.diagnosis.system import forms_of
from hmcvt_core.physics.effects.hydraulic import PistonLeakage
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning, GearMesh
from hmcvt_core.physics.effects.sensor import EngineTorqueZero
from hmcvt_core.transmission.parameters import HydraulicParameters, to_scaled

from .campaigns import BASE, campaign, fitted, with_column

SYSTEM = Transmission(BASE)
TRUE = to_scaled(BASE.parameters.to_array())
SMALL = 1e-5  # stated noise: small enough for priors not to matter
KINDS = {
    f"{kind.name} {kind.form}".strip(): forms_of(kind)
    for kind in SYSTEM.library
    if kind.name != "pressure_sensor"
}  # where it is read: test_pressure.py


def _typical(form):
    return form.with_values({item.name: item.typical for item in form.sizes()})


def _exact(effects, noise=SMALL, n=40, **plan):
    return observe(
        campaign(effects, seed=5, n=n, noise=0.0, speed_noise=0.0, **plan), noise
    )


def _shows(form):
    with_form = _exact([_typical(form)], temperature=True)
    without = _exact([], temperature=True)
    if len(with_form) < len(without):
        return True
    return np.abs(with_form.measured - without.measured).max() > 100.0 * SMALL


@pytest.mark.parametrize("name", KINDS)
def test_refit_finds_every_effect(name):
    # A form whose threshold no test reaches shows nothing.
    forms = [form for form in KINDS[name] if _shows(form)]
    for form in forms[:: max(1, len(forms) - 1)][:2]:
        observed = _exact([_typical(form)], temperature=True)
        found = refit(Hypothesis(SYSTEM, (form,)), observed)
        np.testing.assert_allclose(found.sizes, 1.0, rtol=0.02)
        np.testing.assert_allclose(found.base, [*TRUE, 0.0], rtol=0.01, atol=2e-2)
        assert found.effects[0].values() == pytest.approx(
            _typical(form).values(), rel=0.02
        )


def test_shapes_are_fitted_between_the_values_of_their_grid():
    truth = GearMesh(0.006, load_exponent=0.5, speed_exponent=0.2)
    start = refit(
        Hypothesis(SYSTEM, (ChargePump(), GearMesh())), _exact([ChargePump(4.0), truth])
    )
    found = with_free_shapes(start)
    assert found.effects[1].values() == pytest.approx(truth.values(), rel=0.05)
    assert found.sizes == pytest.approx([1.0, 1.5], rel=0.05)
    beyond = with_free_shapes(
        refit(Hypothesis(SYSTEM, (Churning(),)), _exact([Churning(8.0, exponent=3.0)]))
    )
    assert beyond.effects[0].exponent == 2.0
    pistons = with_free_shapes(
        refit(
            Hypothesis(SYSTEM, (PistonLeakage(motor_part=1.0),)),
            _exact([PistonLeakage(3e-11, motor_part=0.0)]),
        )
    )
    assert pistons.effects[0].motor_part == 1.0  # a switch
    again = with_free_shapes(found)
    np.testing.assert_allclose(again.theta, found.theta, rtol=1e-2, atol=1e-4)


def test_sizes_stay_within_their_bounds():
    # A meter that reads too little looks like a charge pump that gives torque.
    hypothesis = Hypothesis(SYSTEM, (ChargePump(),))
    below = refit(hypothesis, _exact([EngineTorqueZero(-12.0)]))
    assert below.sizes[0] == 0.0
    alone = refit(Hypothesis(SYSTEM), _exact([EngineTorqueZero(-12.0)]))
    np.testing.assert_allclose(below.base, alone.base, rtol=2e-2)
    beyond = refit(hypothesis, _exact([ChargePump(60.0)]))
    (limit,) = ChargePump.sizes()
    assert beyond.effects[0].torque == pytest.approx(limit.high)


def test_base_parameters_stay_physical():
    # A meter that reads too little on top of a pump without damping: less than none is asked for.
    tight = replace(
        BASE,
        parameters=HydraulicParameters(2e-11, 0.12, 0.0),
        effects=(EngineTorqueZero(-10.0),),
    )
    samples = campaign(noise=0.0)
    readings = np.minimum(
        tight.efficiency(
            samples.displacement_ratio, samples.engine_speed, samples.load_torque
        ),
        1.0,
    )
    found = refit(
        Hypothesis(SYSTEM), observe(replace(samples, efficiency=readings), 0.003)
    )
    assert found.base[2] == 0.0
    assert found.base[1] >= 0.0


def test_a_refit_is_where_the_penalised_squares_are_least_and_its_jacobian_their_slope():
    observed = observe(campaign((Churning(8.0),), seed=2, n=40), 0.003)
    hypothesis = Hypothesis(SYSTEM, (Churning(),))
    found = refit(hypothesis, observed)
    away = found.theta - hypothesis.prior_mean
    slope = np.einsum("cn,cnp,c->p", found.whitened, found.jacobian, 1.0 / found.noise)
    slope[:4] -= away[:4] / SYSTEM.base.spread**2
    curvature = np.einsum(
        "cnp,cnp,c->p", found.jacobian, found.jacobian, 1.0 / found.noise
    )
    assert np.abs(slope / np.sqrt(curvature + 1.0)).max() < 0.05, (
        "standard deviations off"
    )
    prior_dof, squares = observed.prior_dof, np.sum(found.whitened**2, axis=1)
    np.testing.assert_allclose(
        found.noise, (prior_dof + squares) / (prior_dof + 40 - 5 / 2), rtol=2e-2
    )
    step = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3])
    moved, here = (
        hypothesis.predict(theta, observed.points, observed.channels)
        for theta in (found.theta + step, found.theta)
    )
    change = (moved - here) / observed.deviation
    np.testing.assert_allclose(change, found.jacobian @ step, atol=2e-3)
    np.testing.assert_allclose(found.target, found.whitened + found.jacobian @ away)
    there = linearise(hypothesis, observed, found.theta, found.noise)
    np.testing.assert_array_equal(there.whitened, found.whitened)
    scale = np.abs(there.jacobian).max()
    np.testing.assert_allclose(there.jacobian, found.jacobian, atol=2e-3 * scale)


def test_gears_are_known_within_a_tolerance_as_are_gauges_where_they_are_read():
    observed = _exact((), noise=0.003)
    worse, here = (
        SYSTEM.predict(np.append(TRUE, loss), (), observed.points) for loss in (1.0, 0)
    )
    lost = 1.0 - worse[0] / here[0]  # over two to five pairs in a path
    assert (lost > 0.0006 * 2).all() and (lost < 0.0006 * 5).all()
    gauged = Transmission(BASE, ["pressure"])
    assert gauged.base.names[3:] == ("gear_loss", "pressure_gain", "pressure_zero")
    off = gauged.predict(np.array([*TRUE, 0.0, 2.0, 1.0]), (), observed.points)
    np.testing.assert_allclose(off[2], 1.02 * here[2] + 1e5)
    np.testing.assert_array_equal(off[:2], here[:2])


def test_readings_turn_where_the_motor_comes_to_rest():
    stroke = np.linspace(-0.9, 0.9, 181)
    points = {
        "displacement_ratio": stroke,
        "engine_speed": np.full(181, 150.0),
        "load_torque": np.full(181, 300.0),
    }
    hypothesis, theta = Hypothesis(SYSTEM), np.append(TRUE, 0.0)
    _, speed, pressure, *_ = here = hypothesis.predict(theta, points)
    turning = hypothesis.local_variation(theta, points, CHANNELS, here)
    assert (turning[0] == 0.0).all()  # the noise of what is served is as stated
    standing = np.abs(speed / 150.0 - BASE.stage.mechanical_speed_ratio) < 0.005
    assert (
        standing.any() and turning[2][standing].max() > 0.005 * pressure[standing].max()
    )
    assert (
        turning[2][np.abs(stroke - stroke[standing].mean()) > 0.1] < 1e-3 * 2e7
    ).all()


def test_what_is_handed_over_meets_what_is_served():
    # Speed and efficiency ask for different leakages; the likeliest refit gives one of them up.
    samples, leaky = campaign(seed=2, n=40), HydraulicParameters(2.6e-11, 0.12, 0.2)
    fit = fitted(
        with_column(
            samples,
            efficiency=replace(BASE, parameters=leaky).efficiency(
                samples.displacement_ratio, samples.engine_speed, samples.load_torque
            ),
        ),
        0.001,
    )
    likeliest, served = (
        np.mean(each.whitened**2, axis=1) for each in (fit, fit.served_fit(np.ones(2)))
    )
    assert likeliest[1] < 1.5 and served[0] < 0.3 * likeliest[0]


def test_effects_with_the_wrong_sign_are_refitted_below_zero():
    hypothesis = Hypothesis(SYSTEM, (Churning(),), reversed_sign=True)
    observed = observe(campaign((Churning(-8.0),), seed=2), 0.003)
    assert refit(hypothesis, observed).effects[0].torque == pytest.approx(-8.0, rel=0.2)
    np.testing.assert_array_equal(hypothesis.signs, [np.nan] * 4 + [-1.0])


def test_jacobian_of_a_rough_refit_is_exact():
    effects = (ChargePump(torque=20.0), PistonLeakage())
    observed = observe(campaign(effects, n=40, seed=6), 0.004)
    hypothesis = Hypothesis(Transmission(BASE), effects)
    start = refit(hypothesis, observed, rough=True)
    moved = np.append(start.theta[:-1], 0.0)
    rough = refit(hypothesis, observed, moved, start.jacobian, rough=True)
    exact = linearise(hypothesis, observed, rough.theta, rough.noise)
    np.testing.assert_array_equal(rough.jacobian, exact.jacobian)
