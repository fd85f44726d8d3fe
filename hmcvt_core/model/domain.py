# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far a model reaches: the region of its data, a prediction, a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..transmission.ranges import ENGINE_SPEED, POINT_RANGES, RPM, Array

AXES = tuple(axis.name for axis in POINT_RANGES)


@dataclass(frozen=True)
class Domain:
    """A box around the identification data; each entry is (lowest, highest), SI units.

    Raises:
        InputError: an interval is reversed or not finite.
    """

    displacement_ratio: tuple[float, float]
    engine_speed: tuple[float, float]
    load_torque: tuple[float, float]

    def __post_init__(self) -> None:
        for axis in AXES:
            low, high = getattr(self, axis)
            if not (np.isfinite([low, high]).all() and low <= high):
                raise InputError(
                    f"domain.{axis} = [{low}, {high}]: needs two rising numbers"
                )

    @classmethod
    def of(cls, samples: BenchSamples) -> Domain:
        """Return the smallest box that holds the samples."""
        return cls(
            *(
                (
                    float(getattr(samples, axis).min()),
                    float(getattr(samples, axis).max()),
                )
                for axis in AXES
            )
        )

    def contains(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
    ) -> NDArray[np.bool_]:
        """Tell which points, of arrays that broadcast, lie inside."""
        stroke, speed, load = map(
            self.covers, AXES, (displacement_ratio, engine_speed, load_torque)
        )
        return stroke & speed & load

    def covers(self, axis: str, values: ArrayLike) -> NDArray[np.bool_]:
        """Tell which values of one axis lie inside; a rounding error outside counts as inside."""
        low, high = getattr(self, axis)
        slack = 1e-9 * max(abs(low), abs(high), 1.0)
        array = np.asarray(values, dtype=float)
        return (array >= low - slack) & (array <= high + slack)

    def departures(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> list[str]:
        """Say for each axis along which one point lies outside how far the data reach."""
        point = (displacement_ratio, engine_speed, load_torque)
        said = []
        for axis, value in zip(POINT_RANGES, point, strict=True):
            if not self.covers(axis.name, value):
                low, high = getattr(self, axis.name)
                form = (
                    ".9g" if low <= float(f"{value:.4g}") <= high else ".4g"
                )  # just beyond
                unit = "" if axis.unit == "-" else f" {axis.unit}"
                turns = (
                    f" ({low / RPM:.0f} to {high / RPM:.0f} r/min)"
                    if axis == ENGINE_SPEED
                    else ""
                )
                said.append(
                    f"{axis.name} {value:{form}}{unit} is not in {low:{form}} to "
                    f"{high:{form}}{unit}{turns}"
                )
        return said

    def to_mapping(self) -> dict[str, list[float]]:
        """Return axis -> [low, high]."""
        return {axis: list(getattr(self, axis)) for axis in AXES}


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency on a grid.

    Attributes:
        displacement_ratio: axis of shape (a,) [-].
        engine_speed: axis of shape (b,) [rad/s].
        load_torque: axis of shape (c,) [N m].
        efficiency: shape (a, b, c) [-]; NaN where the model has no answer.
        inside_domain: where the data of the identification reach, shape (a, b, c); None if unknown.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    efficiency: Array
    inside_domain: NDArray[np.bool_] | None = None


class Prediction(NamedTuple):
    """What the model says at operating points; floats, or arrays of one shape.

    Attributes:
        efficiency: output power / engine power [-]; NaN where the model has no answer.
        standard_error: from the covariance of the parameters [-]; NaN where none is known.
        inside_domain: whether the point lies in the box of the identification data.
    """

    efficiency: Any
    standard_error: Any
    inside_domain: Any
