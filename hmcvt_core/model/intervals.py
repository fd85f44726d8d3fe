# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Intervals that standard errors stand for."""

from __future__ import annotations

from functools import lru_cache

from ..errors import InputError
from ..transmission.quantities import Range

LEVEL = 0.9
"""Level of intervals in reports and JSON."""
MIN_DEGREES = 1.0
"""Of freedom: one sample more than parameters."""


_LEVEL_RANGE = Range("level", 0.0, 1.0, "-", "a fraction, not percent")


def half_width(degrees_of_freedom: float | None, level: float = LEVEL) -> float:
    """Return half the width of an interval in standard errors.

    Args:
        degrees_of_freedom: of the scatter (Student's t); None for normal errors.
        level: probability that the interval holds the truth, above 0 and below 1.

    Raises:
        InputError: the level is not one number between 0 and 1.
    """
    fraction = _LEVEL_RANGE.check(level)
    if fraction.ndim or not 0.0 < fraction < 1.0:
        raise InputError(f"level = {level!r}: needs a fraction above 0 and below 1")
    return _quantile(degrees_of_freedom, 0.5 + 0.5 * float(fraction))


@lru_cache(maxsize=64)
def _quantile(degrees_of_freedom: float | None, probability: float) -> float:
    """Return the quantile of Student's t; of the normal distribution for None."""
    # Imported where used: it takes a tenth of a second.
    from scipy.special import ndtri, stdtrit

    if degrees_of_freedom is None:
        return float(ndtri(probability))
    return float(stdtrit(degrees_of_freedom, probability))
