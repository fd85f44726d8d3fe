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
from numpy.typing import NDArray

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
_ROWS = np.arange(6)
_HELD = _ROWS // 2
"""Parameter that each search holds, shape (6,): lower and upper end of each in turn."""
_OUTWARD = np.where(_ROWS % 2, 1.0, -1.0)
"""Direction of each end from the best value, shape (6,)."""
_END_BOUND = _BOUNDS[_HELD, _ROWS % 2]
"""Bound beyond which no end lies, shape (6,)."""
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


class _Brackets:
    """Points inside each interval, and values outside, between which its end lies.

    A root is that of the rise of the squares, relative to the rise at an end.

    Attributes:
        best: variables of least squares, shape (3,).
        inside: outermost points known to be inside, shape (6, 3).
        inside_root: root at them, shape (6,).
        outside: innermost values known to be outside, shape (6,); NaN where none is known.
        outside_root: root at them, shape (6,).
        settled: which ends are found, shape (6,).
    """

    def __init__(self, best: Array) -> None:
        self.best = best
        self.inside = np.tile(best, (6, 1))
        self.inside_root = np.zeros(6)
        self.outside = np.full(6, np.nan)
        self.outside_root = np.full(6, np.nan)
        self.settled = self._reached == _END_BOUND

    @property
    def _reached(self) -> Array:
        """Outermost value inside of each parameter that is held, shape (6,)."""
        return self.inside[_ROWS, _HELD]

    def narrow(self, rows: NDArray[np.intp], points: Array, root: Array) -> None:
        """Take the least squares at guesses as inside or outside.

        Args:
            rows: k of the ends.
            points: of least squares at their guesses, shape (k, 3).
            root: at these, shape (k,).
        """
        is_inside = root <= 1.0 + _EXACT
        kept = rows[is_inside]
        self.inside[kept] = points[is_inside]
        self.inside_root[kept] = root[is_inside]
        at_bound = self._reached[kept] == _END_BOUND[kept]
        self.settled[kept] = at_bound | (root[is_inside] >= 1.0 - _EXACT)
        beyond = rows[~is_inside]
        self.outside[beyond] = points[~is_inside, _HELD[beyond]]
        self.outside_root[beyond] = root[~is_inside]

    def next_guess(self, guess: Array, halved: bool) -> Array:
        """Return values of the held parameters to try next, shape (6,).

        Args:
            guess: tried last, shape (6,).
            halved: whether to take the middle: false position may creep.
        """
        reached = self._reached
        # Outward as far again where nothing is known to be outside.
        distance = np.maximum(
            np.abs(reached - self.best[_HELD]), np.abs(guess - reached)
        )
        with np.errstate(invalid="ignore"):
            fraction = (1.0 - self.inside_root) / (self.outside_root - self.inside_root)
        if halved:
            fraction = np.full(6, 0.5)
        between = reached + fraction * (self.outside - reached)
        further = reached + distance * _OUTWARD
        return np.where(np.isnan(self.outside), further, between)


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
        lowest = float(self._squares(self.best[None])[0])
        brackets = _Brackets(self.best)
        guess = self.best[_HELD] + _OUTWARD * np.maximum(distance[_HELD], _DIFFERENCE)
        for number in range(_REFINEMENTS):
            (open_rows,) = np.nonzero(~brackets.settled)
            if not len(open_rows):
                break
            is_held = np.arange(3) == _HELD[open_rows, None]
            tried = brackets.inside[open_rows]
            tried[is_held] = np.clip(guess, *_BOUNDS[_HELD].T)[open_rows]
            points, squares = self._least_squares.fitted(
                tried, is_held, _SMALL_GAIN * self.rise
            )
            root = np.sqrt(np.maximum(squares - lowest, 0.0) / self.rise)
            brackets.narrow(open_rows, points, root)
            guess = brackets.next_guess(guess, halved=number % 3 == 2)
        return brackets.inside

    @cached_property
    def _least_squares(self) -> LeastSquares:
        return LeastSquares(self._residuals, _BOUNDS, np.full(3, _DIFFERENCE))

    def _squares(self, points: Array) -> Array:
        return np.asarray(np.sum(self._residuals(points) ** 2, axis=-1))

    def _residuals(self, points: Array) -> Array:
        return np.nan_to_num(
            self.problem.residuals(to_scaled(points * _UNIT)), nan=NO_ANSWER
        )
