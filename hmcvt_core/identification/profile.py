# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Intervals of identified parameters by profile likelihood.

A standard error takes the sum of squares for a parabola. Few tests, which tie parameters or leave
one at its bound, make it none. An interval then ends where the least squares, the other parameters
free within their bounds, exceed the best ones by F(1, n - p) times the variance of the scatter, or
at the bound itself (Bates & Watts 1988, Nonlinear Regression Analysis and Its Applications, 6.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..model.intervals import half_width
from ..transmission.parameters import (
    PARAMETER_RANGES,
    SEARCH_BOUNDS,
    from_scaled,
    to_scaled,
)
from ..transmission.ranges import Array
from .criterion import NO_ANSWER
from .precision import degrees_of_freedom, scatter
from .problem import Problem
from .side_by_side import LeastSquares

_UNIT = from_scaled(SEARCH_BOUNDS[:, 1])
"""Units of the variables, shape (3,). The leakage counts itself, not by its logarithm: losses rise
with it, and where it is small its logarithm changes nothing."""
_BOUNDS = from_scaled(SEARCH_BOUNDS.T).T / _UNIT[:, None]
"""Shape (3, 2)."""
_DIFFERENCE = 1e-6
"""Step of differences, of the width of the bounds."""
_EXACT = 0.01
"""Error of an end in terms of its distance from the best value, to first order."""
_REFINEMENTS = 25
"""Of an end, at most; the outermost value known to be inside stands for one that is not found."""
_SMALL_GAIN = 1e-3
"""Of the rise at an end: a step that gains less ends a search."""


def profile_intervals(
    problem: Problem, scaled: Array, errors: Array
) -> dict[str, tuple[float, float]]:
    """Return the interval of each parameter at 90 %, (low, high), in its unit.

    Args:
        problem: samples and model.
        scaled: the best point, shape (3,).
        errors: standard errors of the parameters, where the search begins, shape (3,).
    """
    half = half_width(degrees_of_freedom(problem.samples))
    rise = (half * scatter(problem, scaled)) ** 2
    best = np.clip(from_scaled(scaled) / _UNIT, *_BOUNDS.T)
    ends = _Profile(problem, best, rise).ends(half * errors / _UNIT)
    intervals = {}
    for i, limits in enumerate(PARAMETER_RANGES):
        low, high = (_UNIT[i] * ends[2 * i : 2 * i + 2, i]).tolist()
        if ends[2 * i, i] <= _BOUNDS[i, 0]:
            low = limits.low
        intervals[limits.name] = (low, high)
    return intervals


@dataclass(frozen=True, eq=False)
class _Profile:
    """Lower and upper end of each parameter, six searches side by side.

    Attributes:
        problem: samples and model.
        best: variables of least squares, shape (3,).
        rise: of the squares at the end of an interval.
    """

    problem: Problem
    best: Array
    rise: float

    def ends(self, distance: Array) -> Array:
        """Return the points at the ends, shape (6, 3), by false position on the root of the rise.

        Args:
            distance: of the first guess from the best value of each parameter, shape (3,).
        """
        rows = np.arange(6)
        held = rows // 2
        outward = np.where(rows % 2, 1.0, -1.0)
        bound = _BOUNDS[held, rows % 2]
        lowest = float(self._squares(self.best[None])[0])
        inside = np.tile(self.best, (6, 1))
        inside_root = np.zeros(6)
        outside = np.full(6, np.nan)
        outside_root = np.full(6, np.nan)
        guess = self.best[held] + outward * np.maximum(distance[held], _DIFFERENCE)
        settled = inside[rows, held] == bound
        for number in range(_REFINEMENTS):
            (open_rows,) = np.nonzero(~settled)
            if not len(open_rows):
                break
            low, high = _BOUNDS[held].T
            tried = inside.copy()
            tried[rows, held] = np.clip(guess, low, high)
            points, squares = self._least_squares.fitted(
                tried[open_rows],
                np.arange(3) == held[open_rows, None],
                _SMALL_GAIN * self.rise,
            )
            root = np.sqrt(np.maximum(squares - lowest, 0.0) / self.rise)
            for row, point, value in zip(open_rows.tolist(), points, root, strict=True):
                axis = held[row]
                if value <= 1.0 + _EXACT:
                    inside[row] = point
                    inside_root[row] = value
                    at_bound = point[axis] == bound[row]
                    settled[row] = at_bound or value >= 1.0 - _EXACT
                else:
                    outside[row] = point[axis]
                    outside_root[row] = value
            at = inside[rows, held]
            # Outward as far again where nothing is known to be outside.
            further = (
                at
                + np.maximum(np.abs(at - self.best[held]), np.abs(guess - at)) * outward
            )
            with np.errstate(invalid="ignore"):
                part = (1.0 - inside_root) / (outside_root - inside_root)
            # Every third time the middle: false position may creep.
            part = np.where(number % 3 == 2, 0.5, part)
            between = at + part * (outside - at)
            guess = np.where(np.isnan(outside), further, between)
        return inside

    @cached_property
    def _least_squares(self) -> LeastSquares:
        return LeastSquares(self._residuals, _BOUNDS, np.full(3, _DIFFERENCE))

    def _squares(self, points: Array) -> Array:
        return np.asarray(np.sum(self._residuals(points) ** 2, axis=-1))

    def _residuals(self, points: Array) -> Array:
        return np.nan_to_num(
            self.problem.residuals(to_scaled(points * _UNIT)), nan=NO_ANSWER
        )
