# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a diagnosis leaves unexplained, put into the saved model."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import without_remainder
from hmcvt_core.benches.transmission.served import handed_over
from hmcvt_core.physics.effects.mechanical import PlanetaryMesh
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import BASE, campaign, random_points

NOISE = 0.004


def wave(points):
    """A loss that no listed effect makes."""
    by_speed = np.cos((points.engine_speed - 80.0) / 50.0)
    return 0.02 * np.sin(3.0 * points.displacement_ratio) * by_speed


def in_stages(model, seed, noise, wave_in, stages=("HM2", "HM3")):
    """Samples in some stages, of which one loses more."""
    rng = np.random.default_rng(seed)
    points = random_points(seed, 120)
    stage = np.array(stages)[np.arange(120) % len(stages)]
    at = points._replace(stage=stage)
    efficiency = model.readings_at(at)["efficiency"]
    efficiency = efficiency - wave(points) * (stage == wave_in)
    efficiency = efficiency + noise * rng.standard_normal(120)
    kept = np.flatnonzero(np.isfinite(efficiency) & (efficiency > 0.1))
    columns = [values[kept] for values in (*points[:3], efficiency)]
    names = [str(name) for name in stage[kept]]
    return hmcvt.BenchSamples(*columns, extra={"stage": names}, source="simulated")


def error(model, samples):
    predicted = model.readings_at(samples.points)["efficiency"]
    return float(np.sqrt(np.nanmean((predicted - samples.efficiency) ** 2)))


@pytest.fixture(scope="module")
def unexplained():
    return hmcvt.diagnose(BASE, campaign(seed=1, noise=NOISE, loss=wave), noise=NOISE)


def test_the_remainder_lowers_the_error_on_fresh_tests(unexplained):
    assert unexplained.verdict == "unexplained"
    fresh = campaign(seed=2, n=200, noise=0.0, loss=wave)
    without = error(unexplained.base, fresh)
    # A part of the wave looks like the zero of a stroke sensor, which is not served.
    assert error(unexplained.model, fresh) < 0.7 * without
    assert unexplained.delivered.rmse_after < unexplained.delivered.rmse_before
    assert unexplained.delivered.bumps > 0


def test_without_the_remainder_the_base_is_left(unexplained):
    bare = without_remainder(unexplained)
    assert bare.model.effects == () and bare.delivered.kind == "base"


def test_the_error_grows_away_from_the_tests(unexplained):
    inside = unexplained.model.predict(0.3, 150.0, 200.0).standard_error
    outside = unexplained.model.predict(0.3, 320.0, 200.0).standard_error
    assert outside > 1.05 * inside


def test_the_remainder_fades_outside_the_tests(unexplained):
    far = OperatingPoints(np.zeros(1), np.full(1, 600.0), np.full(1, 100.0))
    with_it = unexplained.model.readings_at(far)["efficiency"]
    assert with_it == pytest.approx(
        unexplained.base.readings_at(far)["efficiency"], abs=1e-4
    )


def test_the_remainder_is_served_from_a_file(unexplained, tmp_path):
    model = unexplained.model
    hmcvt.save_model(model, tmp_path / "model.yaml")
    loaded = hmcvt.load_model(tmp_path / "model.yaml")
    assert loaded.fingerprint == model.fingerprint
    assert loaded.provenance["empirical_remainder"]["bumps"] > 0
    assert {effect.name for effect in loaded.effects} == {"empirical_loss"}


def test_noise_alone_adds_nothing():
    diagnosis = hmcvt.diagnose(BASE, campaign(seed=3, noise=NOISE), noise=NOISE)
    assert diagnosis.delivered.bumps == 0 and diagnosis.model is diagnosis.base


def test_a_loss_in_one_stage_of_several_is_served_there(tmp_path):
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    samples = in_stages(tractor, seed=1, noise=NOISE, wave_in="HM3")
    found = hmcvt.diagnose(tractor, samples, noise=NOISE)
    fresh = in_stages(tractor, seed=2, noise=0.0, wave_in="HM3")
    assert error(found.model, fresh) < 0.7 * error(found.base, fresh)
    hmcvt.save_model(found.model, tmp_path / "model.yaml")
    loaded = hmcvt.load_model(tmp_path / "model.yaml")
    assert error(loaded, fresh) == pytest.approx(error(found.model, fresh), rel=1e-6)
    stages = {
        effect.stage for effect in loaded.effects if effect.name == "empirical_loss"
    }
    assert "HM3" in stages and "" not in stages


def test_a_leading_set_that_the_relevant_explanations_lack_still_competes():
    mesh = (PlanetaryMesh(0.06),)
    found = hmcvt.diagnose(BASE, campaign(mesh, seed=1, n=48), noise=NOISE)
    assert found.named is not None
    others = ((found.posterior.base_only, 1.0),)
    posterior = replace(found.posterior, entries=others)
    handed = handed_over(replace(found, posterior=posterior))
    assert handed.rmse_after <= handed.rmse_before
