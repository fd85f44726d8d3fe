# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Least squares from several starts side by side (Levenberg & Marquardt within bounds).

A prediction takes little longer with fifty candidates than with one, so several searches that share
their predictions take little longer than one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..transmission.ranges import Array

_STEPS = 50
"""Of a search, at most."""
_SMALL_STEP = 1e-4
"""Of the step of the differences: a search whose step is smaller ends."""
_ROUNDING = 1e-14
"""Of the squares: a rise that rounding explains."""
_DAMPING = 1e-4
"""Of the first step, by the curvature along each variable."""
_WEAKEST_DAMPING = 1e-12
"""Below which variables that the residuals tie would leave no step determined."""
_STRONGEST_DAMPING = 1e4
"""Above which no step gains anything."""


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Sums of squares over d variables within bounds.

    Attributes:
        residuals: of points (m, k, d), shape (m, k, n), finite; the m searches may differ in them.
        bounds: lowest and highest value of each variable, shape (d, 2).
        difference: step of the differences that give the slopes, shape (d,).
    """

    residuals: Callable[[Array], Array]
    bounds: Array
    difference: Array

    def fitted(
        self,
        starts: Array,
        held: NDArray[np.bool_] | None = None,
        small_gain: float = 0.0,
    ) -> tuple[Array, Array]:
        """Search for the least squares from each start.

        Args:
            starts: m points within the bounds, shape (m, d).
            held: which variables of each keep their value, shape (m, d); None for none.
            small_gain: a step that changes the squares by less ends a search.

        Returns:
            The points, shape (m, d), and their squares, shape (m,).
        """
        points = starts
        residuals, slopes = self.linearised(points)
        squares = np.sum(residuals**2, axis=1)
        damping = np.full(len(points), _DAMPING)
        moving = np.ones(len(points), dtype=bool)
        for _ in range(_STEPS):
            step = self._step(points, residuals, slopes, damping, held)
            trial = np.clip(points + step, *self.bounds.T)
            new_residuals, new_slopes = self.linearised(trial)
            new_squares = np.sum(new_residuals**2, axis=1)
            gain = squares - new_squares
            better = moving & (gain > -_ROUNDING * squares)
            points = np.where(better[:, None], trial, points)
            squares = np.where(better, new_squares, squares)
            residuals = np.where(better[:, None], new_residuals, residuals)
            slopes = np.where(better[:, None, None], new_slopes, slopes)
            damping = damping * np.where(better, 0.1, 10.0)
            damping = np.maximum(damping, _WEAKEST_DAMPING)
            is_small = np.max(np.abs(step) / self.difference, axis=1) < _SMALL_STEP
            is_small |= np.abs(gain) < small_gain
            moving &= ~is_small & (damping < _STRONGEST_DAMPING)
            if not moving.any():
                break
        return points, squares

    def linearised(self, points: Array) -> tuple[Array, Array]:
        """Residuals (m, n) and their slopes (m, n, d) at points (m, d)."""
        step = np.diag(self.difference)
        below = np.maximum(points[:, None] - step, self.bounds[:, 0])
        above = np.minimum(points[:, None] + step, self.bounds[:, 1])
        every = np.concatenate([points[:, None], below, above], axis=1)
        residuals = self.residuals(every)
        width = np.diagonal(above - below, axis1=1, axis2=2)
        change = residuals[:, 1 + len(step) :] - residuals[:, 1 : 1 + len(step)]
        return residuals[:, 0], (change / width[..., None]).transpose(0, 2, 1)

    def _step(
        self,
        points: Array,
        residuals: Array,
        slopes: Array,
        damping: Array,
        held: NDArray[np.bool_] | None,
    ) -> Array:
        """Return the damped step of each search, (m, d); none beyond a bound that is reached."""
        gradient = np.einsum("mni,mn->mi", slopes, residuals)
        at_low = (points <= self.bounds[:, 0]) & (gradient > 0.0)
        at_high = (points >= self.bounds[:, 1]) & (gradient < 0.0)
        fixed = at_low | at_high
        if held is not None:
            fixed |= held
        curvature = np.einsum("mni,mnj->mij", slopes, slopes)
        size = np.diagonal(curvature, axis1=1, axis2=2)
        curvature = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, curvature)
        # A ridge of one for a variable that rests, and for one that changes nothing.
        ridge = np.where(fixed | (size == 0.0), 1.0, damping[:, None] * size)
        curvature = curvature + ridge[:, :, None] * np.eye(points.shape[1])
        pull = np.where(fixed, 0.0, gradient)
        return np.asarray(-np.linalg.solve(curvature, pull[..., None])[..., 0])
