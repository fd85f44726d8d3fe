# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the models of a diagnosis miss, beyond the noise and the errors of their parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from ...diagnosis import Diagnosis
from ...diagnosis.results.outcome import Cause
from ...diagnosis.system import Array
from ...files.bench import BenchSamples
from ...model.accuracy import misfit
from ...model.model import EfficiencyModel

AnyDiagnosis = TypeVar("AnyDiagnosis", bound=Diagnosis)


def with_misfits(diagnosis: AnyDiagnosis, inherited: float = 0.0) -> AnyDiagnosis:
    """Return a diagnosis whose models state their misfit.

    It is that of the gap that a model leaves, or of what it leaves of the readings if that is more:
    the diagnosis may explain readings by errors of meters and gears, which the served parameters
    do not hold.

    Args:
        diagnosis: of a transmission.
        inherited: misfit of the sound model with which the readings are compared [-].
    """
    gap_before = float(np.hypot(diagnosis.shrinkage.before, inherited))
    base = _with_gap(diagnosis, diagnosis.base, gap_before)
    causes = []
    for cause in diagnosis.causes:
        gap_after = float(np.hypot(_gap_after(diagnosis, cause), inherited))
        model = _with_gap(diagnosis, cause.model, gap_after)
        causes.append(replace(cause, model=model))
    return replace(diagnosis, base=base, causes=tuple(causes))


def with_misfit(
    diagnosis: Diagnosis, model: EfficiencyModel, left_out: Array
) -> EfficiencyModel:
    """Return a model with the misfit that errors at samples left out show.

    Args:
        diagnosis: gives noise and samples.
        model: any.
        left_out: its errors there [-], shape (m,).
    """
    errors = parameter_errors(model, diagnosis.samples)
    known = errors[np.isfinite(errors)]
    of_parameters = float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
    noise = believed_noise(diagnosis)
    return replace(model, misfit=misfit(left_out, noise, of_parameters))


def _gap_after(diagnosis: Diagnosis, cause: Cause) -> float:
    """Return the gap that the model of a cause leaves; on a holdout if the set leads."""
    if diagnosis.named is not None and cause.effect in diagnosis.sets[0].effects:
        return diagnosis.shrinkage.after
    return cause.gap_after


def _with_gap(
    diagnosis: Diagnosis, model: EfficiencyModel, gap: float
) -> EfficiencyModel:
    """Return a model with the misfit that its residuals show, and a gap that it leaves."""
    samples: BenchSamples = diagnosis.samples
    missed = model.readings_at(samples.points)["efficiency"] - samples.efficiency
    errors = parameter_errors(model, samples)
    return replace(model, misfit=misfit(missed, believed_noise(diagnosis), errors, gap))


def parameter_errors(model: EfficiencyModel, samples: BenchSamples) -> Array:
    """Return the standard error of the efficiency from the parameters [-], shape (n,)."""
    exact = replace(model, misfit=0.0, remainder_deviation=0.0)
    return np.asarray(exact.predict(*samples.points).standard_error)


def believed_noise(diagnosis: Diagnosis) -> float:
    """Return the noise of the efficiency [-], not above its statement.

    What exceeds a stated noise counts as missed by the model, as in the shrinkage.
    """
    if diagnosis.posterior.base_only.fit.observed.assumed:
        return diagnosis.gap.noise
    return min(diagnosis.gap.noise, diagnosis.gap.noise_stated)
