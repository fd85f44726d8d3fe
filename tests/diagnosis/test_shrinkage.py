# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Shrinkage of the gap: folds, the formula, and errors at samples left out."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core.benches.transmission import observe
from hmcvt_core.diagnosis.fitting.cross_validation import (
    cross_validated_errors,
    fold_assignments,
)
from hmcvt_core.diagnosis.fitting.evidence import linear_models
from hmcvt_core.diagnosis.observations import replicate_groups
from hmcvt_core.diagnosis.results.shrinkage import shrinkage

from .campaigns import campaign, measure, random_points


def _observed(samples, prior_dof=1e8):
    observed = observe(replace(samples, output_speed=None), 0.01)
    return replace(observed, prior_dof=np.array([prior_dof]))


def _linear(observed, columns, target, spread, signs=np.nan):
    (linear,) = linear_models(
        observed, columns, target, spread[None], np.broadcast_to(signs, spread.shape)
    )
    return linear


@pytest.mark.parametrize("n", [5, 24, 96])
def test_every_sample_is_left_out_once(n):
    parts = fold_assignments(_observed(campaign(n=n, seed=1)), 0)[0]
    assert sorted(np.concatenate(parts).tolist()) == list(range(n))
    sizes = [len(part) for part in parts]
    assert max(sizes) - min(sizes) <= 1
    assert len(parts) > 2


def test_repeated_points_are_left_out_together():
    points = random_points(2, 20)
    thrice = type(points)(
        *(None if axis is None else np.repeat(axis, 3) for axis in points)
    )
    observed = _observed(measure(thrice, seed=2))
    group = replicate_groups(observed.axes, observed.points)
    assert len(np.unique(group)) == 20
    for part in fold_assignments(observed, 3)[0]:
        inside = np.isin(np.arange(60), part)
        assert not set(group[inside]) & set(group[~inside])


def test_folds_follow_the_seed_and_are_dealt_anew_where_that_matters():
    observed = _observed(campaign(seed=1))
    same = [
        [part.tolist() for part in fold_assignments(observed, seed)[0]]
        for seed in (4, 4, 5)
    ]
    assert same[0] == same[1]
    assert same[0] != same[2]
    assert len(fold_assignments(observed, 0)) == 8
    assert len(fold_assignments(_observed(campaign(seed=1, n=12)), 0)) == 1, (
        "every sample alone"
    )


@pytest.mark.parametrize(
    ("before", "after", "noise", "expected"),
    [
        (np.array([0.02, -0.02] * 10), np.array([-0.01, 0.01] * 10), 0.005, 0.8),
        (
            np.full(4, 0.02),
            np.full(4, 0.01),
            [0.0, 0.01, 0.0, 0.01],
            1.0 - 0.5e-4 / 3.5e-4,
        ),
        (np.full(30, 0.02), np.full(30, 1e-4), 0.005, 1.0),
        (np.full(30, 0.02), np.full(30, 0.03), 0.005, 1.0 - 8.75 / 3.75),
        (np.full(30, 0.02), np.full(30, 0.9), 0.005, -10.0),
    ],
    ids=[
        "above noise",
        "noise of each sample",
        "no more than all",
        "worse",
        "much worse",
    ],
)
def test_fraction(before, after, noise, expected):
    found = shrinkage(before, after, np.array(noise), "holdout", seed=0)
    gap = [
        max(np.mean(errors**2 - np.square(noise)), 0.0) ** 0.5
        for errors in (before, after)
    ]
    assert [found.before, found.after] == pytest.approx(gap)
    assert found.fraction == pytest.approx(expected)
    assert found.on == "holdout"
    if np.ndim(noise) == 0:
        assert found.interval == pytest.approx((expected, expected)), (
            "all samples say the same"
        )


@pytest.mark.parametrize(
    ("before", "significant"),
    [(0.02, False), (0.004, True)],
    ids=["not significant", "below the noise"],
)
def test_without_a_gap_there_is_no_fraction(before, significant):
    found = shrinkage(
        np.full(20, before),
        np.full(20, 0.001),
        np.array(0.005),
        "cross-validation",
        seed=0,
        significant=significant,
    )
    assert found.fraction is None
    assert found.interval is None


def test_a_gap_is_at_least_what_all_channels_foretell():
    found = shrinkage(
        np.full(20, 0.004),
        np.full(20, 0.001),
        np.array(0.005),
        "cross-validation",
        seed=0,
        expected=np.array([4e-6, 1e-6]),
    )
    assert (found.before, found.after, found.fraction) == pytest.approx(
        (0.002, 0.001, 0.75)
    )
    seen = shrinkage(
        np.full(9, 0.04), np.full(9, 0.001), 0.005, "", 0, expected=np.array([0, 1e-4])
    )
    assert seen.after == pytest.approx((1e-4 * 0.005**2 / 0.04**2) ** 0.5), (
        "hardly hidden"
    )


def _problem(seed=0, n=30, p=3):
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((1, n, p))
    return columns, columns @ np.array([1.0, -1.0, 0.5]) + rng.standard_normal((1, n))


def test_errors_are_those_of_a_fit_to_the_others():
    observed = _observed(campaign(n=30, seed=1))
    columns, target = _problem()
    spread = np.array([1.0, 2.0, 3.0])
    parts = fold_assignments(observed, 0)[0]
    errors = cross_validated_errors(
        _linear(observed, columns, target, spread), observed, [parts]
    )
    for part in parts:
        others = np.setdiff1d(np.arange(30), part)
        own = columns[0, others]
        mean = np.linalg.solve(
            own.T @ own + np.diag(spread**-2.0), own.T @ target[0, others]
        )
        expected = (target[0, part] - columns[0, part] @ mean) * 0.01
        np.testing.assert_allclose(errors[part], expected, rtol=1e-5, atol=1e-9)


def test_several_deals_are_averaged_in_squares_with_the_sign_of_the_mean():
    observed = _observed(campaign(n=30, seed=1))
    model = _linear(observed, *_problem(), np.ones(3))
    dealt = fold_assignments(observed, 0)
    each = np.stack(
        [cross_validated_errors(model, observed, [parts]) for parts in dealt]
    )
    errors = cross_validated_errors(model, observed, dealt)
    np.testing.assert_allclose(errors**2, np.mean(each**2, axis=0))
    np.testing.assert_array_equal(np.sign(errors), np.sign(each.mean(axis=0)))


def test_a_size_that_goes_negative_is_held_at_zero():
    observed = _observed(campaign(n=30, seed=1))
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((1, 30, 2))
    target = columns @ np.array([1.0, -3.0])
    held, without = (
        cross_validated_errors(linear, observed, fold_assignments(observed, 0)[:1])
        for linear in (
            _linear(observed, columns, target, np.ones(2), signs=[np.nan, 1.0]),
            _linear(observed, columns[..., :1], target, np.ones(1)),
        )
    )
    np.testing.assert_allclose(held, without, rtol=1e-5)
