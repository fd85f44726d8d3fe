# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The run of a strategy over a cycle: step by step, within the limits of the machine.

The strategy chooses by its own model, which may differ from the tractor that is driven. Where it
asks for what the tractor cannot do, the reachable point next to it is taken and the step is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.model.engine import Engine
from hmcvt_core.transmission.ranges import RPM, Array

from .cycle import Cycle
from .moves import Moves, State
from .points import Drive, Grid, WorkingPoints
from .strategies import Choice, Situation, Strategy, checked_choice

NOWHERE = -1
"""Position of stage and speed where nothing holds the demand."""


class Complaint(NamedTuple):
    """What did not go as asked at a step.

    Attributes:
        time: beginning of the step [s].
        reason: in words.
    """

    time: float
    reason: str


class Run(NamedTuple):
    """What a strategy did.

    Attributes:
        stage: position of the stage, shape (n,); `NOWHERE` where nothing holds the demand.
        speed: position of the engine speed, shape (n,); likewise.
        changed: whether the step began with a stage change, shape (n,).
        broken: steps that the machine could not reach within its limits.
        replaced: choices of the strategy that were not possible.
    """

    stage: NDArray[np.intp]
    speed: NDArray[np.intp]
    changed: NDArray[np.bool_]
    broken: Sequence[Complaint]
    replaced: Sequence[Complaint]

    def fuel(self, points: WorkingPoints) -> Array:
        """Return the fuel rate at each step, shape (n,) [kg/s]; zero where nothing holds it."""
        rate = np.zeros(len(points))
        (driven,) = np.nonzero(self.stage != NOWHERE)
        at = (driven, self.stage[driven], self.speed[driven])
        rate[driven] = np.where(
            self.changed[driven], points.fuel_changing[at], points.fuel[at]
        )
        return rate


def drive_cycle(
    strategy: Strategy,
    drive: Drive,
    cycle: Cycle,
    points: WorkingPoints,
    believed: WorkingPoints | None = None,
) -> Run:
    """Drive a cycle with a strategy.

    Args:
        strategy: chooses at each step.
        drive: the drive line.
        cycle: demand.
        points: working points of the tractor.
        believed: working points by the model that the strategy knows; the tractor's when left
            out.

    Raises:
        InputError: a stage change takes longer than a step.
    """
    return _Runner(strategy, drive, cycle, points, believed or points).run()


class _Runner:
    """Keeps the state from step to step; see `drive_cycle`."""

    def __init__(
        self,
        strategy: Strategy,
        drive: Drive,
        cycle: Cycle,
        points: WorkingPoints,
        believed: WorkingPoints,
    ) -> None:
        self._strategy = strategy
        self._engine = drive.engine
        self._cycle = cycle
        self._points = points
        self._believed = believed
        self._moves = Moves.of(drive.vehicle.limits, points, cycle.step)
        self._state: State | None = None
        self._broken: list[Complaint] = []
        self._replaced: list[Complaint] = []

    def run(self) -> Run:
        count = len(self._points)
        stage = np.full(count, NOWHERE, dtype=np.intp)
        speed = stage.copy()
        changed = np.zeros(count, dtype=bool)
        for k in np.flatnonzero(self._points.possible).tolist():
            if k == 0 or stage[k - 1] == NOWHERE:
                self._state = None
            stage[k], speed[k] = self._next(k)
            at = (k, stage[k], speed[k])
            if self._state is not None:
                changed[k] = self._moves.changes(self._state.stage, int(stage[k]))
            self._state = State(
                int(stage[k]),
                float(self._points.engine_speed[at]),
                float(self._points.stroke[at]),
            )
        return Run(stage, speed, changed, self._broken, self._replaced)

    def _next(self, k: int) -> tuple[int, int]:
        """Return positions of stage and engine speed of a step."""
        cost = self._moves.cost(self._state, self._points, k)
        if self._state is not None and not np.isfinite(cost).any():
            obstacle = self._moves.obstacle(self._state, self._points, k)
            self._broken.append(
                Complaint(
                    float(self._cycle.time[k]),
                    f"no working point is within the limits of the machine: {obstacle}",
                )
            )
            cost = self._points.fuel[k]
        wanted = self._wanted(k)
        grid = self._points.grid
        stage, speed = _nearest(wanted, grid, self._points.engine_speed[k], cost)
        taken = Choice(
            grid.stages[stage], float(self._points.engine_speed[k, stage, speed])
        )
        if wanted is not None and not _is_met(wanted, taken, grid.spacing):
            self._replaced.append(
                Complaint(
                    float(self._cycle.time[k]),
                    f"asked for {wanted.stage} at {wanted.engine_speed / RPM:.0f} r/min, "
                    f"which is not possible; taken: {taken.stage} at "
                    f"{taken.engine_speed / RPM:.0f} r/min",
                )
            )
        return stage, speed

    def _wanted(self, k: int) -> Choice | None:
        """Return what the strategy asks for; None where its model holds nothing, or it fails."""
        now = situation(
            self._cycle, self._believed, self._moves, self._state, self._engine, k
        )
        if not np.isfinite(now.reachable).any():
            return None
        try:
            return checked_choice(self._strategy(now), now.stages)
        except InputError as error:
            complaint = str(error)
        except Exception as error:  # a strategy of a user may raise anything
            complaint = f"{type(error).__name__}: {error}"
        self._replaced.append(
            Complaint(
                float(self._cycle.time[k]), f"{complaint}; the least fuel is taken"
            )
        )
        return None


def situation(
    cycle: Cycle,
    points: WorkingPoints,
    moves: Moves,
    state: State | None,
    engine: Engine,
    k: int,
) -> Situation:
    """Return what a strategy knows at a step.

    Args:
        cycle: demand.
        points: working points by the model that the strategy has.
        moves: of the machine.
        state: in the step before; None at the beginning.
        engine: of the drive line.
        k: the step.
    """
    grid = points.grid
    reachable = moves.cost(state, points, k)
    if not np.isfinite(reachable).any():
        reachable = points.fuel[k]
    return Situation(
        time=float(cycle.time[k]),
        output_speed=float(cycle.output_speed[k]),
        output_power=float(cycle.output_power[k]),
        pto_power=float(cycle.pto_power[k]),
        auxiliary_power=float(cycle.auxiliary_power[k]),
        stage=None if state is None else grid.stages[state.stage],
        engine_speed=np.nan if state is None else state.engine_speed,
        displacement_ratio=np.nan if state is None else state.stroke,
        stages=grid.stages,
        engine_speeds=points.engine_speed[k],
        stroke=points.stroke[k],
        engine_torque=points.engine_torque[k],
        fuel=points.fuel[k],
        fuel_changing=points.fuel_changing[k],
        reachable=reachable,
        engine=engine,
        step=cycle.step,
        moves=moves,
    )


def _nearest(
    choice: Choice | None, grid: Grid, engine_speed: Array, cost: Array
) -> tuple[int, int]:
    """Return the possible point next to a choice: of its stage if any, else of least fuel.

    Args:
        choice: what the strategy asks for, or None.
        grid: stages and engine speeds.
        engine_speed: of each point, shape (s, m) [rad/s].
        cost: fuel of each point, infinite where it is not possible, shape (s, m) [kg/s].
    """
    if choice is not None:
        stage = grid.stages.index(choice.stage)
        possible = np.isfinite(cost[stage])
        if possible.any():
            distance = np.abs(engine_speed[stage] - choice.engine_speed)
            return stage, int(np.where(possible, distance, np.inf).argmin())
    least = np.unravel_index(int(cost.argmin()), cost.shape)
    return int(least[0]), int(least[1])


def _is_met(wanted: Choice, taken: Choice, spacing: float) -> bool:
    """Whether a choice was taken, but for the distance of the grid."""
    difference = abs(wanted.engine_speed - taken.engine_speed)
    return wanted.stage == taken.stage and difference <= spacing
