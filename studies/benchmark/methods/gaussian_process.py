# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Gaussian process of the residual efficiency, and the signature nearest to it."""

import warnings

import numpy as np
from scipy.stats import chi2
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from studies.benchmark.answer import Answer
from studies.benchmark.case import Case
from studies.benchmark.methods.linear import linear, nearest_answer, scaled_axes

SIGNIFICANCE = 0.02


def answer(case: Case) -> Answer:
    """Fit a Gaussian process with a length scale along each axis by its likelihood."""
    problem = linear(case)
    tests, points = scaled_axes(case)
    noise = problem.efficiency_noise
    residual = problem.efficiency_residual
    kernel = ConstantKernel(0.01**2, (1e-8, 1e-1)) * RBF(
        np.full(tests.shape[1], 2.0), (0.3, 50.0)
    )
    process = GaussianProcessRegressor(
        kernel, alpha=noise**2, n_restarts_optimizer=2, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(tests, residual)
    nothing = -0.5 * np.sum((residual / noise) ** 2 + np.log(2.0 * np.pi * noise**2))
    gain = 2.0 * (process.log_marginal_likelihood_value_ - nothing)
    has_gap = gain > chi2.ppf(1.0 - SIGNIFICANCE, tests.shape[1] + 1)
    gap, deviation = process.predict(points, return_std=True)
    smooth = process.predict(tests)
    change = problem.change(smooth)
    promised = 1.0 - np.mean(deviation**2) / max(np.mean(gap**2), 1e-12)
    prediction = case.model_at_points.base + gap
    return nearest_answer(
        problem, change, bool(has_gap), prediction, deviation, float(promised)
    )
