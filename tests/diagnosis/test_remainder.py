# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a diagnosis leaves unexplained: put into the saved model, and stated as its error."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import without_remainder
from hmcvt_core.benches.transmission.served import handed_over
from hmcvt_core.transmission.ranges import OperatingPoints

from .campaigns import BASE, campaign, diagnosed, random_points

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


@pytest.mark.long
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
    found = diagnosed("planetary mesh")
    assert found.named is not None
    others = ((found.posterior.base_only, 1.0),)
    posterior = replace(found.posterior, entries=others)
    handed = handed_over(replace(found, posterior=posterior))
    assert handed.rmse_after <= handed.rmse_before


# --- models of a diagnosis state what they miss ---------------------------------------------------


@pytest.fixture(scope="module")
def fresh():
    return campaign(seed=2, n=300, noise=0.0, loss=wave)


def coverage(model, tests):
    """Fraction of tests that lie in the 95 % intervals."""
    prediction = model.predict(*tests.points[:3])
    off = np.abs(prediction.efficiency - tests.efficiency)
    return np.mean(off <= 1.96 * prediction.standard_error)


def test_base_states_the_gap(unexplained, fresh):
    assert unexplained.base.misfit == pytest.approx(
        error(unexplained.base, fresh), rel=0.25
    )
    assert coverage(unexplained.base, fresh) > 0.9
    assert coverage(replace(unexplained.base, misfit=0.0), fresh) < 0.6


def test_remainder_states_what_it_leaves(unexplained, fresh):
    model = unexplained.model
    assert 0.0 < model.misfit < 0.7 * unexplained.base.misfit
    assert coverage(model, fresh) > 0.85


def test_cause_leaves_less_than_the_base():
    diagnosis = diagnosed("planetary mesh")
    assert diagnosis.verdict in ("cause_found", "ambiguous")
    assert diagnosis.model.misfit < 0.3 * diagnosis.base.misfit


@pytest.mark.long
def test_misfit_of_the_model_given_is_not_inherited():
    given = replace(BASE, misfit=0.1)
    diagnosis = hmcvt.diagnose(given, campaign(seed=3, noise=NOISE), noise=NOISE)
    assert diagnosis.model.misfit < 0.5 * NOISE


@pytest.mark.long
def test_change_inherits_the_misfit_of_the_sound_model():
    sound = campaign(seed=1000, n=48, noise=NOISE, loss=wave)
    change = hmcvt.diagnose(
        BASE, campaign(seed=1, n=24, noise=NOISE, loss=wave), baseline=sound
    )
    assert change.base.misfit > 0.5 * error(
        change.base, campaign(seed=2, n=300, noise=0.0, loss=wave)
    )
