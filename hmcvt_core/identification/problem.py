# SPDX-License-Identifier: Apache-2.0
"""The identification problem: scaled variables, bounds, residuals, objectives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..model.relative_error import RelativeError
from ..transmission.parameters import HydraulicParameters, from_scaled
from ..transmission.points import OperatingPoints
from ..transmission.uncertainty import PAPER_EFFICIENCY_UNCERTAINTY

Array = NDArray[np.float64]

# Scaled variables: log10 of the leakage, which spans decades; the dampings as they are, so that
# zero can be reached.
BOUNDS = np.array([[-13.0, -10.0], [0.0, 1.0], [0.0, 1.5]])
BOUND_TEXT = {
    "leakage": ("1e-13", "1e-10"), "motor_damping": ("0", "1"), "pump_damping": ("0", "1.5"),
}


def to_parameters(scaled: Array) -> HydraulicParameters:
    """Return the parameters at scaled variables of shape (3,)."""
    return HydraulicParameters(float(10.0 ** scaled[0]), float(scaled[1]), float(scaled[2]))


def to_scaled(parameters: HydraulicParameters) -> Array:
    """Return scaled variables of shape (3,), within the bounds."""
    values = parameters.to_array()
    values[0] = np.log10(values[0])
    return np.clip(values, BOUNDS[:, 0], BOUNDS[:, 1])


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples, the model form that shall meet them, and the weight of each sample.

    Attributes:
        model: stage and formulation; its parameters are the ones to be found.
        samples: n bench samples.
        deviation: standard deviation of each efficiency, shape (n,) [-].
        deviation_known: whether the samples state it (else the paper's 1.12 % is taken).
    """

    model: EfficiencyModel
    samples: BenchSamples
    deviation: Array
    deviation_known: bool

    @classmethod
    def of(cls, model: EfficiencyModel, samples: BenchSamples) -> Problem:
        """Set up; samples without `efficiency_std` get the paper's uncertainty, eq. (3)."""
        known = samples.efficiency_std is not None
        deviation = (samples.efficiency_std if samples.efficiency_std is not None
                     else PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency)
        return cls(model, samples, deviation, known)

    @property
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

    def weighted_squares(self, scaled: Array) -> Array:
        """Mean squared weighted residual, shape (...)."""
        return np.asarray((self.residuals(scaled) ** 2).mean(axis=-1))

    def determination_loss(self, scaled: Array) -> Array:
        """1 - RSQ of eq. (21), shape (...).

        As printed, the lower sum runs over predicted (not measured) minus the measured mean.
        """
        predicted, measured = self.predict(scaled), self.samples.efficiency
        spread = np.sum((predicted - measured.mean()) ** 2, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.sum((predicted - measured) ** 2, axis=-1) / spread)


def relative_error(problem: Problem, scaled: Array) -> RelativeError:
    """Error of the prediction at scaled variables of shape (3,)."""
    return RelativeError.of(problem.predict(scaled), problem.samples.efficiency)
