# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the data of a model reach; a prediction, and a map of predictions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..files import picture, plain
from ..files.bench import BenchSamples
from ..transmission.ranges import (
    ENGINE_SPEED,
    OIL_TEMPERATURE,
    POINT_RANGES,
    RPM,
    Array,
    Range,
)

AXES = tuple(axis.name for axis in POINT_RANGES)
"""Names of the coordinates of an operating point."""
_RANGES = (*POINT_RANGES, OIL_TEMPERATURE)
AXES_WITH_OIL = tuple(axis.name for axis in _RANGES)
"""The same, and the oil temperature."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class Domain:
    """A box around the identification data; each entry is (lowest, highest), SI units.

    Attributes:
        displacement_ratio: [-].
        engine_speed: [rad/s].
        load_torque: [N m].
        oil_temperature: [deg C]; None where the data do not state it.

    Raises:
        InputError: an interval is reversed or not finite.
    """

    displacement_ratio: tuple[float, float]
    engine_speed: tuple[float, float]
    load_torque: tuple[float, float]
    oil_temperature: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for axis, (low, high) in self.intervals().items():
            if not (np.isfinite([low, high]).all() and low <= high):
                raise InputError(
                    f"domain.{axis} = [{low}, {high}]: needs two rising numbers"
                )

    @classmethod
    def of(cls, samples: BenchSamples) -> Domain:
        """Return the smallest box that holds the samples."""
        intervals = {}
        for axis in AXES_WITH_OIL:
            values = getattr(samples, axis)
            if values is not None:
                intervals[axis] = (float(values.min()), float(values.max()))
        return cls(**intervals)

    def united(self, other: Domain) -> Domain:
        """Return the smallest box that holds this one and another, as far as each is known."""
        intervals = self.intervals()
        for axis, ends in other.intervals().items():
            both = ends + intervals.get(axis, ends)
            intervals[axis] = (min(both), max(both))
        return Domain(**intervals)

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return axis -> (lowest, highest); without the oil temperature where it is not known."""
        intervals = {}
        for axis in AXES_WITH_OIL:
            ends = getattr(self, axis)
            if ends is not None:
                intervals[axis] = ends
        return intervals

    def contains(
        self,
        displacement_ratio: ArrayLike,
        engine_speed: ArrayLike,
        load_torque: ArrayLike,
        oil_temperature: ArrayLike | None = None,
    ) -> NDArray[np.bool_]:
        """Return which points lie inside.

        Args:
            displacement_ratio: [-]; broadcasts with the rest.
            engine_speed: [rad/s].
            load_torque: [N m].
            oil_temperature: [deg C]; None leaves it out, as does a box that does not know it.
        """
        stroke_inside = self.covers("displacement_ratio", displacement_ratio)
        speed_inside = self.covers("engine_speed", engine_speed)
        load_inside = self.covers("load_torque", load_torque)
        inside = stroke_inside & speed_inside & load_inside
        if self.oil_temperature is not None and oil_temperature is not None:
            inside = inside & self.covers("oil_temperature", oil_temperature)
        return inside

    @cached_property
    def _limits(self) -> tuple[tuple[float, float], ...]:
        return tuple(self.limits_with_slack(axis) for axis in self.intervals())

    def contains_point(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
    ) -> bool:
        """Return whether one point lies inside; what `contains` gives, without arrays.

        Args:
            displacement_ratio: [-].
            engine_speed: [rad/s].
            load_torque: [N m].
            oil_temperature: [deg C]; None leaves it out, as does a box that does not know it.
        """
        stroke, speed, load, *oil = self._limits
        inside = (
            stroke[0] <= displacement_ratio <= stroke[1]
            and speed[0] <= engine_speed <= speed[1]
            and load[0] <= load_torque <= load[1]
        )
        if oil and oil_temperature is not None:
            ((low, high),) = oil
            inside = inside and low <= oil_temperature <= high
        return inside

    def covers(self, axis: str, values: ArrayLike) -> NDArray[np.bool_]:
        """Return which values of one axis lie inside; a rounding error outside counts as inside."""
        low, high = self.limits_with_slack(axis)
        array = np.asarray(values, dtype=float)
        return (array >= low) & (array <= high)

    def limits_with_slack(self, axis: str) -> tuple[float, float]:
        """Return the ends of one axis, a rounding error further apart."""
        low, high = getattr(self, axis)
        slack = _ROUNDING * max(abs(low), abs(high), 1.0)
        return low - slack, high + slack

    def departures(
        self,
        displacement_ratio: float,
        engine_speed: float,
        load_torque: float,
        oil_temperature: float | None = None,
    ) -> list[str]:
        """Return a sentence for each axis along which one point lies outside.

        Args:
            displacement_ratio: [-].
            engine_speed: [rad/s].
            load_torque: [N m].
            oil_temperature: [deg C]; None leaves it out, as does a box that does not know it.
        """
        point = (displacement_ratio, engine_speed, load_torque, oil_temperature)
        known = self.intervals()
        sentences = []
        for axis, value in zip(_RANGES, point, strict=True):
            if axis.name not in known or value is None:
                continue
            if not self.covers(axis.name, value):
                sentences.append(self._departure(axis, value))
        return sentences

    def _departure(self, axis: Range, value: float) -> str:
        low, high = getattr(self, axis.name)
        # A value just beyond an end needs more digits to look different from it.
        just_beyond = low <= float(f"{value:.4g}") <= high
        form = ".9g" if just_beyond else ".4g"
        unit = "" if axis.unit == "-" else f" {axis.unit}"
        turns = ""
        if axis == ENGINE_SPEED:
            turns = f" ({low / RPM:.0f} to {high / RPM:.0f} r/min)"
        return (
            f"{axis.name} {value:{form}}{unit} is not in {low:{form}} to "
            f"{high:{form}}{unit}{turns}"
        )

    def to_dict(self) -> dict[str, list[float]]:
        """Return axis -> [low, high]."""
        return self.to_mapping()

    def report(self) -> str:
        """Return the interval of each axis as text."""
        lines = []
        known = self.intervals()
        for axis in _RANGES:
            if axis.name not in known:
                continue
            low, high = known[axis.name]
            unit = "" if axis.unit == "-" else f" {axis.unit}"
            name = axis.name.replace("_", " ")
            lines.append(f"{name:<18} {low:.4g} to {high:.4g}{unit}")
        return "\n".join(lines)

    def to_mapping(self) -> dict[str, list[float]]:
        """Return axis -> [low, high]."""
        return {axis: list(ends) for axis, ends in self.intervals().items()}


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

    def to_dict(self) -> dict[str, Any]:
        """Return the map as plain data for JSON; None where the model has no answer."""
        return dict(plain(vars(self)))

    def report(self) -> str:
        """Return size and range of the map as text."""
        shape = " x ".join(str(length) for length in self.efficiency.shape)
        answered = self.efficiency[np.isfinite(self.efficiency)]
        if not answered.size:
            return f"efficiency map, {shape} points: no answer at any of them"
        return (
            f"efficiency map, {shape} points: {100 * answered.min():.1f} to "
            f"{100 * answered.max():.1f} %, no answer at "
            f"{self.efficiency.size - answered.size}"
        )

    def plot(self, load_torque: float | None = None, *, ax: Any = None) -> Any:
        """Draw the efficiency over engine speed and displacement ratio.

        Args:
            load_torque: the nearest of the axis is drawn [N m]; the middle one when left out.
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        return picture(self, load_torque, ax=ax)


class Prediction(NamedTuple):
    """Prediction of a model at operating points; floats, or arrays of one shape.

    Attributes:
        efficiency: output power / engine power [-]; NaN where the model has no answer.
        standard_error: from the covariance of the parameters and the misfit of the model [-]; NaN
            where that covariance is not known.
        inside_domain: whether the point lies in the box of the identification data.
    """

    efficiency: Any
    standard_error: Any
    inside_domain: Any

    def to_dict(self) -> dict[str, Any]:
        """Return the prediction as plain data for JSON; None where it is unknown."""
        return dict(plain(self._asdict()))

    def report(self) -> str:
        """Return the prediction as text, one line for each point."""
        columns = np.broadcast_arrays(*(np.atleast_1d(values) for values in self))
        lines = []
        for efficiency, error, inside in zip(*map(np.ravel, columns), strict=True):
            reach = "within the data" if inside else "outside the data"
            lines.append(f"{100 * efficiency:.2f} % +- {100 * error:.2f} %, {reach}")
        return "\n".join(lines)
