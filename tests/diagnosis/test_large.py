# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Large campaigns: slips are looked for in all samples, and evenly spread ones are weighed."""

import re

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.preparation import prepare, spread_out
from hmcvt_core.diagnosis.settings import MAX_SAMPLES
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.physics.effects.mechanical import Churning
from tests.diagnosis.campaigns import BASE, NOISE, campaign, joined, with_column


def test_samples_are_kept_where_they_are_few():
    # A long dwell at one point, and a sweep of the whole range.
    dwell = campaign(seed=6, n=1).select(np.zeros(9000, dtype=int))
    kept = spread_out(observe(joined(dwell, campaign(seed=5, n=600))), MAX_SAMPLES)
    assert (len(kept), len(np.unique(kept))) == (MAX_SAMPLES, MAX_SAMPLES)
    assert (np.diff(kept) > 0).all()
    assert (kept >= 9000).sum() == 600, "all of the sweep"
    even = spread_out(observe(campaign(seed=3, n=4000)), MAX_SAMPLES)
    parts, _ = np.histogramdd(
        observe(campaign(seed=3, n=4000)).coordinates.T[even], bins=4
    )
    whole, _ = np.histogramdd(observe(campaign(seed=3, n=4000)).coordinates.T, bins=4)
    assert (parts[whole > 20] >= 4).all()


def test_outliers_and_narrow_gaps():
    quiet = campaign(seed=5, n=3000)
    slipped = quiet.efficiency.copy()
    slipped[::100] -= 0.05
    base, notes, _ = prepare(
        Transmission(BASE), observe(with_column(quiet, efficiency=slipped), NOISE)
    )
    assert notes[0].startswith(
        "30 samples stand alone against their neighbours and were left out: sample 1 ("
    )
    assert notes[0].endswith("and others")
    assert notes[1:] == [
        "1000 of 2970 samples are weighed, evenly spread over the operating points"
    ]
    assert (
        len(base.observed) == MAX_SAMPLES
        and not (base.observed.number % 100 == 0).any()
    )
    narrow = quiet.efficiency - 0.05 * (np.abs(quiet.engine_speed - 150.0) < 1.0)
    _, notes, _ = prepare(
        Transmission(BASE), observe(with_column(quiet, efficiency=narrow), NOISE)
    )
    assert "alone" not in notes[0]


@pytest.mark.long
@pytest.mark.slow
def test_two_causes_in_many_samples_are_named():
    effects = Churning(15.0), PressureLeakage(4e-11)
    found = hmcvt.diagnose(BASE, campaign(effects, seed=1, n=11_000), noise=NOISE)
    assert found.verdict in ("cause_found", "ambiguous")
    assert found.sets[0].effects == ("churning", "pressure_leakage")
    assert found.unlisted < 0.05
    assert (
        found.gap.samples == len(found.samples) == len(found.residuals) == MAX_SAMPLES
    )
    assert found.gap.noise == pytest.approx(NOISE, rel=0.1)
    assert found.gap.rmse == pytest.approx(np.sqrt(np.mean(found.residuals**2)))
    assert re.search(r"note: 1000 of \d{5} samples are weighed", found.report())
