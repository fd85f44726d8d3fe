# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Evidence against dense multivariate normals and numerical integration."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from hmcvt_core.diagnosis.evidence import evidence, gram, log_mean

CERTAIN = 1e8
"""So much worth that the noise stays as stated."""


def _problem(seed, n=7, p=3, channels=2):
    rng = np.random.default_rng(seed)
    return (rng.standard_normal((channels, n, p)), rng.standard_normal((channels, n)),
            np.exp(rng.uniform(-1.0, 1.0, p)))


def _weigh(columns, target, spread, trust=CERTAIN, positive=None):
    trusts = np.full(columns.shape[0], trust)
    return evidence(gram(columns, target)[None], target.shape[1], spread[None], trusts, positive)


def _one_sided(*problem, index):
    """Log factor for a coefficient that can only be positive."""
    return (_weigh(*problem, positive=index).log - _weigh(*problem).log)[0]


def _dense(columns, target, spread, mean=None):
    flat = columns.reshape(-1, columns.shape[-1])
    covariance = flat @ np.diag(spread**2) @ flat.T + np.eye(len(flat))
    return multivariate_normal.logpdf(target.ravel(), mean, covariance)


def _dropped_constant(channels, n):
    """What `evidence` leaves out as common to every hypothesis."""
    return 0.5 * channels * CERTAIN - 0.5 * channels * n * np.log(2.0 * np.pi)


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("p", [1, 4])
def test_log_evidence_is_that_of_the_dense_normal(channels, p):
    for seed in range(5):
        columns, target, spread = _problem(seed, p=p, channels=channels)
        found = _weigh(columns, target, spread)
        log = found.log[0] + _dropped_constant(channels, target.shape[1])
        assert log == pytest.approx(_dense(columns, target, spread), abs=1e-4)


def test_posterior_is_that_of_the_dense_normal():
    columns, target, spread = _problem(3)
    found = _weigh(columns, target, spread)
    flat, prior = columns.reshape(-1, 3), np.diag(spread**2)
    gain = prior @ flat.T @ np.linalg.inv(flat @ prior @ flat.T + np.eye(len(flat)))
    np.testing.assert_allclose(found.mean[0], gain @ target.ravel(), rtol=1e-6)
    np.testing.assert_allclose(found.covariance[0], prior - gain @ flat @ prior, rtol=1e-5,
                               atol=1e-8)
    np.testing.assert_allclose(found.noise, 1.0, atol=1e-6)


def test_noise_follows_the_data_when_the_statement_is_worth_little():
    rng = np.random.default_rng(0)
    n = 600
    columns = rng.standard_normal((2, n, 2))
    coefficients = np.array([1.0, -2.0])
    target = columns @ coefficients + np.array([[2.0], [0.5]]) * rng.standard_normal((2, n))
    found = _weigh(columns, target, np.array([5.0, 5.0]), trust=1.0)
    np.testing.assert_allclose(np.sqrt(found.noise[0]), [2.0, 0.5], rtol=0.1)
    np.testing.assert_allclose(found.mean[0], coefficients, atol=0.2)
    stated = _weigh(columns, target, np.array([5.0, 5.0]), trust=1e4)
    assert 1.0 < stated.noise[0, 0] < 2.0, "a statement worth more pulls towards itself"


@pytest.mark.parametrize("index", [0, 2])
def test_one_sided_factor_is_that_of_the_integral(index):
    for seed in range(4):
        columns, target, spread = _problem(seed, channels=1)
        rest = [i for i in range(3) if i != index]

        def density(value, columns=columns, target=target, spread=spread, rest=rest):
            prior = np.exp(-0.5 * (value / spread[index]) ** 2) / (
                spread[index] * np.sqrt(2.0 * np.pi))
            return prior * np.exp(_dense(columns[..., rest], target, spread[rest],
                                         mean=columns[0, :, index] * value))

        half, _ = quad(density, 0.0, 12.0 * spread[index], epsabs=0.0, epsrel=1e-9, limit=200)
        whole = np.exp(_dense(columns, target, spread))
        expected = np.log(2.0 * half / whole)
        factor = _one_sided(columns, target, spread, index=index)
        assert factor == pytest.approx(expected, abs=1e-4)


def test_one_sided_stays_finite_far_on_the_wrong_side():
    factor = _one_sided(np.ones((1, 50, 1)), np.full((1, 50), -40.0), np.array([10.0]), index=0)
    assert -1e6 < factor < -1000.0


def test_log_mean():
    values = np.array([-1.0, 0.5, 2.0])
    assert log_mean(values) == pytest.approx(np.log(np.exp(values).mean()))
    assert log_mean(values - 5000.0) == pytest.approx(log_mean(values) - 5000.0)
