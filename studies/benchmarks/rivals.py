# SPDX-License-Identifier: Apache-2.0
"""What one would use instead of the model: a table of it, and SciPy's minimiser on it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import brentq, minimize_scalar

from hmcvt_core import EfficiencyModel
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS

Array = NDArray[np.float64]
Search = Callable[["Settings", "Point"], float]

LOAD_TORQUE_LIMITS = (50.0, 400.0)
"""Of the table [N m], as the node publishes its map."""

NODES = (41, 31, 31)
ACCURACY = 1e-6
"""Of the efficiency at an optimum."""

_TOLERANCES = (10.0 ** np.arange(-7.0, 1.0)).tolist()


class Point(NamedTuple):
    """An operating point, and what it gives."""

    displacement_ratio: float
    engine_speed: float
    load_torque: float
    output_speed: float
    power: float


def operating_points(count: int, seed: int) -> tuple[Array, Array, Array]:
    """Return random displacement ratios, engine speeds and load torques.

    Every pair of engine speed and load torque with the same power lies inside the table.
    """
    rng = np.random.default_rng(seed)
    low, high = ENGINE_SPEED_LIMITS
    speed = rng.uniform(low, high, count)
    power = rng.uniform(LOAD_TORQUE_LIMITS[0] * high, LOAD_TORQUE_LIMITS[1] * low, count)
    return rng.uniform(-1.0, 1.0, count), speed, power / speed


def points(model: EfficiencyModel, count: int, seed: int) -> list[Point]:
    """Return random points, with what they give."""
    stroke, speed, torque = operating_points(count, seed)
    output = model.output_speed(stroke, speed, torque)
    return [Point(*row) for row in
            np.transpose([stroke, speed, torque, output, speed * torque]).tolist()]


class Table:
    """Efficiency and output speed on a grid, with linear interpolation."""

    def __init__(self, model: EfficiencyModel) -> None:
        limits = ((-1.0, 1.0), ENGINE_SPEED_LIMITS, LOAD_TORQUE_LIMITS)
        self.axes = [np.linspace(*ends, nodes) for ends, nodes in zip(limits, NODES, strict=True)]
        self.efficiency = RegularGridInterpolator(
            self.axes, model.efficiency_map(*self.axes).efficiency)
        self.output_speed = RegularGridInterpolator(
            self.axes, model.output_speed(*np.meshgrid(*self.axes, indexing="ij")))

    @cached_property
    def _line(self) -> Array:
        """Points at every stroke of the table; the other two columns are filled in."""
        line = np.empty((NODES[0], 3))
        line[:, 0] = self.axes[0]
        return line

    def best_stroke(self, engine_speed: float, load_torque: float) -> float:
        """Best displacement ratio at an engine speed; a table is highest at one of its nodes."""
        self._line[:, 1:] = engine_speed, load_torque
        return float(self.axes[0][self.efficiency(self._line).argmax()])

    def best_pair(self, output_speed: float, power: float) -> tuple[float, float]:
        """Best displacement ratio and engine speed for an output, of the engine speeds in it."""
        strokes, speeds, _ = self.axes
        torques = np.clip(power / speeds, *LOAD_TORQUE_LIMITS)  # rounding at the ends
        reached = self.output_speed(np.stack(np.broadcast_arrays(
            strokes, speeds[:, None], torques[:, None]), axis=-1))
        held = np.array([np.interp(output_speed, row, strokes, np.nan, np.nan) for row in reached])
        line = np.stack([held, speeds, torques], axis=-1)[np.isfinite(held)]
        best = line[self.efficiency(line).argmax()]
        return float(best[0]), float(best[1])


# --- scipy.optimize.minimize_scalar on the model --------------------------------------------------


class Settings(NamedTuple):
    """How finely to search.

    Attributes:
        pieces: equal parts of the interval, each of which is searched.
        tolerance: of the variable.
        missed: share of points where another top of the curve is taken for the highest.
    """

    pieces: int
    tolerance: float
    missed: float = math.nan


def scipy_stroke(model: EfficiencyModel, settings: Settings, point: Point) -> float:
    """Return the best efficiency at a held engine speed; the variable is the stroke."""
    _, speed, torque, *_ = point
    return _lowest(lambda stroke: -model.efficiency(float(stroke), speed, torque),
                   (-1.0, 1.0), settings)


def scipy_pair(model: EfficiencyModel, settings: Settings, point: Point) -> float:
    """Return the best efficiency at a held output; the variable is the engine speed."""
    target, power = point.output_speed, point.power

    def excess(stroke: float, speed: float) -> float:
        return model.output_speed(stroke, speed, power / speed) - target

    def end(stroke: float, otherwise: float) -> float:
        """Engine speed at which full stroke gives the output, or the limit before it."""
        low, high = ENGINE_SPEED_LIMITS
        if excess(stroke, low) > 0.0 or excess(stroke, high) < 0.0:
            return otherwise
        return brentq(lambda speed: excess(stroke, speed), low, high, xtol=settings.tolerance)

    def loss(speed: float) -> float:
        speed = float(speed)
        if excess(1.0, speed) <= 0.0:
            stroke = 1.0
        elif excess(-1.0, speed) >= 0.0:
            stroke = -1.0
        else:
            stroke = brentq(excess, -1.0, 1.0, (speed,), xtol=1e-9)
        return -model.efficiency(stroke, speed, power / speed)

    low, high = end(1.0, ENGINE_SPEED_LIMITS[0]), end(-1.0, ENGINE_SPEED_LIMITS[1])
    return _lowest(loss, (low, high), settings)


def _lowest(loss: Callable[[float], float], limits: tuple[float, float],
            settings: Settings) -> float:
    ends = np.linspace(*limits, settings.pieces + 1).tolist()
    return max(-minimize_scalar(loss, bounds=piece, method="bounded",
                                options={"xatol": settings.tolerance}).fun
               for piece in itertools.pairwise(ends))


def just_enough(search: Search, given: Sequence[Point], best: Array, pieces: int) -> Settings:
    """Find the coarsest power of ten that does as well as the finest.

    Where even the finest misses, the search has gone to another top of the curve.
    """
    def missed(tolerance: float) -> float:
        found = np.array([search(Settings(pieces, tolerance), point) for point in given])
        return float(np.mean(found < best - ACCURACY))

    finest = missed(_TOLERANCES[0])
    enough = itertools.takewhile(lambda tolerance: missed(tolerance) <= finest, _TOLERANCES)
    return Settings(pieces, max(enough), finest)


def ours(model: EfficiencyModel, point: Point, hold: str) -> Any:
    """Return our optimum."""
    return model.optimal_displacement_ratio(
        point.engine_speed, point.load_torque, hold=hold,
        output_speed=point.output_speed if hold == "output_speed" else None)
