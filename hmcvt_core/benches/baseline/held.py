# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What all sound machines have in common: smooth remainders over the operating point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...diagnosis.system import Array, Axis, Points
from .remainder import LeftOut, Remainder

FEWEST_CHANGED = 5
"""Fewest samples of a changed machine, as of any diagnosis."""
MIN_RANGE_FRACTION = 0.2
"""Minimum range of an axis for the remainder, as a part of its largest value."""
BEYOND_FRACTION = 0.05
BEYOND_SIZE_FRACTION = 0.01
"""Fractions of range and largest value by which samples may exceed the baseline without a note."""


class HeldMachine:
    """Errors of a sound machine that its remainders show; a part of a `SoundMachine`.

    Attributes:
        remainders: what the fit leaves of each channel.
        remainder_axes: along which the remainders vary, as far as they are read.
    """

    remainders: tuple[Remainder, ...]
    remainder_axes: tuple[Axis, ...]

    def stacked(self, points: Points) -> Array:
        """Return operating points along all axes that are read, shape (n, axes)."""
        return stacked(points, self.remainder_axes)

    def drift_at(self, points: Points, deviation: Array) -> Array:
        """Return the covariance of errors that readings in succession share."""
        covariances = []
        for remainder, noise in zip(self.remainders, deviation, strict=True):
            covariances.append(remainder.drift_covariance(self.stacked(points), noise))
        return np.stack(covariances)

    def left_out_residuals(self) -> list[LeftOut]:
        """Return residuals of each channel at sound samples that are left out."""
        return [remainder.left_out_runs() for remainder in self.remainders]


def stacked(points: Points, axes: Sequence[Axis]) -> Array:
    """Return operating points along those axes that are read, shape (n, axes)."""
    rows = [points[axis.name] for axis in axes if axis.name in points]
    return np.stack(np.broadcast_arrays(*rows), axis=1)


def min_widths(
    points: Points, axes: Sequence[Axis], stated: Mapping[str, float]
) -> Array:
    """Return the least range by which each axis is scaled, shape (axes,).

    A remainder does not change within a small part of the working range, however little of it the
    baseline covers.

    Args:
        points: operating points of the baseline.
        axes: those that are read count.
        stated: least ranges by the names of axes; a part of the largest value of the others.
    """
    widths = []
    for axis in axes:
        if axis.name in points:
            largest = float(np.abs(points[axis.name]).max())
            widths.append(stated.get(axis.name, MIN_RANGE_FRACTION * largest))
    return np.maximum(np.array(widths), 1e-12)


def extrapolation_notes(
    sound: Any, samples: Any, axes: Sequence[str], machine: str
) -> list[str]:
    """Return a note for each axis along which samples go beyond those of the baseline.

    Args:
        sound: samples of the baseline.
        samples: of the changed machine.
        axes: names of their columns.
        machine: in words.
    """
    notes = []
    for name in axes:
        known = getattr(sound, name)
        values = getattr(samples, name)
        size = np.abs(known).max()
        margin = BEYOND_FRACTION * np.ptp(known) + BEYOND_SIZE_FRACTION * size
        beyond = (values < known.min() - margin) | (values > known.max() + margin)
        if beyond.any():
            notes.append(
                f"{int(beyond.sum())} of {len(samples)} samples go beyond the "
                f"{name.replace('_', ' ')} of the baseline, where the sound {machine} is less "
                "certain"
            )
    return notes
