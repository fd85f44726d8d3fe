# SPDX-License-Identifier: Apache-2.0
"""The identification problem: what is minimised, and the local search that finishes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.agreement import determination_loss
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, SEARCH_BOUNDS, from_scaled
from ..transmission.ranges import OperatingPoints

Array = NDArray[np.float64]
OBJECTIVES = {"power_balance": "weighted squares", "published": "1 - RSQ, eq. (21)"}
"""What each formulation minimises."""

_FAR = 1e3  # residual, or 1 - RSQ, where the model has no answer
_PRECISION = 1e-14


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples, and the model that shall meet them; scaled variables are those of `from_scaled`.

    Attributes:
        model: stage, formulation and effects; its parameters are the ones to be found.
        samples: n bench samples.
    """

    model: EfficiencyModel
    samples: BenchSamples

    @cached_property
    def deviation(self) -> Array:
        """Standard deviation of each efficiency, (n,) [-]; the paper's, eq. (3), where unstated."""
        stated = self.samples.efficiency_std
        return PAPER_EFFICIENCY_UNCERTAINTY * self.samples.efficiency if stated is None else stated

    @cached_property
    def points(self) -> OperatingPoints:
        """Operating points of the samples."""
        s = self.samples
        return OperatingPoints(s.displacement_ratio, s.engine_speed, s.load_torque,
                               s.oil_temperature)

    def predict(self, scaled: Array) -> Array:
        """Efficiency at scaled variables of shape (..., 3): shape (..., n)."""
        return self.model.efficiency_of_candidates(from_scaled(scaled), self.points)

    def residuals(self, scaled: Array) -> Array:
        """(Predicted - measured) / deviation, shape (..., n); NaN where there is no answer."""
        return (self.predict(scaled) - self.samples.efficiency) / self.deviation

    def objective(self, scaled: Array) -> Array:
        """What the formulation minimises (`OBJECTIVES`), shape (...).

        Both are measured in units of a scatter, so that t_0 = 1 of the annealing means the same for
        every bench: the mean of weighted squares in the variance of the noise, at which it is 1 for
        a true model; 1 - RSQ in the spread of the predictions.
        """
        if self.model.formulation == "published":
            return determination_loss(self.predict(scaled), self.samples.efficiency)
        return np.asarray((self.residuals(scaled) ** 2).mean(axis=-1))

    def finish(self, ends: Array) -> tuple[Array, float]:
        """Finish points of shape (m, 3) by a local search within the bounds.

        Returns:
            The best point, shape (3,), and its objective; infinite where some sample has no answer.
        """
        search = self._simplex if self.model.formulation == "published" else self._least_squares
        points = np.vstack([*(search(end) for end in ends), *ends])
        values = np.nan_to_num(self.objective(points), nan=np.inf)
        return points[int(values.argmin())], float(values.min())

    def _least_squares(self, start: Array) -> Array:
        from scipy.optimize import least_squares

        # Of SciPy's methods this one puts a parameter on its bound, not next to it.
        found = least_squares(lambda scaled: np.nan_to_num(self.residuals(scaled), nan=_FAR), start,
                              bounds=SEARCH_BOUNDS.T, method="dogbox", ftol=_PRECISION,
                              xtol=_PRECISION, gtol=_PRECISION)
        return np.asarray(found.x)

    def _simplex(self, point: Array) -> Array:
        """Search that also follows the edge of consistency, where RSQ may be highest."""
        from scipy.optimize import minimize

        for _ in range(2):  # one run may collapse early
            point = minimize(lambda scaled: np.nan_to_num(self.objective(scaled), nan=_FAR), point,
                             method="Nelder-Mead", bounds=SEARCH_BOUNDS,
                             options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 2000}).x
        return point
