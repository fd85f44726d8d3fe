# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the transmission works, and the range of every quantity that enters from outside.

A range is a gate against wrong units and broken sensors, not a statement about validity of the
model: for that see `hmcvt_core.model.domain`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

Array = NDArray[np.float64]
RPM = 2.0 * np.pi / 60.0
"""One revolution a minute in rad/s."""


@dataclass(frozen=True)
class Range:
    """A closed interval of one physical quantity.

    Attributes:
        name: the quantity, as it is called in files and arguments.
        low: lowest value, in `unit`.
        high: highest value, in `unit`.
        unit: the unit, `-` for a plain number.
        hint: what to suspect when a value is outside.
    """

    name: str
    low: float
    high: float
    unit: str
    hint: str = ""

    def __str__(self) -> str:
        text = f"{self.low:g} to {self.high:g}"
        if self.unit == "-":
            return text
        return f"{text} {self.unit}"

    def contains(self, value: ArrayLike) -> NDArray[np.bool_]:
        """Return, element by element, which values are finite and inside."""
        array = np.asarray(value, dtype=float)
        return (array >= self.low) & (array <= self.high)

    def check(self, value: ArrayLike, where: str = "") -> NDArray[np.float64]:
        """Return `value` as an array of floats.

        Args:
            value: scalar or array of any shape, in `unit`.
            where: the place to name in the error, such as a file and row.

        Raises:
            InputError: a value is no number, not finite or outside; the first one is named.
        """
        prefix = f"{where}: " if where else ""
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(
                f"{prefix}{self.name} = {value!r} is not a number"
            ) from None
        # One pass each and false for NaN; cheaper than a mask when all is well.
        if array.size and not (array.min() >= self.low and array.max() <= self.high):
            first = np.flatnonzero(~self.contains(array).ravel())[0]
            index = f"[{first}]" if array.ndim else ""
            raise InputError(f"{prefix}{self.complaint(array.ravel()[first], index)}")
        return array

    def complaint(self, value: float, index: str = "") -> str:
        """Say in one line what is wrong with a value outside."""
        if not np.isfinite(value):
            return f"{self.name}{index} = {value} is not finite; allowed {self}"
        hint = f" ({self.hint})" if self.hint else ""
        text = f"{value:g}"
        if self.low <= float(text) <= self.high:
            text = repr(float(value))  # just beyond a limit, and inside once rounded
        return f"{self.name}{index} = {text} is outside {self}{hint}"


DISPLACEMENT_RATIO = Range(
    "displacement_ratio", -1.0, 1.0, "-", "a fraction of full pump stroke, not percent"
)
ENGINE_SPEED = Range("engine_speed", 10.0, 320.0, "rad/s", "is it in r/min?")
LOAD_TORQUE = Range("load_torque", 1.0, 5000.0, "N m", "output power / engine speed")
ANY_LOAD = Range("load_torque", -5000.0, 5000.0, "N m", "output power / engine speed")
"""With coasting and overrun, where wheels drive the engine: of lookups, not of bench tests."""
EFFICIENCY = Range("efficiency", 0.01, 1.0, "-", "a fraction, not percent")
OUTPUT_SPEED = Range("output_speed", 0.1, 1000.0, "rad/s", "is it in r/min?")
OIL_TEMPERATURE = Range("oil_temperature", -40.0, 150.0, "deg C", "is it in kelvin?")
EFFICIENCY_STD = Range("efficiency_std", 1e-6, 0.2, "-", "a fraction, not percent")
MISFIT = Range("misfit", 0.0, 1.0, "-", "a fraction, not percent")
STAMP = Range("stamp", 0.0, 1e12, "s")
PRESSURE = Range("pressure", -6e7, 6e7, "Pa", "high less low side of the motor")

POINT_RANGES = (DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE)
"""What makes an operating point, in the order in which it is given everywhere."""
_ANY_POINT = (DISPLACEMENT_RATIO, ENGINE_SPEED, ANY_LOAD)

BENCH_COLUMNS: Sequence[Range] = (
    *POINT_RANGES,
    EFFICIENCY,
    OUTPUT_SPEED,
    OIL_TEMPERATURE,
    EFFICIENCY_STD,
    STAMP,
    PRESSURE,
)
"""The columns of a bench file; the first four are required."""
REQUIRED_COLUMNS = tuple(column.name for column in BENCH_COLUMNS[:4])

ENGINE_SPEED_LIMITS = (750.0 * RPM, 2200.0 * RPM)
"""Working speeds of the paper's engine (section 4.2), rad/s."""


CHUNK = 8192
"""Values worked out at a time: their arrays stay in the cache of the processor."""


class OperatingPoints(NamedTuple):
    """Where the transmission works; arrays of one shape (or None), SI units.

    `stage` holds names; without it the model's own stage is engaged.
    """

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    oil_temperature: Array | None = None
    stage: Any = None

    @classmethod
    def checked(
        cls,
        point: Sequence[ArrayLike],
        oil_temperature: ArrayLike | None = None,
        stage: ArrayLike | None = None,
    ) -> OperatingPoints:
        """Return points in range; `point` holds the first three, which broadcast with the rest.

        Raises:
            InputError: a value is out of range, or the shapes do not broadcast.
        """
        given: list[Any] = []
        for limits, value in zip(_ANY_POINT, point, strict=True):
            # NumPy would read a text as its number, and True as 1.
            if np.asarray(value).dtype.kind in "USb":
                raise InputError(
                    f"{limits.name} = {value!r} is not a number; allowed {limits}"
                )
            given.append(limits.check(value))
        temperature = None
        if oil_temperature is not None:
            temperature = OIL_TEMPERATURE.check(oil_temperature)
        names = None
        if stage is not None:
            names = np.asarray(stage, dtype=str)
        given += [temperature, names]
        shapes = [column.shape for column in given if column is not None]
        try:
            shape = np.broadcast_shapes(*shapes)
        except ValueError:
            raise InputError(
                f"operating points of shapes {', '.join(map(str, shapes[:3]))} do not "
                "broadcast"
            ) from None
        return cls(*given).map(lambda column: np.broadcast_to(column, shape))

    def map(self, function: Any) -> OperatingPoints:
        """Return the points with a function applied to each array."""
        columns = []
        for axis in self:
            columns.append(None if axis is None else function(axis))
        return OperatingPoints._make(columns)

    def solved(self, solve: Callable[[str | None, OperatingPoints], Any]) -> Array:
        """Rows that a function gives, for each stage and its points; shape (rows, ..., *shape).

        Args:
            solve: takes a stage, None for the model's own, and n of its points; gives rows of shape
                (..., n).
        """
        flat = self.map(np.ravel)
        plain = flat._replace(stage=None)
        if flat.stage is None or flat.engine_speed.size == 0:
            rows = plain._solved_in_chunks(None, solve)
            return rows.reshape(*rows.shape[:-1], *self.engine_speed.shape)
        parts = []
        positions = []
        for name in dict.fromkeys(flat.stage.tolist()):
            (at,) = np.nonzero(flat.stage == name)
            engaged = plain._at(at)
            parts.append(engaged._solved_in_chunks(name, solve))
            positions.append(at)
        by_stage = np.concatenate(parts, axis=-1)
        rows = np.empty_like(by_stage)
        rows[..., np.concatenate(positions)] = by_stage
        return rows.reshape(*rows.shape[:-1], *self.engine_speed.shape)

    def _solved_in_chunks(
        self, stage: str | None, solve: Callable[[str | None, OperatingPoints], Any]
    ) -> Array:
        """Rows that a function gives for points of one stage, shape (rows, ..., n)."""
        parts = []
        # Without a point one empty call gives the number of rows.
        for start in range(0, max(self.engine_speed.size, 1), CHUNK):
            chunk = self._at(slice(start, start + CHUNK))
            parts.append(np.stack(solve(stage, chunk)))
        return np.concatenate(parts, axis=-1)

    def _at(self, positions: Any) -> OperatingPoints:
        """Return the points at positions: an index array, a mask or a slice."""
        return self.map(lambda axis: axis[positions])


class Solution(NamedTuple):
    """What a formulation says at operating points; arrays of one shape, NaN without an answer.

    Attributes:
        efficiency: output power / engine power [-]; in overrun (negative load) engine power /
            output power, NaN where the wheels alone do not turn the engine.
        output_speed: [rad/s], negative backward.
        engine_torque: [N m]; known also where the efficiency is not.
    """

    efficiency: Array
    output_speed: Array
    engine_torque: Array

    @classmethod
    def of(
        cls, load_torque: Array, engine_torque: Array, output_speed: Array
    ) -> Solution:
        """Return a solution with the efficiency that follows from the torques."""
        efficiency = np.where(engine_torque > 0.0, load_torque / engine_torque, np.nan)
        overrun = load_torque < 0.0
        if overrun.any():
            back = np.where(engine_torque < 0.0, engine_torque / load_torque, np.nan)
            efficiency = np.where(overrun, back, efficiency)
        return cls(efficiency, output_speed, engine_torque)
