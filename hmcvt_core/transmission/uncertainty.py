# SPDX-License-Identifier: Apache-2.0
"""Measurement uncertainty of a bench, eqs (1)-(3)."""

from __future__ import annotations

import numpy as np

from ..errors import InputError

PAPER_EFFICIENCY_UNCERTAINTY = 0.0112
"""Total relative uncertainty of the paper's efficiency readings, eq. (3) [-]."""


def random_uncertainty(mean: float, standard_deviation: float) -> float:
    """Relative uncertainty from scatter, eq. (1): s(u) / mean.

    Args:
        mean: mean of repeated readings, any unit.
        standard_deviation: their sample standard deviation, same unit.

    Raises:
        InputError: the mean is zero or a value is not finite.
    """
    if not np.isfinite([mean, standard_deviation]).all() or mean == 0.0:
        raise InputError(f"mean = {mean}, standard deviation = {standard_deviation}: "
                         "finite numbers and a mean other than 0 are needed")
    return abs(standard_deviation / mean)


def systematic_uncertainty(largest_error: float) -> float:
    """Uncertainty from the instrument's largest error, uniformly distributed, eq. (2).

    Args:
        largest_error: in the unit (or the fraction) wanted back.
    """
    return float(largest_error / np.sqrt(3.0))


def total_uncertainty(*parts: float) -> float:
    """Root of the sum of squares of independent uncertainties, eq. (3)."""
    return float(np.sqrt(np.sum(np.square(parts))))
