# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`identify` sets a sample aside that disagrees with the rest, and says so."""

from dataclasses import replace

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
from hmcvt_core.identification.campaign import Campaign, set_aside_remarks

TRUTH = hmcvt.HydraulicParameters(1.5e-11, 0.11, 0.105)
NOISE = 0.006


def campaign(stage, count=40, seed=0):
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-1.0, 1.0, count)
    speed = rng.uniform(90.0, 225.0, count)
    torque = rng.uniform(90.0, 550.0, count)
    exact = hmcvt.EfficiencyModel(stage, TRUTH).efficiency(stroke, speed, torque)
    return hmcvt.BenchSamples(
        stroke, speed, torque, exact * (1.0 + NOISE * rng.standard_normal(count))
    )


def with_reading(samples, index, efficiency):
    values = samples.efficiency.copy()
    values[index] = efficiency
    return replace(samples, efficiency=values)


@pytest.mark.parametrize("reading", [0.57, 0.05, 0.98])
def test_one_bad_sample_is_named_and_does_not_count(hm4, reading):
    samples = campaign(hm4)
    fit = hmcvt.identify(with_reading(samples, 7, reading))
    assert fit.set_aside == (8,) and len(fit.samples) == 39
    expected = samples.efficiency[7]
    sentence = next(text for text in fit.warnings if "rejected" in text)
    start = f"sample 8 is rejected: it reads {reading:g}, the rest of the samples say "
    assert sentence.startswith(start)
    said, _, point = sentence.removeprefix(start).partition(" ")
    assert float(said) == pytest.approx(expected, abs=0.02)
    stroke = samples.displacement_ratio[7]
    assert point.startswith(f"(displacement ratio {stroke:.3g}, ")
    assert any(text.startswith("with all 40 samples the fit") for text in fit.warnings)
    rest = hmcvt.identify(samples.select(np.delete(np.arange(40), 7)))
    np.testing.assert_allclose(
        fit.parameters.to_array(), rest.parameters.to_array(), rtol=1e-6
    )
    assert fit.standard_errors == pytest.approx(rest.standard_errors, rel=1e-4)
    assert fit.to_dict()["set_aside"] == [8]
    assert "\n       8  " not in fit.report() and "\n       9  " in fit.report()


@pytest.mark.long
def test_standard_errors_mean_what_they_say(hm4):
    """Deviations from the truth, over 20 campaigns with a typo, are those stated."""
    ratios = []
    for seed in range(20):
        fit = hmcvt.identify(with_reading(campaign(hm4, seed=seed), 3, 0.4))
        assert 4 in fit.set_aside
        errors = np.array(list(fit.standard_errors.values()))
        ratios.append((fit.parameters.to_array() - TRUTH.to_array()) / errors)
    assert 0.7 < np.std(ratios) < 1.3


@pytest.mark.parametrize("seed", range(3))
def test_honest_samples_all_count(hm4, seed):
    assert hmcvt.identify(campaign(hm4, seed=seed)).set_aside == ()


@pytest.mark.parametrize("count", [5, 7, 8, 12])
def test_honest_samples_of_small_campaigns_all_count(hm4, count):
    """At most one campaign of a hundred may lose an honest sample."""
    model = hmcvt.EfficiencyModel(hm4, TRUTH)
    for seed in range(12):
        belongs = Campaign.checked(model, campaign(hm4, count, seed), seed).belongs
        assert belongs.all(), seed


@pytest.mark.parametrize("count", [7, 8, 40])
def test_only_the_typo_is_set_aside(hm4, count):
    model = hmcvt.EfficiencyModel(hm4, TRUTH)
    for seed in range(4):
        samples = campaign(hm4, count, seed)
        wrong = 0.6 * samples.efficiency[3]
        belongs = Campaign.checked(model, with_reading(samples, 3, wrong), seed).belongs
        assert np.flatnonzero(~belongs).tolist() == [3], seed


@pytest.mark.parametrize("seed", [1, 2, 4, 5])
def test_three_tenths_that_read_low_are_set_aside(hm4, seed):
    """Their fit and that of the others are far apart: one start finds one of them."""
    samples = campaign(hm4, seed=seed)
    efficiency = samples.efficiency.copy()
    efficiency[:12] *= 1.0 - np.random.default_rng(seed).uniform(0.08, 0.2, 12)
    fit = hmcvt.identify(replace(samples, efficiency=efficiency))
    assert fit.set_aside == tuple(range(1, 13))


def most_carried(model, stroke, speed):
    """Highest load torque with an answer [N m]."""
    carried, refused = 1.0, 5000.0
    while refused - carried > 1e-6:
        middle = 0.5 * (carried + refused)
        if np.isfinite(model.efficiency(stroke, speed, middle)):
            carried = middle
        else:
            refused = middle
    return carried


@pytest.mark.parametrize("seed", [4, 5, 6, 8])
def test_a_sample_close_to_stall_counts(seed):
    """A little more leakage than the true one has no answer at it."""
    stages = hmcvt.load_model(hmcvt.data_path("params/hydrostatic.yaml")).stages
    model = replace(next(iter(stages.values())), parameters=TRUTH)
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(0.25, 1.0, 20)
    speed = rng.uniform(90.0, 220.0, 20)
    share = np.append(0.9995, rng.uniform(0.1, 0.8, 19))
    limit = [most_carried(model, *at) for at in zip(stroke, speed, strict=True)]
    torque = share * limit
    noise = 1.0 + 0.011 * rng.standard_normal(20)
    measured = model.efficiency(stroke, speed, torque) * noise
    samples = hmcvt.BenchSamples(stroke, speed, torque, measured)
    assert Campaign.checked(model, samples, 0).belongs.all()
    typo = with_reading(samples, 9, 0.5 * measured[9])
    belongs = Campaign.checked(model, typo, 0).belongs
    assert np.flatnonzero(~belongs).tolist() == [9]


def test_few_samples_all_count(table2, fitted):
    assert fitted.set_aside == () and len(fitted.samples) == 5
    assert hmcvt.identify(with_reading(table2.select(range(5)), 2, 0.5)).set_aside == ()


def test_the_command_names_the_row(hm4, tmp_path):
    """Case `identify_one_typo`: two digits swapped in one row."""
    file = tmp_path / "bench.csv"
    hmcvt.write_bench(file, with_reading(campaign(hm4), 7, 0.57))
    text = run("identify", file).out
    assert "note: row 9 is rejected: it reads 0.57, the rest" in text
    data = run("identify", file, "--json").json
    assert data["set_aside"] == [8]


def test_stated_noise_is_the_deviation_of_the_samples(hm4, tmp_path):
    samples = campaign(hm4)
    stated = replace(samples, efficiency_std=np.full(len(samples), 0.02))
    fit = hmcvt.identify(samples, noise=0.02)
    assert fit.standard_errors == hmcvt.identify(stated).standard_errors
    assert (
        fit.standard_errors["leakage"]
        > hmcvt.identify(samples).standard_errors["leakage"]
    )
    with pytest.raises(hmcvt.InputError, match=r"noise: efficiency_std = 2 is outside"):
        hmcvt.identify(samples, noise=2.0)
    file = tmp_path / "bench.csv"
    hmcvt.write_bench(file, samples)
    data = run("identify", file, "--noise", "0.02", "--json").json
    entry = data["parameters"]["leakage"]
    assert entry["standard_error"] == pytest.approx(fit.standard_errors["leakage"])


def test_a_sample_without_an_answer_is_named_in_words(hm4):
    samples = replace(campaign(hm4, count=3), rows=(2, 3, 4))
    expected = np.array([0.8, np.nan, 0.7])
    (remark,) = set_aside_remarks(samples, np.array([1]), expected)
    assert remark.startswith("row 3 is rejected: it reads ")
    assert "the model of the rest has no answer at it (" in remark


def test_numbers_set_aside_count_in_the_file(hm4, tmp_path):
    path = tmp_path / "bench.csv"
    hmcvt.write_bench(path, with_reading(campaign(hm4), 7, 0.05))
    done = run("identify", path, "--fit", "3-40", "--json")
    assert done.code == 0 and done.json["set_aside"] == [8]
