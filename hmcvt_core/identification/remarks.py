# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Sentences on what bench samples leave undetermined or unchecked."""

import itertools
from collections.abc import Iterator

import numpy as np

from ..files.bench import BenchSamples
from ..model.domain import AXES
from ..model.model import EfficiencyModel
from ..model.oil import oil_remarks
from ..physics.formulation import FORMULATIONS
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    SEARCH_BOUNDS,
    from_scaled,
    to_scaled,
)
from .precision import WIDTH

_LOOSE = 0.5  # a standard error above this part of the value leaves the parameter undetermined
_TIED = 0.95  # a correlation above this leaves only a combination
_AT_BOUND = 1e-4  # of the width


def undetermined(samples: BenchSamples, model: EfficiencyModel) -> Iterator[str]:
    """Yield what samples leave open of a model that was fitted to them."""
    yield from _copied(samples)
    yield from _too_few(samples)
    yield from _one_sided(samples)
    yield from _loose(model)
    yield from _tied(model)
    yield from oil_remarks(model, samples)


def _copied(samples: BenchSamples) -> Iterator[str]:
    columns = [values.tolist() for values in samples.columns.values()]
    distinct = len(set(zip(*columns, *samples.extra.values(), strict=True)))
    count = len(samples)
    if distinct < count:
        yield (
            f"{count - distinct} of {count} samples copy another one in every column: they "
            "count as measurements, and the standard errors are too small if they are none"
        )


def _too_few(samples: BenchSamples) -> Iterator[str]:
    axes = [getattr(samples, axis).tolist() for axis in AXES]
    points = len(set(zip(*axes, strict=True)))
    if points >= len(PARAMETER_NAMES):
        return
    size = f"{points} samples"
    if points < len(samples):
        plural = "s" if points > 1 else ""
        size = f"{len(samples)} samples at {points} working point{plural}"
    yield (
        f"{size} cannot determine {len(PARAMETER_NAMES)} parameters: the values are one "
        "choice among many"
    )


def _one_sided(samples: BenchSamples) -> Iterator[str]:
    for sign, word in ((1.0, "positive"), (-1.0, "negative")):
        if not (samples.displacement_ratio * sign > 0.0).any():
            yield f"no sample has a {word} displacement ratio: the model is unchecked there"


def _loose(model: EfficiencyModel) -> Iterator[str]:
    values = model.parameters.to_array()
    distances = np.abs(SEARCH_BOUNDS - to_scaled(values)[:, None])
    bounds = from_scaled(SEARCH_BOUNDS.T)
    for i, name in enumerate(PARAMETER_NAMES):
        error = model.standard_errors[name]
        unit = PARAMETER_UNITS[name]
        side = int(distances[i].argmin())
        if distances[i, side] < _AT_BOUND * WIDTH[i]:
            yield (
                f"{name} is not determined by these samples: its best value lies at the "
                f"{('lower', 'upper')[side]} bound {bounds[side, i]:g} {unit}"
            )
        elif error > _LOOSE * values[i]:
            yield (
                f"{name} is not determined by these samples: {values[i]:.3g} with a standard "
                f"error of {error:.2g} {unit}"
            )


def _tied(model: EfficiencyModel) -> Iterator[str]:
    correlation = np.asarray(model.correlation)
    for i, j in itertools.combinations(range(len(PARAMETER_NAMES)), 2):
        if abs(correlation[i, j]) > _TIED:
            yield (
                f"{PARAMETER_NAMES[i]} and {PARAMETER_NAMES[j]} are tied "
                f"(correlation {correlation[i, j]:.2f}): only a combination is determined"
            )


def unchecked(
    model: EfficiencyModel, held_back: BenchSamples, unanswered: int
) -> Iterator[str]:
    """Yield what samples held out do not check.

    Args:
        model: with the domain of the samples that it was fitted to.
        held_back: samples that it has not seen.
        unanswered: number of them at which the model has no answer.
    """
    count = len(held_back)
    if unanswered:
        reason = FORMULATIONS[model.formulation].no_answer
        yield (
            f"the model has no answer at {unanswered} of {count} samples held out, which "
            f"the error of the prediction leaves out: {reason}"
        )
    if model.domain is None:
        return
    inside = model.domain.contains(*held_back.points[:3])
    outside = int((~inside).sum())
    if 2 * outside > count:
        yield (
            f"{outside} of {count} samples held out lie outside the range of those "
            "fitted: the error of the prediction is mostly one of extrapolation"
        )
