# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The readings of a bench, channel by channel, and what is known of their noise."""

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
    MAX_SAMPLES,
    MIN_REPLICATE_NOISE,
    PRIOR_DOF_ASSUMED,
    PRIOR_DOF_ASSUMED_SMALL,
    PRIOR_DOF_STATED,
    PRIOR_DOF_STATED_SMALL,
    RECORDED_DEGREE,
    REPLICATE_TOLERANCE,
    REPLICATES_NEEDED,
    SMALL_CAMPAIGN,
    SMOOTH_DEGREE,
    TIE_TOLERANCE,
)
from .system import Array, Axis, Channel, Points

REPEATED_POINTS = "repeated points"
"""Source of a noise that repeated points show."""
SESSION = "session"
"""Key of `Observations.points` under which the sessions of the samples are numbered."""


@dataclass(frozen=True)
class SharedError:
    """An error that readings share, as those of one session share the zero of a meter.

    Attributes:
        name: what is off, in words.
        session: name of the session whose readings share it; empty where all do.
        deviation: prior standard deviation, in its unit.
        unit: of the error.
    """

    name: str
    session: str
    deviation: float
    unit: str


@dataclass(frozen=True, eq=False)
class Observations:
    """Channels read at n operating points.

    Attributes:
        axes: of the points.
        points: values by the name of the axis, shape (n,) each; under `SESSION` the number of
            the session from 0, -1 for none, where the campaign has several. No prediction depends
            on the session.
        channels: those read; the gap is measured in the first.
        measured: readings, each channel in its unit, shape (channels, n).
        deviation: standard deviations stated or assumed, same shape and units.
        prior_dof: prior degrees of freedom of `deviation`: how many samples its statement is
            worth against the residuals, shape (channels,).
        samples: the system's record of the samples, with a length, `source` (for messages) and
            `select(index)`.
        number: row of each sample in the data as given, from 0, shape (n,).
        noise_source: where the noise of the first channel comes from, in words.
        assumed: whether that noise is assumed rather than stated.
        shared_errors: change of each reading by one standard deviation of each error that
            readings share, as those of one session do, shape (channels, n, m), in the units of the
            channels; None where readings share none.
        shared_names: what these errors are, m of them.
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
    shared_errors: Array | None = None
    shared_names: tuple[SharedError, ...] = ()

    def __len__(self) -> int:
        return len(self.number)

    @property
    def steered(self) -> tuple[Axis, ...]:
        """The axes that a test can set."""
        return tuple(axis for axis in self.axes if axis.steered)

    @property
    def coordinates(self) -> Array:
        """Values along the steered axes, shape (axes, n)."""
        return self.coordinates_of(self.points)

    def coordinates_of(self, points: Points) -> Array:
        """Return the values of any points along the steered axes, shape (axes, n)."""
        return np.stack([points[axis.name] for axis in self.steered])

    def is_inside(self, coordinates: Array) -> NDArray[np.bool_]:
        """Return which points lie in the range of the campaign along all steered axes.

        Args:
            coordinates: shape (axes, n).

        Returns:
            Shape (n,).
        """
        low = self.coordinates.min(axis=1, keepdims=True)
        high = self.coordinates.max(axis=1, keepdims=True)
        margin = _equality(self.coordinates)
        inside = (coordinates >= low - margin) & (coordinates <= high + margin)
        return np.asarray(inside.all(axis=0))

    @cached_property
    def smooth(self) -> SmoothFunctions:
        """Functions that are smooth over every axis along which the campaign varies."""
        varying = []
        for axis in self.axes:
            if axis.steered or np.ptp(self.points[axis.name]) > axis.tolerance:
                varying.append(axis)
        return SmoothFunctions(tuple(varying), self.points)

    @cached_property
    def unit_discrepancy(self) -> Array:
        """Change of each reading by one unit of discrepancy in one channel, in deviations.

        A relative discrepancy changes its channel, and the first one, by a part of the reading.
        Shape (channels with the discrepancy, channels read, n).
        """
        relative = np.array([channel.relative for channel in self.channels])
        unit = np.where(relative[:, None], self.measured, 1.0)
        change = np.eye(len(relative))[..., None] * unit
        change[relative, 0] = self.measured[0]
        return np.asarray(change / self.deviation)

    @property
    def shared_count(self) -> int:
        """Number of errors that readings share."""
        return 0 if self.shared_errors is None else self.shared_errors.shape[-1]

    @cached_property
    def shared_columns(self) -> Array:
        """Shared errors in deviations of the readings, shape (channels, n, m)."""
        if self.shared_errors is None:
            return np.zeros((*self.measured.shape, 0))
        return np.asarray(self.shared_errors / self.deviation[..., None])

    @property
    def stated_noise(self) -> float:
        """Root mean square of the noise stated or assumed for the first channel."""
        return float(np.sqrt(np.mean(self.deviation[0] ** 2)))

    def select(self, index: NDArray[np.intp]) -> Observations:
        """Return the samples of an index, with the same noise."""
        shared_errors = self.shared_errors
        if shared_errors is not None:
            shared_errors = shared_errors[:, index]
        return replace(
            self,
            points={name: row[index] for name, row in self.points.items()},
            measured=self.measured[:, index],
            deviation=self.deviation[:, index],
            samples=self.samples.select(index),
            number=self.number[index],
            shared_errors=shared_errors,
        )

    def without(self, index: NDArray[np.intp]) -> Observations:
        """Return all samples but those of an index."""
        return self.select(np.setdiff1d(np.arange(len(self)), index))

    def with_stated_noise(self, noise: float) -> Observations:
        """Return the observations with a stated noise of the first channel.

        Args:
            noise: standard deviation, in the unit of the channel.
        """
        first, first_dof, _ = noise_statement(
            self.channels[0], self.measured[0], noise, None, (), {}
        )
        return replace(
            self,
            deviation=np.vstack([first, self.deviation[1:]]),
            prior_dof=np.append(first_dof, self.prior_dof[1:]),
            noise_source="given",
            assumed=False,
        )

    def describe(self, i: int) -> str:
        """Return one sample by its row in the file, or its number, and its operating point."""
        parts = []
        for axis in self.steered:
            value = self.points[axis.name][i]
            part = f"{axis.name.replace('_', ' ')} {value:.4g} {axis.unit}"
            parts.append(part.removesuffix(" -"))
        rows = getattr(self.samples, "rows", ())
        name = f"row {rows[i]}" if rows else f"sample {self.number[i] + 1}"
        return f"{name} ({', '.join(parts)})"


def noise_statement(
    channel: Channel,
    measured: Array,
    given: float | None,
    column: Array | None,
    axes: Sequence[Axis],
    points: Points,
) -> tuple[Array, float, str | None]:
    """Return the noise of a channel: given, by sample, from repeated points, or assumed.

    Args:
        channel: what was read.
        measured: readings, shape (n,).
        given: one standard deviation for all samples.
        column: standard deviations of every sample, shape (n,).
        axes: of the operating points.
        points: the operating points.

    Returns:
        The standard deviations, shape (n,); their prior degrees of freedom; and the source of the
        statement, None where `channel.uncertainty` is assumed.
    """
    n = len(measured)
    if given is not None:
        return np.full(n, given), _stated_prior_dof(n), "given"
    if column is not None:
        return column, _stated_prior_dof(n), f"column {channel.name}_std"
    repeats = pure_error(replicate_groups(axes, points), measured)
    if repeats is not None:
        deviation, degrees_of_freedom = repeats
        prior_dof = _stated_prior_dof(n, degrees_of_freedom)
        return np.full(n, deviation), prior_dof, REPEATED_POINTS
    return channel.deviation(measured), assumed_prior_dof(n), None


def _stated_prior_dof(samples: int, prior_dof: float = PRIOR_DOF_STATED) -> float:
    """Return the prior degrees of freedom of a stated noise in a campaign of so many samples."""
    if samples < SMALL_CAMPAIGN:
        # So few samples cannot correct a statement, so it gets more weight.
        return max(prior_dof, PRIOR_DOF_STATED_SMALL)
    return prior_dof


def assumed_prior_dof(samples: int) -> float:
    """Return the prior degrees of freedom of an assumed noise in a campaign of so many samples."""
    if samples < SMALL_CAMPAIGN:
        return PRIOR_DOF_ASSUMED_SMALL
    return PRIOR_DOF_ASSUMED


def pure_error(group: NDArray[np.intp], measured: Array) -> tuple[float, float] | None:
    """Return the noise that repeated points show (pure error of an analysis of variance).

    Args:
        group: number of the operating point of each sample, from `replicate_groups`, shape (n,).
        measured: one channel, shape (n,).

    Returns:
        The pooled standard deviation and its degrees of freedom; None where there are too few
        repeats, or where they are copies of one reading.
    """
    count = np.bincount(group)
    degrees_of_freedom = float(np.sum(count - 1))
    if degrees_of_freedom < REPLICATES_NEEDED:
        return None
    mean = np.bincount(group, measured) / count
    squares = np.sum((measured - mean[group]) ** 2)
    deviation = float(np.sqrt(squares / degrees_of_freedom))
    # Readings that agree better than any bench are copies, or placeholders in a plan.
    if deviation <= MIN_REPLICATE_NOISE * np.abs(measured).max():
        return None
    return deviation, degrees_of_freedom


def replicate_groups(axes: Sequence[Axis], points: Points) -> NDArray[np.intp]:
    """Number the distinct operating points in their order along the axes.

    Repeated points share a number. No two points of one number are further apart than one
    tolerance, so a slow sweep, in which every sample is close to the next, stays many points.

    Args:
        axes: of the points.
        points: values by the name of the axis, shape (n,) each.

    Returns:
        The number of each point, from 0, shape (n,).
    """
    from scipy.cluster.hierarchy import fclusterdata

    rows = []
    for axis in axes:
        values = points[axis.name]
        tolerance = max(REPLICATE_TOLERANCE * float(np.ptp(values)), axis.tolerance)
        rows.append(values / tolerance)
    scaled = np.stack(rows, axis=1)
    if 1 < len(scaled) <= MAX_SAMPLES:
        label = fclusterdata(
            scaled, 1.0, "distance", metric="chebyshev", method="complete"
        )
    else:
        # Clustering needs all pairs of points. A lattice of one tolerance needs none.
        label = np.unique(np.round(scaled), axis=0, return_inverse=True)[1].ravel()
    order = order_of(np.stack([points[axis.name] for axis in axes]))
    return _renumbered(label, order)


def _renumbered(label: NDArray[np.intp], order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Renumber labels by where each first appears in an order, shape (n,)."""
    _, first, group = np.unique(label[order], return_index=True, return_inverse=True)
    rank_of_group = np.argsort(np.argsort(first))
    number = np.empty(len(label), dtype=np.intp)
    number[order] = rank_of_group[group]
    return number


def order_of(coordinates: Array, further: Array | None = None) -> NDArray[np.intp]:
    """Return the indices that sort points along their axes, the last digits left out.

    Args:
        coordinates: shape (axes, n); the first axis counts most.
        further: readings that sort repeated points, shape (channels, n), the last one first.

    Returns:
        Shape (n,).
    """
    keys = [*tie_free(coordinates)[::-1]]
    if further is not None:
        keys = [*further, *keys]
    return np.lexsort(keys)


def tie_free(coordinates: Array, within: Array | None = None) -> Array:
    """Return scaled coordinates without their last digits, which then decide no tie.

    Args:
        coordinates: shape (axes, n).
        within: as of `scaled_to_extent`.

    Returns:
        As of `scaled_to_extent`, in steps of `TIE_TOLERANCE`.
    """
    scaled = scaled_to_extent(coordinates, within)
    return np.asarray(np.round(scaled / TIE_TOLERANCE) * TIE_TOLERANCE)


def scaled_to_extent(coordinates: Array, within: Array | None = None) -> Array:
    """Return coordinates scaled to -1 ... 1 by the extent of a campaign, clipped beyond it.

    Args:
        coordinates: shape (axes, n).
        within: coordinates of the campaign, shape (axes, m); the same ones if None.

    Returns:
        Shape (axes, n).
    """
    campaign = coordinates if within is None else within
    low = campaign.min(axis=1, keepdims=True)
    high = campaign.max(axis=1, keepdims=True)
    tolerance = _equality(campaign)
    has_extent = high - low > tolerance
    scaled = 2.0 * (coordinates - low) / np.where(has_extent, high - low, 1.0) - 1.0
    beyond = np.where(coordinates > high + tolerance, 1.0, -1.0)
    return np.where(has_extent, scaled, beyond).clip(-1.0, 1.0)


def _equality(coordinates: Array) -> Array:
    """Return the difference up to which coordinates along each axis are equal, shape (axes, 1)."""
    largest = np.abs(coordinates).max(axis=1, keepdims=True)
    return np.asarray(TIE_TOLERANCE * largest)


@dataclass(frozen=True, eq=False)
class SmoothFunctions:
    """Products of Legendre polynomials over the extent of a campaign, the constant first.

    Their total degree is at most `SMOOTH_DEGREE` over the axes that a test sets, and at most
    `RECORDED_DEGREE` where an axis that is only recorded takes part.

    Attributes:
        axes: along which the functions vary.
        campaign: operating points whose extent scales each axis.
    """

    axes: tuple[Axis, ...]
    campaign: Points

    @cached_property
    def powers(self) -> NDArray[np.intp]:
        """Degree of each function along each axis, shape (m, axes)."""
        recorded = np.array([not axis.steered for axis in self.axes])
        kept = []
        for powers in itertools.product(
            range(SMOOTH_DEGREE + 1), repeat=len(self.axes)
        ):
            most = SMOOTH_DEGREE
            if np.any(np.array(powers)[recorded]):
                most = RECORDED_DEGREE
            if sum(powers) <= most:
                kept.append(powers)
        kept.sort(key=sum)
        return np.array(kept)

    @property
    def degree(self) -> NDArray[np.intp]:
        """Total degree of each function, shape (m,)."""
        return np.asarray(self.powers.sum(axis=1))

    @property
    def family(self) -> NDArray[np.intp]:
        """Family of each function, whose coefficients have one amplitude, shape (m,).

        0 for the constant, 1 + i for functions of axis i alone, 1 + axes for products.
        """
        involved = self.powers > 0
        of_one_axis = 1 + involved.argmax(axis=1)
        family = np.where(involved.sum(axis=1) > 1, 1 + len(self.axes), of_one_axis)
        return np.where(self.degree == 0, 0, family)

    def at(self, points: Points) -> Array:
        """Return the functions at operating points, each of mean square about 1, shape (n, m)."""
        within = np.stack([self.campaign[axis.name] for axis in self.axes])
        where = np.stack([points[axis.name] for axis in self.axes])
        scaled = scaled_to_extent(where, within)
        # P_k has mean square 1 / (2 k + 1) over -1 ... 1.
        norms = np.sqrt(2.0 * np.arange(SMOOTH_DEGREE + 1) + 1.0)
        along_axis = norms * legendre.legvander(scaled, SMOOTH_DEGREE)
        values = np.ones((where.shape[1], len(self.powers)))
        for axis, of_axis in enumerate(along_axis):
            values *= of_axis[:, self.powers[:, axis]]
        return values

    @cached_property
    def at_campaign(self) -> Array:
        """The functions at the points of the campaign, shape (n, m)."""
        return self.at(self.campaign)
