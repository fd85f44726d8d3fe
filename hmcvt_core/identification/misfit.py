# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Form error of a fitted model: its error at samples left out, beyond noise and parameter errors.

The errors of the three parameters hold if the form of the model is right. A form error shows at
samples left out only: their mean squared error is that of noise, parameters and form together.
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
from ..transmission.parameters import PARAMETER_NAMES
from ..transmission.ranges import Array

STATED = "stated"
REPEATED = "repeated points"
NOT_KNOWN = "not known"

FEWEST = 8
"""Fewest samples from which a form error is estimated: refits keep twice as many as parameters."""

_NEIGHBOURS = 3
"""Next samples of which one confirms a sample that is rejected; chosen for 24 tests."""
_MIN_RANGE = 1e-6
"""Range of an axis along which all samples are equal, against division by zero."""
_OIL_RANGE = 100.0
"""Difference of oil temperatures that counts like the range of an axis [deg C]."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the measured efficiency.

    Attributes:
        deviation: standard deviation [-], shape (n,) or scalar; 0 where it is not known.
        source: `stated`, `repeated points` or `not known`.
    """

    deviation: Array | float
    source: str

    @classmethod
    def of(cls, samples: BenchSamples, fitted: NDArray[np.bool_]) -> Noise:
        """Return the noise that samples state, or else show at repeated points.

        Args:
            samples: n of them.
            fitted: which of them count at repeated points, shape (n,).
        """
        if samples.efficiency_std is not None:
            return cls(samples.efficiency_std, STATED)
        used = samples.select(fitted)
        repeats = pure_error(_point_numbers(used), used.efficiency)
        if repeats is None:
            return cls(0.0, NOT_KNOWN)
        deviation, _ = repeats
        return cls(deviation, REPEATED)


def _point_numbers(samples: BenchSamples) -> NDArray[np.intp]:
    """Return the number of the operating point of each sample, shape (n,)."""
    points = np.round(_coordinates(samples) / REPLICATE_TOLERANCE)
    return np.unique(points, axis=0, return_inverse=True)[1].ravel()


def _coordinates(samples: BenchSamples) -> Array:
    """Return operating points scaled by the range of each axis, shape (n, axes).

    Samples of different oil temperature or stage are far from each other.
    """
    columns = []
    for axis in AXES:
        values = getattr(samples, axis)
        columns.append(values / max(float(np.ptp(values)), _MIN_RANGE))
    if samples.oil_temperature is not None:
        columns.append(samples.oil_temperature / _OIL_RANGE)
    if samples.stage is not None:
        numbers = np.unique(samples.stage, return_inverse=True)[1]
        columns.append(numbers.astype(float))
    return np.stack(columns, axis=1)


def missed_alike(
    model: EfficiencyModel, samples: BenchSamples, belongs: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which rejected samples show a form error, shape (n,).

    A mistake of the bench is alone among samples that agree. A form error has the same sign at a
    neighbour.

    Args:
        model: fitted to the samples that belong.
        samples: n of them.
        belongs: which of them are not rejected, shape (n,).
    """
    if belongs.all():
        return ~belongs
    from scipy.spatial.distance import cdist

    coordinates = _coordinates(samples)
    distance = cdist(coordinates, coordinates)
    np.fill_diagonal(distance, np.inf)
    neighbours = np.argsort(distance, axis=1)[:, :_NEIGHBOURS]
    missed = model.efficiency(*samples.points) - samples.efficiency
    same_sign = missed[:, None] * missed[neighbours] > 0.0
    alike = np.any(~belongs[neighbours] & same_sign, axis=1)
    return np.asarray(~belongs & alike)


def with_misfit(
    model: EfficiencyModel,
    samples: BenchSamples,
    belongs: NDArray[np.bool_],
    fold: NDArray[np.intp],
    others: Sequence[EfficiencyModel],
) -> EfficiencyModel:
    """Return a fitted model with its form error, which stays as it is with few samples.

    Where the noise is not known, the form error holds it: it is then the error of a further
    reading. It is at least the scatter of the fit, whose degrees of freedom are those of the model:
    a further reading is then within the intervals of Student's t, exactly so where the form of the
    model is right (Seber & Wild 1989, Nonlinear Regression, 5.1).

    Args:
        model: fitted to the samples that belong.
        samples: n of them.
        belongs: which of them are not rejected, shape (n,).
        fold: of each sample, shape (n,), see `cross_validation.folds`; -1 for one that is rejected,
            which `model` itself predicts.
        others: for each fold, the refit to the samples outside it.
    """
    counted = belongs | missed_alike(model, samples, belongs)
    samples = samples.select(counted)
    fold = fold[counted]
    if len(samples) < FEWEST:
        return model
    errors = np.empty(len(samples))
    parameter_errors = np.empty(len(samples))
    for number in np.unique(fold).tolist():
        fitted = model if number < 0 else others[number]
        rows = fold == number
        left_out = samples.select(rows)
        prediction = replace(fitted, misfit=0.0).predict(*left_out.points)
        errors[rows] = prediction.efficiency - left_out.efficiency
        parameter_errors[rows] = prediction.standard_error
    noise = Noise.of(samples, fold >= 0)
    missed = misfit(errors, noise.deviation, parameter_errors)
    if noise.source == NOT_KNOWN:
        missed = max(missed, _scatter(model, samples.select(fold >= 0)))
    return replace(
        model,
        misfit=missed,
        provenance={**model.provenance, "misfit_noise": noise.source},
    )


def _scatter(model: EfficiencyModel, samples: BenchSamples) -> float:
    """Return the standard deviation of the residuals of a fit [-].

    Args:
        model: as fitted.
        samples: those it was fitted to, more than there are parameters.
    """
    residuals = model.efficiency(*samples.points) - samples.efficiency
    free = len(samples) - len(PARAMETER_NAMES)
    return float(np.sqrt(np.sum(residuals**2) / free))


def misfit_remarks(model: EfficiencyModel) -> list[str]:
    """Return a sentence where the form error of a fitted model holds the noise of its samples."""
    if model.misfit == 0.0 or model.provenance.get("misfit_noise") != NOT_KNOWN:
        return []
    return [
        "the noise of the samples is not known: the form error of "
        f"{100.0 * model.misfit:.2f} points, and so the standard error of an efficiency, "
        "includes it"
    ]
