# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Intervals that standard errors stand for."""

from __future__ import annotations

from functools import lru_cache

from ..errors import InputError

LEVEL = 0.9
"""Level of intervals in reports and JSON."""
MIN_DEGREES = 1.0
"""Of freedom: one sample more than parameters."""


@lru_cache(maxsize=64)
def half_width(degrees_of_freedom: float | None, level: float = LEVEL) -> float:
    """Return half the width of an interval in standard errors.

    Args:
        degrees_of_freedom: of the scatter (Student's t); None for normal errors.
        level: probability that the interval holds the truth, above 0 and below 1.

    Raises:
        InputError: the level is not between 0 and 1.
    """
    # Imported where used: it takes a tenth of a second.
    from scipy.special import ndtri, stdtrit

    if not 0.0 < level < 1.0:
        raise InputError(f"level = {level!r}: needs a fraction above 0 and below 1")
    upper = 0.5 + 0.5 * level
    if degrees_of_freedom is None:
        return float(ndtri(upper))
    return float(stdtrit(degrees_of_freedom, upper))
