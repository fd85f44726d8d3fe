# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the transmission works, and the ranges of the registry that code uses by name.

A range is a gate against wrong units and broken sensors, not a statement about validity of the
model: for that see `hmcvt_core.model.domain`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .quantities import BY_NAME, STORED, Quantity
from .quantities import Range as Range

Array = NDArray[np.float64]
RPM = 2.0 * np.pi / 60.0
"""One revolution a minute in rad/s."""


DISPLACEMENT_RATIO = BY_NAME["displacement_ratio"]
ENGINE_SPEED = BY_NAME["engine_speed"]
LOAD_TORQUE = BY_NAME["load_torque"]
ANY_LOAD = Range("load_torque", -5000.0, 5000.0, "N m", "output power / engine speed")
"""With coasting and overrun, where wheels drive the engine: of lookups, not of bench tests."""
EFFICIENCY = BY_NAME["efficiency"]
OUTPUT_SPEED = BY_NAME["output_speed"]
OIL_TEMPERATURE = BY_NAME["oil_temperature"]
EFFICIENCY_STD = BY_NAME["efficiency_std"]
MISFIT = Range("misfit", 0.0, 1.0, "-", "a fraction, not percent")

POINT_RANGES = (DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE)
"""What makes an operating point, in the order in which it is given everywhere."""
ANY_POINT = (DISPLACEMENT_RATIO, ENGINE_SPEED, ANY_LOAD)

BENCH_COLUMNS: Sequence[Quantity] = STORED
"""The columns of a bench file."""
REQUIRED_COLUMNS = tuple(column.name for column in STORED if column.required)

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
        for limits, value in zip(ANY_POINT, point, strict=True):
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
        left = np.ones(flat.engine_speed.size, dtype=bool)
        # A list of the names would take longer than the balance.
        while left.any():
            name = str(flat.stage[left.argmax()])
            engaged = flat.stage == name
            (at,) = np.nonzero(engaged)
            of_stage = plain if at.size == left.size else plain._at(at)
            parts.append(of_stage._solved_in_chunks(name, solve))
            positions.append(at)
            left &= ~engaged
        if len(parts) == 1:
            return parts[0].reshape(*parts[0].shape[:-1], *self.engine_speed.shape)
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
    """Solution of a formulation at operating points; arrays of one shape, NaN without an answer.

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
