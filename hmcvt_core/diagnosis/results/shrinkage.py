# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""How far the gap shrinks, from errors at samples that the fit has not seen.

.. math:: G^2 = \overline{e^2} - \sigma^2, \qquad S = 1 - G^2_{after} / G^2_{before}

e are errors of prediction at the same points, sigma is the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InputError
from ..fitting.cross_validation import cross_validated_errors, fold_assignments
from ..fitting.refit import Fit
from ..observations import Observations
from ..preparation import describe_samples
from ..selection.explanation import Explanation
from ..settings import (
    LEAST_SHRINKAGE,
    NO_ANSWER,
    ROUNDING,
    SHRINKAGE_DRAWS,
    SHRINKAGE_TAIL,
)
from ..system import Array
from .analysis import Analysis, rms
from .outcome import ShrinkageSummary


@dataclass(frozen=True, eq=False)
class Measurement:
    """Errors before and after at the samples by which the shrinkage is measured, m of them.

    Attributes:
        shrinkage: of the leading set.
        samples: the system's record of these samples.
        before: errors of the base model, shape (m,).
        after: errors with the leading set added, shape (m,).
        notes: on samples that do not count.
    """

    shrinkage: ShrinkageSummary
    samples: Any
    before: Array
    after: Array
    notes: tuple[str, ...] = ()


class CrossValidation:
    """Errors of explanations at samples left out, and how far each shrinks the gap.

    Args:
        analysis: of the campaign.
    """

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        observed = analysis.base.observed
        self._assignments = fold_assignments(observed, analysis.seed)
        self._errors: dict[Explanation, Array] = {}
        self._shrinkage: dict[Explanation, ShrinkageSummary] = {}

    @property
    def base_errors(self) -> Array:
        """Errors of the base model, shape (n,)."""
        return self.errors(self.analysis.posterior.base_only)

    def errors(self, explanation: Explanation) -> Array:
        """Return errors of the first channel at samples left out, shape (n,).

        A fold does not hold a size at its bound as the served fit does; the larger errors count.
        """
        if explanation not in self._errors:
            observed = self.analysis.base.observed
            left_out = cross_validated_errors(
                explanation.plain_model, observed, self._assignments
            )
            served = explanation.served_fit.whitened[0] * observed.deviation[0]
            larger = served if rms(served) > rms(left_out) else left_out
            self._errors[explanation] = larger
        return self._errors[explanation]

    def shrinkage(self, explanation: Explanation) -> ShrinkageSummary:
        """Return how far the gap shrinks with an explanation held in every fold."""
        if explanation not in self._shrinkage:
            self._shrinkage[explanation] = shrinkage(
                self.base_errors,
                self.errors(explanation),
                self.analysis.noise,
                "cross-validation",
                self.analysis.seed,
                expected=self._expected_squares(explanation),
            )
        return self._shrinkage[explanation]

    def _expected_squares(self, explanation: Explanation) -> Array:
        """Mean squares of the model-averaged gap before and after an explanation, shape (2,)."""
        mean, deviation = self.analysis.expected_gap
        before = _residuals(self.analysis.base)
        after = _residuals(explanation.served_fit)
        squares = [mean**2, (mean - before + after) ** 2] + deviation**2
        return np.asarray(np.nanmean(squares, axis=1))


def _residuals(fit: Fit) -> Array:
    """Residuals of the first channel, shape (n,); NaN where the model has no answer."""
    whitened = fit.whitened[0]
    residuals = whitened * fit.observed.deviation[0]
    return np.where(whitened == NO_ANSWER, np.nan, residuals)


def measure_shrinkage(
    analysis: Analysis, validation: CrossValidation, held_out: Observations | None
) -> Measurement:
    """Measure the shrinkage by the leading set, by cross-validation or on a holdout.

    Args:
        analysis: of the campaign.
        validation: gives the errors at samples left out.
        held_out: samples of a holdout, or None.

    Raises:
        InputError: the model has no answer at any sample of the holdout.
    """
    if held_out is not None:
        return _on_holdout(analysis, held_out)
    before = validation.base_errors
    samples = analysis.base.observed.samples
    if analysis.significant:
        leading, _ = analysis.leading
        summary = validation.shrinkage(leading)
        return Measurement(summary, samples, before, validation.errors(leading))
    summary = shrinkage(
        before, before, analysis.noise, "cross-validation", analysis.seed, False
    )
    return Measurement(summary, samples, before, before)


def _on_holdout(analysis: Analysis, held_out: Observations) -> Measurement:
    """Measure the model that is saved on held-out samples.

    Samples that do not state their noise have that of the campaign.
    """
    fit_before = fit_after = analysis.base
    if analysis.significant:
        leading, _ = analysis.leading
        fit_after = leading.served_fit
    before = _errors_at(held_out, fit_before)
    after = _errors_at(held_out, fit_after)
    answered = np.isfinite(before) & np.isfinite(after)
    if not answered.any():
        raise InputError(
            f"{held_out.samples.source}: the model has no answer at any of the operating "
            "points held out"
        )
    notes: tuple[str, ...] = ()
    refused = np.flatnonzero(~answered)
    if len(refused):
        refusal = analysis.base.hypothesis.system.refusal
        notes = (
            f"{len(refused)} of {len(held_out)} held-out samples {refusal} and do not "
            f"count: {describe_samples(held_out, refused)}",
        )
    counted = held_out.select(np.flatnonzero(answered))
    noise = counted.deviation[0]
    if counted.assumed:
        noise = np.full(len(counted), rms(analysis.noise))
    before = before[answered]
    after = after[answered]
    summary = shrinkage(
        before, after, noise, "holdout", analysis.seed, analysis.significant
    )
    return Measurement(summary, counted.samples, before, after, notes)


def _errors_at(observed: Observations, fit: Fit) -> Array:
    predicted = fit.hypothesis.predict(fit.theta, observed.points)[0]
    return np.asarray(observed.measured[0] - predicted)


def shrinkage(
    before: Array,
    after: Array,
    noise: Array | float,
    on: str,
    seed: int,
    significant: bool = True,
    expected: Array | float = 0.0,
) -> ShrinkageSummary:
    """Return how far the gap shrinks, from errors on data not used for the fit.

    Args:
        before: errors of the first channel with the base model, shape (n,).
        after: the same with effects added, shape (n,).
        noise: standard deviation of the first channel at each, shape (n,) or scalar.
        on: where the errors come from.
        seed: of the bootstrap over points.
        significant: whether there is a gap at all; without one `fraction` is None.
        expected: mean squares of the model-averaged gap before and after, shape (2,). Weighted by
            the noise fraction, the part of the noise in the squared errors before, they bound G^2
            from below: errors within the noise show no gap.
    """
    variances = np.broadcast_to(np.square(noise), before.shape)
    squares = np.stack([before**2, after**2], axis=1) - variances[:, None]
    measured = np.maximum(squares.mean(axis=0), 0.0)
    variance = np.mean(np.square(noise))
    total_before = max(variance + measured[0], ROUNDING**2)
    gap_squares = np.maximum(measured, expected * variance / total_before)
    fraction = None
    interval = None
    if significant and gap_squares[0] > 0.0:
        fraction = float(_fractions(gap_squares[None])[0])
        interval = _interval(squares, fraction, seed)
    root_before, root_after = np.sqrt(gap_squares).tolist()
    return ShrinkageSummary(root_before, root_after, fraction, interval, on)


def _fractions(squares: Array) -> Array:
    """Fraction removed of rows of G^2 before and after, shape (k, 2) to (k,)."""
    before, after = squares.T
    # After: not below the noise, and a gap shrinks by no more than all of it.
    return np.clip(1.0 - after / before, LEAST_SHRINKAGE, 1.0)


def _interval(squares: Array, fraction: float, seed: int) -> tuple[float, float] | None:
    """Bootstrap interval of a fraction, widened to contain it; None where no draw has a gap."""
    rng = np.random.default_rng(seed)
    n = len(squares)
    draws = np.stack(
        [squares[rng.integers(0, n, n)].mean(axis=0) for _ in range(SHRINKAGE_DRAWS)]
    )
    draws = draws[draws[:, 0] > 0.0]
    if not len(draws):
        return None
    tails = [SHRINKAGE_TAIL, 1.0 - SHRINKAGE_TAIL]
    low, high = np.quantile(_fractions(draws), tails).tolist()
    return min(low, fraction), max(high, fraction)
