# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Strategies: what chooses stage and engine speed at each step, knowing the past alone.

A strategy is called at each step that some working point holds, with a `Situation`, and returns a
stage and an engine speed. It may ask for what the machine cannot do: the run then takes the
reachable point next to it and names the step (`run`).
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.model.engine import Engine
from hmcvt_core.transmission.ranges import RPM, Array

from .moves import Moves, Points

ASSUMED_EFFICIENCY = 0.8
"""Efficiency that the engine's line assumes of the transmission everywhere [-]."""

FIXED_SPEED = 1900.0 * RPM
"""Engine speed that `fixed_speed` holds when none is given [rad/s]."""

HYSTERESIS = 0.005
"""Fraction of the fuel that another stage or a distant engine speed must save; chosen on the
shipped cycles."""

NEAR_SPEED = 50.0 * RPM
"""Change of the engine speed in a second that needs no saving [rad/s2]; chosen likewise."""

HORIZON = 10.0
"""Time for which the demand is taken to stay [s]; chosen on the shipped cycles."""

_STATIONS = 80  # points that a way may lead over: more barely change it
_LINE_SPEEDS = 200  # at which the engine's line is looked for
_SAME_SPEED = 15.0 * RPM  # difference of engine speeds that counts as none


class Choice(NamedTuple):
    """What a strategy asks for.

    Attributes:
        stage: name of the stage.
        engine_speed: [rad/s]; the nearest one of the grid is taken.
    """

    stage: str
    engine_speed: float


@dataclass(frozen=True, eq=False)
class Situation:
    """What a strategy knows at one step: the demand, the state before, and what points cost.

    Attributes:
        time: beginning of the step [s].
        output_speed: demand [rad/s].
        output_power: demand [W].
        pto_power: demand [W].
        auxiliary_power: demand [W].
        stage: engaged in the step before; None at the beginning.
        engine_speed: in the step before [rad/s]; NaN at the beginning.
        displacement_ratio: in the step before [-]; NaN at the beginning and in neutral.
        stages: names, in the order of the arrays.
        engine_speeds: of each point, shape (s, m), rising [rad/s].
        stroke: displacement ratio of each point, shape (s, m) [-].
        engine_torque: of each point by the strategy's model [N m]; NaN where none holds.
        fuel: of each point by the strategy's model, without the loss of a stage change;
            infinite where the point is not possible, shape (s, m) [kg/s].
        fuel_changing: with that loss.
        reachable: fuel in this step, with that loss where the stage changes; infinite also where
            the machine cannot be within the step.
        engine: of the drive line.
        step: length of the step [s].
        moves: what the machine can change within a step.
    """

    time: float
    output_speed: float
    output_power: float
    pto_power: float
    auxiliary_power: float
    stage: str | None
    engine_speed: float
    displacement_ratio: float
    stages: tuple[str, ...]
    engine_speeds: Array
    stroke: Array
    engine_torque: Array
    fuel: Array
    fuel_changing: Array
    reachable: Array
    engine: Engine
    step: float
    moves: Moves

    def choice(self, position: int) -> Choice:
        """Return the point at a position of the flattened arrays."""
        at = np.unravel_index(position, self.fuel.shape)
        return Choice(self.stages[int(at[0])], float(self.engine_speeds[at]))


Strategy = Callable[[Situation], Choice]


def least_fuel(now: Situation) -> Choice:
    """Choose the least fuel of this step among the points that the machine reaches."""
    return now.choice(int(now.reachable.argmin()))


def causal(now: Situation) -> Choice:
    """Choose what needs least fuel if the demand stays for `HORIZON`, with all changes on the way.

    A way to a distant point may lead through worse ones: an engine speed that takes several steps,
    a stage that is reached at another displacement ratio. A point of another stage, or of a distant
    engine speed, must save more than `HYSTERESIS`: demands fluctuate, and stage and engine speed
    would hunt.
    """
    candidates = np.flatnonzero(np.isfinite(now.reachable))
    cost = now.reachable.ravel()[candidates] + _future(now, candidates)
    if now.stage is not None:
        points = _points(now, candidates)
        is_far = np.abs(points.engine_speed - now.engine_speed) > NEAR_SPEED * now.step
        is_far |= points.stage != now.stages.index(now.stage)
        cost[is_far] *= 1.0 + HYSTERESIS
    return now.choice(int(candidates[cost.argmin()]))


def _future(now: Situation, candidates: NDArray[np.intp]) -> Array:
    """Return the least fuel of the steps after candidates if the demand stays, shape (n,).

    The engine either stays at the candidate, or moves on over other points.
    """
    steps = max(1, round(HORIZON / now.step))
    fuel = now.fuel.ravel()
    changing = now.fuel_changing.ravel()
    staying = steps * fuel[candidates]
    possible = np.flatnonzero(np.isfinite(fuel))
    stations = possible[:: max(1, len(possible) // _STATIONS)]
    at = _points(now, stations)
    cost = _move_cost(now, at, at, fuel[stations], changing[stations])
    later = np.zeros(len(stations))
    for _ in range(steps - 1):
        later = (cost + later).min(axis=1)
    first = _move_cost(
        now, _points(now, candidates), at, fuel[stations], changing[stations]
    )
    return np.asarray(np.minimum(staying, (first + later).min(axis=1)))


def _points(now: Situation, positions: NDArray[np.intp]) -> Points:
    """Return the points at positions of the flattened arrays."""
    return Points(
        positions // now.fuel.shape[1],
        now.engine_speeds.ravel()[positions],
        now.stroke.ravel()[positions],
    )


def _move_cost(
    now: Situation, before: Points, after: Points, fuel: Array, changing: Array
) -> Array:
    """Return the fuel of a step that moves from points to others, shape (n, k) [kg/s].

    Args:
        now: gives the limits of the machine.
        before: n points.
        after: k points.
        fuel: of these without a stage change, shape (k,) [kg/s].
        changing: the same with a stage change.
    """
    is_reached, changes = now.moves.between(before, after)
    return np.where(is_reached, np.where(changes, changing, fuel), np.inf)


def engine_line(now: Situation) -> Choice:
    """Choose the engine's optimal line: the speed of its least fuel for the power asked for.

    The transmission enters with one efficiency. The stage is kept while it holds the demand near
    that speed; otherwise the one with the least stroke follows.
    """
    speeds = now.engine.speed
    fine = np.linspace(speeds[0], speeds[-1], _LINE_SPEEDS)
    power = now.output_power / ASSUMED_EFFICIENCY
    power += now.pto_power / ASSUMED_EFFICIENCY + now.auxiliary_power
    rates = now.engine.fuel_rate(fine, power / fine)
    if not np.isfinite(rates).any():
        return _at_speed(now, float(speeds[-1]))
    return _at_speed(now, float(fine[np.nanargmin(rates)]))


def fixed_speed(engine_speed: float = FIXED_SPEED) -> Strategy:
    """Return the strategy that holds an engine speed [rad/s] where the demand allows it."""
    return partial(_at_speed, engine_speed=engine_speed)


def _at_speed(now: Situation, engine_speed: float) -> Choice:
    """Return the reachable point next to an engine speed: of the stage kept, or of least stroke."""
    distance = np.abs(now.engine_speeds - engine_speed)
    distance = np.where(np.isfinite(now.reachable), distance, np.inf)
    nearest = distance.min(axis=1)
    close = nearest <= nearest.min() + _SAME_SPEED
    stages = np.flatnonzero(close)
    if now.stage is not None and close[now.stages.index(now.stage)]:
        stages = np.array([now.stages.index(now.stage)])
    speeds = distance[stages].argmin(axis=1)
    strokes = np.abs(np.nan_to_num(now.stroke[stages, speeds]))
    least = int(strokes.argmin())
    return Choice(
        now.stages[stages[least]],
        float(now.engine_speeds[stages[least], speeds[least]]),
    )


STRATEGIES: dict[str, Strategy] = {
    "causal": causal,
    "least_fuel": least_fuel,
    "engine_line": engine_line,
    "fixed_speed": fixed_speed(),
}
"""The shipped strategies by name."""


def strategy_named(name: str) -> Strategy:
    """Return a shipped strategy, or the one of a Python file that you wrote; the file is run.

    Args:
        name: of `STRATEGIES`, or a path that ends in `.py`; the file defines
            `choose(now)`, which takes a `Situation` and returns a stage and an engine speed.

    Raises:
        InputError: there is no such strategy, or the file cannot be loaded.
    """
    if name in STRATEGIES:
        return STRATEGIES[name]
    if not name.endswith(".py"):
        raise InputError(
            f"strategy {name!r} is not known; there is {', '.join(STRATEGIES)}, or a Python "
            "file with a function choose(now)"
        )
    path = Path(name)
    spec = importlib.util.spec_from_file_location(f"hmcvt_strategy_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # the path ends in .py
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # a file of a user may raise anything
        raise InputError(
            f"{name}: cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    choose = getattr(module, "choose", None)
    if not callable(choose):
        raise InputError(f"{name}: holds no function choose(now)")
    strategy: Strategy = choose
    return strategy


def checked_choice(answer: Any, stages: tuple[str, ...]) -> Choice:
    """Return what a strategy answers as a choice.

    Raises:
        InputError: it is not one of the stages and an engine speed.
    """
    try:
        name, value = answer
        choice = Choice(str(name), float(value))
    except (TypeError, ValueError):
        raise InputError(f"{answer!r} is not a stage and an engine speed") from None
    if choice.stage not in stages:
        raise InputError(
            f"stage {choice.stage!r} is not known; there is {', '.join(stages)}"
        )
    if not math.isfinite(choice.engine_speed):
        raise InputError(f"engine speed = {choice.engine_speed} is not finite")
    return choice
