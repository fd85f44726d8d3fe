# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Large campaigns: samples at neighbouring operating points become one point, their mean.

What is averaged is the difference from the refitted model, and a smooth field of what is left is
taken along to the mean point, so that neither bends the mean. The mean of m samples is sqrt(m)
times as exact as one, and the scatter of neighbours tells the noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import LARGE, REPEATED, Gathered, Observations, Reading, filled_in
from .regions import smooth_functions

Array = NDArray[np.float64]

_DEGREE = 3
_FINER = 1.05  # a lattice than the one before
_LOCAL = 20  # samples in a group over which what is left is a plane, at least


def condensed(base: Fit) -> Observations:
    """Return the means over cells of neighbouring samples.

    Args:
        base: the refit without any effect to the samples.
    """
    observed, n = base.observed, len(base.observed)
    cell = neighbourhoods(observed, LARGE)
    points = _mean_points(base, cell)
    both = {name: np.concatenate([row, points[name]]) for name, row in observed.points.items()}
    predicted = observed.read(base.hypothesis.predict(base.theta, both))
    smooth, _ = smooth_functions(np.stack(list(both.values())), _DEGREE)
    readings, shifts = [], []
    for reading, foretold in zip(observed.readings, predicted, strict=True):
        deviation, apart = reading.deviation, reading.measured - foretold[:n]
        field = smooth @ np.linalg.lstsq(smooth[:n] / deviation[:, None], apart / deviation)[0]
        rest, total = apart - field[:n], np.bincount(cell, deviation**-2.0).astype(float)
        shifts.append(field[n:] + np.bincount(cell, rest * deviation**-2.0) / total)
        factor, trust = _noise(reading, rest, smooth[:n, :len(both) + 1],
                               neighbourhoods(observed, min(LARGE, n // _LOCAL)))
        if factor == 0.0:  # copies are no more exact than one of them
            factor, total = 1.0, total / np.bincount(cell)
        readings.append(Reading(reading.channel, foretold[n:] + shifts[-1],
                                factor / np.sqrt(total), trust))
    first = observed.readings[0].measured - predicted[0, :n]
    return replace(observed, points=points, readings=tuple(readings),
                   number=np.arange(len(shifts[0])),
                   gathered=Gathered(observed, cell, first - shifts[0][cell]))


def _mean_points(base: Fit, cell: NDArray[np.intp]) -> dict[str, Array]:
    """The mean of each cell, or one of its samples if the model has no answer there."""
    observed, first = base.observed, np.unique(cell, return_index=True)[1]
    weight = observed.readings[0].deviation ** -2.0
    points = {name: (np.bincount(cell, row * weight) / np.bincount(cell, weight)).clip(
        row.min(), row.max()) for name, row in observed.points.items()}
    refused = np.isnan(base.hypothesis.predict(base.theta, points)).any(axis=0)
    return {name: np.where(refused, observed.points[name][first], row)
            for name, row in points.items()}


def _noise(
    reading: Reading, rest: Array, plane: Array, group: NDArray[np.intp]
) -> tuple[float, float]:
    """Deviation in stated ones, and what that is worth: the scatter about a plane in each group.

    Zero where readings are copies.

    Args:
        reading: what states one.
        rest: of the samples, shape (n,).
        plane: functions of the place up to degree one, shape (n, axes + 1).
        group: of each sample, shape (n,).
    """
    squares = free = 0.0
    order, ends = np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))
    for members in np.split(order, ends[:-1]):
        own = plane[members] / reading.deviation[members, None]
        target = rest[members] / reading.deviation[members]
        at, _, rank, _ = np.linalg.lstsq(own, target)
        squares += float(np.sum((target - own @ at) ** 2))
        free += len(members) - int(rank)
    factor = float(np.sqrt(squares / max(free, 1.0)))
    if filled_in(factor * float(reading.deviation.mean()), reading.measured):
        return 0.0, reading.trust
    # Scatter that stated the noise already counts once.
    return (factor, free) if free >= reading.trust else (1.0, reading.trust)


def neighbourhoods(observed: Observations, most: int) -> NDArray[np.intp]:
    """Number the cells of the samples, shape (n,): of the finest lattice with at most so many.

    Every axis counts by the range of the campaign; samples that repeat a point stay together.
    """
    rows = [observed.points[axis.name] for axis in observed.axes]
    place = np.stack([(row - row.min()) / max(float(np.ptp(row)), axis.held / REPEATED)
                      for row, axis in zip(rows, observed.axes, strict=True)], axis=1)
    cell, parts = np.zeros(len(place), dtype=np.intp), 2.0
    while parts < 0.5 / REPEATED:
        code = (place * parts).astype(int) @ (int(parts) + 1) ** np.arange(place.shape[1])
        finer = np.unique(code, return_inverse=True)[1]
        if finer.max() >= most:
            break
        cell, parts = finer, _FINER * parts
    return cell
