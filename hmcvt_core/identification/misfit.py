# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a fitted model misses at samples left out of the fit, beyond noise and parameter errors.

The errors of the three parameters say how far the fit may be off if the form of the model is right.
What its form misses shows at samples left out only: their mean squared error is that of noise,
parameters and misfit together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..diagnosis.observations import pure_error
from ..diagnosis.settings import REPLICATE_TOLERANCE
from ..files.bench import BenchSamples
from ..model.accuracy import misfit
from ..model.domain import AXES
from ..model.model import EfficiencyModel
from ..transmission.ranges import Array

STATED = "stated"
REPEATED = "repeated points"
NOT_KNOWN = "not known"

_LEAST_RANGE = 1e-6
"""Range of an axis along which all samples are equal, against division by zero."""
_SAME_OIL = 1.0
"""Difference of oil temperatures of one operating point [deg C], that of a diagnosis."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the measured efficiency.

    Attributes:
        deviation: standard deviation at each sample [-], shape (n,); 0 where it is not known.
        source: `stated`, `repeated points` or `not known`.
    """

    deviation: Array
    source: str

    @classmethod
    def of(cls, samples: BenchSamples) -> Noise:
        """Return the noise that samples state, or else show at repeated points."""
        if samples.efficiency_std is not None:
            return cls(samples.efficiency_std, STATED)
        repeats = pure_error(_point_numbers(samples), samples.efficiency)
        if repeats is None:
            return cls(np.zeros(len(samples)), NOT_KNOWN)
        deviation, _ = repeats
        return cls(np.full(len(samples), deviation), REPEATED)


def _point_numbers(samples: BenchSamples) -> NDArray[np.intp]:
    """Return the number of the operating point of each sample, shape (n,)."""
    columns = []
    for axis in AXES:
        values = getattr(samples, axis)
        width = max(float(np.ptp(values)), _LEAST_RANGE)
        columns.append(np.round(values / (REPLICATE_TOLERANCE * width)))
    if samples.oil_temperature is not None:
        columns.append(np.round(samples.oil_temperature / _SAME_OIL))
    if samples.stage is not None:
        columns.append(np.unique(samples.stage, return_inverse=True)[1])
    points = np.stack(columns, axis=1)
    return np.unique(points, axis=0, return_inverse=True)[1].ravel()


def with_misfit(
    model: EfficiencyModel,
    samples: BenchSamples,
    fold: NDArray[np.intp],
    others: Sequence[EfficiencyModel],
) -> EfficiencyModel:
    """Return a fitted model with its misfit; without refits its misfit stays as it is.

    Where the noise is not known, the misfit holds it: it is then the error of a further reading.

    Args:
        model: fitted to all samples.
        samples: n of them.
        fold: of each sample, shape (n,), see `cross_validation.folds`.
        others: for each fold, the refit to the samples outside it.
    """
    if not others:
        return model
    errors = np.empty(len(samples))
    parameter_errors = np.empty(len(samples))
    for part, other in enumerate(others):
        left_out = samples.select(fold == part)
        prediction = replace(other, misfit=0.0).predict(*left_out.points)
        errors[fold == part] = prediction.efficiency - left_out.efficiency
        parameter_errors[fold == part] = prediction.standard_error
    noise = Noise.of(samples)
    return replace(
        model,
        misfit=misfit(errors, noise.deviation, parameter_errors),
        provenance={**model.provenance, "misfit_noise": noise.source},
    )


def misfit_remarks(model: EfficiencyModel) -> list[str]:
    """Say where the misfit of a fitted model holds the noise of its samples."""
    if model.misfit == 0.0 or model.provenance.get("misfit_noise") != NOT_KNOWN:
        return []
    return [
        "the noise of the samples is not known, so that standard errors of the efficiency are "
        f"those of a further reading: they hold a misfit of {100.0 * model.misfit:.2f} points"
    ]
