# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Posterior predictive of one explanation at possible tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..system import Array


class Prediction(NamedTuple):
    """One explanation on possible tests, linear in its free parameters.

    Attributes:
        mean: reading above that of the point, in deviations, shape (channels, n); NaN: no answer.
        columns: shape (channels, n, p).
        covariance: of the free parameters, shape (p, p).
    """

    mean: Array
    columns: Array
    covariance: Array

    @property
    def reading_covariance(self) -> Array:
        """Covariance of what is foretold, without noise, shape (n, channels, channels)."""
        by_point = np.swapaxes(self.columns, 0, 1)
        return np.asarray(by_point @ self.covariance @ np.swapaxes(by_point, 1, 2))

    def after_reading(self, index: int) -> Prediction:
        """Return the same when a point has been read, whatever the reading (Kalman update)."""
        own = self.columns[:, index]
        gain = (
            self.covariance
            @ own.T
            @ np.linalg.inv(self.reading_covariance[index] + np.eye(len(own)))
        )
        return self._replace(covariance=self.covariance - gain @ own @ self.covariance)

    def squared_distance(self, other: Prediction, tests: float) -> float:
        """Squared deviations from another once this one has adapted, at the cost of its prior.

        Args:
            other: what the tests read.
            tests: how many, evenly over the points.
        """
        miss = (other.mean - self.mean).ravel()
        columns, each = self.columns.reshape(len(miss), -1), tests / self.mean.shape[1]
        # Without the inverse of a covariance over units of very different sizes.
        inner = np.eye(columns.shape[1]) + each * columns.T @ columns @ self.covariance
        cross = each * columns.T @ miss
        return float(
            each * miss @ miss - cross @ self.covariance @ np.linalg.solve(inner, cross)
        )
