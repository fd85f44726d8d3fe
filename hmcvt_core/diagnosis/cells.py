# SPDX-License-Identifier: Apache-2.0
"""Large campaigns: samples at neighbouring operating points become one point, their mean.

What is averaged is the difference from the refitted model, and a smooth field of what is left is
taken along to the mean point: neither bends the mean. The mean of m samples is sqrt(m) times as
exact as one, and their scatter about it tells the noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import REPEATED, Gathered, Observations, Reading, filled_in
from .regions import smooth_functions

Array = NDArray[np.float64]

LARGE = 1000
"""Most samples that are weighed one by one, and most cells."""

_FIELD_DEGREE = 3


def condensed(base: Fit) -> Observations:
    """Return the means over cells of neighbouring samples.

    Args:
        base: the refit without any effect to the samples.
    """
    observed, n = base.observed, len(base.observed)
    cell = neighbourhoods(observed)
    points = _points(base, cell)
    both = {name: np.concatenate([row, points[name]]) for name, row in observed.points.items()}
    predicted = base.hypothesis.predict(base.theta, both)
    smooth, _ = smooth_functions(np.stack(list(both.values())), _FIELD_DEGREE)
    readings, shifts = [], []
    for reading, foretold in zip(observed.readings, predicted, strict=False):
        deviation, apart = reading.deviation, reading.measured - foretold[:n]
        field = smooth @ np.linalg.lstsq(smooth[:n] / deviation[:, None], apart / deviation)[0]
        rest, total = apart - field[:n], np.bincount(cell, deviation**-2.0)
        mean = np.bincount(cell, rest * deviation**-2.0) / total
        shifts.append(field[n:] + mean)
        readings.append(_mean_reading(reading, foretold[n:] + shifts[-1], 1.0 / np.sqrt(total),
                                      (rest - mean[cell]) / deviation))
    first = observed.readings[0].measured - predicted[0, :n]
    return replace(observed, points=points, readings=tuple(readings), number=np.arange(len(mean)),
                   gathered=Gathered(observed, cell, first - shifts[0][cell]))


def _mean_reading(reading: Reading, measured: Array, deviation: Array, scatter: Array) -> Reading:
    """One reading of the cells; `scatter` of the samples in them is in deviations, shape (n,)."""
    trust, free = reading.trust, float(len(scatter) - len(measured))
    pooled = np.sqrt(np.sum(scatter**2) / max(free, 1.0))
    # The scatter may have stated the noise before: it counts once.
    if free > trust and not filled_in(float(pooled * reading.deviation.mean()), reading.measured):
        deviation, trust = pooled * deviation, free
    return Reading(reading.channel, measured, deviation, trust)


def _points(base: Fit, cell: NDArray[np.intp]) -> dict[str, Array]:
    """Mean operating points, or the sample that is nearest where the model has no answer there."""
    observed = base.observed
    weight = observed.readings[0].deviation ** -2.0
    points = {name: (np.bincount(cell, row * weight) / np.bincount(cell, weight)).clip(
        row.min(), row.max()) for name, row in observed.points.items()}
    answers = base.hypothesis.predict(base.theta, points)
    for i in np.flatnonzero(np.isnan(answers).any(axis=0)).tolist():
        members = np.flatnonzero(cell == i)
        away = sum(((row[members] - points[name][i]) / max(float(np.ptp(row)), 1e-12)) ** 2
                   for name, row in observed.points.items())
        for name, row in observed.points.items():
            points[name][i] = row[members[np.argmin(away)]]
    return points


def neighbourhoods(observed: Observations, most: int = LARGE) -> NDArray[np.intp]:
    """Number the cells of the samples, shape (n,): the widest is halved until there are enough.

    Every axis counts by the range of the campaign; samples that repeat a point stay together.
    """
    rows = np.stack([observed.points[axis.name] for axis in observed.axes], axis=1)
    extent = np.maximum(np.ptp(rows, axis=0), 1e-12)
    scaled = (rows - rows.min(axis=0)) / extent
    least = np.maximum(REPEATED, np.array([axis.held for axis in observed.axes]) / extent)

    def widths(index: NDArray[np.intp]) -> Array:
        wide = np.ptp(scaled[index], axis=0)
        return np.where(wide > least, wide, 0.0)

    cells = [np.arange(len(scaled))]
    width = [float(widths(cells[0]).max())]
    while len(cells) < most and max(width) > 0.0:
        at = int(np.argmax(width))
        index = cells[at]
        along = scaled[index, widths(index).argmax()]
        above = along > (along.min() + along.max()) / 2.0
        cells[at:at + 1] = index[~above], index[above]
        width[at:at + 1] = [float(widths(part).max()) for part in cells[at:at + 2]]
    cell = np.empty(len(scaled), dtype=np.intp)
    for i, index in enumerate(cells):
        cell[index] = i
    return cell
