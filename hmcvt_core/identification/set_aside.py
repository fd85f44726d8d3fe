# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Sentences on the samples that a fit sets aside because they disagree with the rest."""

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..transmission.ranges import Array

MOST_SET_ASIDE = 1.0 / 3.0
"""Of the samples; with more no majority is to be trusted."""
_MOST_NAMED = 20


def set_aside_remarks(
    samples: BenchSamples, aside: NDArray[np.intp], expected: Array
) -> list[str]:
    """Name samples that are set aside.

    Args:
        samples: all of them.
        aside: those set aside, from 0.
        expected: efficiency that the rest of the samples predicts at every sample, shape (n,) [-].
    """
    remarks = []
    for i in aside[:_MOST_NAMED]:
        remarks.append(
            f"sample {i + 1} is set aside: it reads {samples.efficiency[i]:.4g}, the rest of "
            f"the samples say {expected[i]:.4g}"
        )
    if len(aside) > _MOST_NAMED:
        remarks.append(
            f"{len(aside) - _MOST_NAMED} more samples are set aside like these"
        )
    return remarks
