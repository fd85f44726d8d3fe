# SPDX-License-Identifier: Apache-2.0
"""Samples held out, on which the shrinkage is measured: what counts, and how noisy it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from .intake import listed_samples
from .observations import stated_noise

Array = NDArray[np.float64]


class Held(NamedTuple):
    """Errors of two models at samples held out.

    Attributes:
        before, after: measured - predicted efficiency, shape (n,) [-].
        noise: standard deviation of the efficiency at each, shape (n,) [-].
        notes: on samples that do not count.
    """

    before: Array
    after: Array
    noise: Array
    notes: tuple[str, ...]


def fresh(holdout: BenchSamples, samples: BenchSamples) -> tuple[BenchSamples, tuple[str, ...]]:
    """Leave out what the diagnosis has seen already, and say so.

    Raises:
        InputError: nothing is left, or the holdout lacks the oil temperature that `samples` have.
    """
    if holdout.oil_temperature is None and samples.oil_temperature is not None:
        raise InputError(f"{holdout.source}: column oil_temperature is missing; {samples.source} "
                         "has it")
    seen = set(_rows(samples))
    kept = np.array([i for i, row in enumerate(_rows(holdout)) if row not in seen], dtype=np.intp)
    if not len(kept):
        raise InputError(f"{holdout.source}: every sample held out is among those diagnosed; a "
                         "holdout is measured apart, or leave it out for cross-validation")
    copies = len(holdout) - len(kept)
    if not copies:
        return holdout, ()
    return holdout.select(kept), (f"{copies} of {len(holdout)} samples held out are among those "
                                  "diagnosed and were left out",)


def _rows(samples: BenchSamples) -> list[tuple[float, ...]]:
    return list(zip(*(column.tolist() for column in (
        samples.displacement_ratio, samples.engine_speed, samples.load_torque,
        samples.efficiency)), strict=True))


def errors_on(
    held: BenchSamples, before: EfficiencyModel, after: EfficiencyModel, campaign_noise: float
) -> Held:
    """Errors of two models at samples held out, with the noise of those samples.

    Their own column `efficiency_std` or repeated points state it, else it is `campaign_noise`.

    Raises:
        InputError: a model has no answer at any of them.
    """
    errors = [held.efficiency - model.efficiency(
        held.displacement_ratio, held.engine_speed, held.load_torque, held.oil_temperature)
        for model in (before, after)]
    usable = np.isfinite(errors[0]) & np.isfinite(errors[1])
    if not usable.any():
        raise InputError(f"{held.source}: the model has no answer at any of the operating points "
                         "held out")
    stalled = np.flatnonzero(~usable)
    notes: tuple[str, ...] = ()
    if len(stalled):
        notes = (f"{len(stalled)} of {len(held)} samples held out ask for a load that the model "
                 f"cannot carry and do not count: {listed_samples(held, stalled)}",)
    stated = stated_noise(held)
    noise = np.full(len(held), campaign_noise) if stated is None else stated[0]
    return Held(errors[0][usable], errors[1][usable], noise[usable], notes)
