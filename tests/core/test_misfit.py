# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a model misses at samples left out of its fit, and the standard errors that hold it."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import hmcvt_core as hmcvt
from hmcvt_core.identification.annealing import QUICK
from hmcvt_core.identification.misfit import FEWEST
from hmcvt_core.identification.refit import refit
from hmcvt_core.model.accuracy import misfit

from .conftest import assert_refused

NOISE = 0.002
WAVE = 0.01
"""Root mean square of a loss that the form of the model misses [-]."""
POINT = (0.5, 146.6, 200.0)


def bench(model, n=96, seed=0, wave=0.0, stated=True, repeats=1):
    """Tests of a unit whose efficiency differs from the model by a wave."""
    rng = np.random.default_rng(seed)
    stroke = np.repeat(rng.uniform(-1.0, 1.0, n), repeats)
    speed = np.repeat(rng.uniform(80.0, 220.0, n), repeats)
    load = np.repeat(rng.uniform(80.0, 300.0, n), repeats)
    missed = np.sqrt(2.0) * wave * np.sin(6.0 * stroke + speed / 25.0)
    noise = NOISE * rng.standard_normal(len(stroke))
    return hmcvt.BenchSamples(
        stroke,
        speed,
        load,
        model.efficiency(stroke, speed, load) + missed + noise,
        efficiency_std=np.full(len(stroke), NOISE) if stated else None,
    )


def coverage(model, tests):
    """Fraction of tests that lie in the 95 % intervals."""
    prediction = model.predict(*tests.points)
    off = np.abs(prediction.efficiency - tests.efficiency)
    return np.mean(off <= 1.96 * prediction.standard_error)


def test_misfit_is_what_noise_and_parameters_leave():
    rng = np.random.default_rng(0)
    errors = 0.02 * rng.standard_normal(4000)
    errors[7] = np.nan
    assert misfit(errors, 0.0, 0.0) == pytest.approx(0.02, rel=0.03)
    left = np.sqrt(0.02**2 - 0.01**2 - 0.005**2)
    assert misfit(errors, 0.01, 0.005) == pytest.approx(left, rel=0.05)
    assert misfit(errors, np.full(4000, 0.02), 0.0) < 0.005
    assert misfit(errors, 0.05, 0.0) < 0.002


def test_few_samples_do_not_exclude_a_misfit():
    errors = NOISE * np.random.default_rng(1).standard_normal(400)
    few = misfit(errors[:10], NOISE, 0.0)
    assert 0.25 * NOISE < few < NOISE
    assert misfit(errors, NOISE, 0.0) < 0.6 * few


def test_misfit_is_not_below_a_gap_known_otherwise():
    errors = np.full(20, 1e-3)
    assert misfit(errors, 1e-3, 0.0, gap=0.01) == pytest.approx(0.01, rel=1e-3)
    assert misfit(errors, 1e-3, 0.006, gap=0.01) == pytest.approx(0.008, rel=1e-3)
    assert misfit(errors[:0], 0.0, 0.0, gap=0.01) == 0.01
    assert misfit(np.array([np.nan]), 0.0, 0.0) == 0.0


def test_standard_error_holds_the_misfit(model):
    missing = replace(model, misfit=0.02)
    of_parameters = model.predict(*POINT).standard_error
    assert missing.predict(*POINT).standard_error == pytest.approx(
        np.hypot(of_parameters, 0.02)
    )
    assert missing.efficiency(*POINT) == model.efficiency(*POINT)
    assert missing.fingerprint == model.fingerprint
    assert "form error" in missing.report()
    assert "form error" not in model.report()


def test_standard_error_is_unknown_without_errors_of_the_parameters(model):
    bare = replace(model, standard_errors={}, correlation=None, misfit=0.02)
    assert np.isnan(bare.predict(*POINT).standard_error)


def test_misfit_is_kept_in_a_file(model, tmp_path):
    path = tmp_path / "model.yaml"
    hmcvt.save_model(replace(model, misfit=0.0123), path)
    assert hmcvt.load_model(path).misfit == 0.0123
    hmcvt.save_model(model, path)
    assert "misfit:" not in path.read_text(encoding="utf-8")
    assert hmcvt.load_model(path).misfit == 0.0


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (1.5, r"misfit = 1\.5 is outside 0 to 1 \(a fraction, not percent\)"),
        (-0.1, r"misfit = -0\.1 is not a finite number of at least 0"),
        ("much", r"misfit = 'much' is not a finite number"),
    ],
)
def test_wrong_misfit_is_refused(model, tmp_path, value, message):
    path = tmp_path / "model.yaml"
    data = {**model.to_mapping(), "misfit": value}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    assert_refused(hmcvt.load_model, path, message)


def test_identification_measures_the_misfit(model, hm4):
    fit = hmcvt.identify(bench(model, wave=WAVE), stage=hm4, schedule=QUICK)
    assert fit.model.misfit == pytest.approx(WAVE, rel=0.2)
    assert fit.to_dict()["misfit"] == fit.model.misfit
    assert fit.model.provenance["misfit_noise"] == "stated"
    assert "form error" in fit.report()
    fresh = bench(model, 500, seed=1, wave=WAVE)
    assert 0.9 <= coverage(fit.model, fresh) <= 1.0
    assert coverage(replace(fit.model, misfit=0.0), fresh) < 0.5


def test_misfit_of_an_exact_form_is_below_the_noise(model, hm4):
    fit = hmcvt.identify(bench(model), stage=hm4, schedule=QUICK)
    assert fit.model.misfit < 0.5 * NOISE


def test_bad_readings_are_no_misfit(model, hm4):
    samples = bench(model)
    efficiency = samples.efficiency.copy()
    efficiency[[3, 40, 77]] -= 0.2
    fit = hmcvt.identify(
        replace(samples, efficiency=efficiency), stage=hm4, schedule=QUICK
    )
    assert fit.set_aside == (4, 41, 78)
    assert fit.model.misfit < 0.5 * NOISE


def test_a_region_that_is_set_aside_counts(model, hm4):
    samples = bench(model)
    region = samples.displacement_ratio > 0.75
    lower = replace(samples, efficiency=samples.efficiency - 0.03 * region)
    fit = hmcvt.identify(lower, stage=hm4, schedule=QUICK)
    assert len(fit.set_aside) > 5
    missed = 0.03 * np.sqrt(np.mean(region))
    assert fit.model.misfit == pytest.approx(missed, rel=0.3)


def test_repeated_points_state_the_noise(model, hm4):
    samples = bench(model, 30, wave=WAVE, stated=False, repeats=2)
    fit = hmcvt.identify(samples, stage=hm4, schedule=QUICK)
    assert fit.model.provenance["misfit_noise"] == "repeated points"
    assert not any("noise of the samples" in note for note in fit.warnings)


def test_misfit_holds_noise_that_is_not_known(model, hm4):
    samples = bench(model, stated=False)
    fit = hmcvt.identify(samples, stage=hm4, schedule=QUICK)
    assert fit.model.misfit == pytest.approx(NOISE, rel=0.25)
    assert any("noise of the samples is not known" in note for note in fit.warnings)
    assert 0.9 <= coverage(fit.model, bench(model, 500, seed=1)) <= 0.99


def test_few_samples_and_the_formulas_of_the_paper_have_no_misfit(model, hm4, fitted):
    assert fitted.model.misfit == 0.0
    few = bench(model, FEWEST - 1, wave=WAVE)
    assert hmcvt.identify(few, stage=hm4, schedule=QUICK).model.misfit == 0.0


def test_published_formulas_have_no_misfit(fitted_published):
    assert fitted_published.model.misfit == 0.0


def test_refit_measures_the_misfit_anew(model):
    served = replace(model, misfit=0.05)
    few = refit(bench(model, FEWEST - 2), served, served)
    assert few.model.misfit == 0.05
    errors = {name: 0.05 * value for name, value in model.standard_errors.items()}
    known = replace(served, standard_errors=errors)
    many = refit(bench(model, 60, wave=WAVE), known, known)
    assert many.model.misfit == pytest.approx(WAVE, rel=0.25)
    assert many.model.provenance["misfit_noise"] == "stated"


def test_samples_whose_standard_error_is_unknown_do_not_count():
    errors = np.array([0.01, -0.01, 0.012, 0.5])
    known = misfit(errors[:3], NOISE, np.full(3, 0.001))
    assert misfit(errors, NOISE, np.array([0.001, 0.001, 0.001, np.nan])) == known
