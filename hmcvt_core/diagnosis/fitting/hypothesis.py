# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A hypothesis: the base model with some effects, their sizes free.

Parameters are theta: scaled base parameters, then of every effect its size, in typical ones, and
its shapes where they are free, as parts of their range.
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
from ..system import Array, Channel, Effect, Points, System


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A system and effects whose sizes are free.

    Attributes:
        system: what stands on the bench.
        effects: with the shapes to use; what is free of them is fitted.
        reversed_sign: whether sizes that cannot be negative are negative: effects that nobody listed.
        bent: of how many effects, from the first, the shapes are free too.
    """

    system: System
    effects: tuple[Effect, ...] = ()
    reversed_sign: bool = False
    free_shapes: int = 0

    @property
    def base_count(self) -> int:
        """How many parameters every hypothesis has."""
        return len(self.system.base)

    @cached_property
    def free_parameters(self) -> list[tuple[int, Any]]:
        """Which effect, and which parameter of it, each theta after the shared ones is."""
        return [
            (i, item)
            for i, effect in enumerate(self.effects)
            for item in (
                effect.sizes()[0],
                *(
                    other
                    for other in effect.parameters()
                    if i < self.free_shapes and other.bends
                ),
            )
        ]

    @cached_property
    def size_indices(self) -> NDArray[np.intp]:
        """Places of the sizes in theta, one for each effect."""
        return self.base_count + np.flatnonzero(
            [item.is_size for _, item in self.free_parameters]
        )

    @property
    def prior_mean(self) -> Array:
        """Mean of theta; sizes are free and have zero."""
        return np.append(
            self.system.base.mean,
            [
                0.0 if item.is_size else SHAPE_PRIOR_MEAN
                for _, item in self.free_parameters
            ],
        )

    def spread(self, sizes: Array | float) -> Array:
        """Prior standard deviations of theta, for those of the sizes."""
        found = np.append(
            self.system.base.spread,
            np.full(len(self.free_parameters), SHAPE_PRIOR_SPREAD),
        )
        found[self.size_indices] = sizes
        return found

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest theta."""
        base, ends = self.system.base, []
        for _, item in self.free_parameters:
            low, high = _scaled(item, item.low), _scaled(item, item.high)
            ends.append(
                (-high, -max(low, 0.0))
                if self.reversed_sign and item.is_size
                else (low, high)
            )
        lowest, highest = np.array(ends).reshape(-1, 2).T
        return np.append(base.low, lowest), np.append(base.high, highest)

    @property
    def signs(self) -> Array:
        """1 or -1 for sizes of one sign only, 0 for the others, NaN for what is none, (p,)."""
        low, high = (end[self.size_indices] for end in self.bounds)
        one = np.full(self.base_count + len(self.free_parameters), np.nan)
        one[self.size_indices] = np.where(
            low >= 0.0, 1.0, np.where(high <= 0.0, -1.0, 0.0)
        )
        return one

    def effects_at(self, theta: Array) -> tuple[Effect, ...]:
        """Return the effects as they are at theta."""
        values: list[dict[str, float]] = [{} for _ in self.effects]
        for (i, item), value in zip(
            self.free_parameters, theta[self.base_count :].tolist(), strict=True
        ):
            values[i][item.name] = _value(item, value)
        return tuple(
            effect.with_values(each)
            for effect, each in zip(self.effects, values, strict=True)
        )

    def theta(self, base: Array) -> Array:
        """Return where the effects are as they stand, for scaled base parameters."""
        return np.append(
            base,
            [
                _scaled(item, self.effects[i].values()[item.name])
                for i, item in self.free_parameters
            ],
        )

    def predict(
        self, theta: Array, points: Points, channels: Sequence[Channel] = ()
    ) -> Array:
        """Return some channels, or every one, shape (channels, n)."""
        found = self.system.predict(
            theta[: self.base_count], self.effects_at(theta), points
        )
        names = [channel.name for channel in self.system.channels]
        return (
            found[[names.index(channel.name) for channel in channels]]
            if channels
            else found
        )

    def local_variation(
        self, theta: Array, points: Points, channels: Sequence[Channel], here: Array
    ) -> Array:
        """How far readings, `here`, turn within `Axis.transition_width` of points, in their units.

        What is served hardly does, and what is stated of its noise stands. Shape (channels, n).
        """
        found = np.zeros_like(here)
        for axis in (axis for axis in self.system.axes if axis.transition_width):
            around = sum(
                self.predict(theta, {**points, axis.name: place}, channels)
                for place in points[axis.name]
                + axis.transition_width * np.array([[-1.0], [1.0]])
            )
            found = np.fmax(
                found, np.abs(around / 2.0 - here)
            )  # of NaN and a number, the number
        found[[channel.served for channel in channels]] = 0.0
        return found


def _scaled(item: Any, value: float) -> float:
    """A size in typical ones; a shape as the part of its range, in proportion where it can be."""
    if item.is_size:
        return value / item.typical
    if item.low > 0.0:
        return math.log(value / item.low) / math.log(item.high / item.low)
    return (value - item.low) / (item.high - item.low)


def _value(item: Any, scaled: float) -> float:
    """What `_scaled` gives back; a shape stays in its range, however it is rounded."""
    if item.is_size:
        return scaled * item.typical
    found = (
        item.low * (item.high / item.low) ** scaled
        if item.low > 0.0
        else (item.low + scaled * (item.high - item.low))
    )
    return min(max(found, item.low), item.high)
