# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""A smooth function of the operating point as a Gaussian process, one in each stage.

.. math:: k(x, x') = s^2 \exp\left(-\tfrac12 \sum_i (x_i - x'_i)^2 / l_i^2\right)

within a stage, and zero between two (Rasmussen & Williams 2006, section 2.2). Lengths, deviation
and a factor of the noise have the largest posterior density under log-normal priors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.system import Array

LENGTH_MEDIAN = 0.5
LENGTH_LOG_DEVIATION = 0.7
"""Prior of a length, as a part of the range of its axis.

Losses are nearly polynomials of second degree over their range (Ivantysyn & Ivantysynova), which
bend once; known within a factor of two.
"""
DEVIATION_MEDIAN = 0.003
DEVIATION_LOG_DEVIATION = 1.0
"""Prior of the standard deviation of the function [-]: texture of a base model, factor of three."""
NOISE_LOG_DEVIATION = 0.1
ASSUMED_NOISE_LOG_DEVIATION = 0.7
"""Prior of the log of the factor of the noise, stated (JCGM 100:2008, table E.1) or assumed."""
LOG_BOUNDS = 3.0
"""Prior deviations within which each logarithm is sought."""
MAX_FITTED = 150
"""Maximum number of samples that lengths and deviation are fitted to. Limit of computing time."""
JITTER = 1e-10


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A process with its samples.

    Attributes:
        lengths: along each axis, as parts of its range, shape (axes,).
        deviation: standard deviation of the function [-].
        noise_factor: of the noise.
        coordinates: of the samples, shape (axes, n).
        stage: number of the stage of each, shape (n,).
        noise: their standard deviation [-], shape (n,).
    """

    lengths: Array
    deviation: float
    noise_factor: float
    coordinates: Array
    stage: Array
    noise: Array

    def at(self, coordinates: Array, stage: Array, noise: Array) -> GaussianProcess:
        """Return the process with other samples."""
        return replace(self, coordinates=coordinates, stage=stage, noise=noise)

    def given(
        self, kept: NDArray[np.intp], values: Array
    ) -> Callable[[Array, Array], Array]:
        """Return the posterior mean as a function of coordinates and stages.

        Args:
            kept: samples that it is conditioned on.
            values: of all samples [-], shape (n,).
        """
        known = self.coordinates[:, kept]
        stage = self.stage[kept]
        covariance = self._covariance(known, stage, known, stage)
        covariance += np.diag((self.noise_factor * self.noise[kept]) ** 2)
        covariance += JITTER * np.eye(len(kept))
        weights = np.linalg.solve(covariance, values[kept])

        def mean(coordinates: Array, of_stage: Array) -> Array:
            return np.asarray(
                self._covariance(coordinates, of_stage, known, stage) @ weights
            )

        return mean

    def _covariance(
        self, one: Array, one_stage: Array, other: Array, other_stage: Array
    ) -> Array:
        scaled = (one[:, :, None] - other[:, None, :]) / self.lengths[:, None, None]
        same = one_stage[:, None] == other_stage
        return np.asarray(
            self.deviation**2 * np.exp(-0.5 * np.sum(scaled**2, axis=0)) * same
        )


def fit_gaussian_process(
    coordinates: Array, stage: Array, values: Array, noise: Array, noise_stated: bool
) -> GaussianProcess:
    """Return the process of the largest posterior density.

    Args:
        coordinates: of the samples, scaled to 0 ... 1, shape (axes, n).
        stage: number of the stage of each, shape (n,).
        values: of the function, with noise [-], shape (n,).
        noise: standard deviation of each [-], shape (n,).
        noise_stated: whether it is stated rather than assumed.
    """
    from scipy.optimize import minimize

    axes, n = coordinates.shape
    rows = np.unique(np.linspace(0, n - 1, min(n, MAX_FITTED)).astype(int))
    apart = (coordinates[:, rows, None] - coordinates[:, None, rows]) ** 2
    same = stage[rows, None] == stage[rows]
    target = values[rows]
    variance = noise[rows] ** 2
    of_noise = NOISE_LOG_DEVIATION if noise_stated else ASSUMED_NOISE_LOG_DEVIATION
    medians = np.log([*axes * (LENGTH_MEDIAN,), DEVIATION_MEDIAN, 1.0])
    spread = np.array(
        [*axes * (LENGTH_LOG_DEVIATION,), DEVIATION_LOG_DEVIATION, of_noise]
    )

    def objective(scaled: Array) -> tuple[float, Array]:
        """Negative log density, and its gradient by the logarithms in prior deviations."""
        logs = medians + spread * scaled
        squares = np.exp(-2.0 * logs[:axes])
        kernel = np.exp(2.0 * logs[axes]) * same
        kernel = kernel * np.exp(-0.5 * np.tensordot(squares, apart, 1))
        of_readings = np.exp(2.0 * logs[axes + 1]) * variance
        covariance = kernel + np.diag(of_readings + JITTER)
        inverse = np.linalg.inv(covariance)
        weights = inverse @ target
        _, log_determinant = np.linalg.slogdet(covariance)
        value = 0.5 * (target @ weights + log_determinant + scaled @ scaled)
        pull = inverse - np.outer(weights, weights)
        slopes = [
            0.5 * np.sum(pull * kernel * apart[i] * squares[i]) for i in range(axes)
        ]
        slopes.append(float(np.sum(pull * kernel)))
        slopes.append(float(np.diagonal(pull) @ of_readings))
        return float(value), spread * np.array(slopes) + scaled

    start = np.zeros(axes + 2)
    bounds = [(-LOG_BOUNDS, LOG_BOUNDS)] * len(start)
    found = minimize(objective, start, jac=True, bounds=bounds, method="L-BFGS-B")
    logs = medians + spread * found.x
    return GaussianProcess(
        lengths=np.exp(logs[:axes]),
        deviation=float(np.exp(logs[axes])),
        noise_factor=float(np.exp(logs[axes + 1])),
        coordinates=coordinates,
        stage=stage,
        noise=noise,
    )
