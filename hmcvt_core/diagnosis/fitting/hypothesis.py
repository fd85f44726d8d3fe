# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A hypothesis: the base model with some effects, their sizes free.

Its parameters are theta: the scaled base parameters; then the errors that readings share, in
standard deviations; then of every effect its size, in typical sizes, and its shapes if they are
free, as parts of their range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..settings import SHAPE_PRIOR_MEAN, SHAPE_PRIOR_SPREAD
from ..system import Array, Case, Channel, Effect, Points, System


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A system and effects whose sizes are free.

    Attributes:
        system: on the bench.
        effects: with the shapes to use where they are not free.
        reversed_sign: whether sizes that cannot be negative are negative. This stands for a gap
            that no listed effect causes.
        free_shapes: of how many effects, from the first, the shapes are free too.
        shared_count: number of errors that the readings share.
    """

    system: System
    effects: tuple[Effect, ...] = ()
    reversed_sign: bool = False
    free_shapes: int = 0
    shared_count: int = 0

    @property
    def base_count(self) -> int:
        """Number of base parameters and shared errors, which come first in theta."""
        return len(self.system.base) + self.shared_count

    @property
    def shared(self) -> slice:
        """Where theta holds the shared errors."""
        return slice(len(self.system.base), self.base_count)

    @cached_property
    def free_parameters(self) -> list[tuple[int, Any]]:
        """Index of the effect, and its parameter, for each theta after the base parameters."""
        free: list[tuple[int, Any]] = []
        for i, effect in enumerate(self.effects):
            free.append((i, effect.sizes()[0]))
            if i < self.free_shapes:
                free += [(i, item) for item in effect.parameters() if item.bends]
        return free

    @cached_property
    def size_indices(self) -> NDArray[np.intp]:
        """Indices of the sizes in theta, one for each effect."""
        is_size = [item.is_size for _, item in self.free_parameters]
        return self.base_count + np.flatnonzero(is_size)

    @cached_property
    def prior_mean(self) -> Array:
        """Prior mean of theta, shape (p,); that of a size is zero."""
        means = []
        for _, item in self.free_parameters:
            means.append(0.0 if item.is_size else SHAPE_PRIOR_MEAN)
        of_base = np.append(self.system.base.mean, np.zeros(self.shared_count))
        return np.append(of_base, means)

    @cached_property
    def base_spread(self) -> Array:
        """Prior standard deviations of the base parameters and the shared errors."""
        return np.append(self.system.base.spread, np.ones(self.shared_count))

    def spread(self, sizes: Array | float) -> Array:
        """Return prior standard deviations of theta, shape (p,).

        Args:
            sizes: prior standard deviations of the sizes, in typical sizes.
        """
        shapes = np.full(len(self.free_parameters), SHAPE_PRIOR_SPREAD)
        spread = np.append(self.base_spread, shapes)
        spread[self.size_indices] = sizes
        return spread

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta, shape (p,) each."""
        unbounded = [np.inf] * self.shared_count
        lowest = [*self.system.base.low.tolist(), *(-limit for limit in unbounded)]
        highest = [*self.system.base.high.tolist(), *unbounded]
        for _, item in self.free_parameters:
            low = _scaled(item, item.low)
            high = _scaled(item, item.high)
            if self.reversed_sign and item.is_size:
                lowest.append(-high)
                highest.append(-max(low, 0.0))
            else:
                lowest.append(low)
                highest.append(high)
        return np.array(lowest), np.array(highest)

    @cached_property
    def signs(self) -> Array:
        """Sign that each theta must have, shape (p,).

        1 or -1 for a size of one sign, 0 for a size of either sign, NaN for what is not a size.
        """
        low, high = self.bounds
        signs = np.full(len(low), np.nan)
        for i in self.size_indices:
            if low[i] >= 0.0:
                signs[i] = 1.0
            elif high[i] <= 0.0:
                signs[i] = -1.0
            else:
                signs[i] = 0.0
        return signs

    def effects_at(self, theta: Array) -> tuple[Effect, ...]:
        """Return the effects with the sizes and shapes of theta."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        of_effects = theta[self.base_count :].tolist()
        for (i, item), scaled in zip(self.free_parameters, of_effects, strict=True):
            values[i][item.name] = _value(item, scaled)
        return tuple(
            effect.with_values(changes)
            for effect, changes in zip(self.effects, values, strict=True)
        )

    def theta(self, base: Array) -> Array:
        """Return theta for base parameters and shared errors, and the effects as given."""
        scaled = []
        for i, item in self.free_parameters:
            scaled.append(_scaled(item, self.effects[i].values()[item.name]))
        return np.append(base, scaled)

    def case(self, theta: Array) -> Case:
        """Return the base parameters of theta, and the effects with its values."""
        return theta[: len(self.system.base)], self.effects_at(theta)

    def predict(
        self, theta: Array, points: Points, channels: Sequence[Channel] = ()
    ) -> Array:
        """Return predicted readings, in the units of the channels, shape (channels, n).

        Args:
            theta: parameters, shape (p,).
            points: operating points.
            channels: to return; every channel of the system if empty.
        """
        base, effects = self.case(theta)
        predicted = self.system.predict(base, effects, points)
        if not channels:
            return predicted
        return np.asarray(predicted[self.rows_of(channels)])

    def rows_of(self, channels: Sequence[Channel]) -> list[int]:
        """Return the indices of channels among all channels of the system."""
        names = [channel.name for channel in self.system.channels]
        return [names.index(channel.name) for channel in channels]

    def local_variation(
        self,
        theta: Array,
        points: Points,
        channels: Sequence[Channel],
        predicted: Array,
    ) -> Array:
        """Return how far readings bend or jump within `Axis.transition_width` of their points.

        The mean of the readings on both sides less the reading: a linear change cancels.
        Served channels barely vary there, so their stated noise is kept.

        Args:
            theta: parameters, shape (p,).
            points: operating points.
            channels: whose readings they are.
            predicted: readings at the points, shape (channels, n).

        Returns:
            In the units of the channels, shape (channels, n).
        """
        variation = np.zeros_like(predicted)
        for axis in self.system.axes:
            if not axis.transition_width:
                continue
            values = points[axis.name]
            below = {**points, axis.name: values - axis.transition_width}
            above = {**points, axis.name: values + axis.transition_width}
            around = self.predict(theta, below, channels)
            around = around + self.predict(theta, above, channels)
            # fmax prefers a number to NaN.
            variation = np.fmax(variation, np.abs(around / 2.0 - predicted))
        variation[[channel.served for channel in channels]] = 0.0
        return variation


def _scaled(item: Any, value: float) -> float:
    """Return a size in typical sizes, or a shape as a part of its range.

    The range of a positive shape is divided in proportion (logarithmically).
    """
    if item.is_size:
        return float(value / item.typical)
    if item.low > 0.0:
        return math.log(value / item.low) / math.log(item.high / item.low)
    return float((value - item.low) / (item.high - item.low))


def _value(item: Any, scaled: float) -> float:
    """Return the value of a scaled parameter; rounding keeps a shape within its range."""
    if item.is_size:
        return float(scaled * item.typical)
    if item.low > 0.0:
        value = item.low * (item.high / item.low) ** scaled
    else:
        value = item.low + scaled * (item.high - item.low)
    return float(min(max(value, item.low), item.high))
