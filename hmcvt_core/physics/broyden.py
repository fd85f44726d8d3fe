# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Broyden's method for many small systems x = g(x) at once.

Every point is a separate system with the same number of unknowns. The first step is that of a
fixed-point iteration, g(x) - x; each further step is bent by what the earlier ones have shown:

.. math:: s_{k+1} = \frac{s'}{1 - s'^T s_k / |s_k|^2}, \qquad
          s' = r \prod_{j<k} \left(I + \frac{s_{j+1} s_j^T}{|s_j|^2}\right), \quad r = g(x) - x

This needs no Jacobian, and only products of vectors (Kelley 1995, Iterative Methods for Linear and
Nonlinear Equations, algorithm `brsol`).
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MEMORY = 8
"""Steps that are remembered; then the method starts again from where it is."""
_ROUNDS = 5
"""How often it starts, at most."""
_TOLERANCE = 1e-7
"""Scaled residual at which the next step is the last: a step from there is exact to rounding."""
_EXACT = 1e-10
"""Scaled residual up to which a point takes no further steps while others do."""
_SETTLED = 1e-6
"""Scaled residual up to which a point counts as solved: the last digits of the terms are noise."""
_SLOPES = (0.05, 20.0)
"""Slopes between which a step is trusted. The function answers x weakly: a slope far from 1 is
noise of the last digits, or a kink beyond which earlier steps show nothing."""
_NO_STEP = 1e-300
"""Squared length below which a step has no direction."""


class _Steps:
    """Steps taken so far, and the direction of each over its squared length."""

    def __init__(self) -> None:
        self._steps: list[Array] = []
        self._directions: list[Array] = []

    def bent(self, residual: Array) -> Array:
        """Return the next step for a residual, both of shape (unknowns, n)."""
        if not self._steps:
            return residual
        step = residual
        for direction, following in zip(
            self._directions, self._steps[1:], strict=False
        ):
            step = step + following * _dot(step, direction)
        slope = 1.0 - _dot(step, self._directions[-1])
        step = step / slope
        doubtful = (slope < _SLOPES[0]) | (slope > _SLOPES[1])
        if doubtful.any():
            step = np.where(doubtful, residual, step)
            self._directions = [
                np.where(doubtful, 0.0, direction) for direction in self._directions
            ]
        return step

    def add(self, step: Array) -> None:
        """Remember a step that was taken."""
        self._steps.append(step)
        self._directions.append(step / np.maximum(_dot(step, step), _NO_STEP))


def broyden(
    function: Callable[..., Array],
    first: Array,
    scale: Array,
    longest_step: float = math.inf,
    restricted: Callable[[NDArray[np.intp]], Callable[..., Array]] | None = None,
) -> Array:
    """Solve x = function(*x) at n points.

    Args:
        function: takes the unknowns, each of shape (..., n), and returns their next values stacked.
        first: where to start, shape (unknowns, ..., n).
        scale: typical size of each unknown, broadcasts to `first`.
        longest_step: longest change of an unknown in one step, in scales.
        restricted: returns the function at some of the points, given by their index; None
            evaluates it at all points until the last one is solved.

    Returns:
        The solutions, shape as `first`; NaN where the iteration does not settle.
    """
    scales = np.broadcast_to(scale, first.shape)
    solution = np.empty_like(first)
    unsolved = np.arange(first.shape[-1])
    unknown = first / scales
    for _ in range(_ROUNDS):
        unknown, residual = _iterated(function, unknown, scales, longest_step)
        settled = (np.abs(residual) <= _SETTLED).all(axis=0)
        solution[..., unsolved] = np.where(settled, unknown * scales, np.nan)
        if not (np.abs(residual) > _TOLERANCE).any():
            break
        is_open = (np.abs(residual) > _EXACT).reshape(-1, len(unsolved)).any(axis=0)
        if restricted is not None and not is_open.all():
            # Most points are solved by then, and a few take many times as long.
            unsolved = unsolved[is_open]
            function = restricted(unsolved)
            unknown = unknown[..., is_open]
            scales = scales[..., is_open]
    return solution


def _iterated(
    function: Callable[..., Array], unknown: Array, scale: Array, longest_step: float
) -> tuple[Array, Array]:
    """Make steps until all points are solved, at most as many as are remembered.

    Returns:
        The unknowns, in scales, and the residual before the last step.
    """
    steps = _Steps()
    for _ in range(_MEMORY):
        residual = function(*(unknown * scale)) / scale - unknown
        step = steps.bent(residual)
        if longest_step < math.inf:
            length = np.abs(step).max(axis=0) / longest_step
            step = step / np.maximum(1.0, length)
        unknown = unknown + step
        if not (np.abs(residual) > _TOLERANCE).any():
            break
        steps.add(step)
    return unknown, residual


def _dot(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("k...,k...->...", first, second))
