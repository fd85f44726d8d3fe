# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Samples that disagree with the rest: which are set aside, and sentences on them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..transmission.parameters import PARAMETER_NAMES, TYPICAL_PARAMETERS
from ..transmission.ranges import Array
from .robust import RobustProblem

MAX_SET_ASIDE = 1.0 / 3.0
"""Of the samples; with more no majority is to be trusted."""
_FEWEST_LEFT = 2 * len(PARAMETER_NAMES)
"""Operating points that show which sample disagrees: with fewer a fit follows any of them."""
_MAX_NAMED = 20


@dataclass(frozen=True, eq=False)
class Agreement:
    """Which samples agree, and what they predict.

    Attributes:
        belongs: which samples agree with each other, shape (n,).
        expected: efficiency that these predict at every sample, shape (n,) [-].
        remarks: a sentence on each sample that is set aside.
    """

    belongs: NDArray[np.bool_]
    expected: Array
    remarks: tuple[str, ...] = ()


def agreement(model: EfficiencyModel, samples: BenchSamples, seed: int) -> Agreement:
    """Return which samples agree with each other under some parameters of a model.

    Nothing is set aside where few operating points, or no majority, decide it.

    Args:
        model: stages, formulation and effects; its parameters are not used.
        samples: n bench samples.
        seed: of the random numbers.
    """
    before_any_bench = replace(model, parameters=TYPICAL_PARAMETERS)
    problem = RobustProblem(before_any_bench, samples)
    everything = np.ones(len(samples), dtype=bool)
    if len(np.unique(problem.point_numbers)) <= _FEWEST_LEFT:
        return Agreement(everything, samples.efficiency)
    change, belongs = problem.consensus(seed)
    aside = np.flatnonzero(~belongs)
    points_left = len(np.unique(problem.point_numbers[belongs]))
    majority = len(aside) <= MAX_SET_ASIDE * len(samples)
    if not len(aside) or not majority or points_left < _FEWEST_LEFT:
        return Agreement(everything, samples.efficiency)
    expected = problem.predict(change)
    remarks = set_aside_remarks(samples, aside, expected)
    return Agreement(belongs, expected, tuple(remarks))


def _point(samples: BenchSamples, i: int) -> str:
    """Return the operating point of a sample in words, with its stage."""
    stage = ""
    if samples.stage is not None:
        stage = f"stage {samples.stage[i]}, "
    return (
        f"{stage}displacement ratio {samples.displacement_ratio[i]:.3g}, "
        f"{samples.engine_speed[i]:.4g} rad/s, {samples.load_torque[i]:.4g} N m"
    )


def set_aside_remarks(
    samples: BenchSamples, aside: NDArray[np.intp], expected: Array
) -> list[str]:
    """Name samples that are set aside.

    Args:
        samples: all of them.
        aside: those set aside, from 0.
        expected: efficiency that the rest of the samples predicts at every sample, shape (n,) [-].
    """
    remarks = []
    for i in aside[:_MAX_NAMED]:
        name = f"sample {i + 1}"
        if samples.rows:
            name = f"row {samples.rows[i]}"
        said = f"the rest of the samples say {expected[i]:.4g}"
        if not np.isfinite(expected[i]):
            said = "the model of the rest has no answer at it"
        reading = f"{samples.efficiency[i]:.4g}"
        remarks.append(
            f"{name} is set aside: it reads {reading}, {said} ({_point(samples, int(i))})"
        )
    if len(aside) > _MAX_NAMED:
        remarks.append(
            f"{len(aside) - _MAX_NAMED} more samples are set aside like these"
        )
    return remarks
