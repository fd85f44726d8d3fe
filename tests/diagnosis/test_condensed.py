# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Large campaigns: neighbouring samples are weighed as their means, and the answer stays."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.cells import condensed, neighbourhoods
from hmcvt_core.diagnosis.intake import admitted
from hmcvt_core.diagnosis.observations import LARGE
from hmcvt_core.diagnosis.regions import regions
from hmcvt_core.diagnosis.significance import significance
from hmcvt_core.physics.effects.mechanical import ChargePump
from tests.diagnosis.campaigns import BASE, NOISE, campaign, fitted, with_column

BIG = campaign((ChargePump(8.0),), seed=3, n=4000)


def test_cells_are_small_and_hold_repeated_points_together():
    cell = neighbourhoods(observe(BIG), LARGE)
    cells = len(np.bincount(cell))
    assert 0.9 * LARGE < cells <= LARGE
    for name in ("displacement_ratio", "engine_speed", "load_torque"):
        row = getattr(BIG, name)
        width = max(np.ptp(row[cell == i]) for i in range(cells))
        assert width < 0.1 * np.ptp(row)
    dwelt = BIG.select(np.repeat(np.arange(30), 50))
    assert len(np.bincount(neighbourhoods(observe(dwelt), LARGE))) == 30


def test_means_keep_what_the_samples_say():
    fit = fitted(BIG)
    means = condensed(fit)
    assert len(means) == len(np.bincount(neighbourhoods(fit.observed, LARGE)))
    assert means.count.sum() == len(BIG)
    assert (means.whole is fit.observed, len(means.samples)) == (True, len(BIG))
    single = means.scale[0] * np.sqrt(means.count)
    np.testing.assert_allclose(single, NOISE, rtol=0.05)
    own = BIG.efficiency - fit.hypothesis.predict(fit.theta, fit.observed.points)[0]
    there = fit.hypothesis.predict(fit.theta, means.points)[0]
    np.testing.assert_allclose(means.at_samples(means.readings[0].measured - there), own, atol=1e-9)


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_scatter_of_neighbours_corrects_a_wrong_statement_of_the_noise(factor):
    means = condensed(fitted(BIG, factor * NOISE))
    np.testing.assert_allclose(means.scale[0] * np.sqrt(means.count), NOISE, rtol=0.05)
    assert means.readings[0].trust > 1000.0


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_no_gap(seed):
    base, notes = admitted(Transmission(BASE), observe(campaign(seed=200 + seed, n=3000), NOISE))
    assert notes == [f"3000 samples are weighed as the means of {len(base.observed)} cells of "
                     "neighbouring operating points"]
    assert significance(base, regions(base.observed.place), 0, 199).p_value > 0.02


def test_lone_slips_are_left_out_and_a_narrow_gap_is_not():
    quiet = campaign(seed=5, n=3000)
    slipped = quiet.efficiency.copy()
    slipped[::100] -= 0.05
    _, notes = admitted(Transmission(BASE), observe(with_column(quiet, efficiency=slipped), NOISE))
    assert notes[0].startswith("30 samples stand alone against their neighbours and were left out: "
                               "sample 1 (")
    assert notes[0].endswith("and others")
    narrow = quiet.efficiency - 0.05 * (np.abs(quiet.engine_speed - 150.0) < 1.0)
    _, notes = admitted(Transmission(BASE), observe(with_column(quiet, efficiency=narrow), NOISE))
    assert "alone" not in notes[0]


def test_a_few_points_dwelt_on_are_weighed_as_so_many():
    few = campaign(seed=6, n=12, noise=0.0)
    dwelt = few.select(np.repeat(np.arange(12), 100))
    noisy = with_column(dwelt, efficiency=dwelt.efficiency
                        + NOISE * np.random.default_rng(1).standard_normal(1200))
    base, _ = admitted(Transmission(BASE), observe(noisy))
    assert len(base.observed) == 12
    assert base.observed.readings[0].trust == pytest.approx(1188.0)
    assert significance(base, regions(base.observed.place), 0, 199).p_value > 0.02


def test_a_large_campaign_is_told_by_samples():
    points = campaign((ChargePump(8.0),), seed=3, n=150, noise=0.0)
    many = points.select(np.repeat(np.arange(150), 20))
    many = with_column(many, efficiency=many.efficiency
                       + NOISE * np.random.default_rng(2).standard_normal(3000))
    found = hmcvt.diagnose(BASE, many)
    assert (found.verdict, found.causes[0].effect) == ("cause_found", "charge_pump")
    assert found.gap.samples == len(found.samples) == len(found.residuals) == 3000
    assert len(found.residuals_after) == 3000
    assert found.gap.noise == pytest.approx(NOISE, rel=0.05)
    assert found.gap.rmse == pytest.approx(np.sqrt(np.mean(found.residuals**2)))
    assert found.gap.rmse == pytest.approx(np.hypot(found.shrinkage.before, NOISE), rel=0.05)
    assert sum(region.samples for region in found.where[:1]) % 20 == 0
    assert found.model.provenance["samples"] == 3000
    assert "3000 samples are weighed as the means of 150 cells" in found.report()
