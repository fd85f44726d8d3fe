# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The problem: what is minimised, where to start, how the search is finished, what stays open."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..files.bench import BenchSamples
from ..model.agreement import determination_loss
from ..model.domain import Domain
from ..model.model import INCONSISTENT, STALLED, EfficiencyModel
from ..physics import published
from ..transmission.parameters import (
    PAPER_EFFICIENCY_UNCERTAINTY,
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
    to_scaled,
)
from ..transmission.ranges import BENCH_COLUMNS, Array
from ..transmission.stage import Stage

OBJECTIVES = {"power_balance": "weighted squares", "published": "1 - RSQ, eq. (21)"}
"""What each formulation minimises."""

_FAR = 1e3  # residual, or 1 - RSQ, where the model has no answer
_PRECISION = 1e-14
_WIDTH = SEARCH_BOUNDS[:, 1] - SEARCH_BOUNDS[:, 0]
_LOOSE = 0.5  # a standard error above this part of the value leaves the parameter undetermined
_TIED = 0.95  # a correlation above this leaves only a combination
_HYDRAULIC = np.linspace(
    published.STANDING_EFFICIENCY, 1.0 - 1e-9, 4001
)  # eta_H looked at
_MOST_COMBINATIONS = 32
_LEAST_SCATTER = 1e-3  # of the residuals: samples without any would promise certainty


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples, and the model that shall meet them; the variables are those of `from_scaled`.

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
        return (
            PAPER_EFFICIENCY_UNCERTAINTY * self.samples.efficiency
            if stated is None
            else stated
        )

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
        """What the formulation minimises (`OBJECTIVES`), shape (...).

        Both are measured in units of a scatter, so that t_0 = 1 of the annealing means the same for
        every bench: the mean of weighted squares in the variance of the noise, at which it is 1 for
        a true model; 1 - RSQ in the spread of the predictions.
        """
        if self.model.formulation == "published":
            return determination_loss(self.predict(variables), self.samples.efficiency)
        return np.asarray((self.residuals(variables) ** 2).mean(axis=-1))

    def finish(self, ends: Array) -> tuple[Array, float]:
        """Finish points of shape (m, 3) by a local search within the bounds.

        Returns:
            The best point, shape (3,), and its objective; infinite where some sample has no answer.
        """
        search = (
            self._simplex
            if self.model.formulation == "published"
            else self._least_squares
        )
        points = np.vstack([*(search(end) for end in ends), *ends])
        values = np.nan_to_num(self.objective(points), nan=np.inf)
        return points[int(values.argmin())], float(values.min())

    def _least_squares(self, start: Array) -> Array:
        from scipy.optimize import least_squares

        # Of SciPy's methods this one puts a parameter on its bound, not next to it.
        found = least_squares(
            lambda scaled: np.nan_to_num(self.residuals(scaled), nan=_FAR),
            start,
            bounds=SEARCH_BOUNDS.T,
            method="dogbox",
            ftol=_PRECISION,
            xtol=_PRECISION,
            gtol=_PRECISION,
        )
        return np.asarray(found.x)

    def _simplex(self, point: Array) -> Array:
        """Search that also follows the edge of consistency, where RSQ may be highest."""
        from scipy.optimize import minimize

        for _ in range(2):  # one run may collapse early
            point = minimize(
                lambda scaled: np.nan_to_num(self.objective(scaled), nan=_FAR),
                point,
                method="Nelder-Mead",
                bounds=SEARCH_BOUNDS,
                options={"xatol": 1e-9, "fatol": 1e-12, "maxfev": 2000},
            ).x
        return point


class HydraulicRoots(NamedTuple):
    """Hydraulic efficiencies that meet one measured efficiency.

    Attributes:
        consistent: roots at which the published formulas agree with themselves.
        rejected: roots beyond the pole of eq. (11).
    """

    consistent: tuple[float, ...]
    rejected: tuple[float, ...]


def hydraulic_roots(stage: Stage, samples: BenchSamples) -> list[HydraulicRoots]:
    """Part 1 of the paper's piecewise identification (section 4.1, improvement 4).

    Returns:
        For each sample every eta_H in (0, 1) at which eq. (18) gives the measured efficiency. Where
        power circulates there may be two; at eps = 0, where eta_H does not enter, there is none.
    """
    return [
        _roots(stage, stroke, float(measured))
        for stroke, measured in zip(
            samples.displacement_ratio, samples.efficiency, strict=True
        )
    ]


def _roots(stage: Stage, stroke: Array, efficiency: float) -> HydraulicRoots:
    from scipy.optimize import brentq

    def gap(hydraulic: Array | float) -> Array:
        total = published.efficiencies(stage, stroke, np.asarray(hydraulic)).total
        return (
            np.nan_to_num(total, nan=np.finfo(float).max) - efficiency
        )  # no number at the pole

    roots: dict[bool, list[float]] = {True: [], False: []}
    values = gap(_HYDRAULIC)
    change = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    for i in change if stroke != 0.0 else ():
        root = brentq(gap, _HYDRAULIC[i], _HYDRAULIC[i + 1], xtol=1e-15)
        if abs(gap(root)) < 1e-6:  # a sign change through the pole is no root
            found = published.efficiencies(stage, stroke, np.array(root))
            roots[bool(published.is_consistent(found, stroke))].append(root)
    return HydraulicRoots(tuple(roots[True]), tuple(roots[False]))


def starting_points(problem: Problem, roots: list[HydraulicRoots]) -> Array:
    """Starts of part 2: scaled variables that best reproduce eta_H, shape (m, 3), m at least 1.

    One start for every combination of consistent roots, as long as those are few.
    """
    from scipy.optimize import least_squares

    used = [i for i, entry in enumerate(roots) if entry.consistent]
    middle = SEARCH_BOUNDS.mean(axis=1)
    if not used:
        return middle[None, :]
    chosen = problem.samples.select(used).points

    def miss(scaled: Array, target: Array) -> Array:
        parameters = HydraulicParameters(*from_scaled(scaled).tolist())
        found = published.hydraulic_efficiency(problem.model.stage, parameters, chosen)
        return np.where(np.isnan(found), 1.0, found - target)

    combinations = itertools.product(*(roots[i].consistent for i in used))
    return np.array(
        [
            least_squares(
                miss, middle, bounds=SEARCH_BOUNDS.T, args=(np.array(target),)
            ).x
            for target in itertools.islice(combinations, _MOST_COMBINATIONS)
        ]
    )


def precision(
    problem: Problem, scaled: Array, scattered: Problem | None = None
) -> tuple[dict[str, float], Array]:
    """Standard errors by name, each in its unit, and correlation (3, 3), both linearised.

    From the Jacobian of the weighted residuals at the best point. The width of the bounds enters as
    prior knowledge, so that a direction the samples do not see gets the error of that width rather
    than infinity. `scattered` holds the samples whose residuals tell the scatter, if others.
    """
    step = np.diag(1e-6 * _WIDTH)
    low = np.maximum(scaled - step, SEARCH_BOUNDS[:, 0])
    high = np.minimum(scaled + step, SEARCH_BOUNDS[:, 1])
    residuals, *found = problem.residuals(np.vstack([scaled, low, high]))
    jacobian = np.nan_to_num(
        np.subtract(found[3:], found[:3]) / np.diag(high - low)[:, None]
    ).T
    if scattered is not None:
        residuals = scattered.residuals(scaled)
    free = len(residuals) - len(scaled)
    scatter = float(np.sqrt(np.sum(residuals**2) / free)) if free > 0 else 1.0
    if problem.samples.efficiency_std is not None:
        scatter = max(
            scatter, 1.0
        )  # stated deviations are believed unless residuals are larger
    prior = np.diag(12.0 / _WIDTH**2)
    scale = max(scatter, _LEAST_SCATTER)
    covariance = np.linalg.inv(jacobian.T @ jacobian / scale**2 + prior)
    spread = np.sqrt(np.diag(covariance))
    natural = spread * np.array([np.log(10.0) * 10.0 ** scaled[0], 1.0, 1.0])
    return (
        dict(zip(PARAMETER_NAMES, natural.tolist(), strict=True)),
        covariance / np.outer(spread, spread),
    )


def findings(samples: BenchSamples, model: EfficiencyModel) -> Iterator[str]:
    """Say in plain sentences what samples leave open of a model that was fitted to them."""
    columns = [
        column.tolist()
        for item in BENCH_COLUMNS
        if (column := getattr(samples, item.name)) is not None
    ]
    points = len(set(zip(*columns[:3], strict=True)))
    rows = len(set(zip(*columns, *samples.extra.values(), strict=True)))
    if rows < len(samples):
        yield (
            f"{len(samples) - rows} of {len(samples)} samples copy another one in "
            "every column: they count as measurements, and the standard errors are "
            "too small if they are none"
        )
    if points < len(PARAMETER_NAMES):
        where = (
            f"{points} samples"
            if points == len(samples)
            else (
                f"{len(samples)} samples at {points} working point{'s' if points > 1 else ''}"
            )
        )
        yield (
            f"{where} cannot determine {len(PARAMETER_NAMES)} "
            "parameters: the values are one choice among many"
        )
    for sign, word in ((1.0, "positive"), (-1.0, "negative")):
        if not (samples.displacement_ratio * sign > 0.0).any():
            yield f"no sample has a {word} displacement ratio: the model is unchecked there"
    values = model.parameters.to_array()
    distances = np.abs(SEARCH_BOUNDS - to_scaled(values)[:, None])
    for i, (name, value, distance) in enumerate(
        zip(PARAMETER_NAMES, values, distances, strict=True)
    ):
        error, unit = model.standard_errors[name], PARAMETER_UNITS[name]
        side = int(distance.argmin())
        if distance[side] < 1e-4 * _WIDTH[i]:
            yield (
                f"{name} is not determined by these samples: its best value lies at the "
                f"{('lower', 'upper')[side]} bound {from_scaled(SEARCH_BOUNDS.T)[side, i]:g} "
                f"{unit}"
            )
        elif error > _LOOSE * value:
            yield (
                f"{name} is not determined by these samples: {value:.3g} with a standard error "
                f"of {error:.2g} {unit}"
            )
    for i, j in itertools.combinations(range(len(PARAMETER_NAMES)), 2):
        tie = np.asarray(model.correlation)[i, j]
        if abs(tie) > _TIED:
            yield (
                f"{PARAMETER_NAMES[i]} and {PARAMETER_NAMES[j]} are tied "
                f"(correlation {tie:.2f}): only a combination is determined"
            )


def unchecked(held: Problem, none: int, fitted: BenchSamples) -> Iterator[str]:
    """Say what the samples held back do not check: no answer at `none` of them, or far away."""
    count = len(held.samples)
    if none:
        reason = STALLED if held.model.formulation == "power_balance" else INCONSISTENT
        yield (
            f"the model has no answer at {none} of {count} samples held back, which "
            f"the error of the prediction leaves out: {reason}"
        )
    outside = int((~Domain.of(fitted).contains(*held.samples.points[:3])).sum())
    if 2 * outside > count:
        yield (
            f"{outside} of {count} samples held back lie outside the range of those "
            "fitted: the error of the prediction is mostly one of extrapolation"
        )
