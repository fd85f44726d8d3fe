# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The one model of a diagnosis that is handed over: saved, exported and served.

Three predictions of the efficiency compete on data left out, whole sessions and blocks of
neighbouring tests:

- the refitted base model;
- the base model with the leading set of effects, where one is named;
- the average over all explanations, unlisted losses among them (Bayesian model averaging; Hoeting
  et al. 1999, Stat. Sci. 14, 382), with a Gaussian process for what they leave of the readings
  (Kennedy & O'Hagan 2001, J. R. Stat. Soc. B 63, 425).

Each has to lower the squared error of the one before by a margin, otherwise that one is kept.
The average is put into the model as bumps of engine torque (`physics.effects.empirical`), stage by
stage, so that every user of the model takes the same object.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import Diagnosis
from ...diagnosis.analysis import rms
from ...diagnosis.fitting.cross_validation import (
    block_assignments,
    cross_validated_errors,
    session_assignments,
)
from ...diagnosis.observations import Observations, scaled_to_extent
from ...diagnosis.results.outcome import AVERAGE, BASE, LEADING_SET, Delivered
from ...diagnosis.selection.explanation import Explanation
from ...diagnosis.settings import SMALL_CAMPAIGN
from ...diagnosis.system import Array, Points
from ...files.bench import BenchSamples
from ...model.model import EfficiencyModel
from .bumps import with_bumps
from .channels import STAGE
from .gaussian_process import GaussianProcess, fit_gaussian_process
from .misfit import with_misfit


class Margin(NamedTuple):
    """By how much a model has to lower the squared error at samples left out.

    Attributes:
        standard_errors: of the gain, block by block.
        part: of the squared error before.
    """

    standard_errors: float
    part: float


MARGINS = {
    (BASE, LEADING_SET): Margin(1.0, 0.05),
    (BASE, AVERAGE): Margin(1.0, 0.3),
    (LEADING_SET, AVERAGE): Margin(2.0, 0.3),
}
"""Margins of a model over the one before it; chosen on development campaigns.

The evidence speaks for a set that is named. An average without a named cause may hold the noise and
the errors of meters of one campaign: where it removed less than three tenths, half of the models
were worse on fresh tests.
"""
MAX_SAMPLES = 300
"""Maximum number of samples that a Gaussian process is conditioned on. Limit of computing time."""


@dataclass(frozen=True, eq=False)
class HandedOver:
    """What is handed over, and why.

    Attributes:
        kind: `base`, `leading set` or `average`.
        model: the model.
        bumps: number of bumps in it.
        rmse_before: error of the refitted base model at samples left out [-].
        rmse_after: error of the model at the same samples [-]; not above `rmse_before`.
        left_out: errors of the model at samples left out [-], shape (assignments, n).
    """

    kind: str
    model: EfficiencyModel
    bumps: int
    rmse_before: float
    rmse_after: float
    left_out: Array


def with_served_model(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis with the model that is handed over, and its errors at samples left out.

    Args:
        diagnosis: of a transmission; without a gap it is returned as it is.
    """
    if not diagnosis.gap.significant:
        return diagnosis
    handed = handed_over(diagnosis)
    served = _with_model(diagnosis, handed)
    if served.shrinkage.grows:
        handed = replace(
            handed,
            kind=BASE,
            model=diagnosis.base,
            bumps=0,
            rmse_after=handed.rmse_before,
        )
        served = _with_model(diagnosis, handed)
    if handed.kind != BASE or diagnosis.verdict == "excess_scatter":
        return served
    note = (
        "no model with more than the base lowers the error at tests left out by more than "
        "chance: the base model is kept"
    )
    return replace(served, notes=(*served.notes, note))


def without_remainder(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis whose model holds no empirical remainder.

    Args:
        diagnosis: of a transmission.
    """
    return _with_model(diagnosis, handed_over(diagnosis, empirical=False))


def _with_model(diagnosis: Diagnosis, handed: HandedOver) -> Diagnosis:
    """Return a diagnosis with a model, its errors and how far the gap shrinks with it."""

    def predict(samples: BenchSamples) -> Array:
        efficiency: Array = handed.model.readings_at(samples.points)["efficiency"]
        return efficiency

    assert diagnosis.judge is not None
    if handed.kind == AVERAGE:
        measurement = diagnosis.judge.measured_model(predict, handed.left_out)
    elif handed.kind == LEADING_SET:
        assert diagnosis.leading is not None
        measurement = diagnosis.judge.measured(diagnosis.leading)
    else:
        measurement = diagnosis.judge.measured(diagnosis.posterior.base_only)
    return replace(
        diagnosis,
        served=handed.model,
        delivered=Delivered(
            handed.rmse_before, handed.rmse_after, handed.kind, handed.bumps
        ),
        shrinkage=measurement.shrinkage,
        residuals_after=measurement.after,
    )


def handed_over(diagnosis: Diagnosis, empirical: bool = True) -> HandedOver:
    """Return the model that predicts samples left out best.

    Args:
        diagnosis: of a transmission.
        empirical: whether bumps may be part of it.
    """
    campaign = _Campaign(diagnosis)
    left_out = {BASE: campaign.base}
    if diagnosis.named is not None and diagnosis.leading is not None:
        left_out[LEADING_SET] = campaign.leading
    if empirical and len(campaign.observed) >= SMALL_CAMPAIGN:
        left_out[AVERAGE] = campaign.average
    before = left_out[BASE]
    best = BASE
    for kind in (LEADING_SET, AVERAGE):
        if kind in left_out:
            margin = MARGINS[best, kind]
            if campaign.gains(left_out[best], left_out[kind], margin):
                best = kind
    if best == BASE:
        return HandedOver(BASE, diagnosis.base, 0, rms(before), rms(before), before)
    model, bumps = campaign.model_of(best)
    after = left_out[best]
    root_mean_square = np.sqrt(np.mean(after**2, axis=0))
    model = with_misfit(diagnosis, model, root_mean_square)
    return HandedOver(best, model, bumps, rms(before), rms(after), after)


class _Campaign:
    """A campaign that is diagnosed, and the predictions that compete.

    Args:
        diagnosis: of it.
    """

    def __init__(self, diagnosis: Diagnosis) -> None:
        self.diagnosis = diagnosis
        self.posterior = diagnosis.posterior
        self.observed: Observations = self.posterior.base_only.fit.observed
        self.assignments = [
            *block_assignments(self.observed, diagnosis.seed),
            *session_assignments(self.observed),
        ]

    @cached_property
    def base(self) -> Array:
        """Errors of the base model at samples left out [-], shape (assignments, n)."""
        return self._errors(self.posterior.base_only)

    @cached_property
    def leading(self) -> Array:
        """Errors with the leading set, as `base`."""
        assert self.diagnosis.leading is not None
        return self._errors(self.diagnosis.leading)

    @cached_property
    def average(self) -> Array:
        """Errors of the average over the explanations with the Gaussian process, as `base`."""
        average = np.zeros((len(self.assignments), len(self.observed)))
        for explanation, probability in self.posterior.entries:
            average += probability * self._errors(explanation)
        rows = []
        for errors, folds in zip(average, self.assignments, strict=True):
            corrected = errors.copy()
            for fold in folds:
                kept = np.setdiff1d(self._conditioned, fold)
                corrected[fold] -= self._process.given(kept, self._residuals)(
                    self._coordinates[:, fold], self._stage[fold]
                )
            rows.append(corrected)
        return np.stack(rows)

    def _errors(self, explanation: Explanation) -> Array:
        """Return errors of the efficiency at samples left out, shape (assignments, n)."""
        rows = []
        for folds in self.assignments:
            rows.append(
                cross_validated_errors(explanation.plain_model, self.observed, [folds])
            )
        return np.stack(rows) + self._taken_by_meters(explanation)

    def _taken_by_meters(self, explanation: Explanation) -> Array:
        """Return what an explanation takes for errors of meters and the average does not [-], (n,).

        The base model alone takes a part of the gap for the zero of a meter.
        """
        shared = explanation.fit.hypothesis.shared
        excess = explanation.plain_model.mean[shared] - self._meter_errors
        change = self.observed.shared_columns[0] @ excess
        return np.asarray(change * self.observed.deviation[0])

    @cached_property
    def _meter_errors(self) -> Array:
        """Errors of meters, averaged over the explanations, in prior deviations, shape (m,)."""
        errors = np.zeros(self.observed.shared_count)
        for explanation, probability in self.posterior.entries:
            shared = explanation.fit.hypothesis.shared
            errors += probability * explanation.model.mean[shared]
        return errors

    def gains(self, before: Array, after: Array, margin: Margin) -> bool:
        """Return whether errors are lower by a margin.

        Args:
            before: errors of one model, shape (assignments, n).
            after: errors of another one, the same shape.
            margin: by which they have to be lower.
        """
        total = float(np.mean(before**2))
        standard_errors = []
        gains = []
        for folds, old, new in zip(self.assignments, before, after, strict=True):
            gain = old**2 - new**2
            of_blocks = np.array([np.sum(gain[fold]) for fold in folds]) / len(gain)
            gains.append(gain.mean())
            spread = np.std(of_blocks, ddof=1) if len(folds) > 1 else np.inf
            standard_errors.append(spread * np.sqrt(len(folds)))
        gain = float(np.mean(gains))
        error = float(np.mean(standard_errors))
        return gain > max(margin.standard_errors * error, margin.part * total)

    # --- what the explanations leave of the readings -----------------------------------------

    @cached_property
    def _coordinates(self) -> Array:
        """Operating points scaled to 0 ... 1, shape (3, n)."""
        return self._scaled(self.observed.points)

    @cached_property
    def _stage(self) -> Array:
        return self._stage_of(self.observed.points)

    def _scaled(self, points: Points) -> Array:
        campaign = self.observed.coordinates
        scaled = scaled_to_extent(self.observed.coordinates_of(points), campaign)
        return np.asarray((scaled + 1.0) / 2.0)

    def _stage_of(self, points: Points) -> Array:
        count = len(next(iter(points.values())))
        return np.asarray(points.get(STAGE.name, np.zeros(count)))

    @cached_property
    def _conditioned(self) -> NDArray[np.intp]:
        """Samples that the process is conditioned on, evenly picked if there are many."""
        n = len(self.observed)
        return np.unique(np.linspace(0, n - 1, min(n, MAX_SAMPLES)).astype(int))

    @cached_property
    def _residuals(self) -> Array:
        """What the average over the explanations leaves of the efficiency [-], shape (n,)."""
        left = np.zeros(len(self.observed))
        for explanation, probability in self.posterior.entries:
            residual = (
                explanation.plain_model.residual()[0] * self.observed.deviation[0]
            )
            left += probability * (residual + self._taken_by_meters(explanation))
        return left

    @cached_property
    def _process(self) -> GaussianProcess:
        noise = self.observed.deviation[0]
        likeliest, _ = self.posterior.entries[0]
        if self.observed.assumed:
            noise = noise * np.sqrt(likeliest.model.noise[0])
        kept = self._conditioned
        return fit_gaussian_process(
            self._coordinates[:, kept],
            self._stage[kept],
            self._residuals[kept],
            noise[kept],
            not self.observed.assumed,
        ).at(self._coordinates, self._stage, noise)

    # --- the model -----------------------------------------------------------------------------

    def model_of(self, kind: str) -> tuple[EfficiencyModel, int]:
        """Return the model of a prediction other than the base, and how many bumps it holds."""
        base: EfficiencyModel = self.diagnosis.base
        start = base
        if self.diagnosis.named is not None:
            start = self.diagnosis.named.model
        if kind == LEADING_SET:
            return start, 0
        samples = self.observed.points
        points = self._range()
        wanted = self._average_at(points)
        at_samples = self._average_at(samples)
        names = list(base.stages)
        return with_bumps(
            start,
            {name: np.append(samples[name], points[name]) for name in samples},
            np.append(at_samples, wanted),
            len(self.observed),
            names,
            self._process.deviation,
        )

    def _range(self) -> Points:
        """Return tests that can be run between the lowest and highest of each axis."""
        fit = self.posterior.base_only.fit
        tests = fit.hypothesis.system.candidates(self.observed.points, fit.base)
        inside = self.observed.is_inside(self.observed.coordinates_of(tests))
        return {name: np.asarray(tests[name])[inside] for name in self.observed.points}

    def _average_at(self, points: Points) -> Array:
        """Return the efficiency of the average with the process [-], shape (n,)."""
        fit = self.posterior.base_only.fit
        base = fit.hypothesis.system.predict(fit.base, (), points)[0]
        gap, _ = self.posterior.gap_at(points)
        process = self._process.given(self._conditioned, self._residuals)
        return np.asarray(
            base + gap + process(self._scaled(points), self._stage_of(points))
        )
