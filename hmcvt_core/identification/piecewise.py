# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The paper's identification in two parts (section 4.1, improvement 4): eta_H first.

Part 1 inverts eq. (18) for the hydraulic efficiency of each sample. Part 2 looks for the parameters
that give these efficiencies; here they are starts of the annealing.
"""

import itertools
from typing import NamedTuple

import numpy as np

from ..files.bench import BenchSamples
from ..physics import published
from ..transmission.parameters import SEARCH_BOUNDS, HydraulicParameters, from_scaled
from ..transmission.ranges import Array
from ..transmission.stage import Stage
from .problem import Problem

_GRID = np.linspace(published.STANDING_EFFICIENCY, 1.0 - 1e-9, 4001)
"""Values of eta_H between which a root is looked for."""
_ROOT_TOLERANCE = 1e-6
_MAX_COMBINATIONS = 32
_STALLED_MISS = 1.0  # of eta_H, where the motor does not turn forward


class HydraulicRoots(NamedTuple):
    """Hydraulic efficiencies that meet one measured efficiency.

    Attributes:
        consistent: roots at which the published formulas agree with themselves.
        rejected: roots beyond the pole of eq. (11).
    """

    consistent: tuple[float, ...]
    rejected: tuple[float, ...]


def hydraulic_roots(stage: Stage, samples: BenchSamples) -> list[HydraulicRoots]:
    """Part 1: invert eq. (18) for eta_H.

    Returns:
        For each sample every eta_H in (0, 1) at which eq. (18) gives the measured efficiency. Where
        power circulates there may be two; at eps = 0, where eta_H does not enter, there is none.
    """
    pairs = zip(samples.displacement_ratio, samples.efficiency, strict=True)
    return [_roots(stage, stroke, float(measured)) for stroke, measured in pairs]


def _roots(stage: Stage, stroke: Array, efficiency: float) -> HydraulicRoots:
    from scipy.optimize import brentq

    if stroke == 0.0:
        return HydraulicRoots((), ())

    def gap(hydraulic: Array | float) -> Array:
        total = published.efficiencies(stage, stroke, np.asarray(hydraulic)).total
        # At the pole there is no number.
        return np.nan_to_num(total, nan=np.finfo(float).max) - efficiency

    consistent: list[float] = []
    rejected: list[float] = []
    signs = np.sign(gap(_GRID))
    for i in np.flatnonzero(signs[:-1] * signs[1:] < 0.0):
        root = brentq(gap, _GRID[i], _GRID[i + 1], xtol=1e-15)
        if abs(gap(root)) >= _ROOT_TOLERANCE:
            continue  # a change of sign through the pole is no root
        values = published.efficiencies(stage, stroke, np.array(root))
        if published.is_consistent(values, stroke):
            consistent.append(root)
        else:
            rejected.append(root)
    return HydraulicRoots(tuple(consistent), tuple(rejected))


def starting_points(problem: Problem, roots: list[HydraulicRoots]) -> Array:
    """Part 2: scaled parameters that best reproduce eta_H, shape (m, 3), m at least 1.

    One start for every combination of consistent roots, as long as those are few.
    """
    from scipy.optimize import least_squares

    used = [i for i, entry in enumerate(roots) if entry.consistent]
    middle = SEARCH_BOUNDS.mean(axis=1)
    if not used:
        return middle[None, :]
    points = problem.samples.select(used).points

    def miss(scaled: Array, target: Array) -> Array:
        parameters = HydraulicParameters(*from_scaled(scaled).tolist())
        hydraulic = published.hydraulic_efficiency(
            problem.model.stage, parameters, points
        )
        return np.where(np.isnan(hydraulic), _STALLED_MISS, hydraulic - target)

    combinations = itertools.product(*(roots[i].consistent for i in used))
    starts = []
    for target in itertools.islice(combinations, _MAX_COMBINATIONS):
        solution = least_squares(
            miss, middle, bounds=SEARCH_BOUNDS.T, args=(np.array(target),)
        )
        starts.append(solution.x)
    return np.array(starts)


def chain_starts(
    problem: Problem, roots: list[HydraulicRoots], chains: int, seed: int | None
) -> Array:
    """Starts of the annealing chains, shape (chains, 3): half from part 1, the rest at random."""
    low, high = SEARCH_BOUNDS.T
    from_roots = starting_points(problem, roots)[: max(1, chains // 2)]
    at_random = np.random.default_rng(seed).uniform(low, high, (chains, len(low)))
    return np.concatenate([from_roots, at_random])[:chains]
