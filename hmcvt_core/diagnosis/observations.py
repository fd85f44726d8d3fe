# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the bench measured, channel by channel and where, with what is known of its noise."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from .settings import (
    LEAST_REPLICATE_NOISE,
    MOST_SAMPLES,
    PRIOR_DOF_ASSUMED,
    PRIOR_DOF_ASSUMED_SMALL,
    PRIOR_DOF_STATED,
    PRIOR_DOF_STATED_SMALL,
    REPLICATE_TOLERANCE,
    REPLICATES_NEEDED,
    SMALL_CAMPAIGN,
    SMOOTH_DEGREE,
)
from .system import Array, Axis, Channel, Points


@dataclass(frozen=True, eq=False)
class Observations:
    """Channels read at n operating points.

    Attributes:
        axes: of the points.
        points: values by axis.
        channels: those read, the one in which the gap is measured first.
        measured: shape (channels, n), each in its unit.
        deviation: standard deviations stated or assumed, same shape and units.
        prior_dof: how many samples the statement of `deviation` is worth, shape (channels,); the data
            tell the rest.
        samples: the system's own record, with a length, `source` (for messages) and
            `select(index)`.
        number: of each sample in what was handed in, shape (n,).
        noise_source: where the noise of the first channel comes from, in words.
        assumed: whether nobody stated it.
    """

    axes: tuple[Axis, ...]
    points: Points
    channels: tuple[Channel, ...]
    measured: Array
    deviation: Array
    prior_dof: Array
    samples: Any
    number: NDArray[np.intp]
    noise_source: str
    assumed: bool = False

    def __len__(self) -> int:
        return len(self.number)

    @property
    def steered(self) -> tuple[Axis, ...]:
        """The axes that a test can set."""
        return tuple(axis for axis in self.axes if axis.steered)

    @property
    def coordinates(self) -> Array:
        """Values along them, shape (axes, n)."""
        return np.stack([self.points[axis.name] for axis in self.steered])

    @cached_property
    def smooth(self) -> tuple[Array, NDArray[np.intp]]:
        """`smooth_functions` of the place, up to the third degree."""
        return smooth_functions(self.coordinates, SMOOTH_DEGREE)

    @cached_property
    def unit_discrepancy(self) -> Array:
        """One unit of an unlisted loss in one channel as it shows in each, in deviations.

        Shape (channels, channels, n).
        """
        relative = np.array([[channel.relative] for channel in self.channels])
        found = np.eye(len(relative))[..., None] * np.where(
            relative, self.measured, 1.0
        )
        found[relative[:, 0], 0] = self.measured[0]
        return np.asarray(found / self.deviation)

    @property
    def stated_noise(self) -> float:
        """Root of the mean square of the noise stated of the first channel."""
        return float(np.sqrt(np.mean(self.deviation[0] ** 2)))

    def select(self, index: NDArray[np.intp]) -> Observations:
        """Return a subset of samples, with the same noise."""
        return replace(
            self,
            points={name: row[index] for name, row in self.points.items()},
            measured=self.measured[:, index],
            deviation=self.deviation[:, index],
            samples=self.samples.select(index),
            number=self.number[index],
        )

    def without(self, index: NDArray[np.intp]) -> Observations:
        """Return the other samples."""
        return self.select(np.setdiff1d(np.arange(len(self)), index))

    def with_stated_noise(self, noise: float) -> Observations:
        """Return the same as if somebody had stated the noise of the first channel."""
        first, prior_dof, _ = noise_statement(
            self.channels[0], self.measured[0], noise, None, (), {}
        )
        return replace(
            self,
            deviation=np.vstack([first, self.deviation[1:]]),
            prior_dof=np.append(prior_dof, self.prior_dof[1:]),
            noise_source="given",
            assumed=False,
        )

    def describe(self, i: int) -> str:
        """Return one sample by number and operating point."""
        place = ", ".join(
            f"{axis.name.replace('_', ' ')} {self.points[axis.name][i]:.4g} "
            f"{axis.unit}".removesuffix(" -")
            for axis in self.steered
        )
        return f"sample {self.number[i] + 1} ({place})"


def noise_statement(
    channel: Channel,
    measured: Array,
    given: float | None,
    column: Array | None,
    axes: Sequence[Axis],
    points: Points,
) -> tuple[Array, float, str | None]:
    """Return the noise of a channel as it is stated: given, by sample, or by repeated points.

    Args:
        channel, measured: what was read, shape (n,).
        given: one standard deviation for all.
        column: those of every sample, shape (n,).
        axes, points: where.

    Returns:
        Standard deviations, shape (n,), how many samples that is worth, and who states it; None
        where nobody does and `channel.uncertainty` stands in.
    """
    n, prior_dof, source = len(measured), PRIOR_DOF_STATED, None
    if given is not None:
        deviation, source = np.full(n, given), "given"
    elif column is not None:
        deviation, source = column, f"column {channel.name}_std"
    elif (pure := pure_error(replicate_groups(axes, points), measured)) is not None:
        deviation, prior_dof, source = np.full(n, pure[0]), pure[1], "repeated points"
    else:
        deviation, prior_dof = channel.deviation(measured), PRIOR_DOF_ASSUMED
    if n < SMALL_CAMPAIGN:  # so few cannot correct a statement: it has to be believed
        prior_dof = max(
            prior_dof,
            PRIOR_DOF_ASSUMED_SMALL if source is None else PRIOR_DOF_STATED_SMALL,
        )
    return deviation, prior_dof, source


def pure_error(group: NDArray[np.intp], measured: Array) -> tuple[float, float] | None:
    """Noise that repeated points show: standard deviation and degrees of freedom; None if few.

    Args:
        group: as `replicate_groups` gives it.
        measured: one channel, shape (n,).
    """
    count = np.bincount(group)
    free = float(np.sum(count - 1))
    if free < REPLICATES_NEEDED:
        return None
    mean = np.bincount(group, measured) / count
    deviation = float(np.sqrt(np.sum((measured - mean[group]) ** 2) / free))
    # Readings that agree better than any bench are filled in, as in a plan, or copied.
    return (
        None
        if deviation <= LEAST_REPLICATE_NOISE * np.abs(measured).max()
        else (deviation, free)
    )


def replicate_groups(axes: Sequence[Axis], points: Points) -> NDArray[np.intp]:
    """Number the distinct operating points by their place, shape (n,).

    Repeated points share a number; no two further apart than one tolerance do, so that a slow
    sweep, in which every sample is close to the next one, does not become one point.
    """
    from scipy.cluster.hierarchy import fclusterdata

    # In tolerances: a bench never sets a point twice to the last digit.
    scaled = np.stack(
        [
            points[axis.name]
            / max(
                REPLICATE_TOLERANCE * float(np.ptp(points[axis.name])), axis.tolerance
            )
            for axis in axes
        ],
        axis=1,
    )
    if 1 < len(scaled) <= MOST_SAMPLES:
        label = fclusterdata(
            scaled, 1.0, "distance", metric="chebyshev", method="complete"
        )
    else:  # pairs of neighbours are too many: what a lattice does not part
        label = np.unique(np.round(scaled), axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort(scaled.T[::-1])
    _, first, group = np.unique(label[order], return_index=True, return_inverse=True)
    number = np.empty(len(scaled), dtype=np.intp)
    number[order] = np.argsort(np.argsort(first))[group]
    return number


def scaled_to_extent(place: Array, within: Array | None = None) -> Array:
    """Places scaled to -1 .. 1 by the extent of a campaign (their own), same shape; none beyond."""
    within = place if within is None else within
    low, high = within.min(axis=1, keepdims=True), within.max(axis=1, keepdims=True)
    return np.asarray(
        (2.0 * (place - low) / np.maximum(high - low, 1e-12) - 1.0).clip(-1.0, 1.0)
    )


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
    # Along each axis, by order; the factor makes the mean square one.
    along = np.sqrt(2.0 * np.arange(degree + 1) + 1.0) * legendre.legvander(
        scaled_to_extent(place, within), degree
    )
    powers = sorted(
        (
            p
            for p in itertools.product(range(degree + 1), repeat=len(place))
            if sum(p) <= degree
        ),
        key=sum,
    )
    columns = [
        np.prod([along[axis, :, order] for axis, order in enumerate(power)], axis=0)
        for power in powers
    ]
    return np.stack(columns, axis=1), np.array([sum(power) for power in powers])
