# SPDX-License-Identifier: Apache-2.0
"""Robust z scores: which transmissions stand apart from their fleet.

.. math:: z = (x - median) / (1.4826 MAD)

1.4826 makes the median absolute deviation that of a normal distribution. |z| > 3.5 counts as an
outlier (Iglewicz and Hoaglin, How to Detect and Handle Outliers, 1993). Median and MAD hold while
less than half of the fleet is odd; mean and standard deviation would follow the odd ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

THRESHOLD = 3.5
LEAST_LOGS = 8
"""Below as many values a median absolute deviation is itself a matter of chance."""

_MAD_TO_DEVIATION = 1.4826
_LEAST_DEVIATION = 1e-6  # of the largest value: less is rounding, not scatter


class Scores(NamedTuple):
    """Where each value stands.

    Attributes:
        median: of the values.
        deviation: 1.4826 MAD, in the unit of the values; in decades with `logarithmic`.
        logarithmic: whether the logarithms (base 10) were compared.
        z: shape (n,); NaN for all when the values are too few or at least half of them equal.
    """

    median: float
    deviation: float
    logarithmic: bool
    z: Array


def robust_scores(values: Sequence[float], logarithmic: bool = False) -> Scores:
    """Compare values with their median.

    Args:
        values: n finite numbers, at least one; positive with `logarithmic`.
        logarithmic: for a quantity that spans decades.
    """
    x = np.log10(values) if logarithmic else np.asarray(values, dtype=float)
    median = float(np.median(x))
    deviation = _MAD_TO_DEVIATION * float(np.median(np.abs(x - median)))
    enough = len(x) >= LEAST_LOGS and deviation > _LEAST_DEVIATION * float(np.abs(x).max())
    z = (x - median) / deviation if enough else np.full(len(x), np.nan)
    return Scores(10.0 ** median if logarithmic else median, deviation, logarithmic, z)
