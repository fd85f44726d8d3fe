# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Intervals of identified parameters by profile likelihood.

A standard error takes the sum of squares for a parabola. Few tests, which tie parameters or leave
one at its bound, make it none. An interval then ends where the least squares, the other parameters
free within their bounds, exceed the best ones by F(1, n - p) times the variance of the scatter, or
at the bound itself (Bates & Watts 1988, Nonlinear Regression Analysis and Its Applications, 6.1).
"""

from __future__ import annotations

from dataclasses import dataclass

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
_STEPS = 15
"""Of a fit, at most."""
_SMALL_GAIN = 1e-3
"""Of the rise at an end: a step that gains less ends a search."""
_DAMPING = 1e-4
"""Of the first step (Levenberg & Marquardt), by the curvature along each variable."""
_STRONGEST_DAMPING = 1e4
"""Above which no step gains anything."""


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
            points, squares = self._fitted(tried[open_rows], held[open_rows])
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

    def _fitted(self, points: Array, held: NDArray[np.intp]) -> tuple[Array, Array]:
        """Fit the other parameters within their bounds (Levenberg & Marquardt).

        Args:
            points: m starts, shape (m, 3).
            held: the parameter of each that keeps its value, shape (m,).

        Returns:
            The points, shape (m, 3), and their squares, shape (m,).
        """
        rows = np.arange(len(points))
        residuals, slopes = self._linearised(points)
        squares = np.sum(residuals**2, axis=1)
        damping = np.full(len(points), _DAMPING)
        moving = np.ones(len(points), dtype=bool)
        for _ in range(_STEPS):
            gradient = np.einsum("mni,mn->mi", slopes, residuals)
            at_low = (points <= _BOUNDS[:, 0]) & (gradient > 0.0)
            at_high = (points >= _BOUNDS[:, 1]) & (gradient < 0.0)
            fixed = at_low | at_high
            fixed[rows, held] = True
            curvature = np.einsum("mni,mnj->mij", slopes, slopes)
            size = np.diagonal(curvature, axis1=1, axis2=2)
            curvature = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, curvature)
            # A ridge of one for a variable that rests, and for one that changes nothing.
            ridge = np.where(fixed | (size == 0.0), 1.0, damping[:, None] * size)
            curvature = curvature + ridge[:, :, None] * np.eye(3)
            pull = np.where(fixed, 0.0, gradient)
            step = -np.linalg.solve(curvature, pull[..., None])[..., 0]
            trial = np.clip(points + step, *_BOUNDS.T)
            new_residuals, new_slopes = self._linearised(trial)
            new_squares = np.sum(new_residuals**2, axis=1)
            gain = squares - new_squares
            better = moving & (gain > 0.0)
            points = np.where(better[:, None], trial, points)
            squares = np.where(better, new_squares, squares)
            residuals = np.where(better[:, None], new_residuals, residuals)
            slopes = np.where(better[:, None, None], new_slopes, slopes)
            damping = damping * np.where(better, 0.1, 10.0)
            small = np.abs(gain) < _SMALL_GAIN * self.rise
            moving &= ~small & (damping < _STRONGEST_DAMPING)
            if not moving.any():
                break
        return points, squares

    def _squares(self, points: Array) -> Array:
        return np.asarray(np.sum(self._residuals(points) ** 2, axis=-1))

    def _residuals(self, points: Array) -> Array:
        return np.nan_to_num(
            self.problem.residuals(to_scaled(points * _UNIT)), nan=NO_ANSWER
        )

    def _linearised(self, points: Array) -> tuple[Array, Array]:
        """Residuals (m, n) and their slopes (m, n, 3) at points (m, 3)."""
        step = _DIFFERENCE * np.eye(3)
        below = np.maximum(points[:, None] - step, _BOUNDS[:, 0])
        above = np.minimum(points[:, None] + step, _BOUNDS[:, 1])
        every = np.concatenate([points[:, None], below, above], axis=1)
        residuals = self._residuals(every)
        width = np.diagonal(above - below, axis1=1, axis2=2)
        change = residuals[:, 4:] - residuals[:, 1:4]
        return residuals[:, 0], (change / width[..., None]).transpose(0, 2, 1)
