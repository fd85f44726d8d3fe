# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which working point the machine can reach from which one within a step.

The engine speed changes by at most its rate. The displacement ratio changes by at most its rate in
the time that a stage change leaves. To and from standstill no stage change is counted: the clutches
are open.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import RPM, Array

from .points import WorkingPoints
from .vehicle import Limits

_ROUNDING = 1e-9  # of a limit


class State(NamedTuple):
    """Where the drive line is.

    Attributes:
        stage: position in `Grid.stages`.
        engine_speed: [rad/s].
        stroke: displacement ratio [-]; NaN in neutral.
    """

    stage: int
    engine_speed: float
    stroke: float


class Points(NamedTuple):
    """Some working points of one step, shape (n,) each.

    Attributes:
        stage: position in `Grid.stages`.
        engine_speed: [rad/s].
        stroke: displacement ratio [-]; NaN in neutral.
    """

    stage: NDArray[np.intp]
    engine_speed: Array
    stroke: Array


@dataclass(frozen=True)
class Moves:
    """Highest changes within a step.

    Attributes:
        engine_speed: of the engine speed [rad/s].
        stroke: of the displacement ratio without a stage change [-].
        stroke_changing: of the displacement ratio with one [-].
        neutral: position of the neutral state among the stages.
    """

    engine_speed: float
    stroke: float
    stroke_changing: float
    neutral: int

    @classmethod
    def of(cls, limits: Limits, points: WorkingPoints, step: float) -> Moves:
        """Return the moves of a machine within a step of the cycle [s].

        Raises:
            InputError: a stage change takes longer than the step.
        """
        left = step - limits.stage_change_time
        if left < 0.0:
            raise InputError(
                f"a stage change takes {limits.stage_change_time:g} s, which is longer than "
                f"the step of {step:g} s: give a longer step"
            )
        rate = limits.displacement_rate * (1.0 + _ROUNDING)
        change = limits.engine_speed_rate * step * (1.0 + _ROUNDING)
        return cls(change, rate * step, rate * left, points.grid.neutral)

    def changes(self, before: int, after: int) -> bool:
        """Whether going from one stage to another is a stage change."""
        return before != after and self.neutral not in (before, after)

    def stroke_limit(self, before: int, after: int) -> float:
        """Return the highest change of the displacement ratio between two stages [-]."""
        if self.changes(before, after):
            return self.stroke_changing
        return self.stroke

    def reachable(
        self, state: State, engine_speed: Array, stroke: Array
    ) -> NDArray[np.bool_]:
        """Return which points are reached from a state.

        Args:
            state: in the step before.
            engine_speed: of the points of a step, shape (s, m) [rad/s].
            stroke: of the same points [-].
        """
        is_near = np.abs(engine_speed - state.engine_speed) <= self.engine_speed
        limits = np.full(len(stroke), self.stroke_changing)
        limits[state.stage] = self.stroke
        # A stroke that is not known is one in neutral: any may follow.
        too_far = np.abs(stroke - state.stroke) > limits[:, None]
        return is_near & ~too_far

    def obstacle(self, state: State, points: WorkingPoints, step: int) -> str:
        """Return which limits keep a state from the nearest possible point of a step, in words.

        Args:
            state: in the step before, from which no point is reached.
            points: of the cycle.
            step: of the cycle; some point holds its demand.
        """
        possible = np.isfinite(points.fuel[step])
        speed_change = np.abs(points.engine_speed[step] - state.engine_speed)
        stroke_change = np.abs(points.stroke[step] - state.stroke)
        stroke_limits = np.full(len(stroke_change), self.stroke_changing)
        stroke_limits[state.stage] = self.stroke
        # The lead over a limit is counted in limits, so that the two compare.
        of_speed = speed_change / self.engine_speed
        of_stroke = np.nan_to_num(stroke_change / stroke_limits[:, None])
        excess = np.where(possible, np.maximum(of_speed, of_stroke), np.inf)
        stage, column = np.unravel_index(int(excess.argmin()), excess.shape)
        at = (int(stage), int(column))
        causes = []
        if of_speed[at] > 1.0:
            causes.append(
                f"the engine speed would have to change by {speed_change[at] / RPM:.0f} r/min, "
                f"of at most {self.engine_speed / RPM:.0f}"
            )
        if of_stroke[at] > 1.0:
            causes.append(
                f"the displacement ratio would have to change by {stroke_change[at]:.2f}, "
                f"of at most {stroke_limits[at[0]]:.2f}"
            )
        if not causes:
            causes.append("a stage change leaves the engine too little torque")
        name = points.grid.stages[at[0]]
        return f"to the nearest point, in stage {name}, {' and '.join(causes)}"

    def between(self, before: Points, after: Points) -> tuple[Any, Any]:
        """Return which points are reached from which, and where a stage changes.

        Args:
            before: n points.
            after: k points.

        Returns:
            Two arrays of truth, shape (n, k).
        """
        from_stage = before.stage[:, None]
        changes = from_stage != after.stage
        changes &= (from_stage != self.neutral) & (after.stage != self.neutral)
        speed = np.abs(before.engine_speed[:, None] - after.engine_speed)
        stroke = np.abs(before.stroke[:, None] - after.stroke)
        limit = np.where(changes, self.stroke_changing, self.stroke)
        return (speed <= self.engine_speed) & ~(stroke > limit), changes

    def cost(self, state: State | None, points: WorkingPoints, step: int) -> Array:
        """Return the fuel of each point of a step, infinite where it is not reached.

        Args:
            state: in the step before; None where any point may be taken.
            points: of the cycle.
            step: of the cycle.

        Returns:
            Shape (s, m) [kg/s].
        """
        if state is None:
            return points.fuel[step]
        fuel = points.fuel_changing[step].copy()
        kept = state.stage
        fuel[kept] = points.fuel[step, kept]
        fuel[self.neutral] = points.fuel[step, self.neutral]
        if kept == self.neutral:
            fuel = points.fuel[step]
        reached = self.reachable(state, points.engine_speed[step], points.stroke[step])
        return np.where(reached, fuel, np.inf)
