# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The causal strategy for a running tractor: the next stage and engine speed, demand by demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hmcvt_core.transmission.ranges import Range

from .cycle import STEP, Cycle
from .moves import Moves, State
from .points import NEUTRAL, SPEED_STEP, Drive, speed_grid, working_points
from .run import situation
from .strategies import causal

_CONTROL_STEP = (
    4.0 * SPEED_STEP
)  # distance of engine speeds [rad/s]: an answer within 20 ms

_STEP_RANGE = Range("step", 0.01, 60.0, "s")


class Command(NamedTuple):
    """What the drive line is to do next.

    Attributes:
        stage: name of the stage.
        engine_speed: [rad/s].
        displacement_ratio: that holds the output at this engine speed [-].
    """

    stage: str
    engine_speed: float
    displacement_ratio: float


@dataclass(frozen=True)
class Controller:
    """Chooses as the strategy `causal`, from the present state alone.

    Attributes:
        drive: the drive line.
        step: within which the drive line gets to what is chosen [s].

    Raises:
        InputError: the step is no number or out of range.
    """

    drive: Drive
    step: float = STEP

    def __post_init__(self) -> None:
        _STEP_RANGE.check(self.step)

    def choose(
        self,
        output_speed: float,
        output_power: float,
        stage: str,
        engine_speed: float,
        displacement_ratio: float,
    ) -> Command | None:
        """Return what to do next to hold an output.

        Args:
            output_speed: to hold [rad/s].
            output_power: to hold [W].
            stage: engaged now.
            engine_speed: now [rad/s].
            displacement_ratio: now [-].

        Returns:
            None where no stage holds the output, and at standstill.

        Raises:
            InputError: a stage change takes longer than the step.
        """
        demand = _demand(output_speed, output_power, self.step)
        limits = self.drive.vehicle.limits
        stages = tuple(self.drive.model.stages)
        grid = speed_grid(stages, self.drive.engine, limits, self.step, _CONTROL_STEP)
        points = working_points(self.drive, demand, grid)
        moves = Moves.of(limits, points, self.step)
        state = State(stages.index(stage), engine_speed, displacement_ratio)
        now = situation(demand, points, moves, state, self.drive.engine, 0)
        if not np.isfinite(now.reachable).any():
            return None
        choice = causal(now)
        if choice.stage == NEUTRAL:
            return None
        row = now.stages.index(choice.stage)
        column = int(np.abs(now.engine_speeds[row] - choice.engine_speed).argmin())
        return Command(
            choice.stage, choice.engine_speed, float(now.stroke[row, column])
        )


def _demand(output_speed: float, output_power: float, step: float) -> Cycle:
    """Return a demand of one step."""
    zero = np.zeros(1)
    return Cycle(
        name="now",
        time=zero,
        step=step,
        output_speed=np.array([output_speed]),
        output_power=np.array([max(output_power, 0.0)]),
        pto_power=zero,
        auxiliary_power=zero,
        lowest_engine_speed=zero,
    )
