# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The paper's piecewise identification (section 4.1, improvement 4): eta_H first, then parameters.

Part 1 finds, for each sample, the hydraulic efficiency eta_H that makes eq. (18) meet the measured
efficiency. Where power circulates that map is not monotone and may have two roots; both are found,
and only a root at which the formulas agree with themselves (`published.is_consistent`) is used.
Part 2 looks for the three parameters, starting from those that reproduce the roots.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..physics import published
from ..transmission.parameters import SEARCH_BOUNDS, HydraulicParameters, from_scaled
from ..transmission.stage import Stage
from .problem import Problem

Array = NDArray[np.float64]
_GRID = np.linspace(published.STANDING_EFFICIENCY, 1.0 - 1e-9, 4001)
_MOST_COMBINATIONS = 32


class HydraulicRoots(NamedTuple):
    """Hydraulic efficiencies that meet one measured efficiency.

    Attributes:
        consistent: roots at which the published formulas agree with themselves.
        rejected: roots beyond the pole of eq. (11).
    """

    consistent: tuple[float, ...]
    rejected: tuple[float, ...]


def hydraulic_roots(stage: Stage, samples: BenchSamples) -> list[HydraulicRoots]:
    """Part 1: every eta_H in (0, 1) at which eq. (18) gives the measured efficiency.

    Returns:
        One entry per sample; empty where no eta_H can give the measured value (as at eps = 0,
        where eta_H does not enter).
    """
    return [_roots(stage, stroke, float(measured)) for stroke, measured in
            zip(samples.displacement_ratio, samples.efficiency, strict=True)]


def _roots(stage: Stage, stroke: Array, efficiency: float) -> HydraulicRoots:
    from scipy.optimize import brentq

    def gap(hydraulic: Array | float) -> Array:
        total = published.efficiencies(stage, stroke, np.asarray(hydraulic)).total
        return np.nan_to_num(total, nan=np.finfo(float).max) - efficiency  # no number at the pole

    roots: dict[bool, list[float]] = {True: [], False: []}
    values = gap(_GRID)
    change = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    for i in change if stroke != 0.0 else ():
        root = brentq(gap, _GRID[i], _GRID[i + 1], xtol=1e-15)
        if abs(gap(root)) < 1e-6:  # a sign change through the pole is no root
            found = published.efficiencies(stage, stroke, np.array(root))
            roots[bool(published.is_consistent(found, stroke))].append(root)
    return HydraulicRoots(tuple(roots[True]), tuple(roots[False]))


def starting_points(problem: Problem, roots: list[HydraulicRoots]) -> Array:
    """Part 2's starts: scaled variables that best reproduce eta_H, shape (m, 3), m at least 1.

    One start for every combination of roots, as long as those are few.
    """
    from scipy.optimize import least_squares

    used = [i for i, entry in enumerate(roots) if entry.consistent]
    middle = SEARCH_BOUNDS.mean(axis=1)
    if not used:
        return middle[None, :]
    chosen = problem.samples.select(used).points

    def miss(scaled: Array, target: Array) -> Array:
        parameters = HydraulicParameters(*from_scaled(scaled).tolist())
        found = published.hydraulic_efficiency(problem.model.stage, parameters, chosen)
        return np.where(np.isnan(found), 1.0, found - target)

    combinations = itertools.product(*(roots[i].consistent for i in used))
    return np.array([
        least_squares(miss, middle, bounds=SEARCH_BOUNDS.T, args=(np.array(target),)).x
        for target in itertools.islice(combinations, _MOST_COMBINATIONS)])
