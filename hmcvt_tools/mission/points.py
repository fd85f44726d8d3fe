# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The working points that hold the demand of each step, on a grid of stages and engine speeds.

In a stage every engine speed needs one displacement ratio to hold the output, which the balance
gives without a search. Strategies and the bound choose among the same points, so that no strategy
beats the bound by a finer grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import NO_OPTIMUM, EfficiencyModel
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.physics.regimes import Senses
from hmcvt_core.transmission.ranges import RPM, Array

from .cycle import Cycle
from .vehicle import Limits, Vehicle

NEUTRAL = "neutral"
"""Name of the state in which the output stands and the engine idles or drives the PTO."""

SPEED_STEP = 10.0 * RPM
"""Distance of engine speeds of the grid when none is given [rad/s]."""

_EDGE = 1e-9  # of the stroke: rounding at full stroke
_ROUNDING = 1e-9  # of a limit
_NEXT_TO_REST = 1e-9  # part of the speed at which the motor rests
_SECANTS = 4  # steps towards an edge
_INSIDE = 1e-6  # part by which a step towards an edge stays short of it


@dataclass(frozen=True, eq=False)
class Grid:
    """Stages and engine speeds to choose from, before they are moved to limits.

    Attributes:
        stages: names, `NEUTRAL` last.
        engine_speed: rising and even, shape (m,) [rad/s].
        change: highest change of the engine speed within a step of the cycle [rad/s].
    """

    stages: tuple[str, ...]
    engine_speed: Array
    change: float

    @property
    def spacing(self) -> float:
        """Distance of the engine speeds [rad/s]."""
        return float(self.engine_speed[1] - self.engine_speed[0])

    @property
    def neutral(self) -> int:
        """Position of `NEUTRAL`."""
        return len(self.stages) - 1


def speed_grid(
    stages: tuple[str, ...],
    engine: Engine,
    limits: Limits,
    step: float,
    distance: float = SPEED_STEP,
) -> Grid:
    """Return the grid of a cycle.

    Args:
        stages: names of the stages.
        engine: limits the speeds, too.
        limits: of the machine.
        step: of the cycle [s].
        distance: of the engine speeds, at most [rad/s].

    Raises:
        InputError: no engine speed lies within the limits and the table of the engine.
    """
    low = max(limits.engine_speed_low, float(engine.speed[0]))
    high = min(limits.engine_speed_high, float(engine.speed[-1]))
    if not low < high:
        raise InputError(
            f"engine speeds from {low / RPM:.0f} to {high / RPM:.0f} r/min: nothing lies "
            "between the limits of the vehicle and the table of the engine"
        )
    count = max(math.ceil((high - low) / distance * (1.0 - _ROUNDING)), 2)
    return Grid(
        (*stages, NEUTRAL),
        np.linspace(low, high, count + 1),
        limits.engine_speed_rate * step,
    )


@dataclass(frozen=True, eq=False)
class WorkingPoints:
    """What each point of the grid costs at each step.

    Attributes:
        grid: stages and engine speeds.
        engine_speed: of each point, shape (n, s, m), rising [rad/s]; that of the grid, but for
            the points next to a limit, which lie on it.
        stroke: displacement ratio, shape (n, s, m) [-]; NaN in neutral and where none holds.
        engine_torque: without a stage change, shape (n, s, m) [N m]; NaN where none holds.
        fuel: shape (n, s, m) [kg/s]; infinite where the point is not possible.
        fuel_changing: the same in a step with a stage change.
        strained: steps that leave no torque reserve, shape (n,).
    """

    grid: Grid
    engine_speed: Array
    stroke: Array
    engine_torque: Array
    fuel: Array
    fuel_changing: Array
    strained: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.fuel)

    @property
    def possible(self) -> NDArray[np.bool_]:
        """Steps that some point holds, shape (n,)."""
        return np.asarray(np.isfinite(self.fuel).any(axis=(1, 2)))


class Drive(NamedTuple):
    """The drive line of a mission.

    Attributes:
        model: of the transmission.
        engine: before it.
        vehicle: around it.
    """

    model: EfficiencyModel
    engine: Engine
    vehicle: Vehicle


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def working_points(drive: Drive, cycle: Cycle, grid: Grid) -> WorkingPoints:
    """Return the working points of a cycle.

    Args:
        drive: the drive line.
        cycle: demand.
        grid: stages and engine speeds.

    Raises:
        InputError: the formulation of the model is not `power_balance`.
    """
    shape = (len(cycle), len(grid.stages), len(grid.engine_speed))
    speed = np.empty(shape)
    stroke = np.full(shape, np.nan)
    torque = np.full(shape, np.nan)
    models = drive.model.without_meters().stages
    for i, name in enumerate(grid.stages[:-1]):
        stage = _Stage(models[name].balance(NO_OPTIMUM), drive, cycle, grid)
        speed[:, i], stroke[:, i], torque[:, i] = stage.points()
    speed[:, -1] = _window_on_grid(drive.vehicle, cycle, grid)
    at_rest = cycle.standing & cycle.known & (cycle.output_power == 0.0)
    idle = idle_torque(drive.model, speed[at_rest, -1])
    shafts = shaft_power(drive.vehicle, cycle)[at_rest, None]
    torque[at_rest, -1] = idle + shafts / speed[at_rest, -1]
    low, high = _speed_window(drive.vehicle, cycle, grid)
    allowed = (speed >= low[:, None, None]) & (speed <= high[:, None, None])
    torque = np.where(allowed, torque, np.nan)
    fuel, strained = _fuel_with_reserve(drive, speed, torque)
    change = drive.vehicle.limits.stage_change_loss / cycle.step
    changing = _fuel(drive.engine, speed, torque + change / speed)
    fuel_changing = np.where(np.isfinite(fuel), changing, np.inf)
    return WorkingPoints(grid, speed, stroke, torque, fuel, fuel_changing, strained)


class _Stage:
    """The points of one stage at all steps, moved to where the cost has an edge."""

    def __init__(
        self, solver: BalanceSolver, drive: Drive, cycle: Cycle, grid: Grid
    ) -> None:
        self._solver = solver
        self._drive = drive
        self._cycle = cycle
        self._grid = grid
        self._shafts = shaft_power(drive.vehicle, cycle)
        self._moving = cycle.known & ~cycle.standing

    def points(self) -> tuple[Array, Array, Array]:
        """Return engine speed, displacement ratio and engine torque, shape (n, m) each."""
        speed = _window_on_grid(self._drive.vehicle, self._cycle, self._grid)
        self._move_to_rest(speed)
        stroke, torque = self._held(speed)
        margin = self._margin(speed, stroke, torque)
        for edge in (_lower_edge(margin), _upper_edge(margin)):
            self._move_to_edge(edge, speed, stroke, torque, margin)
        holds = np.abs(stroke) <= 1.0 + _EDGE
        torque = np.where(holds, torque, np.nan)
        stroke = np.where(np.isnan(torque), np.nan, np.clip(stroke, -1.0, 1.0))
        return speed, stroke, torque

    def _held(self, speed: Array) -> tuple[Array, Array]:
        """Return displacement ratio, not limited, and engine torque at speeds (n, k)."""
        stroke = np.full(speed.shape, np.nan)
        torque = np.full(speed.shape, np.nan)
        for sense in (1, -1):
            rows = np.flatnonzero(
                self._moving & (sense * self._cycle.output_speed > 0.0)
            )
            if not len(rows):
                continue
            count = speed.shape[1]
            speeds = speed[rows].ravel()
            outputs = np.repeat(self._cycle.output_speed[rows], count)
            powers = np.repeat(self._cycle.output_power[rows], count)
            strokes, torques = self._solver.held(
                speeds, outputs, powers / speeds, senses=Senses(sense, 1)
            )
            torques = torques + np.repeat(self._shafts[rows], count) / speeds
            stroke[rows] = strokes.reshape(len(rows), count)
            torque[rows] = torques.reshape(len(rows), count)
        return stroke, torque

    def _margin(self, speed: Array, stroke: Array, torque: Array) -> Array:
        """Return how far points are from full stroke and from the torque limit [-]."""
        reserve = self._drive.vehicle.limits.torque_reserve
        highest = (1.0 - reserve) * self._drive.engine.full_load_torque(speed)
        return np.asarray(np.minimum(1.0 - np.abs(stroke), 1.0 - torque / highest))

    def _move_to_rest(self, speed: Array) -> None:
        """Move the two points around a resting motor next to it: friction sets a step there."""
        ratio = self._solver.mechanical_ratio
        if not ratio:
            return
        rest = self._cycle.output_speed / ratio
        above = (speed < rest[:, None]).sum(axis=1)
        (rows,) = np.nonzero((above > 0) & (above < speed.shape[1]) & self._moving)
        speed[rows, above[rows] - 1] = rest[rows] * (1.0 - _NEXT_TO_REST)
        speed[rows, above[rows]] = rest[rows] * (1.0 + _NEXT_TO_REST)

    def _move_to_edge(
        self,
        edge: tuple[Any, Any, int],
        speed: Array,
        stroke: Array,
        torque: Array,
        margin: Array,
    ) -> None:
        """Move the first point beyond an edge onto it, where the margin is zero.

        Args:
            edge: rows, positions of the last point within, and the direction outward.
            speed: of the points, shape (n, m); changed in its place, as the others.
            stroke: displacement ratios.
            torque: engine torques.
            margin: see `_margin`.
        """
        rows, inside, outward = edge
        outside = inside + outward
        known = np.isfinite(margin[rows, outside])
        rows = rows[known]
        inside = inside[known]
        outside = outside[known]
        within = speed[rows, inside].copy()
        beyond = speed[rows, outside].copy()
        within_margin = margin[rows, inside].copy()
        beyond_margin = margin[rows, outside].copy()
        full = np.empty_like(speed[:, :1])
        for _ in range(_SECANTS):
            share = within_margin / (within_margin - beyond_margin)
            at = within + (beyond - within) * share * (1.0 - _INSIDE)
            full[:] = self._grid.engine_speed[0]
            full[rows, 0] = at
            strokes, torques = self._held(full)
            reached = self._margin(full, strokes, torques)[rows, 0]
            holds = reached >= 0.0
            within = np.where(holds, at, within)
            within_margin = np.where(holds, reached, within_margin)
            beyond = np.where(holds, beyond, at)
            beyond_margin = np.where(holds, beyond_margin, reached)
            speed[rows[holds], outside[holds]] = at[holds]
            stroke[rows[holds], outside[holds]] = strokes[rows[holds], 0]
            torque[rows[holds], outside[holds]] = torques[rows[holds], 0]


def _lower_edge(margin: Array) -> tuple[Any, Any, int]:
    """Return rows and positions of the lowest speed that holds, where one below does not."""
    holds = margin >= 0.0
    first = holds.argmax(axis=1)
    (rows,) = np.nonzero(holds.any(axis=1) & (first > 0))
    return rows, first[rows], -1


def _upper_edge(margin: Array) -> tuple[Any, Any, int]:
    """Return rows and positions of the highest speed that holds, where one above does not."""
    holds = margin >= 0.0
    last = holds.shape[1] - 1 - holds[:, ::-1].argmax(axis=1)
    (rows,) = np.nonzero(holds.any(axis=1) & (last < holds.shape[1] - 1))
    return rows, last[rows], 1


def _speed_window(vehicle: Vehicle, cycle: Cycle, grid: Grid) -> tuple[Array, Array]:
    """Return lowest and highest engine speed that PTO and hydraulics allow, shape (n,) each."""
    works = cycle.pto_power > 0.0
    low = np.maximum(
        cycle.lowest_engine_speed, np.where(works, vehicle.pto_speed_low, 0.0)
    )
    high = np.where(works, vehicle.pto_speed_high, grid.engine_speed[-1])
    return low * (1.0 - _ROUNDING), high * (1.0 + _ROUNDING)


def _window_on_grid(vehicle: Vehicle, cycle: Cycle, grid: Grid) -> Array:
    """Return engine speeds of a step, with the ends of its window among them, shape (n, m)."""
    speed = np.tile(grid.engine_speed, (len(cycle), 1))
    low, high = _speed_window(vehicle, cycle, grid)
    last = len(grid.engine_speed) - 1
    below = np.searchsorted(grid.engine_speed, low, side="right") - 1
    (rows,) = np.nonzero(below >= 0)
    speed[rows, below[rows]] = np.maximum(low[rows], grid.engine_speed[below[rows]])
    above = np.searchsorted(grid.engine_speed, high)
    (rows,) = np.nonzero(above <= last)
    speed[rows, above[rows]] = np.minimum(high[rows], grid.engine_speed[above[rows]])
    return speed


def idle_stage(model: EfficiencyModel) -> str:
    """Return the stage whose zero stroke stands for neutral: the one that turns the output least.

    The pump turns with the engine in neutral, too; the clutches of the stage are open.
    """
    ratios = {}
    for name, stage in model.stages.items():
        ratios[name] = abs(stage.stage.mechanical_speed_ratio)
    return min(ratios, key=ratios.__getitem__)


def idle_torque(model: EfficiencyModel, engine_speed: Array) -> Array:
    """Return what the transmission takes from the engine in neutral [N m], as speeds are shaped."""
    stage = model.without_meters().in_stage(idle_stage(model))
    losses = stage.breakdown(np.zeros_like(engine_speed), engine_speed, 0.0)
    return np.asarray(losses.input_power / engine_speed)


def shaft_power(vehicle: Vehicle, cycle: Cycle) -> Array:
    """Return what PTO and auxiliaries take from the engine [W], shape (n,)."""
    return cycle.pto_power / vehicle.pto_efficiency + cycle.auxiliary_power


def _fuel(engine: Engine, engine_speed: Array, torque: Array) -> Array:
    """Return the fuel rate, infinite where it is not possible, in the shape of the torque."""
    fuel = np.full(torque.shape, np.inf)
    # Most points hold no demand: the map is asked for the others alone.
    held = np.isfinite(torque)
    rates = engine.fuel_rate(engine_speed[held], torque[held])
    fuel[held] = np.where(np.isfinite(rates), rates, np.inf)
    return fuel


def _fuel_with_reserve(
    drive: Drive, engine_speed: Array, torque: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the fuel rate, infinite where it is not possible, and the steps without a reserve.

    A step that no point holds with the reserve may use the full load.
    """
    fuel = _fuel(drive.engine, engine_speed, torque)
    reserve = drive.vehicle.limits.torque_reserve
    highest = (1.0 - reserve) * drive.engine.full_load_torque(engine_speed)
    with_reserve = np.where(torque <= highest * (1.0 + _ROUNDING), fuel, np.inf)
    possible = np.isfinite(fuel).any(axis=(1, 2))
    strained = np.asarray(possible & ~np.isfinite(with_reserve).any(axis=(1, 2)))
    return np.where(strained[:, None, None], fuel, with_reserve), strained


def reason(drive: Drive, cycle: Cycle, points: WorkingPoints, step: int) -> str:
    """Return why no point holds the demand of a step."""
    if not cycle.known[step]:
        return "the demand is not stated"
    if cycle.standing[step] and cycle.output_power[step] > 0.0:
        return f"asks for {1e-3 * cycle.output_power[step]:.1f} kW at standstill"
    speed = f"{cycle.output_speed[step]:.1f} rad/s"
    torque = points.engine_torque[step]
    if not np.isfinite(torque).any():
        if cycle.output_speed[step] < 0.0:
            return f"no stage holds {speed} in reverse"
        return (
            f"no stage holds {1e-3 * cycle.output_power[step]:.1f} kW at {speed} within the "
            "engine speeds allowed"
        )
    full_load = drive.engine.full_load_torque(points.engine_speed[step])
    share = float(np.nanmin(torque / full_load))
    if share < 1.0:
        return "the engine has no fuel data at the torque that it takes"
    return f"beyond the engine: {share:.2f} times its full-load torque"
