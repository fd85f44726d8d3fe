# SPDX-License-Identifier: Apache-2.0
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
from ..transmission.parameters import PARAMETER_NAMES
from ..transmission.stage import Stage
from .problem import BOUNDS, Problem, to_parameters

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
    return [_roots(stage, float(eps), float(eta)) for eps, eta in
            zip(samples.displacement_ratio, samples.efficiency, strict=True)]


def _roots(stage: Stage, displacement_ratio: float, efficiency: float) -> HydraulicRoots:
    if displacement_ratio == 0.0:
        return HydraulicRoots((), ())
    stroke = np.array([displacement_ratio])

    def gap(hydraulic: Array) -> Array:
        return published.efficiencies(stage, stroke, hydraulic).total - efficiency

    values = gap(_GRID)
    change = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    low, high = _GRID[change], _GRID[change + 1]
    for _ in range(60):
        middle = (low + high) / 2.0
        left = np.sign(gap(middle)) == np.sign(gap(low))
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    root = (low + high) / 2.0
    # A sign change through the pole is no root.
    root = root[np.abs(gap(root)) < 1e-6]
    found = published.efficiencies(stage, np.full(root.shape, displacement_ratio), root)
    sound = published.is_consistent(found, np.full(root.shape, displacement_ratio))
    return HydraulicRoots(tuple(root[sound].tolist()), tuple(root[~sound].tolist()))


def starting_points(problem: Problem, roots: list[HydraulicRoots]) -> Array:
    """Part 2's starts: scaled variables that best reproduce eta_H, shape (m, 3), m at least 1.

    One start for every combination of roots, as long as those are few.
    """
    from scipy.optimize import least_squares

    used = [i for i, entry in enumerate(roots) if entry.consistent]
    choices = [roots[i].consistent for i in used]
    middle = BOUNDS.mean(axis=1)
    if not used:
        return middle[None, :]
    points = problem.points
    chosen = points._replace(**{name: axis[used] for name, axis in points._asdict().items()
                                if axis is not None})
    starts = []
    for combination in itertools.islice(itertools.product(*choices), _MOST_COMBINATIONS):
        target = np.array(combination)

        def miss(scaled: Array, target: Array = target) -> Array:
            found = published.hydraulic_efficiency(
                problem.model.stage, to_parameters(scaled), chosen)
            return np.where(np.isnan(found), 1.0, found - target)

        starts.append(least_squares(miss, middle, bounds=BOUNDS.T, x_scale=1.0).x)
    return np.clip(np.array(starts).reshape(-1, len(PARAMETER_NAMES)), BOUNDS[:, 0], BOUNDS[:, 1])
