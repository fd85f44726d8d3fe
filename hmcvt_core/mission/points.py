# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The working points that hold the demand of each step, on a grid of stages and engine speeds.

In a stage every engine speed needs one displacement ratio to hold the output, which the balance
gives without a search. Strategies and the bound choose among the same points, so that no strategy
beats the bound by a finer grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..model.engine import Engine
from ..model.model import NO_OPTIMUM, EfficiencyModel
from ..physics.balance import BalanceSolver
from ..physics.regimes import Senses
from ..transmission.ranges import RPM, Array
from .cycle import Cycle
from .vehicle import Limits, Vehicle

NEUTRAL = "neutral"
"""Name of the state in which the output stands and the engine idles or drives the PTO."""

SPEED_STEP = 10.0 * RPM
"""Distance of engine speeds of the grid when none is given [rad/s]."""

_EDGE = 1e-9  # of the stroke: rounding at full stroke
_ROUNDING = 1e-9  # of a limit


@dataclass(frozen=True, eq=False)
class Grid:
    """Stages and engine speeds to choose from.

    Attributes:
        stages: names, `NEUTRAL` last.
        engine_speed: rising, shape (m,) [rad/s].
        reach: steps of the engine speed that it can change by within a step of the cycle.
    """

    stages: tuple[str, ...]
    engine_speed: Array
    reach: int

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
    """Return the grid of a cycle; half the distance gives a grid that holds the first one.

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
    change = limits.engine_speed_rate * step
    reach = math.ceil(change / distance * (1.0 - _ROUNDING))
    spacing = change / reach
    count = math.floor((high - low) / spacing * (1.0 + _ROUNDING)) + 1
    return Grid((*stages, NEUTRAL), low + spacing * np.arange(count), reach)


@dataclass(frozen=True, eq=False)
class WorkingPoints:
    """What each point of the grid costs at each step.

    Attributes:
        grid: stages and engine speeds.
        stroke: displacement ratio, shape (n, s, m) [-]; NaN in neutral and where none holds.
        engine_torque: without a stage change, shape (n, s, m) [N m]; NaN where none holds.
        fuel: shape (n, s, m) [kg/s]; infinite where the point is not possible.
        fuel_changing: the same in a step with a stage change.
        strained: steps that leave no torque reserve, shape (n,).
    """

    grid: Grid
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
        return np.isfinite(self.fuel).any(axis=(1, 2))


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
    stroke = np.full(shape, np.nan)
    torque = np.full(shape, np.nan)
    models = drive.model.without_meters().stages
    for i, name in enumerate(grid.stages[:-1]):
        solver = models[name].balance(NO_OPTIMUM)
        stroke[:, i], torque[:, i] = _held(solver, cycle, grid.engine_speed)
    at_rest = cycle.standing & cycle.known & (cycle.output_power == 0.0)
    torque[at_rest, -1] = idle_torque(drive.model, grid.engine_speed)
    torque += _shaft_power(drive.vehicle, cycle)[:, None, None] / grid.engine_speed
    torque = np.where(_pto_allows(drive.vehicle, cycle, grid), torque, np.nan)
    fuel, strained = _fuel_with_reserve(drive, grid.engine_speed, torque)
    change = drive.vehicle.limits.stage_change_loss / cycle.step
    changing = _fuel(
        drive.engine, grid.engine_speed, torque + change / grid.engine_speed
    )
    fuel_changing = np.where(np.isfinite(fuel), changing, np.inf)
    return WorkingPoints(grid, stroke, torque, fuel, fuel_changing, strained)


def _held(
    solver: BalanceSolver, cycle: Cycle, engine_speed: Array
) -> tuple[Array, Array]:
    """Return displacement ratio and engine torque of a stage, shape (n, m); NaN for none."""
    shape = (len(cycle), len(engine_speed))
    stroke = np.full(shape, np.nan)
    torque = np.full(shape, np.nan)
    moving = cycle.known & ~cycle.standing
    for sense in (1, -1):
        rows = np.flatnonzero(moving & (sense * cycle.output_speed > 0.0))
        if not len(rows):
            continue
        speeds = np.tile(engine_speed, len(rows))
        outputs = np.repeat(cycle.output_speed[rows], len(engine_speed))
        powers = np.repeat(cycle.output_power[rows], len(engine_speed))
        strokes, torques = solver.held(
            speeds, outputs, powers / speeds, senses=Senses(sense, 1)
        )
        within = np.clip(strokes, -1.0, 1.0)
        holds = np.abs(strokes - within) < _EDGE
        stroke[rows] = np.where(holds, within, np.nan).reshape(len(rows), -1)
        torque[rows] = np.where(holds, torques, np.nan).reshape(len(rows), -1)
    return np.where(np.isnan(torque), np.nan, stroke), torque


def idle_stage(model: EfficiencyModel) -> str:
    """Return the stage whose zero stroke stands for neutral: the one that turns the output least.

    The pump turns with the engine in neutral, too; the clutches of the stage are open.
    """
    ratios = {}
    for name, stage in model.stages.items():
        ratios[name] = abs(stage.stage.mechanical_speed_ratio)
    return min(ratios, key=ratios.__getitem__)


def idle_torque(model: EfficiencyModel, engine_speed: Array) -> Array:
    """Return what the transmission takes from the engine in neutral [N m], shape (m,)."""
    stage = model.without_meters().in_stage(idle_stage(model))
    losses = stage.breakdown(np.zeros_like(engine_speed), engine_speed, 0.0)
    return np.asarray(losses.input_power) / engine_speed


def _shaft_power(vehicle: Vehicle, cycle: Cycle) -> Array:
    """Return what PTO and auxiliaries take from the engine [W], shape (n,)."""
    return cycle.pto_power / vehicle.pto_efficiency + cycle.auxiliary_power


def _pto_allows(vehicle: Vehicle, cycle: Cycle, grid: Grid) -> NDArray[np.bool_]:
    """Return at which steps the PTO allows which engine speed, shape (n, 1, m)."""
    speed = grid.engine_speed
    low = vehicle.pto_speed_low * (1.0 - _ROUNDING)
    high = vehicle.pto_speed_high * (1.0 + _ROUNDING)
    in_window = (speed >= low) & (speed <= high)
    works = cycle.pto_power > 0.0
    return (~works[:, None] | in_window)[:, None, :]


def _fuel(engine: Engine, engine_speed: Array, torque: Array) -> Array:
    """Return the fuel rate, infinite where it is not possible, in the shape of the torque."""
    fuel = np.full(torque.shape, np.inf)
    speeds = np.broadcast_to(engine_speed, torque.shape)
    # Most points hold no demand: the map is asked for the others alone.
    held = np.isfinite(torque)
    rates = engine.fuel_rate(speeds[held], torque[held])
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
    with_reserve = np.where(torque <= highest, fuel, np.inf)
    possible = np.isfinite(fuel).any(axis=(1, 2))
    strained = possible & ~np.isfinite(with_reserve).any(axis=(1, 2))
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
    full_load = drive.engine.full_load_torque(points.grid.engine_speed)
    share = float(np.nanmin(torque / full_load))
    if share < 1.0:
        return "the engine has no fuel data at the torque that it takes"
    return f"beyond the engine: {share:.2f} times its full-load torque"
