# SPDX-License-Identifier: Apache-2.0
"""Samples that fit neither the model nor their neighbours: slips of the bench, not a gap.

A gap has neighbours: points close by share it. A slip stands alone. A sample is called an outlier
when its residual lies far from the median of its nearest neighbours', measured by how far samples
usually lie; and only if such samples are few, because many together are a narrow gap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .basis import scaled_axes
from .observations import FEW, Observations

Array = NDArray[np.float64]
_NEIGHBOURS = 6
_FAR = 5.0
_MOST = 0.03  # part of the samples
_MAD_TO_DEVIATION = 1.4826
_LARGE = 2000  # beyond, single samples decide nothing and neighbours get costly


def outliers(observed: Observations, whitened: Array) -> NDArray[np.intp]:
    """Return the indices of outliers, usually none.

    Args:
        observed: the bench.
        whitened: residuals of the refitted base model, shape (channels, n).
    """
    n = whitened.shape[1]
    if not FEW <= n <= _LARGE:
        return np.array([], dtype=np.intp)
    axes = scaled_axes(observed.samples).T
    distance = np.sum((axes[:, None] - axes[None, :]) ** 2, axis=2)
    nearest = np.argsort(distance, axis=1)[:, 1:_NEIGHBOURS + 1]
    flagged = np.zeros(n, dtype=bool)
    for row in whitened:
        apart = row - np.median(row[nearest], axis=1)
        usual = _MAD_TO_DEVIATION * np.median(np.abs(apart - np.median(apart)))
        far = np.abs(apart) > _FAR * max(float(usual), 1e-12)
        if far.sum() <= max(1.0, _MOST * n):
            flagged |= far
    return np.flatnonzero(flagged)
