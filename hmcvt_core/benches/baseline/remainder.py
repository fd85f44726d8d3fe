# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""What physical terms leave of a sound machine, as a smooth function with its uncertainty.

Readings are

.. math:: y(x) = h(x)^T a + g(x) + \epsilon, \qquad a \sim N(0, S), \quad g \sim GP(0, k)

with columns h of physical terms, a Gaussian process g over the operating point (Kennedy & O'Hagan
2001, J. R. Stat. Soc. B 63, 425; Rasmussen & Williams 2006, section 2.7), and noise. k is a Matern
kernel of order 5/2 with one length for each axis. Far from the data g fades to zero and its
standard deviation returns to that of the prior.

Part of the noise is drift: readings taken in succession at about one operating point share errors,
with a correlation that falls exponentially with the number of readings between them. Samples that
count as independent although they are not make a small difference look significant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENGTH_MEDIAN = 1.0
"""Prior median of a length, as a part of the range of its axis.

Losses of hydrostatic units are polynomials of second degree over their range (ISO 4409 maps;
Ivantysyn & Ivantysynova), whose remainders bend about once.
"""
LENGTH_LOG_DEVIATION = 0.7
"""Prior deviation of the log of a length: a factor of two either way."""
DEVIATION_LOG_DEVIATION = 1.0
"""Prior deviation of the log of the standard deviation of g: a factor of three either way."""
NOISE_LOG_DEVIATION = 0.35
"""Prior deviation of the log of stated noise: a factor of 1.4 either way."""
ASSUMED_NOISE_LOG_DEVIATION = 1.0
"""The same of assumed noise: a factor of three either way."""
MAX_FOR_LENGTHS = 200
"""Maximum number of samples by which lengths and noise are estimated. Limit of computing time."""
MAX_SAMPLES = 1000
"""Maximum number of samples that are conditioned on. Limit of computing time and memory."""
JITTER = 1e-9
"""Fraction of the variance that is added to the diagonal against rounding."""
SCATTER_REACH = 0.15
"""Distance over which noise is averaged, as a part of the range of each axis; chosen.

About a seventh of a range is the distance of neighbours in campaigns of some ten tests an axis.
"""
SCATTER_PRIOR = 8.0
"""Samples that the statement of even noise is worth against the local scatter.

The same weight as a stated noise has in a diagnosis (`PRIOR_DOF_STATED`).
"""
MIN_VARIATION = 0.05
"""Variation along an axis, in its width, below which the length along it keeps its median."""
LENGTH_LOG_BOUNDS = (math.log(0.3), 2.0)
"""Bounds of the log of a length: what bends within a third of a range is not smooth.

Anything narrower follows the drift of a bench, because its oil warms as time goes on.
"""
DRIFT_MEDIAN = 0.5
"""Prior median of drift / independent noise; its log has `DEVIATION_LOG_DEVIATION`."""
DRIFT_READINGS = 5.0
"""Prior median of the number of readings over which drift lasts; assumed.

Five windows are a usual load cycle. Its log has `LENGTH_LOG_DEVIATION`.
"""
SUCCESSIVE = 5
"""Minimum number of readings in succession that are left out together, as drift lasts.

Those next to a reading left out would predict it too well.
"""
LONGEST_RUN = 0.2
"""Largest part of the readings that is left out together: five folds at least."""
START_STEP = 1.0
"""Distance of the second start of a search from the prior medians, in logarithms: a factor of
three, as far as the widest of the priors reaches."""
MIN_GAIN = 1e-6
"""Gain in log posterior from which a later start replaces an earlier one, above rounding."""
DEVIATION_LOG_BOUNDS = (-4.0, 3.0)
NOISE_LOG_BOUNDS = (-4.0, 4.0)
"""Bounds of the logs of deviation and noise, against runaway searches."""


@dataclass(frozen=True)
class Training:
    """Readings of one channel of a sound machine; n samples, d axes, p physical terms.

    Attributes:
        points: operating points, shape (n, d).
        columns: physical terms at unit coefficients, shape (n, p).
        spread: prior standard deviations of the coefficients, shape (p,).
        values: readings, shape (n,).
        noise: their standard deviations, shape (n,).
        smooth_deviation: prior median of the standard deviation of the remainder.
        noise_stated: whether `noise` is stated rather than assumed.
        nonnegative: which coefficients are at least zero, shape (p,).
        min_width: least range by which each axis is scaled, shape (d,).
        order: number of each reading in the order of time, shape (n,).
    """

    points: Array
    columns: Array
    spread: Array
    values: Array
    noise: Array
    smooth_deviation: float
    nonnegative: NDArray[np.bool_]
    min_width: Array
    order: Array
    noise_stated: bool = False

    def select(self, index: NDArray[np.intp]) -> Training:
        """Return the readings of an index."""
        return replace(
            self,
            points=self.points[index],
            columns=self.columns[index],
            values=self.values[index],
            noise=self.noise[index],
            order=self.order[index],
        )


class LeftOut(NamedTuple):
    """Residuals at readings that are left out in runs.

    Attributes:
        residuals: residual / its standard deviation, in the order of time, shape (n,).
        run: number of readings in succession that are left out together.
    """

    residuals: Array
    run: int


@dataclass(frozen=True)
class Scatter:
    """How the noise of a bench differs over the operating points.

    Attributes:
        positions: of the samples, axes scaled by their range, shape (n, d).
        squares: squared residual / variance expected of even noise, shape (n,).
    """

    positions: Array
    squares: Array

    def at(self, positions: Array) -> Array:
        """Return noise / even noise, shape (m,).

        Args:
            positions: shape (m, d).
        """
        from scipy.spatial.distance import cdist

        distance = cdist(positions, self.positions) / SCATTER_REACH
        weights = np.exp(-0.5 * distance**2)
        total = SCATTER_PRIOR + weights.sum(axis=1)
        return np.sqrt((SCATTER_PRIOR + weights @ self.squares) / total)


@dataclass(frozen=True)
class Drift:
    """Noise that readings in succession share.

    Attributes:
        deviation: standard deviation of drift / independent noise.
        readings: number of readings over which the correlation falls to 1/e.
    """

    deviation: float
    readings: float

    def covariance(self, scaled: Array, order: Array, noise: Array) -> Array:
        """Return the covariance of readings of one campaign, shape (n, n).

        Args:
            scaled: operating points, axes scaled by their width, shape (n, d).
            order: number of each reading in the order of time, shape (n,).
            noise: independent noise of each reading, shape (n,).
        """
        reach = np.full(scaled.shape[1], SCATTER_REACH)
        apart = np.abs(order[:, None] - order)
        correlation = np.exp(-apart / self.readings) * matern(scaled, scaled, reach)
        return self.deviation**2 * np.outer(noise, noise) * correlation


@dataclass(frozen=True, eq=False)
class Remainder:
    """Physical terms and a Gaussian process, fitted to the readings of one channel.

    Attributes:
        training: the readings.
        low: lowest value along each axis, shape (d,).
        width: range by which each axis is scaled, shape (d,).
        lengths: of the kernel, as parts of `width`, shape (d,).
        deviation: prior standard deviation of the process.
        noise_factor: noise / stated or assumed noise.
        drift: noise that readings in succession share.
        coefficients: of the physical terms, shape (p,).
        scatter: how the noise differs over the operating points, or None where it is even.
    """

    training: Training
    low: Array
    width: Array
    lengths: Array
    deviation: float
    noise_factor: float
    drift: Drift
    coefficients: Array
    scatter: Scatter | None = None

    def noise_ratio_at(self, points: Array) -> Array:
        """Return noise / stated or assumed noise at operating points, shape (m,).

        Args:
            points: shape (m, d).
        """
        ratio = np.full(len(points), self.noise_factor)
        if self.scatter is None:
            return ratio
        return np.asarray(ratio * self.scatter.at((points - self.low) / self.width))

    @property
    def noise(self) -> Array:
        """Standard deviation of each reading, shape (n,)."""
        return self.noise_factor * self.training.noise

    def drift_covariance(self, points: Array, noise: Array) -> Array:
        """Return the covariance of drift in another campaign, shape (m, m).

        Args:
            points: operating points in the order of time, shape (m, d).
            noise: independent noise of each reading, shape (m,).
        """
        scaled = (points - self.low) / self.width
        return self.drift.covariance(scaled, np.arange(float(len(points))), noise)

    def predict(
        self, points: Array, columns: Array, with_smooth: bool = True
    ) -> tuple[Array, Array]:
        """Return mean and covariance of the channel without noise.

        Args:
            points: operating points, shape (m, d).
            columns: physical terms there, shape (m, p).
            with_smooth: whether the process is part of the mean; its covariance always is.

        Returns:
            Mean, shape (m,), and covariance, shape (m, m).
        """
        from scipy.linalg import cho_solve, solve_triangular

        between = self._covariance(points, self.training.points)
        of_smooth = self._covariance(points, points)
        mean = columns @ self.coefficients
        if with_smooth:
            mean = mean + between @ self._weights
        factor = self._factor
        solved = solve_triangular(factor, between.T, lower=True)
        covariance = of_smooth - solved.T @ solved
        free = self._free
        left = columns[:, free] - between @ cho_solve(
            (factor, True), self.training.columns[:, free]
        )
        covariance = covariance + left @ self.coefficient_covariance @ left.T
        return mean, np.asarray(0.5 * (covariance + covariance.T))

    @cached_property
    def coefficient_covariance(self) -> Array:
        """Covariance of the coefficients that are not held at zero."""
        from scipy.linalg import solve_triangular

        free = self._free
        columns = self.training.columns[:, free]
        solved = solve_triangular(self._factor, columns, lower=True)
        prior = np.diag(self.training.spread[free] ** -2.0)
        return np.asarray(np.linalg.inv(solved.T @ solved + prior))

    @property
    def _free(self) -> NDArray[np.bool_]:
        """Which coefficients are not held at zero, shape (p,)."""
        return np.asarray(~self.training.nonnegative | (self.coefficients > 0.0))

    @cached_property
    def _factor(self) -> Array:
        """Lower Cholesky factor of the covariance of the readings at given coefficients."""
        return _factor_of(self._of_readings, self.noise)

    @cached_property
    def _of_readings(self) -> Array:
        """Covariance of process and drift at the readings, shape (n, n)."""
        training = self.training
        scaled = (training.points - self.low) / self.width
        return self._covariance(
            training.points, training.points
        ) + self.drift.covariance(scaled, training.order, self.noise)

    @cached_property
    def _weights(self) -> Array:
        """Weights of the kernel at each reading, shape (n,)."""
        from scipy.linalg import cho_solve

        left = self.training.values - self.training.columns @ self.coefficients
        return np.asarray(cho_solve((self._factor, True), left))

    def left_out_runs(self) -> LeftOut:
        """Return residuals at readings left out for as long as drift lasts."""
        longest = max(1, int(LONGEST_RUN * len(self.training.values)))
        run = max(SUCCESSIVE, math.ceil(self.drift.readings))
        run = min(run, longest)
        return LeftOut(self.left_out_residuals(run), run)

    def left_out_residuals(self, run: int = 1) -> Array:
        """Return residuals at readings left out / their standard deviations, shape (n,).

        In closed form (Rasmussen & Williams 2006, eq. 5.12), with the terms as part of the process.

        Args:
            run: number of readings in succession that are left out together.
        """
        training = self.training
        scaled_terms = training.columns * training.spread
        covariance = self._of_readings + scaled_terms @ scaled_terms.T
        inverse = np.linalg.inv(covariance + np.diag(self.noise**2))
        weighted = inverse @ training.values
        residuals = np.empty(len(weighted))
        for start in range(0, len(weighted), run):
            rows = slice(start, start + run)
            of_run = np.linalg.inv(inverse[rows, rows])
            residuals[rows] = of_run @ weighted[rows] / np.sqrt(np.diagonal(of_run))
        return residuals

    def _covariance(self, points: Array, others: Array) -> Array:
        scaled = (points - self.low) / self.width
        scaled_others = (others - self.low) / self.width
        return self.deviation**2 * matern(scaled, scaled_others, self.lengths)


def matern(points: Array, others: Array, lengths: Array) -> Array:
    """Return the Matern correlation of order 5/2 between points, shape (m, k).

    Args:
        points: shape (m, d).
        others: shape (k, d).
        lengths: shape (d,).
    """
    from scipy.spatial.distance import cdist

    root = np.sqrt(5.0) * cdist(points / lengths, others / lengths)
    return np.asarray((1.0 + root + root**2 / 3.0) * np.exp(-root))


def fit_remainder(training: Training) -> Remainder:
    """Fit physical terms and a Gaussian process to the readings of one channel.

    Lengths, deviation and noise maximise the posterior, with log-normal priors around the medians
    above; the coefficients are the posterior mean, or mode where they are at least zero. A second
    fit weighs each reading by the scatter of its neighbours.

    Args:
        training: at least one reading.
    """
    training = training.select(_spread_rows(len(training.values), MAX_SAMPLES))
    even = _fit(training)
    positions = (training.points - even.low) / even.width
    scatter = Scatter(positions, even.left_out_residuals() ** 2)
    uneven = replace(training, noise=training.noise * scatter.at(positions))
    return replace(_fit(uneven), scatter=scatter)


def _fit(training: Training) -> Remainder:
    """Fit terms and process at the relative noise that the readings state."""
    low = training.points.min(axis=0)
    width = np.maximum(np.ptp(training.points, axis=0), training.min_width)
    subset = training.select(_spread_rows(len(training.values), MAX_FOR_LENGTHS))
    scaled = (subset.points - low) / width
    logs = _fitted_logs(subset, scaled)
    axes = training.points.shape[1]
    lengths = LENGTH_MEDIAN * np.exp(logs[:axes])
    deviation = training.smooth_deviation * float(np.exp(logs[axes]))
    noise_factor = float(np.exp(logs[axes + 1]))
    drift = _drift_of(logs)
    noise = noise_factor * training.noise
    scaled = (training.points - low) / width
    covariance = deviation**2 * matern(scaled, scaled, lengths)
    covariance = covariance + drift.covariance(scaled, training.order, noise)
    coefficients = _coefficients(training, _factor_of(covariance, noise))
    return Remainder(
        training, low, width, lengths, deviation, noise_factor, drift, coefficients
    )


def _drift_of(logs: Array) -> Drift:
    """Return the drift of the last two logarithms, relative to the prior medians."""
    deviation, readings = np.exp(logs[-2:]).tolist()
    return Drift(DRIFT_MEDIAN * deviation, DRIFT_READINGS * readings)


def _spread_rows(count: int, most: int) -> NDArray[np.intp]:
    """Return the indices of at most so many of the rows, drawn evenly."""
    if count <= most:
        return np.arange(count)
    drawn = np.random.default_rng(0).permutation(count)[:most]
    return np.sort(drawn)


def _fitted_logs(training: Training, scaled: Array) -> Array:
    """Return the logs of lengths, deviation, noise and drift, relative to their prior medians.

    Args:
        training: the readings.
        scaled: operating points, axes scaled to 0 ... 1, shape (n, d).
    """
    from scipy.optimize import minimize

    posterior = _LogPosterior(training, scaled)
    free = len(posterior.free)
    bounds = [LENGTH_LOG_BOUNDS] * (free - 4)
    bounds += [DEVIATION_LOG_BOUNDS, NOISE_LOG_BOUNDS]
    bounds += [DEVIATION_LOG_BOUNDS, LENGTH_LOG_BOUNDS]
    searches = []
    for start in _starts(free):
        searches.append(
            minimize(
                posterior.cost_and_gradient,
                start,
                method="L-BFGS-B",
                jac=True,
                bounds=bounds,
                options={"maxiter": 200, "ftol": 1e-12, "gtol": 1e-6},
            )
        )
    best, *others = searches
    for other in others:
        # A tie by rounding goes to the first start.
        if other.fun < best.fun - MIN_GAIN:
            best = other
    return posterior.logs_of(best.x)


class _LogPosterior:
    """Log posterior density of the logs of lengths, deviation, noise and drift.

    The logs are relative to their prior medians. That of a length along an axis that does not vary
    changes nothing and stays zero.

    Attributes:
        axes: number of the axes.
        spread: prior deviations of all logs, shape (axes + 4,).
        free: indices of those that are fitted, shape (k,).

    Args:
        training: the readings.
        scaled: operating points, axes scaled to 0 ... 1, shape (n, d).
    """

    def __init__(self, training: Training, scaled: Array) -> None:
        self._training = training
        self.axes = scaled.shape[1]
        noise_deviation = ASSUMED_NOISE_LOG_DEVIATION
        if training.noise_stated:
            noise_deviation = NOISE_LOG_DEVIATION
        self.spread = np.array(
            [
                *[LENGTH_LOG_DEVIATION] * self.axes,
                DEVIATION_LOG_DEVIATION,
                noise_deviation,
                DEVIATION_LOG_DEVIATION,
                LENGTH_LOG_DEVIATION,
            ]
        )
        varies = np.ptp(scaled, axis=0) > MIN_VARIATION
        self.free = np.append(np.flatnonzero(varies), self.axes + np.arange(4))
        terms = training.columns * training.spread
        self._of_terms = terms @ terms.T
        self._apart = np.abs(training.order[:, None] - training.order)
        squares = (scaled[:, None] - scaled) ** 2
        self._squares = np.ascontiguousarray(np.moveaxis(squares, -1, 0))
        self._near = matern(scaled, scaled, np.full(self.axes, SCATTER_REACH))
        self._noise_products = np.outer(training.noise, training.noise)

    def logs_of(self, free_logs: Array) -> Array:
        """Return all logs, shape (axes + 4,), for those that are fitted, shape (k,)."""
        logs = np.zeros(self.axes + 4)
        logs[self.free] = free_logs
        return logs

    def cost_and_gradient(self, free_logs: Array) -> tuple[float, Array]:
        """Return the negative log density, up to a constant, and its gradient, shape (k,).

        Args:
            free_logs: those that are fitted, shape (k,).
        """
        logs = self.logs_of(free_logs)
        readings = self._training.values
        lengths = LENGTH_MEDIAN * np.exp(logs[: self.axes])
        deviation = self._training.smooth_deviation * np.exp(logs[self.axes])
        noise_factor = np.exp(logs[self.axes + 1])
        noise = noise_factor * self._training.noise
        drift = _drift_of(logs)
        correlation, length_slopes = _matern_with_slopes(self._squares, lengths)
        of_smooth = deviation**2 * correlation
        lasting = np.exp(-self._apart / drift.readings) * self._near
        drift_variance = (drift.deviation * noise_factor) ** 2
        of_drift = drift_variance * self._noise_products * lasting
        factor = _factor_of(of_smooth + self._of_terms + of_drift, noise)
        weights, inverse = _solved(factor, readings)
        cost = 0.5 * readings @ weights + np.sum(np.log(np.diagonal(factor)))
        cost += 0.5 * float(np.sum((logs / self.spread) ** 2))

        # Half the sum of the difference times the derivative of the covariance by a logarithm.
        difference = inverse - np.outer(weights, weights)
        in_smooth = difference * (0.5 * deviation**2)
        in_drift = difference * of_drift
        by_noise = np.sum(np.diagonal(difference) * noise**2)
        gradient = [np.vdot(in_smooth, slope) for slope in length_slopes]
        gradient += [
            2.0 * np.vdot(in_smooth, correlation),
            np.sum(in_drift) + by_noise,
            np.sum(in_drift),
            0.5 * np.vdot(in_drift, self._apart) / drift.readings,
        ]
        return float(cost), (np.array(gradient) + logs / self.spread**2)[self.free]


def _starts(count: int) -> list[Array]:
    """Return the points at which a search begins, relative to the prior medians.

    What bends may count as noise, so that the second start has more noise and less process.

    Args:
        count: number of free logarithms, the last four those of deviation, noise and drift.
    """
    medians = np.zeros(count)
    noisy = np.zeros(count)
    noisy[-4] = -START_STEP
    noisy[-3] = START_STEP
    return [medians, noisy]


def _matern_with_slopes(squares: Array, lengths: Array) -> tuple[Array, Array]:
    """Return `matern` between all points, and its derivatives by the log of each length.

    Args:
        squares: squared differences of the points along each axis, shape (d, n, n).
        lengths: shape (d,).

    Returns:
        Shapes (n, n) and (d, n, n).
    """
    scaled = squares / lengths[:, None, None] ** 2
    root = np.sqrt(5.0 * np.sum(scaled, axis=0))
    decay = np.exp(-root)
    linear = 1.0 + root
    correlation = (linear + root**2 / 3.0) * decay
    scaled *= 5.0 / 3.0 * linear * decay
    return correlation, scaled


def _solved(factor: Array, values: Array) -> tuple[Array, Array]:
    """Return the inverse of a covariance times the readings, and the inverse.

    Args:
        factor: lower Cholesky factor of the covariance, shape (n, n).
        values: readings, shape (n,).
    """
    from scipy.linalg.lapack import dpotri

    # Above its diagonal the factor is zero, and stays so.
    half, _ = dpotri(factor, lower=1)
    inverse = half + half.T
    inverse[np.diag_indices_from(inverse)] = np.diagonal(half)
    return inverse @ values, inverse


def _factor_of(covariance: Array, noise: Array) -> Array:
    """Return the lower Cholesky factor of a covariance with independent noise added."""
    from scipy.linalg import cholesky

    diagonal = np.diagonal(covariance)
    added = noise**2 + JITTER * max(float(diagonal.max(initial=0.0)), 1e-300)
    noisy = covariance.copy()
    noisy[np.diag_indices_from(noisy)] += added
    return np.asarray(cholesky(noisy, lower=True))


def _coefficients(training: Training, factor: Array) -> Array:
    """Return the coefficients of the physical terms, shape (p,)."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import lsq_linear

    count = training.columns.shape[1]
    if count == 0:
        return np.zeros(0)
    # In units of the prior deviations, so that the rows of the prior are those of one matrix.
    scaled_columns = training.columns * training.spread
    whitened = solve_triangular(factor, scaled_columns, lower=True)
    target = solve_triangular(factor, training.values, lower=True)
    rows = np.concatenate([whitened, np.eye(count)])
    aim = np.concatenate([target, np.zeros(count)])
    lowest = np.where(training.nonnegative, 0.0, -np.inf)
    solution = lsq_linear(rows, aim, (lowest, np.inf), "bvls").x
    # The solver may leave a coefficient at its bound by rounding.
    solution[training.nonnegative & (solution < JITTER)] = 0.0
    return np.asarray(solution * training.spread)
