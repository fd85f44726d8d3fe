# SPDX-License-Identifier: Apache-2.0
"""Least squares within bounds, from many starting points side by side.

Levenberg's and Marquardt's method (D. Marquardt, J. SIAM 11, 431, 1963), on the variables that are
not held by a bound. The residuals of every point and of its neighbours for the slopes are asked for
in one call, which costs hardly more than that of one point.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Residuals = Callable[[Array], Array]
"""Takes points of shape (..., d), gives residuals of shape (..., n), finite."""

_STEP = 1e-6  # of the differences
_FIRST_DAMPING, _HARDEST = 1e-3, 1e10
_EASIEST = 1e-9  # fewer samples than variables leave equations that only damping makes solvable
_EASIER, _HARDER = 0.1, 10.0
_TINY = 1e-300  # keeps variables without any influence from dividing by zero


def least_squares(
    residuals: Residuals, starts: Array, bounds: Array, *, most: int = 200, precision: float = 1e-8
) -> Array:
    """Go down to the minimum of the sum of squares that each start leads to.

    Args:
        residuals: see `Residuals`.
        starts: points of shape (m, d), within the bounds.
        bounds: shape (d, 2), lower and upper.
        most: steps at most.
        precision: a start is done when its sum of squares could fall by less than this part, or
            its variables move by less than this part of the distance of the bounds.

    Returns:
        The points reached, shape (m, d).
    """
    low, high = bounds.T
    points = np.array(starts, dtype=float)
    found, slopes = _with_slopes(residuals, points, high)
    squares = np.sum(found**2, axis=-1)
    damping = np.full(len(points), _FIRST_DAMPING)
    active = np.ones(len(points), dtype=bool)
    for _ in range(most):
        step, fall = _step(found, slopes, damping, points, low, high)
        trial = np.clip(points + step, low, high)
        trial_found, trial_slopes = _with_slopes(residuals, trial, high)
        trial_squares = (trial_found**2).sum(axis=-1)
        better = active & (trial_squares < squares)
        moved = (np.abs(trial - points) / (high - low)).max(axis=-1)
        done = (moved < precision) | (fall < precision * squares)
        points[better], squares[better] = trial[better], trial_squares[better]
        found[better], slopes[better] = trial_found[better], trial_slopes[better]
        damping = np.where(better, np.maximum(damping * _EASIER, _EASIEST), damping * _HARDER)
        active &= ~done & (damping < _HARDEST)
        if not active.any():
            break
    return points


def _with_slopes(residuals: Residuals, points: Array, high: Array) -> tuple[Array, Array]:
    """Return residuals (m, n) and their slopes (m, d, n) at points (m, d)."""
    # Backward next to an upper bound.
    steps = np.where(points + _STEP <= high, _STEP, -_STEP)
    # The point itself, then one step along each variable.
    moves = np.eye(points.shape[1] + 1, points.shape[1], -1)
    found = residuals(points[:, None, :] + moves * steps[:, None, :])
    here = found[:, 0]
    return here, (found[:, 1:] - here[:, None]) / steps[:, :, None]


def _step(
    found: Array, slopes: Array, damping: Array, points: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Solve the damped normal equations for the variables that no bound holds.

    Returns:
        Steps (m, d), and by how much the sums of squares (m,) fall as far as the slopes tell.
    """
    gradient = np.matmul(slopes, found[:, :, None])[:, :, 0]
    normal = np.matmul(slopes, slopes.transpose(0, 2, 1))
    held = ((points <= low) & (gradient > 0.0)) | ((points >= high) & (gradient < 0.0))
    gradient[held] = 0.0
    free = ~held
    normal *= free[:, :, None] & free[:, None, :]
    damped = damping[:, None] * normal.diagonal(axis1=1, axis2=2)
    normal += (damped + held + _TINY)[:, :, None] * np.eye(points.shape[1])
    step = -np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    return step, (step * (damped * step - gradient)).sum(axis=-1)
