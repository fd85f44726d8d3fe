# SPDX-License-Identifier: Apache-2.0
"""Regions of the working space: boxes between which the gap is looked for."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.domain import AXES

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
        low, high: limits of each box by axis (displacement ratio, speed, torque), (boxes, 3).
    """

    members: NDArray[np.bool_]
    low: Array
    high: Array

    @cached_property
    def columns(self) -> Array:
        """Members as numbers, shape (boxes, n)."""
        return self.members.astype(float)

    def __len__(self) -> int:
        return len(self.members)


def regions(samples: BenchSamples) -> Regions:
    """Bands along each axis, and corners over pairs of axes, with at least four samples each.

    Below 32 samples an eighth of them is enough, down to one.

    Edges lie midway between neighbouring samples, so a region is as narrow as the data allow.
    Regions that hold the same samples are listed once; the narrower in extent stands for them.
    """
    values = [getattr(samples, axis) for axis in AXES]
    boxes: list[dict[int, tuple[float, float]]] = []
    bands = [_intervals(_edges(axis, _BAND_EDGES)) for axis in values]
    for axis in range(3):
        boxes += [{axis: limits} for limits in bands[axis]]
    # A corner is one-sided on each axis: high load at low speed, and so on.
    sides = [_one_sided(_edges(axis, _CORNER_EDGES)) for axis in values]
    for first, second in itertools.combinations(range(3), 2):
        boxes += [{first: a, second: b} for a in sides[first] for b in sides[second]]
    boxes += [{0: a, 1: b, 2: c} for a in sides[0] for b in sides[1] for c in sides[2]]
    return _unique(values, boxes)


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


def _one_sided(edges: Array) -> list[tuple[float, float]]:
    if len(edges) < 3:
        return []
    low, high = float(edges[0]), float(edges[-1])
    return ([(low, float(edge)) for edge in edges[1:-1]]
            + [(float(edge), high) for edge in edges[1:-1]])


def _unique(values: list[Array], boxes: list[dict[int, tuple[float, float]]]) -> Regions:
    least = max(1, min(_LEAST_SAMPLES, len(values[0]) // _SAMPLES_PER_LEAST))
    extent = np.array([[axis.min(), axis.max()] for axis in values])
    seen: dict[bytes, int] = {}
    members: list[NDArray[np.bool_]] = []
    lows: list[list[float]] = []
    highs: list[list[float]] = []
    for box in boxes:
        inside = np.ones(len(values[0]), dtype=bool)
        for axis, (low, high) in box.items():
            inside &= (values[axis] >= low) & (values[axis] <= high)
        count = int(inside.sum())
        if count < least or count > len(inside) - least:
            continue
        key = np.packbits(inside).tobytes()
        if key in seen:
            continue
        seen[key] = len(members)
        members.append(inside)
        lows.append([box[axis][0] if axis in box else extent[axis, 0] for axis in range(3)])
        highs.append([box[axis][1] if axis in box else extent[axis, 1] for axis in range(3)])
    n = len(values[0])
    return Regions(np.array(members, dtype=bool).reshape(-1, n),
                   np.array(lows).reshape(-1, 3), np.array(highs).reshape(-1, 3))
