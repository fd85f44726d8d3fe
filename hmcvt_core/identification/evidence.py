# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What samples say about a change of the model in service, and which of them do not belong.

Parameters are counted in widths of their wear, and changes in directions that were independent of
each other before the samples came: `Prior.root`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..model.domain import AXES
from ..model.model import EfficiencyModel
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
)
from . import annealing
from .identify import QUICK, thinned
from .problem import Problem

Array = NDArray[np.float64]
MEDIAN_TO_DEVIATION = 1.4826
"""Median of absolute values to standard deviation, normal distribution."""

_SAME_POINT = (
    0.01  # of the range of displacement ratio, speed or torque: no point of its own
)
_HONEST_LOST = 0.01  # campaigns in which an honest sample may be set aside, at most
_STARTS, _CONCENTRATIONS, _REWEIGHTINGS = 4, 3, 10
_SIGNIFICANT = (
    0.0228  # of either tail: two standard deviations where the noise is well known
)
_FAR = 1e3  # residual where there is no answer
_STEP = 1e-5
_OPEN = 0.5  # part of a parameter's change below which it is called kept
_LEAST_ERROR = 1e-6  # of a parameter in service, in widths of its wear


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the samples, with parameters in widths of their wear.

    Attributes:
        unit: parameters of one such width, shape (3,).
        centre: the model in service.
        covariance: of the model in service, shape (3, 3).
        stated: whether the model states it; the wear itself stands for one that is unknown.
    """

    unit: Array
    centre: Array
    covariance: Array
    stated: bool

    @classmethod
    def of(cls, model: EfficiencyModel) -> Prior:
        """Take what a model says of itself."""
        values, unit = model.parameters.to_array(), PRIOR_SPREAD.copy()
        unit[0] *= np.log(10.0) * max(values[0], 10.0 ** PRIOR_MEAN[0])
        covariance, stated = np.eye(len(unit)), False
        if model.standard_errors and model.correlation is not None:
            stated = True
            spread = (
                np.array([model.standard_errors[name] for name in PARAMETER_NAMES])
                / unit
            )
            spread = np.maximum(spread, _LEAST_ERROR)
            covariance = np.outer(spread, spread) * model.correlation
        return cls(unit, values / unit, covariance, stated)

    @cached_property
    def root(self) -> Array:
        """Of the covariance and the wear together: columns are changes to be expected, (3, 3)."""
        return np.asarray(np.linalg.cholesky(self.covariance + np.eye(len(self.unit))))

    def parameters(self, change: Array) -> Array:
        """Parameters in SI units, within the bounds, for changes (..., 3) in terms of `root`."""
        low, high = from_scaled(SEARCH_BOUNDS.T)
        here = self.centre * self.unit
        found = here + change @ self.root.T * self.unit
        return np.clip(found, np.minimum(low, here), np.maximum(high, here))

    def change(self, parameters: Array) -> Array:
        """Inverse of `parameters`."""
        return np.asarray(
            (parameters / self.unit - self.centre) @ np.linalg.inv(self.root).T
        )


@dataclass(frozen=True, eq=False)
class Campaign(Problem):
    """Samples, and the model in service; variables are changes of it in terms of `Prior.root`."""

    @cached_property
    def prior(self) -> Prior:
        """What the model says of itself."""
        return Prior.of(self.model)

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """Number of the working point of each sample, shape (n,)."""
        columns = np.array([getattr(self.samples, axis) for axis in AXES])
        size = np.array([1.0, *columns[1:].max(axis=1)])
        cells = np.round(columns.T / (_SAME_POINT * size))
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def votes(self) -> Array:
        """Weight of each sample: those at one working point have one vote together, shape (n,)."""
        return 1.0 / np.bincount(self.places)[self.places]

    def parameters(self, variables: Array) -> Array:
        """Parameters in SI units of changes (..., 3)."""
        return self.prior.parameters(variables)

    def residuals(self, variables: Array) -> Array:
        """(Predicted - measured) / deviation, shape (..., n); far where there is no answer."""
        return np.nan_to_num(super().residuals(variables), nan=_FAR)

    def slopes(self, change: Array) -> Array:
        """Derivatives of the residuals, shape (n, 3)."""
        step = _STEP * np.eye(len(change))
        low, high = np.split(
            self.residuals(np.vstack([change - step, change + step])), 2
        )
        return (high - low).T / (2.0 * _STEP)

    def scatter(self, residuals: Array, weights: Array) -> Array:
        """Standard deviation of residuals (..., n); the one stated counts like one of them."""
        free = np.maximum(weights.sum(axis=-1) - len(PARAMETER_NAMES), 0.0)
        return np.sqrt((1.0 + (weights * residuals**2).sum(axis=-1)) / (1.0 + free))

    def nearest(
        self, start: Array, weights: Array, directions: Array, precision: Array
    ) -> Array:
        """Weighted least squares along directions (3, k), each with a prior `precision` (k,)."""
        from scipy.optimize import least_squares

        roots = np.sqrt(weights), np.sqrt(precision)
        found = least_squares(
            lambda steps: np.concatenate(
                [roots[0] * self.residuals(directions @ steps), roots[1] * steps]
            ),
            start,
            lambda steps: np.vstack(
                [
                    roots[0][:, None] * self.slopes(directions @ steps) @ directions,
                    np.diag(roots[1]),
                ]
            ),
            method="lm",
        )
        return np.asarray(directions @ found.x)

    def better_half(self, residuals: Array) -> NDArray[np.bool_]:
        """Which samples (..., n) hold the least residuals and, just, the most of the votes."""
        order = np.argsort(np.abs(residuals), axis=-1)
        most = 0.5 * (self.votes.sum() + len(PARAMETER_NAMES) + 1.0)
        before = np.cumsum(self.votes[order], axis=-1) - self.votes[order]
        half = np.empty(order.shape, dtype=bool)
        np.put_along_axis(half, order, before < most - 1e-9, axis=-1)
        return half

    def majority(self, seed: int) -> tuple[Array, NDArray[np.bool_]]:
        """Reweighted least trimmed squares: the change, and which samples belong together."""
        from scipy.stats import norm

        change = self._trimmed(seed)
        residuals = self.residuals(change)
        free = max(self.votes.sum() - len(change), 1.0)
        # The correction for few samples is that of Rousseeuw & Leroy.
        scatter = (
            MEDIAN_TO_DEVIATION
            * (1.0 + 5.0 / free)
            * float(np.abs(residuals[self.better_half(residuals)]).max())
        )
        cutoff = float(norm.isf(0.5 * _HONEST_LOST / len(residuals)))
        belongs = np.abs(residuals) <= cutoff * scatter
        for _ in range(_REWEIGHTINGS):
            weights = self.votes * belongs
            change = self.least_squares(change, weights / scatter**2)
            residuals, slopes = self.residuals(change), self.slopes(change) / scatter
            scatter = float(self.scatter(residuals, weights))
            precision = np.eye(len(change)) + (slopes.T * weights) @ slopes
            leverage = np.einsum(
                "ni,ij,nj->n", slopes, np.linalg.inv(precision), slopes
            )
            # What the fit has not seen it misses by more than what it has seen.
            spread = scatter * np.sqrt(np.where(belongs, 1.0, 1.0 + leverage))
            before, belongs = belongs, np.abs(residuals) <= cutoff * spread
            if (belongs == before).all():
                break
        return change, belongs

    def _trimmed(self, seed: int) -> Array:
        few = replace(self, samples=thinned(self.samples))

        def loss(changes: Array) -> Array:
            residuals = few.residuals(changes)
            half = few.votes * few.better_half(residuals)
            return np.asarray((half * residuals**2).sum(axis=-1) / half.sum(axis=-1))

        annealed = annealing.minimise(
            lambda scaled: loss(self.prior.change(from_scaled(scaled))),
            SEARCH_BOUNDS,
            schedule=QUICK,
            seed=seed,
        )
        starts = self.prior.change(from_scaled(annealed.ends[:_STARTS]))
        ends = [*starts, np.zeros(len(PARAMETER_NAMES))]
        for _ in range(
            _CONCENTRATIONS
        ):  # fit the better half, and again that of the fit
            for i, end in enumerate(ends):
                half = few.votes * few.better_half(residuals := few.residuals(end))
                ends[i] = few.least_squares(
                    end, half / few.scatter(residuals, half) ** 2
                )
        return ends[int(np.argmin([loss(end) for end in ends]))]

    def least_squares(self, start: Array, weights: Array) -> Array:
        """Weighted least squares with the prior."""
        return self.nearest(start, weights, np.eye(len(start)), np.ones(len(start)))

    def evidence(self, start: Array) -> Evidence:
        """Tell which changes the samples prove, and how far to follow each."""
        from scipy.stats import t as student

        scatter = float(self.scatter(self.residuals(start), self.votes))
        change = self.least_squares(start, self.votes / scatter**2)
        residuals = self.residuals(change)
        scatter = float(self.scatter(residuals, self.votes))
        root = np.sqrt(self.votes) / scatter
        slopes = self.slopes(change) * root[:, None]
        information, directions = np.linalg.eigh(slopes.T @ slopes)
        steps = change @ directions
        least = self._least_significance(
            slopes @ directions, residuals * root, information, steps
        )
        free = max(self.votes.sum() - len(steps), 0.0) + 1.0
        with np.errstate(divide="ignore"):
            part = np.maximum(0.0, 1.0 - (student.isf(_SIGNIFICANT, free) / least) ** 2)
        if part.any() and not self.prior.stated:
            # Nothing but these samples speaks for such a model, and they speak against it: the
            # most probable parameters then, with the wear as prior.
            part = np.maximum(part, information / (1.0 + information))
        return Evidence(scatter, directions, information, steps, part)

    def follow(self, evidence: Evidence) -> EfficiencyModel:
        """Fit along the directions that are followed; the rest stays.

        The errors are those of samples and prior, by the part that each has in the model.
        """
        part, information, directions = (
            evidence.part,
            evidence.information,
            evidence.directions,
        )
        chosen, model, prior = part > 0.0, self.model, self.prior
        if chosen.any():
            change = self.nearest(
                (part * evidence.steps)[chosen],
                self.votes / evidence.scatter**2,
                directions[:, chosen],
                (information * (1.0 - part))[chosen] / part[chosen],
            )
            values = prior.parameters(change).tolist()
            model = replace(model, parameters=HydraulicParameters(*values))
        back, turn = (
            directions.T @ np.linalg.inv(prior.root),
            prior.unit[:, None] * prior.root,
        )
        found = np.outer(1.0 - part, 1.0 - part) * (
            back @ prior.covariance @ back.T
        ) + np.diag(part**2 / (1.0 + information))
        covariance = turn @ directions @ found @ (turn @ directions).T
        spread = np.sqrt(np.diag(covariance))
        return replace(
            model,
            standard_errors=dict(zip(PARAMETER_NAMES, spread.tolist(), strict=True)),
            correlation=covariance / np.outer(spread, spread),
        )

    def _least_significance(
        self, slopes: Array, residuals: Array, information: Array, steps: Array
    ) -> Array:
        """Steps by their standard errors when the worst working point for them is left out."""
        size, count = self.places.max() + 1, len(steps)
        lost, said = np.zeros((size, count, count)), np.zeros((size, count))
        np.add.at(lost, self.places, slopes[:, :, None] * slopes[:, None, :])
        np.add.at(said, self.places, slopes * (slopes @ steps - residuals)[:, None])
        covariance = np.linalg.inv(np.diag(information + 1.0) - lost)
        left = np.einsum("gij,gj->gi", covariance, (information + 1.0) * steps - said)
        ratio = (
            left * np.sign(steps) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        )
        return np.maximum(ratio.min(axis=0), 0.0)


class Evidence(NamedTuple):
    """What samples say about changes that are independent of each other.

    Attributes:
        scatter: standard deviation of the residuals.
        directions: one in each column, in terms of `Prior.root`, shape (3, 3).
        information: of the samples about a step in each, where the prior has 1, shape (3,).
        steps: best in each.
        part: how much of it is followed, 0 to 1.
    """

    scatter: float
    directions: Array
    information: Array
    steps: Array
    part: Array

    def kept(self, prior: Prior) -> tuple[str, ...]:
        """Name the parameters that stay, for the most part, as they are."""
        share = (prior.root @ self.directions) ** 2
        followed = share @ self.part / share.sum(axis=1)
        return tuple(
            f"{name} is kept from the model in service: of how it may have changed, the samples "
            f"prove {100.0 * of:.0f} %"
            for name, of in zip(PARAMETER_NAMES, followed, strict=True)
            if of < _OPEN
        )
