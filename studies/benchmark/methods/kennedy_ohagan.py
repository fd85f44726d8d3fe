# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Calibration with a Gaussian process for the discrepancy (Kennedy and O'Hagan 2001).

Base parameters and meters are calibrated together with the discrepancy; the model is linear in
them, so that both are exact given the hyperparameters, which maximise the likelihood.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.stats import chi2

from studies.benchmark.answer import Answer
from studies.benchmark.case import Case, FloatArray
from studies.benchmark.methods.linear import linear, nearest_answer, scaled_axes

SIGNIFICANCE = 0.02
BOUNDS = (1e-4, 0.1)
"""Of the deviation of the discrepancy [-]."""
LENGTHS = (0.3, 50.0)
"""Of a length scale, in standard deviations of its axis."""


def kernel(a: FloatArray, b: FloatArray, logs: FloatArray) -> FloatArray:
    """Return the covariance of the discrepancy; logs are of its deviation and lengths."""
    lengths = np.exp(logs[1:])
    distance = (a[:, None] - b[None]) / lengths
    return np.exp(2.0 * logs[0] - 0.5 * np.sum(distance**2, axis=-1))


def answer(case: Case) -> Answer:
    """Calibrate the base and its discrepancy together."""
    problem = linear(case)
    tests, points = scaled_axes(case)
    rows = problem.of_efficiency
    noise = problem.deviation[rows]
    residual = problem.residual[rows] * noise
    base = problem.nuisance[rows] * noise[:, None]
    calibrated = base @ base.T + np.diag(noise**2)

    def misfit(logs: FloatArray) -> float:
        factor = cho_factor(calibrated + kernel(tests, tests, logs), lower=True)
        squares = residual @ cho_solve(factor, residual)
        return float(0.5 * squares + np.sum(np.log(np.diag(factor[0]))))

    start = np.log([0.005, *np.full(tests.shape[1], 2.0)])
    limits = [np.log(BOUNDS), *[np.log(LENGTHS)] * tests.shape[1]]
    logs = minimize(misfit, start, method="L-BFGS-B", bounds=limits).x
    without = np.concatenate([[-30.0], start[1:]])
    gain = 2.0 * (misfit(without) - misfit(logs))
    has_gap = gain > chi2.ppf(1.0 - SIGNIFICANCE, len(logs))
    if not has_gap:
        logs = without
    factor = cho_factor(calibrated + kernel(tests, tests, logs), lower=True)
    weights = cho_solve(factor, residual)
    there = problem.point_nuisance
    cross = there @ base.T + kernel(points, tests, logs)
    prior = np.sum(there**2, axis=1) + np.exp(2.0 * logs[0])
    variance = prior - np.sum(cross * cho_solve(factor, cross.T).T, axis=1)
    change = problem.change(kernel(tests, tests, logs) @ weights)
    shift = cross @ weights
    prediction = problem.point_linear + shift
    gap = prediction - case.model_at_points.base
    deviation = np.sqrt(np.maximum(variance, 1e-10))
    promised = 1.0 - np.mean(variance) / max(np.mean(gap**2), 1e-12)
    return nearest_answer(
        problem, change, bool(has_gap), prediction, deviation, float(promised)
    )
