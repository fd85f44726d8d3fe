# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The working space of a campaign: boxes in which a gap is looked for, and smooth functions.

Places have shape (axes, n); every axis counts by the extent of the campaign along it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]

_LEAST_SAMPLES = 4
_SAMPLES_PER_LEAST = 8
_BAND_EDGES = 21  # edges per axis for bands along one axis
_CORNER_EDGES = 6  # edges per axis for boxes over two and three axes


@dataclass(frozen=True, eq=False)
class Regions:
    """Boxes over the samples.

    Attributes:
        members: which samples each box holds, shape (boxes, n).
        low, high: limits of each box by axis, shape (boxes, axes).
    """

    members: NDArray[np.bool_]
    low: Array
    high: Array

    def __len__(self) -> int:
        return len(self.members)


def regions(place: Array) -> Regions:
    """Bands along each axis, and corners over two and more axes, with at least four samples each.

    Below 32 samples an eighth of them is enough, down to one.

    Edges lie midway between neighbouring samples, so a region is as narrow as the data allow.
    Regions that hold the same samples are listed once; the narrower in extent stands for them.
    """
    extent = [(float(values.min()), float(values.max())) for values in place]
    bands = [_intervals(_edges(values, _BAND_EDGES)) for values in place]
    # A corner is one-sided on each axis: high load at low speed, and so on.
    sides = [[pair for pair in _intervals(edges) if pair[0] == edges[0] or pair[1] == edges[-1]]
             for edges in (_edges(values, _CORNER_EDGES) for values in place)]
    boxes: list[tuple[tuple[float, float], ...]] = []
    for size in range(1, len(place) + 1):
        for axes in itertools.combinations(range(len(place)), size):
            own = bands if size == 1 else sides
            boxes += itertools.product(*(own[axis] if axis in axes else [limits]
                                         for axis, limits in enumerate(extent)))
    limits = np.array(boxes).reshape(-1, len(place), 2)
    low, high = limits[..., 0], limits[..., 1]
    members = np.ones((len(limits), place.shape[1]), dtype=bool)
    for axis, values in enumerate(place):
        members &= (values >= low[:, axis, None]) & (values <= high[:, axis, None])
    n, inside = place.shape[1], members.sum(axis=1)
    least = max(1, min(_LEAST_SAMPLES, n // _SAMPLES_PER_LEAST))
    first: dict[bytes, int] = {}
    for i in np.flatnonzero((inside >= least) & (inside <= n - least)).tolist():
        first.setdefault(members[i].tobytes(), i)
    kept = list(first.values())
    return Regions(members[kept], low[kept], high[kept])


def _edges(values: Array, most: int) -> Array:
    distinct = np.unique(values)
    if len(distinct) < 2:
        return np.array([])
    middles = (distinct[1:] + distinct[:-1]) / 2.0
    if len(middles) > most:
        # Evenly in samples, so that every band can hold enough of them.
        wanted = np.quantile(values, np.linspace(0.0, 1.0, most + 2)[1:-1])
        nearest = np.searchsorted(middles, wanted).clip(0, len(middles) - 1)
        middles = middles[np.unique(nearest)]
    return np.concatenate([[distinct[0]], middles, [distinct[-1]]])


def _intervals(edges: Array) -> list[tuple[float, float]]:
    pairs = itertools.combinations(range(len(edges)), 2)
    return [(float(edges[i]), float(edges[j])) for i, j in pairs
            if not (i == 0 and j == len(edges) - 1)]


def scaled_to_extent(place: Array, within: Array | None = None) -> Array:
    """Places scaled to -1 .. 1 by the extent of a campaign (their own), same shape; none beyond."""
    within = place if within is None else within
    low, high = within.min(axis=1, keepdims=True), within.max(axis=1, keepdims=True)
    return np.asarray((2.0 * (place - low) / np.maximum(high - low, 1e-12) - 1.0).clip(-1.0, 1.0))


def smooth_functions(
    place: Array, degree: int, within: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Products of Legendre polynomials up to a total degree.

    Args:
        place: where, shape (axes, n).
        degree: the highest.
        within: the places of the campaign by which each axis is scaled, those above if None.

    Returns:
        Values of shape (n, m), each of mean square about 1, and the degree of each, shape (m,).
        The constant comes first.
    """
    scaled = scaled_to_extent(place, within)
    powers = sorted((p for p in itertools.product(range(degree + 1), repeat=len(place))
                     if sum(p) <= degree), key=sum)
    # Along each axis, by order; the factor makes the mean square one.
    along = [[np.sqrt(2.0 * order + 1.0) * legendre.Legendre.basis(order)(values)
              for order in range(degree + 1)] for values in scaled]
    columns = [np.prod([along[axis][order] for axis, order in enumerate(power)], axis=0)
               for power in powers]
    return np.stack(columns, axis=1), np.array([sum(power) for power in powers])
