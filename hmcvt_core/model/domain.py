# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How far and how surely a model reaches: the region of its data, standard errors, a map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..files.bench import BenchSamples
from ..transmission.mapping import number
from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_RANGES, HydraulicParameters
from ..transmission.ranges import ENGINE_SPEED, POINT_RANGES, RPM, OperatingPoints

Array = NDArray[np.float64]
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
                raise InputError(f"domain.{axis} = [{low}, {high}]: needs two rising numbers")

    @classmethod
    def of(cls, samples: BenchSamples) -> Domain:
        """Return the smallest box that holds the samples."""
        return cls(*((float(getattr(samples, axis).min()), float(getattr(samples, axis).max()))
                     for axis in AXES))

    def contains(self, points: OperatingPoints) -> NDArray[np.bool_]:
        """Tell which points lie inside; a rounding error outside counts as inside."""
        return np.all([self.covers(axis, getattr(points, axis)) for axis in AXES], axis=0)

    def covers(self, axis: str, values: ArrayLike) -> NDArray[np.bool_]:
        """Tell which values of one of `AXES` lie inside, as `contains` does."""
        low, high = getattr(self, axis)
        slack = 1e-9 * max(abs(low), abs(high), 1.0)
        array = np.asarray(values)
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
                form = ".9g" if low <= float(f"{value:.4g}") <= high else ".4g"  # just beyond
                unit = "" if axis.unit == "-" else f" {axis.unit}"
                turns = (f" ({low / RPM:.0f} to {high / RPM:.0f} r/min)"
                         if axis == ENGINE_SPEED else "")
                said.append(f"{axis.name} {value:{form}}{unit} is not in {low:{form}} to "
                            f"{high:{form}}{unit}{turns}")
        return said

    def to_mapping(self) -> dict[str, list[float]]:
        """Return axis -> [low, high]."""
        return {axis: list(getattr(self, axis)) for axis in AXES}

    @classmethod
    def from_mapping(cls, data: Mapping[str, object]) -> Domain:
        """Read what `to_mapping` gives.

        Raises:
            InputError: an axis is missing or is not a pair of numbers.
        """
        pairs = []
        for axis in AXES:
            value = data.get(axis)
            if not (isinstance(value, list) and len(value) == 2):
                raise InputError(f"domain.{axis} = {value!r} is not [low, high]")
            low, high = (number({axis: end}, axis, "domain.") for end in value)
            pairs.append((low, high))
        return cls(*pairs)


@dataclass(frozen=True, eq=False)
class EfficiencyMap:
    """Efficiency on a grid.

    Attributes:
        displacement_ratio: axis of shape (a,) [-].
        engine_speed: axis of shape (b,) [rad/s].
        load_torque: axis of shape (c,) [N m].
        efficiency: shape (a, b, c) [-]; NaN where the model has no answer.
        domain: of the model; None for one that does not know its data.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    efficiency: Array
    domain: Domain | None = None

    @property
    def inside_domain(self) -> NDArray[np.bool_] | None:
        """Where the data of the identification reach, shape (a, b, c); None if unknown."""
        if self.domain is None:
            return None
        return self.domain.contains(OperatingPoints(*np.meshgrid(
            self.displacement_ratio, self.engine_speed, self.load_torque, indexing="ij")))


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


class Uncertainty:
    """Of one model.

    Attributes:
        neighbours: parameters a small step away from the model's, one after the other, (3, 3).
    """

    def __init__(
        self, parameters: HydraulicParameters, standard_errors: Mapping[str, float],
        correlation: Array,
    ) -> None:
        self._errors = np.array([standard_errors[name] for name in PARAMETER_NAMES])
        self._correlation, base = correlation, parameters.to_array()
        # A step of a thousandth of the error stays in the linear range, also next to a bound.
        steps = np.maximum(1e-3 * self._errors, 1e-6 * base + 1e-18)
        highest = [limits.high for limits in PARAMETER_RANGES]
        self._steps = np.where(base + steps <= highest, steps, -steps)
        self.neighbours = base + np.diag(self._steps)

    def gradient(self, here: Array | float, there: Array) -> Array:
        """Change of answers by one standard error of each parameter, shape (..., 3); see `of`."""
        return np.asarray((there - here).T / self._steps * self._errors)

    def of(self, here: Array | float, there: Array) -> Array:
        """Standard error of answers `here`, shape (...), that are `there`, (3, ...), next to it."""
        gradient = self.gradient(here, there)
        variance = ((gradient @ self._correlation) * gradient).sum(axis=-1)
        # `published` takes a fixed eta_H at eps = 0: its parameters say nothing there.
        blind = (there == here).all(axis=0)
        return np.where(blind, np.nan, np.sqrt(np.maximum(variance, 0.0)))
