# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The problem of the identification: residuals and objective of candidate parameters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, from_scaled
from ..transmission.ranges import Array
from .criterion import CRITERIA, Criterion


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples and the model to be fitted to them; the variables are those of `from_scaled`.

    Attributes:
        model: stage, formulation and effects; its parameters are the ones to be identified.
        samples: n bench samples.
    """

    model: EfficiencyModel
    samples: BenchSamples

    @property
    def criterion(self) -> Criterion:
        """What the formulation of the model minimises."""
        return CRITERIA[self.model.formulation]

    @cached_property
    def deviation(self) -> Array:
        """Standard deviation of each efficiency, (n,) [-]; the paper's, eq. (3), where unstated."""
        stated = self.samples.efficiency_std
        if stated is None:
            return PAPER_EFFICIENCY_UNCERTAINTY * self.samples.efficiency
        return stated

    def parameters(self, variables: Array) -> Array:
        """Parameters in SI units of variables of shape (..., 3)."""
        return from_scaled(variables)

    def predict(self, variables: Array) -> Array:
        """Efficiency at variables of shape (..., 3): shape (..., n)."""
        return self.model.efficiency_of_candidates(
            self.parameters(variables), self.samples.points
        )

    def residuals(self, variables: Array) -> Array:
        """(Predicted - measured) / deviation, shape (..., n); NaN where there is no answer."""
        return (self.predict(variables) - self.samples.efficiency) / self.deviation

    def objective(self, variables: Array) -> Array:
        """The criterion at variables of shape (..., 3): shape (...)."""
        return self.criterion.value(
            self.predict(variables), self.samples.efficiency, self.deviation
        )

    def finish(self, ends: Array) -> tuple[Array, float]:
        """Finish points of shape (m, 3) by a local search within the bounds.

        Returns:
            The best point, shape (3,), and its objective; infinite where some sample has no answer.
        """
        polished = self.criterion.local_searches(self.residuals, self.objective, ends)
        points = np.vstack([polished, ends])
        values = np.nan_to_num(self.objective(points), nan=np.inf)
        return points[int(values.argmin())], float(values.min())
