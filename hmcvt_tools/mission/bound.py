# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The least fuel that any strategy can need, by dynamic programming over the whole cycle.

The programme knows the cycle in advance, which no strategy does. It obeys the limits of the machine
(`moves`). Its grid holds the points that the strategies choose among, so no strategy needs less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hmcvt_core.model.engine import Engine
from hmcvt_core.transmission.ranges import Array

from .cycle import Cycle
from .moves import Moves
from .points import Drive, WorkingPoints, speed_grid, working_points

_NOWHERE = -1


class Path(NamedTuple):
    """A way through the working points.

    Attributes:
        stage: position of the stage at each step, shape (n,); -1 where nothing holds the demand.
        speed: position of the engine speed, shape (n,); likewise.
        broken: steps that no point of the step before reaches, shape (k,).
        fuel: of the cycle [kg].
    """

    stage: NDArray[np.intp]
    speed: NDArray[np.intp]
    broken: NDArray[np.intp]
    fuel: float


@dataclass(frozen=True)
class Bound:
    """Least fuel of a cycle.

    Attributes:
        fuel: on the grid of the strategies [kg].
        coarse_fuel: on the grid with twice the distance of engine speeds [kg].
        map_error: stated error of the interpolation in the fuel map: what half of its rows change
            along the path [kg].
        path: that needs it.
    """

    fuel: float
    coarse_fuel: float
    map_error: float
    path: Path

    @property
    def grid_error(self) -> float:
        """Stated error of the grid: what halving the distance has changed [kg]."""
        return abs(self.coarse_fuel - self.fuel)

    @property
    def error(self) -> float:
        """Stated error of the fuel, by grid and fuel map together [kg]."""
        return self.grid_error + self.map_error


def bound(drive: Drive, cycle: Cycle, points: WorkingPoints) -> Bound:
    """Return the least fuel of a cycle, with the error of its grid.

    Args:
        drive: the drive line.
        cycle: demand.
        points: working points, as strategies choose among.
    """
    coarse = speed_grid(
        points.grid.stages[:-1],
        drive.engine,
        drive.vehicle.limits,
        cycle.step,
        2.0 * points.grid.spacing,
    )
    coarse_points = working_points(drive, cycle, coarse)
    path = least_fuel_path(drive, cycle, points)
    coarse_path = least_fuel_path(drive, cycle, coarse_points)
    map_error = _map_error(drive.engine, points, path) * cycle.step
    return Bound(path.fuel, coarse_path.fuel, map_error, path)


def _map_error(engine: Engine, points: WorkingPoints, path: Path) -> float:
    """Return the sum of what half of the fuel map's rows change along a path [kg/s].

    Next to a minimum the path itself changes nothing to first order.
    """
    driven = np.flatnonzero(path.stage != _NOWHERE)
    at = (driven, path.stage[driven], path.speed[driven])
    change = engine.interpolation_error(
        points.engine_speed[at], points.engine_torque[at]
    )
    return float(abs(np.sum(change)))


def least_fuel_path(drive: Drive, cycle: Cycle, points: WorkingPoints) -> Path:
    """Return the way of least fuel through the working points of a cycle.

    Where nothing holds a step, the way starts again after it.
    """
    moves = Moves.of(drive.vehicle.limits, points, cycle.step)
    stage = np.full(len(points), _NOWHERE, dtype=np.intp)
    speed = stage.copy()
    broken: list[int] = []
    fuel = 0.0
    for start, end in runs(points.possible):
        run = _Run(moves, points, start, end)
        stage[start:end], speed[start:end] = run.path()
        broken += run.broken
        fuel += run.fuel
    return Path(stage, speed, np.array(broken, dtype=np.intp), fuel * cycle.step)


def runs(possible: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return beginning and end of each unbroken run of steps."""
    padded = np.concatenate([[False], possible, [False]])
    edges = np.flatnonzero(np.diff(padded)).reshape(-1, 2)
    return [(int(start), int(end)) for start, end in edges]


class _Run:
    """Forward pass over steps that all have a working point.

    Attributes:
        broken: steps that no point of the step before reaches; any point may be taken there.
        fuel: least sum of the fuel rates [kg/s].
    """

    def __init__(
        self, moves: Moves, points: WorkingPoints, start: int, end: int
    ) -> None:
        self.broken: list[int] = []
        self._start = start
        self._shape = points.fuel.shape[1:]
        self._before: list[NDArray[np.intp]] = []
        value = points.fuel[start]
        for k in range(start + 1, end):
            reached, before = _step(moves, value, points, k)
            if not np.isfinite(reached).any():
                self.broken.append(k)
                before = np.full(self._shape, value.argmin())
                reached = value.min() + points.fuel[k]
            self._before.append(before)
            value = reached
        self._last = int(value.argmin())
        self.fuel = float(value.min())

    def path(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return stages and engine speeds of the way, from the last step back to the first."""
        positions = [self._last]
        for before in reversed(self._before):
            positions.append(int(before.ravel()[positions[-1]]))
        stage, speed = np.unravel_index(np.array(positions[::-1]), self._shape)
        return stage, speed


@np.errstate(invalid="ignore")
def _step(
    moves: Moves, value: Array, points: WorkingPoints, k: int
) -> tuple[Array, NDArray[np.intp]]:
    """Return the least fuel up to each point of a step, and the point before it.

    Args:
        moves: of the machine.
        value: least fuel up to each point of the step before, shape (s, m) [kg/s].
        points: of the cycle.
        k: the step.

    Returns:
        Two arrays of shape (s, m); infinite fuel where the point is not reached.
    """
    stages, speeds = value.shape
    # Points that lie on a limit are less than two spacings from their place in the grid.
    reach = math.ceil(moves.engine_speed / points.grid.spacing) + 2
    values = _windows(value, reach, np.inf)
    strokes = _windows(points.stroke[k - 1], reach, np.nan)
    engine_speeds = _windows(points.engine_speed[k - 1], reach, np.nan)
    sources = np.flatnonzero(np.isfinite(value).any(axis=1)).tolist()
    reached = np.full((stages, speeds), np.inf)
    before = np.zeros((stages, speeds), dtype=np.intp)
    column = np.arange(speeds)
    for after in np.flatnonzero(np.isfinite(points.fuel[k]).any(axis=1)).tolist():
        stroke = points.stroke[k, after, :, None]
        engine_speed = points.engine_speed[k, after, :, None]
        for source in sources:
            change = np.abs(strokes[source] - stroke)
            too_far = change > moves.stroke_limit(source, after)
            speed_change = np.abs(engine_speeds[source] - engine_speed)
            too_far |= speed_change > moves.engine_speed
            cost = np.where(too_far, np.inf, values[source])
            nearest = cost.argmin(axis=1)
            fuel = points.fuel[k, after]
            if moves.changes(source, after):
                fuel = points.fuel_changing[k, after]
            total = cost[column, nearest] + fuel
            is_better = total < reached[after]
            reached[after] = np.where(is_better, total, reached[after])
            position = source * speeds + column + nearest - reach
            before[after] = np.where(is_better, position, before[after])
    return reached, before


def _windows(values: Array, reach: int, beyond: float) -> Array:
    """Return the neighbours of each column up to a distance, shape (s, m, 2 reach + 1)."""
    padded = np.pad(values, ((0, 0), (reach, reach)), constant_values=beyond)
    return sliding_window_view(padded, 2 * reach + 1, axis=1)
