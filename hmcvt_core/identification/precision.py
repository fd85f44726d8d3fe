# SPDX-License-Identifier: Apache-2.0
"""How well the samples determine the parameters, in numbers and in plain sentences."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.domain import Domain
from ..model.model import INCONSISTENT, STALLED
from ..model.relative_error import RelativeError
from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS
from ..transmission.ranges import BENCH_COLUMNS
from .problem import BOUND_TEXT, BOUNDS, Problem

Array = NDArray[np.float64]
_LOOSE = 0.5  # a standard error above this part of the value leaves the parameter undetermined
_TIED = 0.95  # a correlation above this leaves only a combination


class Precision(NamedTuple):
    """Linearised precision of the parameters.

    Attributes:
        standard_errors: by name, in the unit of the parameter.
        correlation: shape (3, 3).
        noise_factor: scatter of the residuals / stated deviation (1 when it cannot be estimated).
    """

    standard_errors: dict[str, float]
    correlation: Array
    noise_factor: float


def precision(problem: Problem, scaled: Array) -> Precision:
    """Covariance at the best point, from the Jacobian of the weighted residuals.

    The width of the bounds enters as prior knowledge, so that a direction the samples do not see
    gets the error of that width rather than infinity.
    """
    residuals, jacobian = _linearised(problem, scaled)
    free = len(residuals) - len(scaled)
    factor = 1.0
    if free > 0:
        scatter = float(np.sqrt(np.sum(residuals**2) / free))
        # Stated deviations are believed unless the residuals are larger.
        factor = max(scatter, 1.0) if problem.deviation_known else scatter
    factor = max(factor, 1e-3)
    prior = 12.0 / (BOUNDS[:, 1] - BOUNDS[:, 0]) ** 2
    covariance = np.linalg.inv(jacobian.T @ jacobian / factor**2 + np.diag(prior))
    spread = np.sqrt(np.diag(covariance))
    natural = spread * np.array([np.log(10.0) * 10.0 ** scaled[0], 1.0, 1.0])
    return Precision(dict(zip(PARAMETER_NAMES, natural.tolist(), strict=True)),
                     covariance / np.outer(spread, spread), factor)


def _linearised(problem: Problem, scaled: Array) -> tuple[Array, Array]:
    """Weighted residuals (n,) and their Jacobian (n, 3)."""
    step = np.diag(1e-6 * (BOUNDS[:, 1] - BOUNDS[:, 0]))
    low = np.maximum(scaled - step, BOUNDS[:, 0])
    high = np.minimum(scaled + step, BOUNDS[:, 1])
    found = problem.residuals(np.vstack([scaled, low, high]))
    slopes = (found[4:] - found[1:4]) / np.diag(high - low)[:, None]
    return found[0], np.nan_to_num(slopes).T


def findings(problem: Problem, scaled: Array, found: Precision) -> tuple[str, ...]:
    """Say in plain sentences what the samples leave open."""
    samples, sentences = problem.samples, []
    points, rows = _distinct(samples)
    if rows < len(samples):
        sentences.append(f"{len(samples) - rows} of {len(samples)} samples copy another one in "
                         "every column: they count as measurements, and the standard errors are "
                         "too small if they are none")
    if points < len(PARAMETER_NAMES):
        where = f"{points} samples" if points == len(samples) else (
            f"{len(samples)} samples at {points} working point{'s' if points > 1 else ''}")
        sentences.append(f"{where} cannot determine {len(PARAMETER_NAMES)} "
                         "parameters: the values are one choice among many")
    for sign, word in ((1.0, "positive"), (-1.0, "negative")):
        if not (samples.displacement_ratio * sign > 0.0).any():
            sentences.append(f"no sample has a {word} displacement ratio: the model is "
                             "unchecked there")
    values = [10.0 ** scaled[0], scaled[1], scaled[2]]
    for i, name in enumerate(PARAMETER_NAMES):
        sentence = _looseness(name, i, scaled, values[i], found.standard_errors[name])
        if sentence:
            sentences.append(sentence)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        tie = found.correlation[i, j]
        if abs(tie) > _TIED:
            sentences.append(f"{PARAMETER_NAMES[i]} and {PARAMETER_NAMES[j]} are tied "
                             f"(correlation {tie:.2f}): only a combination is determined")
    return tuple(sentences)


def _distinct(samples: BenchSamples) -> tuple[int, int]:
    """Number of working points that differ, and of rows that differ in any column."""
    columns = [column.tolist() for item in BENCH_COLUMNS
               if (column := getattr(samples, item.name)) is not None]
    return (len(set(zip(*columns[:3], strict=True))),
            len(set(zip(*columns, *samples.extra.values(), strict=True))))


def unanswered(held: Problem, error: RelativeError) -> tuple[str, ...]:
    """Say at how many samples held back the identified model has no answer."""
    none = error.without_answer
    if not none:
        return ()
    reason = STALLED if held.model.formulation == "power_balance" else INCONSISTENT
    return (f"the model has no answer at {none} of {len(held.samples)} samples held back, which "
            f"the error of the prediction leaves out: {reason}",)


def extrapolated(held: Problem, fitted: BenchSamples) -> tuple[str, ...]:
    """Say that most samples held back lie where none was fitted."""
    outside = int((~Domain.of(fitted).contains(held.points)).sum())
    if 2 * outside <= len(held.samples):
        return ()
    return (f"{outside} of {len(held.samples)} samples held back lie outside the range of those "
            "fitted: the error of the prediction is mostly one of extrapolation",)


def _looseness(name: str, i: int, scaled: Array, value: float, error: float) -> str:
    width = BOUNDS[i, 1] - BOUNDS[i, 0]
    for end, side in ((0, "lower"), (1, "upper")):
        if abs(scaled[i] - BOUNDS[i, end]) < 1e-4 * width:
            return (f"{name} is not determined by these samples: its best value lies at the "
                    f"{side} bound {BOUND_TEXT[name][end]} {PARAMETER_UNITS[name]}")
    if error > _LOOSE * value:
        return (f"{name} is not determined by these samples: {value:.3g} with a standard error "
                f"of {error:.2g} {PARAMETER_UNITS[name]}")
    return ""
