# SPDX-License-Identifier: Apache-2.0
"""A refit of the model in service that can do no harm: what the samples do not say, it keeps.

1. Which samples belong together: least trimmed squares find the parameters that the better half of
   the samples agrees on; the scatter about them tells which others do not belong, and those are set
   aside [Rousseeuw & Leroy 1987, Robust Regression and Outlier Detection, ch. 5]. Samples at one
   working point have one vote together.
2. What they say: the information of the others, measured in the width of what was known before (the
   covariance of the model in service, and the wear that hydraulics may have: `PRIOR_SPREAD`), falls
   into three independent directions. In each the change has a significance t, the least that is
   left when any one sample is taken away.
3. What is followed: the prior is the model in service; its variance in each direction is the
   smallest under which the change lies within `_SIGNIFICANT` standard deviations (covariance
   inflation of an adaptive Kalman filter [Jazwinski 1969, Automatica 5]). That follows 1 - c2/t2 of
   a change: wear is followed though the prior be tight, noise is not though it be wide.
4. Whether that may serve: `Refit.refused` says what speaks against it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..model.agreement import RelativeError, output_speed_remark, predicted_at
from ..model.domain import AXES, Domain
from ..model.model import EfficiencyModel
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
    to_scaled,
)
from ..transmission.ranges import OperatingPoints
from ..version import __version__
from . import annealing
from .cross_validation import FEWEST, QUICK, CrossValidation, cross_validate
from .identify import thinned
from .problem import Problem, findings

Array = NDArray[np.float64]
MAX_DRIFT = 0.10

_SAME_POINT = 0.01  # of the range of displacement ratio, speed or torque: no point of its own
_CONSISTENT = 1.4826  # median of absolute residuals to standard deviation, normal distribution
_HONEST_LOST = 0.01  # campaigns in which an honest sample may be set aside, at most
_MOST_SET_ASIDE = 1.0 / 3.0  # of the samples; with more no majority is to be trusted
_STARTS, _CONCENTRATIONS, _REWEIGHTINGS = 4, 3, 10
_SIGNIFICANT = 0.00135  # of either tail: three standard deviations where the noise is well known
_NOTICED = 0.01  # change of an efficiency that has to be supported by the samples
_CERTAIN = 2.0  # standard errors
_GRID = (11, 5, 5)
_FAR = 1e3  # residual where there is no answer
_STEP = 1e-5
_OPEN = 0.5  # part of a parameter's change below which it is called kept


@dataclass(frozen=True, eq=False)
class Refit:
    """A model fitted to samples with the one in service as prior, and whether it may serve.

    Attributes:
        model: the refit; what the samples do not determine is that of the model in service.
        set_aside: samples that disagree with the rest, from 1 in their order.
        kept: sentences on what was kept from the model in service.
        refused: one line, what speaks against adopting it; empty when nothing does.
        largest_change: of an efficiency within the domain, against the model in service [-].
        drift: the same against the base model [-].
        warnings: sentences on the samples set aside and on what is left open.
        held_back: the comparison on samples held back, None with fewer than four to compare.
        error_before, error_after: mean |predicted - measured| / measured of the model in service
            and of the refit, over all samples [-].
    """

    model: EfficiencyModel
    set_aside: tuple[int, ...]
    kept: tuple[str, ...]
    refused: str
    largest_change: float
    drift: float
    warnings: tuple[str, ...]
    held_back: CrossValidation | None
    error_before: float
    error_after: float


def refit(
    samples: BenchSamples,
    served: EfficiencyModel,
    base: EfficiencyModel,
    *,
    seed: int = 0,
    max_drift: float = MAX_DRIFT,
) -> Refit:
    """Fit the model in service to samples.

    Args:
        samples: of the bench; samples at one working point count as one.
        served: the model in service: stage, formulation, effects and prior.
        base: model against which drift is measured, the one that the first refit began with.
        seed: of the random numbers.
        max_drift: largest change of an efficiency against `base` within the domain [-].

    Raises:
        IdentificationError: fewer working points than parameters, or no answer at the samples.
    """
    campaign = _Campaign(Problem(served, samples), _Prior.of(served))
    points = len(set(campaign.places.tolist()))
    if points < len(PARAMETER_NAMES):
        raise IdentificationError(
            f"{samples.source}: {len(samples)} samples at {points} distinct working "
            f"point{'s' * (points > 1)} cannot determine {len(PARAMETER_NAMES)} parameters; a "
            f"refit needs at least {len(PARAMETER_NAMES)} points")
    fit, belongs = campaign.majority(seed)
    used = campaign.select(belongs)
    evidence = used.evidence(fit)
    covariance = evidence.covariance(campaign.prior)
    spread = np.sqrt(np.diag(covariance))
    model = replace(
        used.follow(evidence),
        standard_errors=dict(zip(PARAMETER_NAMES, spread.tolist(), strict=True)),
        correlation=covariance / np.outer(spread, spread))
    parts: list[EfficiencyModel] = []

    def fitted(part: BenchSamples) -> EfficiencyModel:
        parts.append(_Campaign(Problem(served, part), campaign.prior).follow(evidence))
        return parts[-1]

    held_back = cross_validate(used.problem.samples, model, served, fitted, seed)
    domain = _joined(Domain.of(used.problem.samples), served.domain)
    grid = _grid(domain)
    after, before, first = (_answers(each, grid) for each in (model, served, base))
    refused = next(_objections(
        samples, belongs, held_back, after - before,
        np.array([_answers(part, grid) for part in parts]), grid, after - first, max_drift), "")
    measured = samples.efficiency
    remark = output_speed_remark(served.stage, samples)
    warnings = [
        *(f"sample {i + 1} is set aside: it reads {measured[i]:.4g}, the rest of the samples say "
          f"{campaign.predicted(fit)[i]:.4g}" for i in np.flatnonzero(~belongs)),
        *findings(used.problem.samples, to_scaled(model.parameters.to_array()),
                  model.standard_errors, np.asarray(model.correlation)),
        *([] if remark is None else [remark]),
        *([] if held_back is not None else [
            f"fewer than {FEWEST} samples: none could be held back to check the refit"])]
    errors = [RelativeError.of(predicted_at(each, samples), measured).mean
              for each in (served, model)]
    provenance = {
        "source": f"hmcvt refit, version {__version__}",
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "data": Path(samples.source).name,
        "data_sha256": samples.sha256,
        "samples": len(samples),
        "set_aside": int(np.sum(~belongs)),
        "seed": seed,
        "fit_error": float(f"{errors[1]:.6g}"),
    }
    return Refit(
        replace(model, domain=domain, provenance=provenance),
        tuple((np.flatnonzero(~belongs) + 1).tolist()), evidence.kept(campaign.prior), refused,
        float(np.abs(after - before).max()), float(np.abs(after - first).max()), tuple(warnings),
        held_back, *errors)


@dataclass(frozen=True, eq=False)
class _Prior:
    """What is known before the samples, with parameters in widths of their wear.

    Attributes:
        unit: parameters of one such width, shape (3,).
        centre: the model in service.
        covariance: of the model in service, shape (3, 3).
    """

    unit: Array
    centre: Array
    covariance: Array

    @classmethod
    def of(cls, model: EfficiencyModel) -> _Prior:
        """Take the covariance of a model; the wear itself stands for one that is unknown."""
        values, unit = model.parameters.to_array(), PRIOR_SPREAD.copy()
        unit[0] *= np.log(10.0) * max(values[0], 10.0 ** PRIOR_MEAN[0])
        covariance = np.eye(len(unit))
        if model.standard_errors and model.correlation is not None:
            spread = np.array([model.standard_errors[name] for name in PARAMETER_NAMES]) / unit
            covariance = np.outer(spread, spread) * model.correlation
        return cls(unit, values / unit, covariance)

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
        return np.asarray((parameters / self.unit - self.centre) @ np.linalg.inv(self.root).T)


@dataclass(frozen=True, eq=False)
class _Campaign:
    """Samples, seen from the model in service."""

    problem: Problem
    prior: _Prior

    @cached_property
    def places(self) -> NDArray[np.intp]:
        """Number of the working point of each sample, shape (n,)."""
        samples = self.problem.samples
        columns = np.array([getattr(samples, axis) for axis in AXES])
        cells = np.round(columns.T / (_SAME_POINT * np.abs(columns).max(axis=1)))
        return np.unique(cells, axis=0, return_inverse=True)[1].ravel()

    @cached_property
    def votes(self) -> Array:
        """Weight of each sample: those at one working point have one vote together, shape (n,)."""
        return 1.0 / np.bincount(self.places)[self.places]

    def select(self, index: NDArray[Any]) -> _Campaign:
        """Return the campaign of some of the samples."""
        return _Campaign(Problem(self.problem.model, self.problem.samples.select(index)),
                         self.prior)

    def predicted(self, change: Array) -> Array:
        """Efficiency for changes (..., 3), shape (..., n)."""
        return self.problem.model.efficiency_of_candidates(
            self.prior.parameters(change), self.problem.points)

    def residuals(self, change: Array) -> Array:
        """(Predicted - measured) / deviation, shape (..., n)."""
        found = (self.predicted(change) - self.problem.samples.efficiency) / self.problem.deviation
        return np.nan_to_num(found, nan=_FAR)

    def slopes(self, change: Array) -> Array:
        """Derivatives of the residuals, shape (n, 3)."""
        step = _STEP * np.eye(len(change))
        low, high = np.split(self.residuals(np.vstack([change - step, change + step])), 2)
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
            lambda steps: np.concatenate([
                roots[0] * self.residuals(directions @ steps), roots[1] * steps]),
            start, lambda steps: np.vstack([
                roots[0][:, None] * self.slopes(directions @ steps) @ directions,
                np.diag(roots[1])]), method="lm") if len(start) else None
        return directions @ (start if found is None else found.x)

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
        scatter = _CONSISTENT * (1.0 + 5.0 / free) * float(
            np.abs(residuals[self.better_half(residuals)]).max())
        cutoff = float(norm.isf(0.5 * _HONEST_LOST / len(residuals)))
        belongs = np.abs(residuals) <= cutoff * scatter
        for _ in range(_REWEIGHTINGS):
            weights = self.votes * belongs
            change = self.least_squares(change, weights / scatter**2)
            residuals, slopes = self.residuals(change), self.slopes(change) / scatter
            scatter = float(self.scatter(residuals, weights))
            precision = np.eye(len(change)) + (slopes.T * weights) @ slopes
            leverage = np.einsum("ni,ij,nj->n", slopes, np.linalg.inv(precision), slopes)
            # What the fit has not seen it misses by more than what it has seen.
            spread = scatter * np.sqrt(np.where(belongs, 1.0, 1.0 + leverage))
            before, belongs = belongs, np.abs(residuals) <= cutoff * spread
            if (belongs == before).all():
                break
        return change, belongs

    def _trimmed(self, seed: int) -> Array:
        few = _Campaign(Problem(self.problem.model, thinned(self.problem.samples)), self.prior)

        def loss(changes: Array) -> Array:
            residuals = few.residuals(changes)
            half = few.votes * few.better_half(residuals)
            return np.asarray((half * residuals**2).sum(axis=-1) / half.sum(axis=-1))

        annealed = annealing.minimise(
            lambda scaled: loss(self.prior.change(from_scaled(scaled))), SEARCH_BOUNDS,
            schedule=QUICK, seed=seed)
        starts = self.prior.change(from_scaled(annealed.ends[:_STARTS]))
        ends = [few.concentrated(start) for start in [*starts, np.zeros(len(PARAMETER_NAMES))]]
        return ends[int(np.argmin([loss(end) for end in ends]))]

    def concentrated(self, change: Array) -> Array:
        """Fit the better half, and again that of the fit."""
        for _ in range(_CONCENTRATIONS):
            half = self.votes * self.better_half(residuals := self.residuals(change))
            change = self.least_squares(change, half / self.scatter(residuals, half)**2)
        return change

    def least_squares(self, start: Array, weights: Array) -> Array:
        """Weighted least squares with the prior."""
        return self.nearest(start, weights, np.eye(len(start)), np.ones(len(start)))

    def evidence(self, start: Array) -> _Evidence:
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
        least = self._least_significance(slopes @ directions, residuals * root, information, steps)
        free = max(self.votes.sum() - len(steps), 0.0) + 1.0
        with np.errstate(divide="ignore"):
            part = np.maximum(0.0, 1.0 - (student.isf(_SIGNIFICANT, free) / least) ** 2)
        return _Evidence(scatter, directions, information, steps, part)

    def follow(self, evidence: _Evidence) -> EfficiencyModel:
        """Fit along the directions that are followed; the rest stays."""
        chosen = evidence.part > 0.0
        part, information = evidence.part[chosen], evidence.information[chosen]
        change = self.nearest(part * evidence.steps[chosen], self.votes / evidence.scatter**2,
                              evidence.directions[:, chosen], information * (1.0 - part) / part)
        values = self.prior.parameters(change).tolist() if chosen.any() else (
            self.problem.model.parameters.to_array().tolist())
        return replace(self.problem.model, parameters=HydraulicParameters(*values))

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
        ratio = left * np.sign(steps) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        return np.maximum(ratio.min(axis=0), 0.0)


class _Evidence(NamedTuple):
    """What samples say about changes that are independent of each other.

    Attributes:
        scatter: standard deviation of the residuals.
        directions: one in each column, in terms of `_Prior.root`, shape (3, 3).
        information: of the samples about a step in each, where the prior has 1, shape (3,).
        steps: best in each.
        part: how much of it is followed, 0 to 1.
    """

    scatter: float
    directions: Array
    information: Array
    steps: Array
    part: Array

    def covariance(self, prior: _Prior) -> Array:
        """Errors of samples and model in service, by the part that each has in the refit."""
        back = self.directions.T @ np.linalg.inv(prior.root)
        found = (np.outer(1.0 - self.part, 1.0 - self.part) * (back @ prior.covariance @ back.T)
                 + np.diag(self.part**2 / (1.0 + self.information)))
        turn = prior.unit[:, None] * prior.root @ self.directions
        return np.asarray(turn @ found @ turn.T)

    def kept(self, prior: _Prior) -> tuple[str, ...]:
        """Name the parameters that stay, for the most part, as they are."""
        share = (prior.root @ self.directions) ** 2
        followed = share @ self.part / share.sum(axis=1)
        return tuple(
            f"{name} is kept from the model in service: of how it may have changed, the samples "
            f"prove {100.0 * of:.0f} %"
            for name, of in zip(PARAMETER_NAMES, followed, strict=True) if of < _OPEN)


def _joined(domain: Domain, other: Domain | None) -> Domain:
    """Return the smallest box that holds two."""
    pairs = [getattr(domain, axis) + getattr(other or domain, axis) for axis in AXES]
    return Domain(*((min(ends), max(ends)) for ends in pairs))


def _grid(domain: Domain) -> OperatingPoints:
    axes = [np.linspace(*getattr(domain, axis), number)
            for axis, number in zip(AXES, _GRID, strict=True)]
    return OperatingPoints(*(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")))


def _answers(model: EfficiencyModel, grid: OperatingPoints) -> Array:
    # No answer means that the load cannot be carried: nothing comes out.
    return np.nan_to_num(model.answer_at(grid).efficiency, nan=0.0)


def _objections(
    samples: BenchSamples, belongs: NDArray[np.bool_], held_back: CrossValidation | None,
    change: Array, parts: Array, grid: OperatingPoints, drift: Array, max_drift: float,
) -> Iterator[str]:
    """Say what speaks against a refit.

    Args:
        samples: all of them.
        belongs: which were not set aside, shape (n,).
        held_back: the comparison on samples held back.
        change: of the efficiency against the model in service, at the points of `grid`.
        parts: the same of refits without a fold, (folds, points).
        drift: the same against the base model.
        max_drift: limit of it.
    """
    lost = int(np.sum(~belongs))
    if lost > _MOST_SET_ASIDE * len(samples):
        yield (f"{lost} of {len(samples)} samples disagree with the others, more than a third: "
               "none can be trusted")
    if held_back is not None and held_back.worse:
        yield ("the refit is worse on samples held back: mean error "
               f"{100 * held_back.error_refit:.2f} %, model in service "
               f"{100 * held_back.error_in_service:.2f} %")
    if len(parts):
        # Jackknife of groups.
        doubt = _CERTAIN * np.sqrt((len(parts) - 1) * parts.var(axis=0))
        excess = np.where(np.abs(change) > _NOTICED, doubt - np.abs(change), -np.inf)
        worst = int(excess.argmax())
        if excess[worst] > 0.0:
            yield (f"the refit would move the efficiency by {100 * change[worst]:+.1f} points "
                   f"{_where(grid, worst)}, where the samples held back allow a doubt of "
                   f"{100 * doubt[worst]:.1f} points")
    worst = int(np.abs(drift).argmax())
    if abs(drift[worst]) > max_drift:
        yield (f"the refit would differ from the base model by {100 * drift[worst]:+.1f} points "
               f"{_where(grid, worst)}, more than the {100 * max_drift:.3g} points allowed")


def _where(grid: OperatingPoints, index: int) -> str:
    return (f"at displacement ratio {grid.displacement_ratio[index]:.2f}, "
            f"{grid.engine_speed[index]:.1f} rad/s, {grid.load_torque[index]:.0f} N m")
