# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a diagnosis leaves unexplained, put into the saved model."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import with_empirical_remainder
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import BASE, campaign

NOISE = 0.004


def wave(points):
    """A loss that no listed effect makes."""
    by_speed = np.cos((points.engine_speed - 80.0) / 50.0)
    return 0.02 * np.sin(3.0 * points.displacement_ratio) * by_speed


def error(model, samples):
    predicted = model.readings_at(samples.points)[0]
    return float(np.sqrt(np.nanmean((predicted - samples.efficiency) ** 2)))


@pytest.fixture(scope="module")
def unexplained():
    return hmcvt.diagnose(BASE, campaign(seed=1, noise=NOISE, loss=wave), noise=NOISE)


def test_the_remainder_halves_the_error_on_fresh_tests(unexplained):
    assert unexplained.verdict == "unexplained"
    remainder = with_empirical_remainder(unexplained)
    fresh = campaign(seed=2, n=200, noise=0.0, loss=wave)
    without = error(unexplained.model, fresh)
    assert error(remainder.model, fresh) < 0.5 * without
    assert remainder.rmse_with < remainder.rmse_without


def test_the_remainder_fades_outside_the_tests(unexplained):
    remainder = with_empirical_remainder(unexplained)
    far = OperatingPoints(np.zeros(1), np.full(1, 600.0), np.full(1, 100.0))
    with_it = remainder.model.readings_at(far)[0]
    assert with_it == pytest.approx(unexplained.model.readings_at(far)[0], abs=1e-4)


def test_the_remainder_is_served_from_a_file(unexplained, tmp_path):
    model = with_empirical_remainder(unexplained).model
    hmcvt.save_model(model, tmp_path / "model.yaml")
    loaded = hmcvt.load_model(tmp_path / "model.yaml")
    assert loaded.fingerprint == model.fingerprint
    assert loaded.provenance["empirical_remainder"]["bumps"] > 0
    assert {effect.name for effect in loaded.effects} == {"empirical_loss"}


def test_noise_alone_adds_nothing():
    diagnosis = hmcvt.diagnose(BASE, campaign(seed=3, noise=NOISE), noise=NOISE)
    remainder = with_empirical_remainder(diagnosis)
    assert remainder.bumps == 0 and remainder.model is diagnosis.model
