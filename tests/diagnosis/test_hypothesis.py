# SPDX-License-Identifier: Apache-2.0
"""Refits find the truth in exact data, and stay within their bounds."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core.diagnosis.hypothesis import (
    BASE_MEAN,
    Hypothesis,
    forms_of,
    linearise,
    predict,
    refit,
    to_base,
)
from hmcvt_core.diagnosis.observations import Observations
from hmcvt_core.physics.effects import library
from hmcvt_core.physics.effects.drag import ChargePump, Churning
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.physics.effects.sensor import EngineTorqueZero
from hmcvt_core.transmission.parameters import HydraulicParameters

from .campaigns import BASE, campaign

SMALL = 1e-5  # stated noise: small enough for priors not to matter
FORMS = [form for kind in library() for form in forms_of(kind)]


def _label(form):
    shapes = [f"{item.name}={form.values()[item.name]:g}" for item in form.parameters()
              if not item.is_size]
    return " ".join([form.name, form.form, *shapes]).replace("  ", " ")


def _typical(form):
    return form.with_values({item.name: item.typical for item in form.sizes()})


def _exact(effects, noise=SMALL, **plan):
    samples = campaign(effects, seed=5, n=40, noise=0.0, speed_noise=0.0, **plan)
    return Observations.of(samples, noise)


@pytest.mark.parametrize("speed", [0.0, None], ids=["output speed", "efficiency alone"])
def test_refit_finds_the_base_parameters(speed):
    observed = Observations.of(campaign(noise=0.0, speed_noise=speed), SMALL)
    found = refit(Hypothesis(BASE), observed, BASE_MEAN)
    np.testing.assert_allclose(found.base, to_base(BASE.parameters), rtol=1e-3)
    assert np.abs(found.whitened).max() < 0.1


@pytest.mark.parametrize("form", FORMS, ids=_label)
def test_refit_finds_every_effect(form):
    truth = _typical(form)
    observed = _exact([truth], temperature=True)
    found = refit(Hypothesis(BASE, (form,)), observed, BASE_MEAN, noise=np.ones(2), steps=60)
    np.testing.assert_allclose(found.sizes, [item.typical for item in form.sizes()], rtol=0.02)
    np.testing.assert_allclose(found.base, to_base(BASE.parameters), rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(found.nuisance, 0.0, atol=0.05)


def test_refit_finds_two_effects_together():
    truth = (ChargePump(6.0), PressureLeakage(2e-11))
    observed = _exact(truth)
    found = refit(Hypothesis(BASE, (ChargePump(), PressureLeakage())), observed, BASE_MEAN)
    np.testing.assert_allclose(found.sizes, [6.0, 2e-11], rtol=0.01)


def test_sizes_stay_within_their_bounds():
    # A meter that reads too little looks like a charge pump that gives torque.
    generous = _exact([EngineTorqueZero(-12.0)])
    below = refit(Hypothesis(BASE, (ChargePump(),)), generous, BASE_MEAN)
    assert below.sizes[0] == 0.0
    beyond = refit(Hypothesis(BASE, (ChargePump(),)), _exact([ChargePump(60.0)]), BASE_MEAN)
    limits = Hypothesis(BASE, (ChargePump(),)).size_limits[0]
    assert beyond.sizes[0] == pytest.approx(limits[1])


def test_base_parameters_stay_physical():
    # A meter that reads too little on top of a pump without damping: less than none is asked for.
    tight = replace(BASE, parameters=HydraulicParameters(2e-11, 0.12, 0.0),
                    effects=(EngineTorqueZero(-10.0),))
    samples = campaign(noise=0.0)
    readings = np.minimum(tight.efficiency_at(Observations.of(samples).points), 1.0)
    found = refit(Hypothesis(BASE), Observations.of(replace(samples, efficiency=readings), 0.003),
                  BASE_MEAN)
    assert found.base[2] == 0.0
    assert found.base[1] >= 0.0
    assert np.isfinite(found.objective)


@pytest.mark.parametrize("effects", [(), (Churning(),)], ids=["base", "churning"])
def test_refit_lowers_the_objective_and_the_jacobian_is_its_slope(effects):
    observed = Observations.of(campaign((Churning(8.0),), seed=2), 0.003)
    hypothesis = Hypothesis(BASE, effects)
    start = refit(hypothesis, observed, BASE_MEAN, noise=np.ones(2), steps=0)
    found = refit(hypothesis, observed, BASE_MEAN, noise=np.ones(2))
    assert found.objective < start.objective
    step = 1e-4 * np.array([1.0, 1.0, 1.0])
    moved = predict(hypothesis.model_at(found.base + step, found.sizes), observed.points, 2)
    here = predict(hypothesis.model_at(found.base, found.sizes), observed.points, 2)
    np.testing.assert_allclose((moved - here) / observed.scale, found.jacobian[..., :3] @ step,
                               atol=2e-3)


def test_linearise_at_the_same_points_gives_the_refit_again():
    observed = Observations.of(campaign((Churning(8.0),), seed=2), 0.003)
    hypothesis = Hypothesis(BASE, (Churning(),))
    found = refit(hypothesis, observed, to_base(BASE.parameters))
    whitened, jacobian = linearise(hypothesis, observed, found)
    # Nuisance columns are taken at the refit here, at the start there.
    np.testing.assert_allclose(whitened, found.whitened, atol=0.05)
    np.testing.assert_allclose(jacobian[..., [0, 1, 2, 5]], found.jacobian[..., [0, 1, 2, 5]],
                               rtol=1e-4, atol=1e-2)


def test_forms_hold_every_combination_of_shapes():
    for kind in library():
        grids = [item.grid for item in kind.parameters() if not item.is_size]
        forms = forms_of(kind)
        assert len(forms) == np.prod([len(grid) for grid in grids], dtype=int)
        assert len({tuple(form.values().items()) for form in forms}) == len(forms)
        assert all(form.values()[item.name] == 0.0 for form in forms for item in form.sizes())
