# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Posterior predictive distribution of one explanation at possible tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..system import Array


class Prediction(NamedTuple):
    """One explanation at possible tests, linear in its coefficients.

    Attributes:
        mean: predicted less reference reading, in deviations, shape (channels, n); NaN where the
            model has no answer.
        columns: derivatives by the coefficients, in deviations, shape (channels, n, p).
        covariance: of the coefficients, shape (p, p).
    """

    mean: Array
    columns: Array
    covariance: Array

    @property
    def reading_covariance(self) -> Array:
        """Covariance of the predicted readings without noise, shape (n, channels, channels)."""
        by_point = np.swapaxes(self.columns, 0, 1)
        return np.asarray(by_point @ self.covariance @ np.swapaxes(by_point, 1, 2))

    def after_reading(self, index: int) -> Prediction:
        """Return the prediction once a test has been read, whatever the reading.

        The covariance of a Kalman update; the noise of a reading is one deviation.

        Args:
            index: of the test.
        """
        columns = self.columns[:, index]
        noise = np.eye(len(columns))
        innovation = self.reading_covariance[index] + noise
        gain = self.covariance @ columns.T @ np.linalg.inv(innovation)
        return self._replace(
            covariance=self.covariance - gain @ columns @ self.covariance
        )

    def squared_distance(self, other: Prediction, tests: float) -> float:
        r"""Return the squared deviations from another prediction after adapting to it.

        With miss d, weight w of each point, columns J and prior covariance C of this explanation:

        .. math:: w\,d^Td - w\,d^TJ\,C\,(I + w J^TJ\,C)^{-1}\,w J^Td

        Args:
            other: what the tests read.
            tests: how many, evenly over the points.
        """
        miss = (other.mean - self.mean).ravel()
        columns = self.columns.reshape(len(miss), -1)
        weight = tests / self.mean.shape[1]
        # No inverse of a covariance, whose units may differ by orders of magnitude.
        inner = (
            np.eye(columns.shape[1]) + weight * columns.T @ columns @ self.covariance
        )
        cross = weight * columns.T @ miss
        adapted = cross @ self.covariance @ np.linalg.solve(inner, cross)
        return float(weight * miss @ miss - adapted)
