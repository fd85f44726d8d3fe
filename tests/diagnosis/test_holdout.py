# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Samples held out: their own noise, what does not count, and the model that is measured."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import PlanetaryMesh

from .campaigns import BASE, NOISE, campaign, joined, with_column

SAMPLES = campaign(seed=1, n=16)


@pytest.mark.long
def test_a_noisier_holdout_is_no_gap():
    loud = 5.0 * NOISE
    held = campaign(seed=31, n=200, noise=loud)
    stated = with_column(held, efficiency_std=np.full(200, loud))
    found = hmcvt.diagnose(BASE, SAMPLES, stated, noise=NOISE)
    assert found.shrinkage.before < 0.4 * loud
    unstated = hmcvt.diagnose(BASE, SAMPLES, held, noise=NOISE)
    assert unstated.shrinkage.before > 0.8 * loud, (
        "taken to be as quiet as the campaign"
    )


STALLED = hmcvt.BenchSamples(
    np.full(3, 1.0), np.full(3, 80.0), np.full(3, 4900.0), np.full(3, 0.5)
)
WARM = with_column(SAMPLES, oil_temperature=np.linspace(40.0, 80.0, 16))


@pytest.mark.parametrize(
    ("samples", "held", "message"),
    [
        (SAMPLES, SAMPLES, "among those diagnosed"),
        (SAMPLES, STALLED, r"no answer at any .* held out"),
        (WARM, campaign(seed=22, n=8), r"oil_temperature is missing; .* has it"),
    ],
    ids=["the campaign itself", "no answer at any", "without oil temperature"],
)
def test_refused_holdouts(samples, held, message):
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.diagnose(BASE, samples, held, noise=NOISE)


def test_samples_left_out_of_a_holdout():
    held = joined(
        SAMPLES.select(np.arange(10)), campaign(seed=34, n=30).select(np.arange(3))
    )
    load = np.where(np.arange(13) // 2 == 5, 4900.0, held.load_torque)
    found = hmcvt.diagnose(
        BASE, SAMPLES, with_column(held, load_torque=load), noise=NOISE
    )
    assert any("10 of 13 held-out samples are among" in note for note in found.notes)
    assert any(
        "2 of 3 held-out samples ask" in note and "sample 11 (" in note
        for note in found.notes
    )
    shrunk = found.shrinkage
    assert (found.verdict, shrunk.on, shrunk.fraction) == ("no_gap", "holdout", None)
    assert len(found.residuals_before) == 1, "and it is enough"
    np.testing.assert_array_equal(found.residuals_before, found.residuals_after)


def test_the_model_measured_is_the_model_saved():
    mesh = (PlanetaryMesh(0.06),)
    held = campaign(mesh, seed=21, n=30)
    found = hmcvt.diagnose(BASE, campaign(mesh, seed=1, n=48), held, noise=NOISE)
    assert found.model.effects[0].name == "planetary_mesh"
    assert found.shrinkage.on == "holdout"
    assert found.shrinkage.fraction > 0.85
    for errors, model in (
        (found.residuals_before, found.base),
        (found.residuals_after, found.model),
    ):
        np.testing.assert_allclose(
            errors,
            held.efficiency
            - model.efficiency(
                held.displacement_ratio, held.engine_speed, held.load_torque
            ),
            atol=1e-12,
        )
    text = found.report().replace("\n", " ")
    assert "On the holdout, with planetary mesh added," in text
