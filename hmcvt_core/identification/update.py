# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far a refit follows its samples in each independent direction of the parameters.

The information of the samples, measured against the prior, falls into three independent directions.
Each has a significance t: the least that is left when any one operating point is taken away. The
variance of the prior is inflated until the change lies within c standard deviations (covariance
inflation of an adaptive Kalman filter [Jazwinski 1969, Automatica 5]); that follows 1 - c^2 / t^2
of a change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..model.model import EfficiencyModel
from ..transmission.parameters import PARAMETER_NAMES, HydraulicParameters
from ..transmission.ranges import Array
from .prior import Prior
from .robust import RobustProblem

_TAIL = 0.0228
"""Of either tail: two standard deviations where the noise is well known."""
_MOSTLY = 0.5
"""Fraction of a parameter's change below which the parameter counts as kept."""


@dataclass(frozen=True, eq=False)
class Update:
    """Changes that are independent of each other, and the fraction of each that is followed.

    Attributes:
        scatter: standard deviation of the weighted residuals.
        directions: one in each column, in terms of `Prior.root`, shape (3, 3).
        information: of the samples about a step in each, where the prior has 1, shape (3,).
        steps: best step in each, shape (3,).
        fraction: of it that is followed, 0 to 1, shape (3,).
    """

    scatter: float
    directions: Array
    information: Array
    steps: Array
    fraction: Array

    @classmethod
    def of(cls, problem: RobustProblem, start: Array) -> Update:
        """Return the update by samples that belong together, near a change `start` (3,)."""
        from scipy.stats import t as student

        scatter = float(problem.scatter(problem.residuals(start), problem.votes))
        change = problem.least_squares(start, problem.votes / scatter**2)
        residuals = problem.residuals(change)
        scatter = float(problem.scatter(residuals, problem.votes))
        weight_roots = np.sqrt(problem.votes) / scatter
        slopes = problem.slopes(change) * weight_roots[:, None]
        information, directions = np.linalg.eigh(slopes.T @ slopes)
        steps = change @ directions
        significance = _least_significance(
            problem, slopes @ directions, residuals * weight_roots, information, steps
        )
        free = max(problem.votes.sum() - len(steps), 0.0) + 1.0
        with np.errstate(divide="ignore"):
            ratio = student.isf(_TAIL, free) / significance
            fraction = np.maximum(0.0, 1.0 - ratio**2)
        if fraction.any() and not problem.prior.stated:
            # Nothing but these samples supports a model without errors, and they refute it: the
            # most probable parameters are taken, with the wear as prior.
            fraction = np.maximum(fraction, information / (1.0 + information))
        return cls(scatter, directions, information, steps, fraction)

    def applied(self, problem: RobustProblem) -> EfficiencyModel:
        """Return the model in service, moved along the directions that are followed.

        Its errors are those of samples and prior, by the fraction that each has in the model.
        """
        chosen = self.fraction > 0.0
        model = problem.model
        if chosen.any():
            change = problem.nearest(
                (self.fraction * self.steps)[chosen],
                problem.votes / self.scatter**2,
                self.directions[:, chosen],
                (self.information * (1.0 - self.fraction))[chosen]
                / self.fraction[chosen],
            )
            values = problem.prior.parameters(change).tolist()
            model = replace(model, parameters=HydraulicParameters(*values))
        covariance = self._covariance(problem.prior)
        spread = np.sqrt(np.diag(covariance))
        free = model.degrees_of_freedom
        if free is not None:
            # The samples add to what is known of the scatter.
            free += float(problem.votes.sum())
        errors = dict(zip(PARAMETER_NAMES, spread.tolist(), strict=True))
        return model.with_errors(errors, covariance / np.outer(spread, spread), free)

    def _covariance(self, prior: Prior) -> Array:
        """Covariance of the parameters in their units, shape (3, 3)."""
        to_steps = self.directions.T @ np.linalg.inv(prior.root)
        kept = np.outer(1.0 - self.fraction, 1.0 - self.fraction)
        in_steps = kept * (to_steps @ prior.covariance @ to_steps.T)
        in_steps = in_steps + np.diag(self.fraction**2 / (1.0 + self.information))
        to_parameters = (prior.unit[:, None] * prior.root) @ self.directions
        return np.asarray(to_parameters @ in_steps @ to_parameters.T)

    def kept(self, prior: Prior) -> tuple[str, ...]:
        """Return a sentence for each parameter that stays mostly as it is."""
        share = (prior.root @ self.directions) ** 2
        followed = share @ self.fraction / share.sum(axis=1)
        sentences = []
        for name, proven in zip(PARAMETER_NAMES, followed, strict=True):
            if proven < _MOSTLY:
                sentences.append(
                    f"{name} is kept from the model in service: of how it may have "
                    f"changed, the samples prove {100.0 * proven:.0f} %"
                )
        return tuple(sentences)


def _least_significance(
    problem: RobustProblem,
    slopes: Array,
    residuals: Array,
    information: Array,
    steps: Array,
) -> Array:
    """Steps by their standard errors, (3,), without the operating point that supports them most."""
    count = len(steps)
    groups = problem.point_numbers
    shape = (int(groups.max()) + 1, count, count)
    lost_information = np.zeros(shape)
    lost_pull = np.zeros(shape[:2])
    np.add.at(lost_information, groups, slopes[:, :, None] * slopes[:, None, :])
    np.add.at(lost_pull, groups, slopes * (slopes @ steps - residuals)[:, None])
    covariance = np.linalg.inv(np.diag(information + 1.0) - lost_information)
    pull = (information + 1.0) * steps - lost_pull
    remaining = np.einsum("gij,gj->gi", covariance, pull)
    errors = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    ratio = remaining * np.sign(steps) / errors
    return np.maximum(ratio.min(axis=0), 0.0)
