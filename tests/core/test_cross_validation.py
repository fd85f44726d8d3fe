# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A refit against the model in service, on samples that the refit has not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.identification.problem import Problem
from hmcvt_core.identification.refit import FOLDS, cross_validate, folds
from hmcvt_core.transmission.parameters import from_scaled, to_scaled

from .test_refit import campaign, spoiled

NOISE = 0.011  # relative, about that of the paper's bench


@pytest.fixture(scope="module")
def plant():
    return hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))


def refit(plant, samples):
    """The nearest parameters; the search from afar is `identify`'s."""
    scaled, _ = Problem(plant, samples).finish(to_scaled(plant.parameters.to_array())[None])
    return replace(plant, parameters=hmcvt.HydraulicParameters(*from_scaled(scaled).tolist()))


def compare(plant, samples, in_service=None):
    found, fold = refit(plant, samples), folds(samples, seed=0)
    others = [refit(plant, samples.select(fold != part)) for part in range(fold.max() + 1)]
    return cross_validate(samples, found, in_service or found, fold, others)


@pytest.mark.parametrize("count", [4, 5, 8, 23, 10_000])
def test_every_sample_is_left_out_once_and_every_fold_spans_the_ratios(count):
    ratio = np.random.default_rng(1).permutation(np.linspace(-1.0, 1.0, count))
    samples = hmcvt.BenchSamples(ratio, *(np.full(count, value) for value in (150.0, 200.0, 0.8)))
    fold = folds(samples, seed=3)
    sizes = np.bincount(fold)
    assert len(sizes) == min(count, FOLDS) and sizes.max() - sizes.min() <= 1
    if count >= 20:
        assert all(ratio[fold == part].min() < -0.6 and ratio[fold == part].max() > 0.3
                   for part in range(FOLDS))
    np.testing.assert_array_equal(fold, folds(samples, seed=3))


def test_errors_are_those_of_models_that_have_not_seen_the_sample(plant):
    samples = campaign(plant, 5, seed=0, noise=NOISE)
    found = compare(plant, samples, plant)
    others = [refit(plant, samples.select(np.delete(np.arange(5), i))) for i in range(5)]
    errors = [abs(model.efficiency(s.displacement_ratio, s.engine_speed, s.load_torque)[0]
                  / s.efficiency[0] - 1.0)
              for model, s in ((others[i], samples.select([i])) for i in range(5))]
    assert found.error_refit == pytest.approx(np.mean(errors), rel=1e-4)


@pytest.mark.parametrize("count", [5, 30])
def test_refit_of_unchanged_samples_is_never_worse(plant, count):
    found = compare(plant, campaign(plant, count, seed=1, noise=NOISE))
    # It has seen every sample, so those held back always look worse.
    assert found.error_refit > found.error_in_service
    assert found.change == 0.0 and not found.worse


@pytest.mark.parametrize("seed", range(3))
def test_refit_is_not_worse_than_the_true_model_for_noise_alone(plant, seed):
    assert not compare(plant, campaign(plant, 20, seed, noise=NOISE), plant).worse


@pytest.mark.parametrize(("count", "part"), [(5, 0.2), (8, 0.125), (40, 0.2)])
def test_refit_to_spoiled_samples_is_worse(plant, count, part):
    samples = campaign(plant, count, seed=2, noise=NOISE)
    rows = 1 + np.random.default_rng(0).permutation(count)[:round(part * count)]
    found = compare(plant, spoiled(samples, rows, -0.3), plant)
    assert found.error_refit > 1.3 * found.error_in_service
    assert found.worse


def test_three_samples_cannot_spare_one(plant):
    assert (folds(campaign(plant, 3, seed=0, noise=NOISE), seed=0) == -1).all()


def test_no_answer_counts_as_no_power_out(plant):
    leaking = replace(plant, parameters=replace(plant.parameters, leakage=1e-8))
    samples = campaign(plant, 6, seed=4, noise=NOISE)
    predicted = leaking.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque)
    stalled = np.isnan(predicted)
    assert stalled.any() and not stalled.all()
    errors = np.where(stalled, 1.0, np.abs(predicted / samples.efficiency - 1.0))
    assert compare(plant, samples, leaking).error_in_service == pytest.approx(errors.mean())
