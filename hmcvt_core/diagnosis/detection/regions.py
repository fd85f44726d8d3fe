# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Regions: boxes over the samples, and the fewest boxes that hold given samples."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..observations import Observations
from ..settings import (
    BAND_EDGES,
    CORNER_EDGES,
    REGION_GAIN,
    REGION_SAMPLES,
    SAMPLES_PER_REGION_SAMPLE,
    TIE_TOLERANCE,
)
from ..system import Array

Interval = tuple[float, float]
"""Lower and upper limit along one axis."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Boxes over the samples.

    Attributes:
        members: which samples each box holds, shape (boxes, n).
        low: lower limits of each box by axis, shape (boxes, axes).
        high: upper limits of each box by axis, shape (boxes, axes).
    """

    members: NDArray[np.bool_]
    low: Array
    high: Array

    def __len__(self) -> int:
        return len(self.members)


def candidate_regions(coordinates: Array) -> Regions:
    """Return bands along each axis, and corners over two and more axes.

    A corner is one-sided on each axis: high load at low speed, and so on. Edges lie midway between
    neighbouring samples, so a region is as narrow as the data allow. Regions that hold the same
    samples are listed once, as the one limited along the fewest axes. A region holds at least four
    samples, and leaves out as many; below 32 samples an eighth of them is enough, down to one.

    Args:
        coordinates: of the samples, shape (axes, n).
    """
    limits = np.array(_boxes(coordinates)).reshape(-1, len(coordinates), 2)
    low = limits[..., 0]
    high = limits[..., 1]
    n = coordinates.shape[1]
    members = np.ones((len(limits), n), dtype=bool)
    for axis, values in enumerate(coordinates):
        members &= (values >= low[:, axis, None]) & (values <= high[:, axis, None])
    kept = _distinct_regions(members)
    return Regions(members[kept], low[kept], high[kept])


def _boxes(coordinates: Array) -> list[tuple[Interval, ...]]:
    """Return the limits of all candidate boxes along all axes."""
    extent = []
    bands = []
    sides = []
    for values in coordinates:
        extent.append((float(values.min()), float(values.max())))
        bands.append(_intervals(_edges(values, BAND_EDGES)))
        sides.append(_one_sided_intervals(_edges(values, CORNER_EDGES)))
    boxes: list[tuple[Interval, ...]] = []
    axes = range(len(coordinates))
    for size in range(1, len(coordinates) + 1):
        intervals = bands if size == 1 else sides
        for limited in itertools.combinations(axes, size):
            choices = []
            for axis in axes:
                choices.append(intervals[axis] if axis in limited else [extent[axis]])
            boxes += itertools.product(*choices)
    return boxes


def _distinct_regions(members: NDArray[np.bool_]) -> list[int]:
    """Return the indices of regions that hold enough samples, the first of those alike."""
    n = members.shape[1]
    least = _least_samples(n)
    inside = members.sum(axis=1)
    large_enough = (inside >= least) & (inside <= n - least)
    first: dict[bytes, int] = {}
    for i in np.flatnonzero(large_enough).tolist():
        first.setdefault(members[i].tobytes(), i)
    return list(first.values())


def _least_samples(n: int) -> int:
    """Return how many samples of a campaign of n a region holds at least."""
    return max(1, min(REGION_SAMPLES, n // SAMPLES_PER_REGION_SAMPLE))


def _edges(values: Array, most: int) -> Array:
    """Return possible limits along one axis: its ends, and points midway between samples.

    Args:
        values: of the samples along the axis, shape (n,).
        most: number of points between the ends.
    """
    distinct = np.unique(values)
    tolerance = TIE_TOLERANCE * float(np.abs(values).max())
    is_step = np.diff(distinct) > tolerance
    if not is_step.any():
        return np.array([])
    middles = ((distinct[1:] + distinct[:-1]) / 2.0)[is_step]
    if len(middles) > most:
        # Evenly in samples, so that every band can hold enough of them.
        wanted = np.quantile(values, np.linspace(0.0, 1.0, most + 2)[1:-1])
        wanted -= tolerance
        nearest = np.searchsorted(middles, wanted).clip(0, len(middles) - 1)
        middles = middles[np.unique(nearest)]
    return np.concatenate([[distinct[0]], middles, [distinct[-1]]])


def _intervals(edges: Array) -> list[Interval]:
    """Return the intervals between any two edges, the whole range left out."""
    last = len(edges) - 1
    intervals = []
    for i, j in itertools.combinations(range(len(edges)), 2):
        if (i, j) != (0, last):
            intervals.append((float(edges[i]), float(edges[j])))
    return intervals


def _one_sided_intervals(edges: Array) -> list[Interval]:
    """Return the intervals that begin or end with the range."""
    one_sided = []
    for low, high in _intervals(edges):
        if low == edges[0] or high == edges[-1]:
            one_sided.append((low, high))
    return one_sided


# --- the boxes that summarise a set of samples ----------------------------------------------


@dataclass(frozen=True, eq=False)
class Settings:
    """Labelled axes that are only recorded, as the stage; a box may be limited to one label.

    Attributes:
        members: samples with each label, shape (labels, n).
        names: axis and label, one for each row of `members`.
    """

    members: NDArray[np.bool_]
    names: tuple[tuple[str, str], ...]

    @classmethod
    def of(cls, observed: Observations) -> Settings:
        """Return the labels between which the samples of a campaign differ."""
        rows = []
        names = []
        for axis in observed.axes:
            values = np.unique(observed.points[axis.name])
            if not axis.labels or len(values) < 2:
                continue
            for value in values:
                rows.append(observed.points[axis.name] == value)
                names.append((axis.name, axis.labels[int(value)]))
        members = np.array(rows, dtype=bool).reshape(len(rows), len(observed))
        return cls(members, tuple(names))


@dataclass(frozen=True, eq=False)
class Box:
    """One box.

    Attributes:
        limits: low and high along each axis, shape (axes, 2).
        members: which samples it holds, shape (n,).
        setting: label along an axis that has labels, if the box is limited to one.
    """

    limits: Array
    members: NDArray[np.bool_]
    setting: dict[str, str] = field(default_factory=dict)


def covering_boxes(
    coordinates: Array,
    candidates: Regions,
    target: NDArray[np.bool_],
    most: int,
    settings: Settings,
) -> list[Box]:
    """Return the fewest boxes whose union is closest to a target, by the F1 score.

    The limits of the boxes that `covering` chooses are then moved, one axis of one box after
    another, and boxes are limited to one setting, while the score grows.

    Args:
        coordinates: of the samples, shape (axes, n).
        candidates: boxes to begin with.
        target: the samples to hold, shape (n,).
        most: number of boxes.
        settings: to which a box may be limited.
    """
    members = np.concatenate([candidates.members, settings.members])
    extent = np.stack([coordinates.min(axis=1), coordinates.max(axis=1)], axis=1)
    fitted = []
    for i in covering(members, target, most):
        if i < len(candidates):
            limits = np.stack([candidates.low[i], candidates.high[i]], axis=1)
            fitted.append(Box(limits, members[i]))
        else:
            name, label = settings.names[i - len(candidates)]
            fitted.append(Box(extent, members[i], {name: label}))
    score = -1.0
    while fitted and _score(fitted, target) > score:
        score = _score(fitted, target)
        for i, box in enumerate(fitted):
            others = fitted[:i] + fitted[i + 1 :]
            fitted[i] = _moved(box, others, coordinates, target, settings)
    return fitted


def _score(boxes: Sequence[Box], target: NDArray[np.bool_]) -> float:
    union = np.any([box.members for box in boxes], axis=0)
    return float(_f1(union[None], target)[0])


def _moved(
    box: Box,
    others: Sequence[Box],
    coordinates: Array,
    target: NDArray[np.bool_],
    settings: Settings,
) -> Box:
    """Return a box with the limits along one axis, or the setting, that raise the score most.

    Arguments as of `covering_boxes`; `others` stay as they are.
    """
    held = np.zeros_like(target)
    for other in others:
        held |= other.members
    best = box
    best_score = _score([box, *others], target)
    for choices in _choices(box, coordinates, settings):
        members = np.stack([choice.members for choice in choices])
        scores = _f1(members | held, target)
        scores[members.sum(axis=1) < _least_samples(len(target))] = -1.0
        if scores.max() > best_score:
            best = choices[int(scores.argmax())]
            best_score = float(scores.max())
    return best


def _choices(box: Box, coordinates: Array, settings: Settings) -> list[list[Box]]:
    """Return boxes that differ from one along a single axis, or by their setting."""
    inside = (coordinates >= box.limits[:, :1]) & (coordinates <= box.limits[:, 1:])
    of_setting = np.ones(coordinates.shape[1], dtype=bool)
    for members, (name, label) in zip(settings.members, settings.names, strict=True):
        if box.setting.get(name) == label:
            of_setting = members
    choices = []
    for axis, values in enumerate(coordinates):
        elsewhere = np.all(np.delete(inside, axis, axis=0), axis=0) & of_setting
        choices.append(_along_axis(box, axis, values, elsewhere))
    if settings.names:
        along_axes = np.all(inside, axis=0)
        of_settings = [Box(box.limits, along_axes)]
        for members, (name, label) in zip(
            settings.members, settings.names, strict=True
        ):
            of_settings.append(Box(box.limits, along_axes & members, {name: label}))
        choices.append(of_settings)
    return [boxes for boxes in choices if boxes]


def _along_axis(
    box: Box, axis: int, values: Array, elsewhere: NDArray[np.bool_]
) -> list[Box]:
    """Return boxes that differ from one along an axis.

    Args:
        box: the one.
        axis: index of the axis.
        values: of the samples along it, shape (n,).
        elsewhere: which samples are inside along the other axes, shape (n,).
    """
    boxes = []
    for low, high in itertools.combinations(_edges(values, BAND_EDGES).tolist(), 2):
        limits = box.limits.copy()
        limits[axis] = (low, high)
        members = elsewhere & (values >= low) & (values <= high)
        boxes.append(Box(limits, members, box.setting))
    return boxes


def covering(
    members: NDArray[np.bool_], target: NDArray[np.bool_], most: int
) -> list[int]:
    """Return the fewest regions whose union is closest to a target, by the F1 score.

    Regions are added one by one while each adds enough. With each that is added the others are
    exchanged while that is better.

    Args:
        members: which samples each region holds, shape (regions, n).
        target: the samples to hold, shape (n,).
        most: number of regions.

    Returns:
        Indices of the regions.
    """
    chosen: list[int] = []
    reached = 0.0
    for _ in range(most):
        extended, score = _exchanged(members, target, chosen, reached)
        if score < reached + REGION_GAIN:
            break
        chosen = extended
        reached = score
    return chosen


def _exchanged(
    members: NDArray[np.bool_],
    target: NDArray[np.bool_],
    chosen: Sequence[int],
    reached: float,
) -> tuple[list[int], float]:
    """Add one region, then exchange regions in turn while the F1 score grows.

    Args:
        members: which samples each region holds, shape (regions, n).
        target: the samples to hold, shape (n,).
        chosen: regions so far.
        reached: their score, which is to be passed.

    Returns:
        The regions and their score.
    """
    regions = [*chosen, 0]
    last = len(regions) - 1
    best = reached
    previous = -1.0
    while best > previous:
        previous = best
        for position in (last, *range(last)):
            others = regions[:position] + regions[position + 1 :]
            union = members | members[others].any(axis=0)
            score = _f1(union, target)
            if score.max() > best:
                regions[position] = int(score.argmax())
                best = float(score.max())
    return regions, best


def _f1(held: NDArray[np.bool_], target: NDArray[np.bool_]) -> Array:
    """Return the F1 score of sets of samples, shape (sets,).

    Args:
        held: shape (sets, n).
        target: shape (n,).
    """
    both = (held & target).sum(axis=1)
    return np.asarray(2.0 * both / (held.sum(axis=1) + target.sum()))
