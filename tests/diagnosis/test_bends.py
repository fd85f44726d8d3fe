# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Forms that miss: as another effect, or beyond their sources."""

from dataclasses import replace

import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.diagnosis.detection.regions import candidate_regions
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.diagnosis.selection.explanation import (
    explain,
    smooth_discrepancies,
    with_form_errors,
)
from hmcvt_core.diagnosis.selection.posterior import compute_posterior
from hmcvt_core.physics.effects.hydraulic import PressureLeakage, StrokeLeakage
from hmcvt_core.physics.effects.mechanical import Churning
from studies.blind.bench.judge import Case, draw, served
from studies.blind.bench.library import without_effects
from studies.blind.bench.properties import Bench

from .campaigns import BASE, campaign, fitted


def explained(effects, **bench):
    samples = campaign(effects, seed=1, **bench)
    observed = fitted(samples).observed
    return explain(refit(Hypothesis(Transmission(BASE), effects), observed))


def test_a_small_effect_may_be_a_bend_of_a_large_one():
    effects = (PressureLeakage(8e-11), StrokeLeakage(2e-12))
    both = explained(effects, speed_noise=None)
    bent = {item.form_error: item for item in with_form_errors(both)}
    assert bent.keys() == {"pressure_leakage", "stroke_leakage"}
    likely = bent["stroke_leakage"]
    assert likely.names == ("pressure_leakage",)
    assert likely.is_listed_set
    # The allowance holds the small one, and is far too narrow for the large one.
    assert likely.log_evidence > both.log_evidence - 3.0
    assert bent["pressure_leakage"].log_evidence < both.log_evidence - 20.0
    # The model that is served keeps both.
    assert len(likely.served_fit.effects) == 2


def test_beside_an_unlisted_loss_an_effect_may_be_a_bend_too():
    effects = (PressureLeakage(8e-11), StrokeLeakage(2e-12))
    extended = smooth_discrepancies(explained(effects, speed_noise=None))[0]
    bent = {item.form_error: item for item in with_form_errors(extended)}
    likely = bent["stroke_leakage"]
    assert likely.discrepancy is extended.discrepancy
    assert likely.names == ("pressure_leakage",)
    assert likely.log_evidence > extended.log_evidence - 3.0


@pytest.mark.long
def test_what_competes_with_an_unlisted_loss_competes_with_a_bend_of_its_set():
    effects = (PressureLeakage(8e-11), StrokeLeakage(2e-12))
    base = fitted(campaign(effects, seed=1, speed_noise=None))
    boxes = candidate_regions(base.observed.coordinates)
    entries = compute_posterior(base, boxes, seed=0).entries
    bent = [item for item, _ in entries if item.form_error]
    assert any(item.discrepancy is None for item in bent)
    assert any(item.discrepancy is not None for item in bent)


def test_a_torque_is_no_bend_of_a_leak_where_the_output_speed_tells():
    effects = (Churning(15.0), PressureLeakage(4e-11))
    assert with_form_errors(explained(effects)) == []
    assert len(with_form_errors(explained(effects, speed_noise=None))) == 2


def test_effect_without_a_size_has_no_bend():
    both = explained((PressureLeakage(8e-11), StrokeLeakage(2e-12)))
    fit = both.fit
    theta = fit.theta.copy()
    theta[fit.hypothesis.size_indices] = 0.0
    assert with_form_errors(replace(both, fit=replace(fit, theta=theta))) == []


@pytest.mark.long
def test_a_shape_that_would_have_to_leave_its_sources_is_another_form():
    """A relief valve that opens, where the library lacks it, is no leakage of a gap."""
    campaign, _ = draw(Case("unlisted", 303, Bench()))
    assert campaign.truth.names == ("relief_valve",)
    model, samples = served(campaign)
    with without_effects(campaign.truth.effects):
        found = hmcvt.diagnose(model, samples)
    assert found.verdict == "other_form"
    assert found.present[0].effects == ("pressure_leakage",)
    assert "in a form that is not in the library" in found.report()
    assert any("the readings ask for more" in note for note in found.notes)
