# SPDX-License-Identifier: Apache-2.0
"""Least squares within bounds, against SciPy's."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

import hmcvt_core as hmcvt
from hmcvt_core.identification import polish, problem
from hmcvt_core.identification.least_squares import least_squares

BOUNDS = np.array([[-2.0, 2.0], [-1.0, 3.0]])
STARTS = np.random.default_rng(0).uniform(*BOUNDS.T, size=(12, 2))
TIMES = np.linspace(0.0, 1.0, 9)


def rosenbrock(x):
    return np.stack([10.0 * (x[..., 1] - x[..., 0] ** 2), 1.0 - x[..., 0]], axis=-1)


def decay(noise):
    measured = 1.5 * np.exp(-0.7 * TIMES) + noise * np.cos(40.0 * TIMES)

    def residuals(x):
        return x[..., :1] * np.exp(-x[..., 1:] * TIMES) - measured

    return residuals


def squares(residuals, points):
    return np.sum(residuals(points) ** 2, axis=-1)


def test_every_start_reaches_the_minimum():
    found = least_squares(rosenbrock, STARTS, BOUNDS)
    np.testing.assert_allclose(found, np.ones((12, 2)), atol=1e-6)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
def test_same_minimum_as_scipy(noise):
    residuals = decay(noise)
    theirs = optimize.least_squares(residuals, STARTS[0], bounds=BOUNDS.T, xtol=1e-14, ftol=1e-14,
                                    gtol=1e-14)
    found = least_squares(residuals, STARTS, BOUNDS)
    np.testing.assert_allclose(squares(residuals, found), 2.0 * theirs.cost, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(found, np.broadcast_to(theirs.x, found.shape), atol=1e-5)


def test_minimum_on_a_bound():
    narrow = np.array([[-2.0, 0.5], [-1.0, 3.0]])
    starts = STARTS * [0.2, 1.0]
    found = least_squares(rosenbrock, starts, narrow)
    np.testing.assert_allclose(found, np.tile([0.5, 0.25], (12, 1)), atol=1e-6)
    assert (found >= narrow[:, 0]).all() and (found <= narrow[:, 1]).all()


def test_leaves_a_bound_that_does_not_hold():
    found = least_squares(rosenbrock, np.array([[2.0, -1.0], [-2.0, 3.0]]), BOUNDS)
    np.testing.assert_allclose(found, np.ones((2, 2)), atol=1e-6)


def test_fewer_equations_than_variables_and_variables_without_influence():
    def one(x):
        return x[..., :1] - 0.25

    found = least_squares(one, STARTS, BOUNDS)
    np.testing.assert_allclose(found[:, 0], 0.25, atol=1e-9)
    np.testing.assert_array_equal(found[:, 1], STARTS[:, 1])

    def line(x):
        return x[..., :1] + x[..., 1:] - 1.0

    np.testing.assert_allclose(least_squares(line, STARTS, BOUNDS).sum(axis=1), 1.0, atol=1e-9)


def test_never_leaves_a_start_worse():
    def jagged(x):
        return np.where(x > 0.3, 1e3, x + np.sin(30.0 * x))

    found = least_squares(jagged, STARTS, BOUNDS)
    assert (squares(jagged, found) <= squares(jagged, STARTS)).all()


def test_starts_do_not_disturb_each_other():
    together = least_squares(decay(0.05), STARTS, BOUNDS)
    alone = np.vstack([least_squares(decay(0.05), start[None], BOUNDS) for start in STARTS])
    np.testing.assert_allclose(together, alone, rtol=1e-12)


def test_leakage_as_such_and_its_logarithm_are_one_point():
    scaled = problem.BOUNDS[:, 0] + np.diff(problem.BOUNDS)[:, 0] * np.random.default_rng(0).random(
        (50, 3))
    scaled = np.concatenate([scaled, problem.BOUNDS.T])
    linear = polish._to_linear(scaled)
    np.testing.assert_allclose(1e-10 * linear[:, 0], 10.0 ** scaled[:, 0], rtol=1e-12)
    np.testing.assert_allclose(polish._from_linear(linear), scaled, rtol=1e-12)
    assert (linear[:, 1:] == scaled[:, 1:]).all()


@pytest.mark.parametrize("leakage", [1e-13, 1e-10])
def test_a_leakage_at_its_bound_is_found_there(leakage):
    """And nowhere beyond, where rounding of the logarithm might put it."""
    base = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    parameters = hmcvt.HydraulicParameters(leakage, 0.1, 0.1)
    rng = np.random.default_rng(0)
    point = rng.uniform(-1, 1, 30), rng.uniform(90, 200, 30), rng.uniform(80, 250, 30)
    told = replace(base, parameters=parameters).efficiency(*point)
    # Beyond the bound: a bench that loses less, or more, than any leakage allowed.
    samples = hmcvt.BenchSamples(*point, told * (1.005 if leakage < 1e-12 else 0.97))
    found = hmcvt.identify(samples).parameters
    assert found.leakage == leakage
