# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the bench measured, channel by channel, with what is known of its noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .regions import smooth_functions
from .system import Axis, Channel, Points

Array = NDArray[np.float64]

FEW = 16
"""Below this many samples scatter has no shape to be judged by; only its size is left."""

LARGE = 1000
"""Most samples that are weighed."""

REPEATED = 0.002
"""Samples so close in every axis repeat one point; a part of the range of the axis."""

SMOOTH_DEGREE = 3
"""Of what counts as smooth over the working space of a campaign."""

TRUST_STATED, TRUST_ASSUMED = 8.0, 1.0
"""How many samples a statement of the noise is worth, and how many an assumption."""

_TRUST_FEW = 30.0
# Nobody stated the noise: weak enough that a bench twice as noisy raises no alarm at the size of
# its scatter, strong enough that one six times as noisy does.
_TRUST_FEW_ASSUMED = 3.0
_LEAST_PART = 1e-5  # of the largest reading
_REPLICATES_NEEDED = 5


@dataclass(frozen=True, eq=False)
class Reading:
    """One channel as it was read.

    Attributes:
        channel: what it is.
        measured: shape (n,), in its unit.
        deviation: standard deviation stated or assumed, shape (n,), same unit.
        trust: how many samples the statement of `deviation` is worth; the data tell the rest.
    """

    channel: Channel
    measured: Array
    deviation: Array
    trust: float

    @property
    def unit_loss(self) -> Array:
        """One unit of an unlisted loss, in deviations, shape (n,)."""
        return (self.measured if self.channel.relative else 1.0) / self.deviation


@dataclass(frozen=True, eq=False)
class Observations:
    """Channels at n operating points.

    Attributes:
        axes: of the points.
        points: values by axis.
        readings: of some of the channels.
        samples: the system's own record, with a length, `source` (for messages) and
            `select(index)`.
        number: of each sample in what was handed in, shape (n,).
        noise_source: where the noise of the first channel comes from, in words.
        assumed: whether nobody stated it.
        channels: all that the system predicts, in its order; empty where all of them are read.
    """

    axes: tuple[Axis, ...]
    points: Points
    readings: tuple[Reading, ...]
    samples: Any
    number: NDArray[np.intp]
    noise_source: str
    assumed: bool = False
    channels: tuple[Channel, ...] = ()

    def __len__(self) -> int:
        return len(self.number)

    @property
    def place(self) -> Array:
        """Values along the axes that a test can set, shape (axes, n)."""
        return np.stack([self.points[axis.name] for axis in self.steered])

    @cached_property
    def smooth(self) -> tuple[Array, NDArray[np.intp]]:
        """`smooth_functions` of the place, up to the third degree."""
        return smooth_functions(self.place, SMOOTH_DEGREE)

    @property
    def steered(self) -> tuple[Axis, ...]:
        """The axes of `place`."""
        return tuple(axis for axis in self.axes if axis.steered)

    @property
    def scale(self) -> Array:
        """Deviations, shape (channels, n)."""
        return np.stack([reading.deviation for reading in self.readings])

    @property
    def trusts(self) -> Array:
        """Worth of the stated noise, shape (channels,)."""
        return np.array([reading.trust for reading in self.readings])

    @property
    def usual_noise(self) -> float:
        """Root of the mean square of the noise stated of the first channel."""
        return float(np.sqrt(np.mean(self.readings[0].deviation ** 2)))

    def whiten(self, predicted: Array) -> Array:
        """(Measured - predicted) / deviation, (channels read, n), of every channel predicted."""
        return np.stack([(reading.measured - row) / reading.deviation
                         for reading, row in zip(self.readings, self.read(predicted), strict=True)])

    def read(self, predicted: Array) -> Array:
        """The rows of what is predicted, (channels, ...), that are read."""
        names = [channel.name for channel in self.channels]
        return predicted[[names.index(item.channel.name) for item in self.readings]] if names \
            else predicted[:len(self.readings)]

    def select(self, index: NDArray[np.intp]) -> Observations:
        """Return a subset of samples, with the same noise."""
        readings = tuple(replace(reading, measured=reading.measured[index],
                                 deviation=reading.deviation[index]) for reading in self.readings)
        return replace(self, points={name: row[index] for name, row in self.points.items()},
                       readings=readings, samples=self.samples.select(index),
                       number=self.number[index])

    def stating(self, noise: float) -> Observations:
        """Return the same as if somebody had stated the noise of the first channel."""
        first, *others = self.readings
        stated, _ = reading_of(first.channel, first.measured, noise, None, (), {})
        return replace(self, readings=(stated, *others), noise_source="given", assumed=False)

    def describe(self, i: int) -> str:
        """Return one sample by number and operating point."""
        place = ", ".join(f"{axis.name.replace('_', ' ')} {self.points[axis.name][i]:.4g} "
                          f"{axis.unit}".removesuffix(" -") for axis in self.steered)
        return f"sample {self.number[i] + 1} ({place})"


def reading_of(
    channel: Channel, measured: Array, given: float | None, column: Array | None,
    axes: Sequence[Axis], points: Points,
) -> tuple[Reading, str | None]:
    """Return a reading with its noise as it is stated: given, by sample, or by repeated points.

    Args:
        channel, measured: what was read, shape (n,).
        given: one standard deviation for all.
        column: those of every sample, shape (n,).
        axes, points: where.

    Returns:
        The reading, and who states its noise; None where nobody does and `channel.uncertainty`
        stands in.
    """
    n, trust, source = len(measured), TRUST_STATED, None
    if given is not None:
        deviation, source = np.full(n, given), "given"
    elif column is not None:
        deviation, source = column, f"column {channel.name}_std"
    elif (pure := pure_error(replicate_groups(axes, points), measured)) is not None:
        deviation, trust, source = np.full(n, pure[0]), pure[1], "repeated points"
    else:
        deviation, trust = channel.deviation(measured), TRUST_ASSUMED
    if n < FEW:  # so few cannot correct a statement: it has to be believed
        trust = max(trust, _TRUST_FEW_ASSUMED if source is None else _TRUST_FEW)
    return Reading(channel, measured, deviation, trust), source


def pure_error(group: NDArray[np.intp], measured: Array) -> tuple[float, float] | None:
    """Noise that repeated points show: standard deviation and degrees of freedom; None if few.

    Args:
        group: as `replicate_groups` gives it.
        measured: one channel, shape (n,).
    """
    count = np.bincount(group)
    free = float(np.sum(count - 1))
    if free < _REPLICATES_NEEDED:
        return None
    mean = np.bincount(group, measured) / count
    deviation = float(np.sqrt(np.sum((measured - mean[group]) ** 2) / free))
    # Readings that agree better than any bench are filled in, as in a plan, or copied.
    return None if deviation <= _LEAST_PART * np.abs(measured).max() else (deviation, free)


def replicate_groups(axes: Sequence[Axis], points: Points) -> NDArray[np.intp]:
    """Number the distinct operating points, shape (n,); repeated points share a number.

    The sample with most neighbours gathers them, then the next: a slow sweep, in which every
    sample is close to the next one, falls into pieces instead of becoming one point.
    """
    from scipy.spatial import cKDTree

    # In tolerances: a bench never sets a point twice to the last digit.
    scaled = np.stack([points[axis.name] / max(REPEATED * float(np.ptp(points[axis.name])),
                                               axis.held) for axis in axes], axis=1)
    if len(scaled) > LARGE:  # pairs of neighbours are too many: what a lattice does not part
        return np.unique(np.round(scaled), axis=0, return_inverse=True)[1].ravel()
    near = cKDTree(scaled).query_ball_point(scaled, 1.0, p=np.inf)
    count = np.array([len(indices) for indices in near])
    leader = np.full(len(scaled), -1)
    # Ties by place, so that the order of the rows does not matter.
    for i in np.lexsort((*scaled.T[::-1], -count)):
        if leader[i] < 0:
            members = np.array(near[i])
            leader[members[leader[members] < 0]] = i
    # Numbered by place, as their leaders are.
    rank = np.argsort(np.lexsort(scaled.T[::-1]))
    return np.unique(rank[leader], return_inverse=True)[1]
