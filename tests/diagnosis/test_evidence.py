# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Evidence against dense multivariate normals and numerical integration."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from hmcvt_core.diagnosis.fitting.evidence import (
    LinearModel,
    change_of_prior_scale,
    fitted_model,
    gram,
    model_evidence,
)
from hmcvt_core.diagnosis.selection.prediction import Prediction
from hmcvt_core.diagnosis.settings import AMPLITUDE_LOG_DEVIATION

CERTAIN = 1e8
"""So much worth that the noise stays as stated."""


def _problem(seed, n=7, p=3, channels=2):
    rng = np.random.default_rng(seed)
    return (
        rng.standard_normal((channels, n, p)),
        rng.standard_normal((channels, n)),
        np.exp(rng.uniform(-1.0, 1.0, p)),
    )


def _weigh(columns, target, spread, prior_dof=CERTAIN, signs=None):
    trusts = np.full(columns.shape[0], prior_dof)
    return model_evidence(
        gram(columns, target)[None], target.shape[1], spread[None], trusts, signs
    )


def _as_size(*problem, index, sign=1.0):
    """Log factor for a coefficient that is the size of an effect."""
    signs = np.full(problem[0].shape[-1], np.nan)
    signs[index] = sign
    return (_weigh(*problem, signs=signs).log_evidence - _weigh(*problem).log_evidence)[
        0
    ]


def _dense(columns, target, spread, mean=None):
    flat = columns.reshape(-1, columns.shape[-1])
    covariance = flat @ np.diag(spread**2) @ flat.T + np.eye(len(flat))
    return multivariate_normal.logpdf(target.ravel(), mean, covariance)


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("p", [1, 4])
def test_log_evidence_is_that_of_the_dense_normal(channels, p):
    for seed in range(5):
        columns, target, spread = _problem(seed, p=p, channels=channels)
        found = _weigh(columns, target, spread)
        # What `evidence` leaves out is common to every hypothesis.
        log = found.log_evidence[0] + 0.5 * channels * (
            CERTAIN - target.shape[1] * np.log(2.0 * np.pi)
        )
        assert log == pytest.approx(_dense(columns, target, spread), abs=1e-4)


def test_posterior_is_that_of_the_dense_normal():
    columns, target, spread = _problem(3)
    found = _weigh(columns, target, spread)
    flat, prior = columns.reshape(-1, 3), np.diag(spread**2)
    gain = prior @ flat.T @ np.linalg.inv(flat @ prior @ flat.T + np.eye(len(flat)))
    np.testing.assert_allclose(found.mean[0], gain @ target.ravel(), rtol=1e-6)
    np.testing.assert_allclose(
        found.covariance[0], prior - gain @ flat @ prior, rtol=1e-5, atol=1e-8
    )
    np.testing.assert_allclose(found.noise, 1.0, atol=1e-6)


def test_noise_follows_the_data_when_the_statement_is_worth_little():
    rng = np.random.default_rng(0)
    n = 600
    columns = rng.standard_normal((2, n, 2))
    coefficients = np.array([1.0, -2.0])
    target = columns @ coefficients + np.array([[2.0], [0.5]]) * rng.standard_normal(
        (2, n)
    )
    found = _weigh(columns, target, np.array([5.0, 5.0]), prior_dof=1.0)
    np.testing.assert_allclose(np.sqrt(found.noise[0]), [2.0, 0.5], rtol=0.1)
    np.testing.assert_allclose(found.mean[0], coefficients, atol=0.2)
    stated = _weigh(columns, target, np.array([5.0, 5.0]), prior_dof=1e4)
    assert 1.0 < stated.noise[0, 0] < 2.0, "a statement worth more pulls towards itself"


def test_log_evidence_changes_with_the_weight_of_a_sample_by_its_likelihood():
    (columns, target, spread), prior_dof = _problem(4, n=30), np.array([8.0, 1.0])

    def weighed(step):
        root = np.sqrt(np.append(1.0 + step, np.ones(29)))
        return model_evidence(
            gram(columns * root[:, None], target * root)[None],
            np.array([[30.0 + step]]),
            spread[None],
            prior_dof,
        )

    here = LinearModel(
        columns, target, spread, spread, *(each[0] for each in weighed(0.0))
    )
    slope = (weighed(0.01).log_evidence[0] - weighed(-0.01).log_evidence[0]) / 0.02
    assert here.log_likelihoods[0] == pytest.approx(slope, abs=0.01)


@pytest.mark.parametrize("sign", [1.0, -1.0, 0.0])
@pytest.mark.parametrize("index", [0, 2])
def test_prior_of_a_size_is_none_at_zero_and_has_one_sign(index, sign):
    for seed in range(4):
        columns, target, spread = _problem(seed, channels=1)
        rest = [i for i in range(3) if i != index]

        def density(value, columns=columns, target=target, spread=spread, rest=rest):
            part = value / spread[index]
            prior = (
                part**2
                * np.exp(-0.5 * part**2)
                / (spread[index] * np.sqrt(2.0 * np.pi))
            )
            return prior * np.exp(
                _dense(
                    columns[..., rest],
                    target,
                    spread[rest],
                    mean=columns[0, :, index] * value,
                )
            )

        halves = [
            quad(density, *ends, epsabs=0.0, epsrel=1e-9, limit=200)[0]
            for ends in ((-12.0 * spread[index], 0.0), (0.0, 12.0 * spread[index]))
        ]
        one = {1.0: 2.0 * halves[1], -1.0: 2.0 * halves[0], 0.0: sum(halves)}[sign]
        expected = np.log(one / np.exp(_dense(columns, target, spread)))
        factor = _as_size(columns, target, spread, index=index, sign=sign)
        assert factor == pytest.approx(expected, abs=1e-4)


def test_other_priors_are_weighed_as_if_from_the_start():
    columns, target, spread = _problem(1, n=12, p=4)
    found, own = _weigh(columns, target, spread), slice(2, 4)
    signs = np.array([np.nan, np.nan, 1.0, 0.0])
    others = np.array([[0.3, 2.0], [4.0, 0.1]])
    gains = change_of_prior_scale(
        found.mean[0, own],
        found.covariance[0, own, own],
        spread[own],
        others,
        signs[own],
    )
    for other, gain in zip(others, gains, strict=True):
        direct = _weigh(columns, target, np.append(spread[:2], other), signs=signs)
        assert found.log_evidence[0] + gain == pytest.approx(
            direct.log_evidence[0], abs=1e-5
        )


@pytest.mark.parametrize("far", [40.0, 1e6])
def test_one_sided_stays_finite_far_on_the_wrong_side(far):
    factor = _as_size(
        np.ones((1, 50, 1)), np.full((1, 50), -far), np.array([10.0]), index=0
    )
    assert -1e15 < factor < -1000.0


class _Readings:
    """What a fit of amplitudes asks of observations."""

    def __init__(self, n, prior_dof):
        self.n = n
        self.prior_dof = np.array(prior_dof)

    def __len__(self):
        return self.n


def _log_posterior(columns, target, spread, group, log_variance, prior_dof):
    """Of the amplitudes, with the noise and the coefficients at their best."""
    amplitude = np.exp(0.5 * np.append(log_variance, 0.0))[group]
    found = model_evidence(
        gram(columns, target)[None],
        target.shape[1],
        spread * amplitude,
        np.array(prior_dof),
    )
    of_prior = -0.5 * np.sum(log_variance**2) / AMPLITUDE_LOG_DEVIATION**2
    return found.log_evidence[0] + of_prior


@pytest.mark.parametrize("seed", range(5))
def test_fitted_amplitudes_are_at_a_mode(seed):
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((2, 40, 12))
    group = np.repeat([-1, 0, 1, 2], 3)
    truth = rng.standard_normal(12) * np.repeat([1.0, 5.0, 1.0, 0.0], 3)
    target = columns @ truth + rng.standard_normal((2, 40))
    spread = np.ones(12)
    prior_dof = [8.0, 8.0]
    fit = fitted_model(_Readings(40, prior_dof), columns, target, spread, group)
    log_variance = 2.0 * np.log(fit.spread[[3, 6, 9]])
    assert log_variance[0] > log_variance[1] > log_variance[2]

    def at(changed):
        return _log_posterior(columns, target, spread, group, changed, prior_dof)

    best = at(log_variance)
    for i in range(3):
        for step in (-0.5, 0.5):
            assert at(log_variance + step * np.eye(3)[i]) < best


@pytest.mark.parametrize("seed", range(3))
def test_noise_does_not_take_up_a_large_gap(seed):
    """A gap a hundred times the median amplitude, which the columns follow to the noise."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((1, 96, 37))
    group = np.append(-1, np.repeat(np.arange(6), 6))
    truth = np.append(1.0, 100.0 * rng.standard_normal(36))
    target = columns @ truth + rng.standard_normal((1, 96))
    fit = fitted_model(_Readings(96, [8.0]), columns, target, np.ones(37), group)
    assert fit.noise[0] == pytest.approx(1.0, rel=0.4)


def test_a_point_that_was_read_makes_another_surer():
    told = Prediction(np.zeros((1, 2)), np.ones((1, 2, 1)), np.eye(1))
    assert told.after_reading(0).reading_covariance.ravel() == pytest.approx(
        [0.5, 0.5]
    )  # 1 - 1 / (1 + 1)
