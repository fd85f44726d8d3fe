# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Time integration of many small independent systems to their steady states at once.

Linearly implicit Euler whose time step grows as the rates fall (pseudo-transient continuation,
Kelley and Keyes, SIAM J. Numer. Anal. 35 (1998) 508): it follows the transient first and turns
into Newton's method at the end, so the steady state is met to rounding.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from studies.blind.effect import FloatArray

Rates = Callable[[FloatArray], FloatArray]

_TOLERANCE = 1e-10
_FIRST_STEP = 0.02
_LAST_STEP = 1e9
_MAX_STEPS = 40
#: A point whose state exceeds this many times its scale has run away.
_RUN_AWAY = 60.0


def _jacobian(
    rates: Rates, state: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rates (m, n) and their derivatives (n, m, m) by forward differences, in scaled units."""
    size = state.shape[0]
    step = 1e-6 * scale
    stacked = np.repeat(state[:, None, :], size + 1, axis=1)
    for k in range(size):
        stacked[k, k + 1] += step[k]
    values = rates(stacked) / scale[:, None, None]
    slopes = (values[:, 1:] - values[:, :1]) / 1e-6
    return values[:, 0], np.moveaxis(slopes, 2, 0)


def settle(
    rates: Rates, start: FloatArray, scale: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Integrate d(state)/dt = rates(state) until it rests.

    `start` has shape (m, n): m states of n independent points; `rates` takes (m, ..., n) and
    returns the like; `scale` (m,) holds a typical size of each state. Returns the states (m, n)
    and a mask (n,) of the points that rest to 1e-10 of scale on a branch that is stable; the
    others run away (stall).
    """
    state = start.copy()
    size, points = state.shape
    step = np.full(points, _FIRST_STEP)
    before = np.full(points, np.inf)
    identity = np.eye(size)
    for _ in range(_MAX_STEPS):
        value, slopes = _jacobian(rates, state, scale)
        system = identity / step[:, None, None] - slopes
        change = np.linalg.solve(system, value.T[:, :, None])[:, :, 0].T
        state = state + change * scale[:, None]
        rests = (step > 1e3) & (np.max(np.abs(change), axis=0) < _TOLERANCE)
        lost = ~(np.max(np.abs(state) / scale[:, None], axis=0) <= _RUN_AWAY)
        if np.all(rests | lost):
            break
        norm = np.sqrt(np.sum(value * value, axis=0)) + 1e-300
        # The further the rates fell the more the step grows; it shrinks where they rose.
        fallen = before / norm
        growth = np.where(fallen >= 1.0, np.minimum(2.0 * fallen, 50.0), 0.3 * fallen)
        growth = np.where(norm < 1e-6, 50.0, np.maximum(growth, 0.05))
        step = np.clip(step * growth, 1e-4, _LAST_STEP)
        before = norm
    # A saddle or a stick-slip cycle does not return to rest when pushed.
    slopes[~rests] = -identity
    stable = np.max(np.linalg.eigvals(slopes).real, axis=1) < 0.0
    return state, rests & ~lost & stable
