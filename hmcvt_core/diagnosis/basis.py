# SPDX-License-Identifier: Apache-2.0
"""Smooth functions over the working space: Legendre products of low degree."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.domain import AXES

Array = NDArray[np.float64]


def scaled_axes(samples: BenchSamples) -> Array:
    """Operating points scaled to -1 .. 1 by their own extent, shape (3, n)."""
    rows = []
    for axis in AXES:
        values = getattr(samples, axis)
        low, high = values.min(), values.max()
        width = max(high - low, 1e-12)
        rows.append(2.0 * (values - low) / width - 1.0)
    return np.stack(rows)


def smooth_functions(samples: BenchSamples, degree: int) -> tuple[Array, NDArray[np.intp]]:
    """Products of Legendre polynomials up to a total degree.

    Returns:
        Values of shape (n, m), each of mean square about 1, and the degree of each, shape (m,).
        The constant comes first.
    """
    axes = scaled_axes(samples)
    powers = sorted((p for p in itertools.product(range(degree + 1), repeat=3)
                     if sum(p) <= degree), key=sum)
    columns = []
    for power in powers:
        value = np.ones(axes.shape[1])
        for axis, order in zip(axes, power, strict=True):
            weights = np.zeros(order + 1)
            weights[order] = np.sqrt(2.0 * order + 1.0)
            value = value * legendre.legval(axis, weights)
        columns.append(value)
    return np.stack(columns, axis=1), np.array([sum(power) for power in powers])
