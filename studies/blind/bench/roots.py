# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Roots of many scalar functions at once, between brackets."""

from collections.abc import Callable

import numpy as np

from studies.blind.effect import FloatArray

_MAX_STEPS = 200
#: Every so many steps the interval is halved, whatever the secant proposes.
_HALVE_EVERY = 4


def bracketed_root(
    function: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    tolerance: float,
    negligible: float,
) -> FloatArray:
    """Return where rising functions change sign: Illinois method, with halving now and then.

    At a jump through zero the point of the jump is returned.

    Args:
        function: takes and returns arrays of one shape; below 0 at `low`, above 0 at `high`.
        low: lower ends, shape (...).
        high: upper ends, shape (...).
        tolerance: width of an interval that is narrow enough, in units of the argument.
        negligible: value of the function that counts as zero.
    """
    low = np.array(low, dtype=float)
    high = np.array(high, dtype=float)
    at_low = function(low)
    at_high = function(high)
    last_side = np.zeros_like(low)
    root = 0.5 * (low + high)
    for step in range(1, _MAX_STEPS + 1):
        secant = low - at_low * (high - low) / (at_high - at_low)
        usable = np.isfinite(secant) & (secant > low) & (secant < high)
        if step % _HALVE_EVERY == 0:
            usable = np.zeros_like(usable)
        proposal = np.where(usable, secant, 0.5 * (low + high))
        value = function(proposal)
        is_zero = np.abs(value) <= negligible
        root = np.where(high - low > tolerance, proposal, root)
        settled = is_zero | (high - low <= tolerance)
        if np.all(settled):
            break
        side = np.where(value > 0.0, 1.0, -1.0)
        # An end that stays a second time counts half, or the secant creeps.
        stays = side == last_side
        at_low = np.where(side > 0.0, np.where(stays, 0.5 * at_low, at_low), value)
        at_high = np.where(side > 0.0, value, np.where(stays, 0.5 * at_high, at_high))
        low = np.where((side > 0.0) & ~is_zero, low, proposal)
        high = np.where((side < 0.0) & ~is_zero, high, proposal)
        last_side = side
    return root
