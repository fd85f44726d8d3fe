# SPDX-License-Identifier: Apache-2.0
"""Samples held out: their own noise, what does not count, and the model that is measured."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.intake import admitted
from hmcvt_core.diagnosis.procedure import _Assembly, _significance
from hmcvt_core.diagnosis.ranking import rank, single_candidates
from hmcvt_core.diagnosis.regions import regions
from hmcvt_core.physics.effects.drag import ChargePump
from hmcvt_core.physics.effects.gears import PlanetaryMesh

from .campaigns import BASE, NOISE, campaign, joined, with_column

SAMPLES = campaign(seed=1)


def test_a_noisier_holdout_is_no_gap():
    loud = 5.0 * NOISE
    held = campaign(seed=31, n=400, noise=loud)
    stated = with_column(held, efficiency_std=np.full(400, loud))
    found = hmcvt.diagnose(BASE, SAMPLES, stated, noise=NOISE)
    assert found.shrinkage.before < 0.4 * loud
    unstated = hmcvt.diagnose(BASE, SAMPLES, held, noise=NOISE)
    assert unstated.shrinkage.before > 0.8 * loud, "taken to be as quiet as the campaign"


def test_repeated_points_state_the_noise_of_the_holdout():
    held = campaign(seed=32, n=20, noise=0.0).select(np.repeat(np.arange(20), 4))
    loud = 5.0 * NOISE * np.random.default_rng(3).standard_normal(80)
    found = hmcvt.diagnose(BASE, SAMPLES, with_column(held, efficiency=held.efficiency + loud),
                           noise=NOISE)
    assert found.shrinkage.before < 0.4 * 5.0 * NOISE


def test_the_campaign_is_no_holdout_of_its_own():
    with pytest.raises(hmcvt.InputError, match="among those diagnosed"):
        hmcvt.diagnose(BASE, SAMPLES, SAMPLES, noise=NOISE)


def test_samples_seen_before_are_left_out_and_counted():
    held = joined(SAMPLES.select(np.arange(10)), campaign(seed=33, n=30))
    found = hmcvt.diagnose(BASE, SAMPLES, held, noise=NOISE)
    assert len(found.residuals_before) == 30
    assert any("10 of 40 samples held out" in note for note in found.notes)


def test_samples_that_stall_are_reported():
    held = campaign(seed=34, n=30)
    load = np.where(np.arange(30) < 2, 4900.0, held.load_torque)
    found = hmcvt.diagnose(BASE, SAMPLES, with_column(held, load_torque=load), noise=NOISE)
    assert len(found.residuals_before) == 28
    assert any("2 of 30 samples held out" in note and "sample 1 (" in note
               for note in found.notes)


def test_the_model_measured_is_the_model_saved():
    """Even where the first cause by probability is not part of the likeliest candidate."""
    samples, held = campaign((PlanetaryMesh(0.06),), seed=1), campaign((ChargePump(8.0),), seed=35)
    bench, notes = admitted(BASE, samples, NOISE)
    boxes = regions(bench.observed.samples)
    found = _significance(bench, boxes, 0)
    ranking = rank(bench, boxes, single_candidates(bench), paired=False)
    other = next(item for item in ranking.singles if item.names != ranking.leading.names)
    result = _Assembly(bench, boxes, found, True, replace(ranking, leading=other), held, 0,
                       notes).diagnosis()
    saved = result.causes[0].model
    assert saved.effects[0].name == "planetary_mesh"
    errors = held.efficiency - saved.efficiency(
        held.displacement_ratio, held.engine_speed, held.load_torque)
    np.testing.assert_allclose(result.residuals_after, errors[np.isfinite(errors)], atol=1e-12)
