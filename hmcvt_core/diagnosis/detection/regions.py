# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Boxes over the samples, and the fewest that hold some of them."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..settings import (
    BAND_EDGES,
    CORNER_EDGES,
    REGION_GAIN,
    REGION_SAMPLES,
    SAMPLES_PER_REGION_SAMPLE,
)
from ..system import Array


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


def candidate_regions(place: Array) -> Regions:
    """Bands along each axis, and corners over two and more axes, with at least four samples each.

    Below 32 samples an eighth of them is enough, down to one.

    Edges lie midway between neighbouring samples, so a region is as narrow as the data allow.
    Regions that hold the same samples are listed once; the narrower in extent stands for them.
    """
    extent = [(float(values.min()), float(values.max())) for values in place]
    bands = [_intervals(_edges(values, BAND_EDGES)) for values in place]
    # A corner is one-sided on each axis: high load at low speed, and so on.
    sides = [
        [
            pair
            for pair in _intervals(edges)
            if pair[0] == edges[0] or pair[1] == edges[-1]
        ]
        for edges in (_edges(values, CORNER_EDGES) for values in place)
    ]
    boxes: list[tuple[tuple[float, float], ...]] = []
    for size in range(1, len(place) + 1):
        for axes in itertools.combinations(range(len(place)), size):
            own = bands if size == 1 else sides
            boxes += itertools.product(
                *(
                    own[axis] if axis in axes else [limits]
                    for axis, limits in enumerate(extent)
                )
            )
    limits = np.array(boxes).reshape(-1, len(place), 2)
    low, high = limits[..., 0], limits[..., 1]
    members = np.ones((len(limits), place.shape[1]), dtype=bool)
    for axis, values in enumerate(place):
        members &= (values >= low[:, axis, None]) & (values <= high[:, axis, None])
    n, inside = place.shape[1], members.sum(axis=1)
    least = max(1, min(REGION_SAMPLES, n // SAMPLES_PER_REGION_SAMPLE))
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
    return [
        (float(edges[i]), float(edges[j]))
        for i, j in pairs
        if not (i == 0 and j == len(edges) - 1)
    ]


def covering(
    members: NDArray[np.bool_], target: NDArray[np.bool_], most: int
) -> list[int]:
    """The fewest regions that hold some points and no others, by F1, one after another.

    With each that is added the others are exchanged while that is better.

    Args:
        members: which points each region holds, shape (regions, n).
        target: the points, shape (n,).
        most: regions.
    """
    chosen, reached = list[int](), 0.0
    for count in range(1, most + 1):
        tried, best, before = [*chosen, 0], reached, -1.0
        while best > before:
            before = best
            for place in (count - 1, *range(count - 1)):
                union = members | members[tried[:place] + tried[place + 1 :]].any(
                    axis=0
                )
                f1 = (
                    2.0
                    * (union & target).sum(axis=1)
                    / (union.sum(axis=1) + target.sum())
                )
                if f1.max() > best:
                    tried[place], best = int(f1.argmax()), float(f1.max())
        if best < reached + REGION_GAIN:
            break
        chosen, reached = tried, best
    return chosen
