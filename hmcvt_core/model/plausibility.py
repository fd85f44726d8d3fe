# SPDX-License-Identifier: Apache-2.0
"""What a gear train rules out: an output speed that no slip explains."""

from __future__ import annotations

import numpy as np

from ..files.bench import BenchSamples
from ..transmission.stage import Stage, speed_ratio

_SLIP = 0.1  # part of the output speed that may be missing or too much before it is told
_ENDS = (0.1, 0.5, 0.9)  # quantiles: a few outliers are no mistake of a column


def output_speed_remark(stage: Stage, samples: BenchSamples) -> str | None:
    """Say that the output speed is not the one of this gear train; None where it may be."""
    if samples.output_speed is None:
        return None
    ratio = speed_ratio(stage, samples.displacement_ratio)
    turning = ratio > _SLIP  # next to standstill slip is all
    if not turning.any():
        return None
    without_slip = samples.engine_speed[turning] * ratio[turning]
    low, middle, high = np.quantile(samples.output_speed[turning] / without_slip, _ENDS)
    if low >= 1.0 - _SLIP and high <= 1.0 + _SLIP:
        return None
    return (f"the output speed is {middle:.2f} times that of gear train and displacement ratio "
            f"({low:.2f} to {high:.2f} in most samples): check its unit and column, the sign of "
            "the displacement ratio, and the transmission")
