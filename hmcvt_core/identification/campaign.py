# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign: bench samples that are checked once, before a model is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..model.plausibility import gear_train_remarks
from ..physics.formulation import PUBLISHED
from ..transmission.parameters import PARAMETER_NAMES, TYPICAL_PARAMETERS
from ..transmission.ranges import Array
from ..version import __version__
from .problem import Problem
from .robust import RobustProblem

MAX_SET_ASIDE = 1.0 / 3.0
"""Of the samples; with more no majority is to be trusted."""
_FEWEST_LEFT = 2 * len(PARAMETER_NAMES)
"""Operating points that show which sample disagrees: with fewer a fit follows any of them."""
_MAX_NAMED = 20


@dataclass(frozen=True, eq=False)
class Campaign:
    """Checked bench samples, and the model that is to be fitted to them.

    Attributes:
        model: stages, formulation and effects; its parameters are those to be identified.
        samples: all n samples.
        belongs: which samples agree with each other, shape (n,); the others are rejected.
        contradictions: a sentence on each stage whose readings do not fit its gear train.
        rejections: a sentence on each rejected sample.
    """

    model: EfficiencyModel
    samples: BenchSamples
    belongs: NDArray[np.bool_]
    contradictions: tuple[str, ...]
    rejections: tuple[str, ...]

    @classmethod
    def checked(
        cls, model: EfficiencyModel, samples: BenchSamples, seed: int
    ) -> Campaign:
        """Check samples against the gear train and against each other.

        Of the paper's formulas all samples count, as in the paper. Nothing is rejected where few
        operating points, or no majority, decide it.

        Args:
            model: stages, formulation and effects; its parameters are not used.
            samples: n bench samples.
            seed: of the random numbers.

        Raises:
            InputError: a sample names no stage of the model.
        """
        contradictions = tuple(gear_train_remarks(model, samples))
        everything = np.ones(len(samples), dtype=bool)
        complete = cls(model, samples, everything, contradictions, ())
        if model.formulation == PUBLISHED.name:
            return complete
        before_any_bench = replace(model, parameters=TYPICAL_PARAMETERS)
        problem = RobustProblem(before_any_bench, samples)
        if len(np.unique(problem.point_numbers)) <= _FEWEST_LEFT:
            return complete
        change, belongs = problem.consensus(seed)
        rejected = np.flatnonzero(~belongs)
        points_left = len(np.unique(problem.point_numbers[belongs]))
        majority = len(rejected) <= MAX_SET_ASIDE * len(samples)
        if not len(rejected) or not majority or points_left < _FEWEST_LEFT:
            return complete
        remarks = set_aside_remarks(samples, rejected, problem.predict(change))
        return replace(complete, belongs=belongs, rejections=tuple(remarks))

    @cached_property
    def fitted(self) -> Problem:
        """The problem of the samples that agree with each other."""
        if self.belongs.all():
            return self.everything
        return Problem(self.model, self.samples.select(self.belongs))

    @cached_property
    def everything(self) -> Problem:
        """The problem of all samples, the rejected ones included."""
        return Problem(self.model, self.samples)

    @cached_property
    def rejected(self) -> NDArray[np.intp]:
        """Positions of the rejected samples, from 0."""
        return np.flatnonzero(~self.belongs)


def set_aside_remarks(
    samples: BenchSamples, rejected: NDArray[np.intp], expected: Array
) -> list[str]:
    """Name rejected samples.

    Args:
        samples: all n of them.
        rejected: positions of those rejected, from 0.
        expected: efficiency that the rest of the samples predicts at every sample, shape (n,) [-].
    """
    remarks = []
    for i in rejected[:_MAX_NAMED]:
        contrast = f"the rest of the samples say {expected[i]:.4g}"
        if not np.isfinite(expected[i]):
            contrast = "the model of the rest has no answer at it"
        reading = f"{samples.efficiency[i]:.4g}"
        point = _point(samples, int(i))
        remarks.append(
            f"{samples.label(i)} is rejected: it reads {reading}, {contrast} ({point})"
        )
    if len(rejected) > _MAX_NAMED:
        remarks.append(
            f"{len(rejected) - _MAX_NAMED} more samples are rejected like these"
        )
    return remarks


def _point(samples: BenchSamples, i: int) -> str:
    """Return the operating point of a sample in words, with its stage."""
    stage = ""
    if samples.stage is not None:
        stage = f"stage {samples.stage[i]}, "
    return (
        f"{stage}displacement ratio {samples.displacement_ratio[i]:.3g}, "
        f"{samples.engine_speed[i]:.4g} rad/s, {samples.load_torque[i]:.4g} N m"
    )


def origin(command: str, samples: BenchSamples, seed: int | None) -> dict[str, Any]:
    """Return the provenance of a model that a command fits to samples at this moment."""
    temperatures = {}
    if samples.oil_temperature is not None:
        temperature = samples.oil_temperature
        ends = [float(temperature.min()), float(temperature.max())]
        temperatures["oil_temperature"] = ends
    return {
        "source": f"hmcvt {command}, version {__version__}",
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "data": Path(samples.source).name,
        "data_sha256": samples.sha256,
        "samples": len(samples),
        "seed": seed,
        **temperatures,
    }
