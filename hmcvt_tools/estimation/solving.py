# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The load behind an engine torque, at the output speed that the bus states.

Engine speed and output speed are known far better than the displacement ratio, so the model is held
at the output speed and searched for the load at which it takes the engine torque. The displacement
ratio follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.model.model import NO_OPTIMUM, EfficiencyModel
from hmcvt_core.physics.balance import BalanceSolver
from hmcvt_core.transmission.parameters import PARAMETER_RANGES, HydraulicParameters
from hmcvt_core.transmission.ranges import ANY_LOAD, CHUNK, OIL_TEMPERATURE, Array
from hmcvt_core.transmission.stage import speed_ratio

_SECANTS = 5
_BISECTIONS = 40
_TOLERANCE = 0.02
"""Of the engine torque [N m]; a bus steps by several."""
_FIRST_EFFICIENCY = 0.8
_FIRST_STEP = 20.0
"""Between the two loads with which the search begins [N m]."""
_SLOPE_STEP = 1.0
"""Of the load, for the slope of the engine torque [N m]."""
_FRACTION_OF_ERROR = 0.1
"""Step of a parameter in its standard errors, for the change of the engine torque."""
QUANTILE = 1.6449
"""Of the normal distribution, for intervals of 90 %."""
STROKE_SLACK = 0.05
"""By which a displacement ratio may exceed full stroke, besides the errors of the parameters:
errors of speeds and of the slip."""
_REACH_SLACK = 0.06
"""Fraction by which slip moves the speed ratio beyond that of full stroke."""
_LARGEST_SLIP = 0.6
"""Displacement ratio that slip takes at most: 0.3 at full load as identified, and twice as much
of a unit whose leakage has doubled (development drives)."""


class Solved(NamedTuple):
    """Loads and what they change with; arrays of shape (n,), NaN without an answer.

    Attributes:
        load_torque: output power / engine speed [N m].
        displacement_ratio: [-].
        load_per_torque: change of the load with the engine torque [-].
        parameter_change: change of the load by one standard error of each parameter, (p, n).
        stroke_deviation: standard deviation of the displacement ratio by the parameters [-].
    """

    load_torque: Array
    displacement_ratio: Array
    load_per_torque: Array
    parameter_change: Array
    stroke_deviation: Array


def unsolved(count: int, parameters: int) -> Solved:
    """Return results without any load: NaN throughout.

    Args:
        count: of the results.
        parameters: with a standard error.
    """
    changes = np.full((parameters, count), np.nan)
    load, stroke, slope, deviation = np.full((4, count), np.nan)
    return Solved(load, stroke, slope, changes, deviation)


class _Held(NamedTuple):
    """What is held while a load is searched; arrays of shape (n,).

    Attributes:
        engine_speed: [rad/s].
        output_speed: [rad/s].
        oil_temperature: [deg C]; known at all rows, or else at none.
    """

    engine_speed: Array
    output_speed: Array
    oil_temperature: Array

    def rows(self, rows: NDArray[np.intp]) -> _Held:
        """Return some of the rows."""
        return _Held(*(column[rows] for column in self))

    def balanced(
        self, balance: BalanceSolver, load_torque: Array
    ) -> tuple[Array, Array]:
        """Return the displacement ratio and engine torque at loads [N m]."""
        known = OIL_TEMPERATURE.contains(self.oil_temperature).all()
        return balance.held(
            self.engine_speed,
            self.output_speed,
            load_torque,
            oil_temperature=self.oil_temperature if known else None,
        )


class StageSolver:
    """Finds loads in one stage.

    Args:
        model: of one stage.

    Attributes:
        stage: gear train of the stage.
    """

    def __init__(self, model: EfficiencyModel) -> None:
        self._model = model
        self.stage = model.stage
        self._balance = model.balance(NO_OPTIMUM)

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest speed ratio without slip [-]."""
        ends = speed_ratio(self.stage, np.array([-1.0, 1.0]))
        if self.stage.layout == "output_coupled":
            # Beyond a pole the ratio turns round: the whole range is searched.
            strokes = np.linspace(-1.0, 1.0, 401)
            ends = speed_ratio(self.stage, strokes)
            ends = ends[~self._balance.beyond_pole(strokes)]
        return float(np.min(ends)), float(np.max(ends))

    @cached_property
    def _neighbours(self) -> list[tuple[float, BalanceSolver]]:
        """Steps in a standard error, and the model one step away, for each parameter."""
        model = self._model
        if not model.states_errors:
            return []
        values = model.parameters.to_array()
        neighbours = []
        for i, name in enumerate(model.standard_errors):
            step = _FRACTION_OF_ERROR * model.standard_errors[name]
            if values[i] + step > PARAMETER_RANGES[i].high:
                step = -step
            moved = values.copy()
            moved[i] += step
            parameters = HydraulicParameters(*moved.tolist())
            near = replace(model, parameters=parameters)
            count = model.standard_errors[name] / step
            neighbours.append((count, near.balance(NO_OPTIMUM)))
        return neighbours

    def solve(
        self,
        engine_speed: Array,
        output_speed: Array,
        engine_torque: Array,
        oil_temperature: Array | None = None,
    ) -> Solved:
        """Return the loads at which the stage takes engine torques.

        Args:
            engine_speed: [rad/s], shape (n,).
            output_speed: [rad/s], shape (n,).
            engine_torque: [N m], shape (n,).
            oil_temperature: [deg C], shape (n,), which only effects read; NaN or None where it is
                not known.
        """
        count = len(engine_speed)
        temperature = np.full(count, np.nan)
        if oil_temperature is not None:
            temperature = oil_temperature
        known = OIL_TEMPERATURE.contains(temperature)
        at = _Held(engine_speed, output_speed, temperature)
        solved = unsolved(count, len(self._neighbours))
        for rows in (np.flatnonzero(known), np.flatnonzero(~known)):
            for start in range(0, len(rows), CHUNK):
                chunk = rows[start : start + CHUNK]
                part = self._solve_chunk(at.rows(chunk), engine_torque[chunk])
                for column, values in zip(solved, part, strict=True):
                    column[..., chunk] = values
        return solved

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def _solve_chunk(self, at: _Held, engine_torque: Array) -> Solved:
        load = self._load(at, engine_torque)
        stroke, torque = at.balanced(self._balance, load)
        _, above = at.balanced(self._balance, load + _SLOPE_STEP)
        slope = (above - torque) / _SLOPE_STEP
        changes = []
        stroke_variance = np.zeros(len(load))
        for count, neighbour in self._neighbours:
            moved_stroke, moved = at.balanced(neighbour, load)
            changes.append(-count * (moved - torque) / slope)
            stroke_variance += (count * (moved_stroke - stroke)) ** 2
        deviation = np.sqrt(stroke_variance)
        in_reach = np.abs(stroke) <= 1.0 + STROKE_SLACK + QUANTILE * deviation
        in_reach &= np.abs(torque - engine_torque) <= 10.0 * _TOLERANCE
        in_reach &= slope > 0.0
        change = np.array(changes).reshape(len(changes), len(load))
        return Solved(
            np.where(in_reach, load, np.nan),
            np.where(in_reach, np.clip(stroke, -1.0, 1.0), np.nan),
            np.where(in_reach, 1.0 / slope, np.nan),
            np.where(in_reach, change, np.nan),
            np.where(in_reach, deviation, np.nan),
        )

    def _load(self, held: _Held, engine_torque: Array) -> Array:
        """Search the load by secants; what they miss, by bisection."""
        at = _FIRST_EFFICIENCY * engine_torque
        before = at - _FIRST_STEP
        _, torque_before = held.balanced(self._balance, before)
        for _ in range(_SECANTS):
            _, torque = held.balanced(self._balance, at)
            slope = (torque - torque_before) / (at - before)
            step = (engine_torque - torque) / slope
            done = np.abs(engine_torque - torque) <= _TOLERANCE
            if done.all():
                return at
            following = np.where(done, at, at + step)
            before = np.where(done, before, at)
            torque_before = np.where(done, torque_before, torque)
            at = np.clip(following, ANY_LOAD.low, ANY_LOAD.high)
        _, torque = held.balanced(self._balance, at)
        missed = ~(np.abs(engine_torque - torque) <= _TOLERANCE)
        (rows,) = np.nonzero(missed)
        if len(rows):
            at = at.copy()
            at[rows] = self._bisected(held.rows(rows), engine_torque[rows])
        return at

    def _bisected(self, held: _Held, engine_torque: Array) -> Array:
        low = np.minimum(2.0 * engine_torque, -1000.0)
        high = np.maximum(engine_torque, 0.0)
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            _, torque = held.balanced(self._balance, middle)
            # A stage that is stalled at a load takes no more.
            below = torque < engine_torque
            low = np.where(below, middle, low)
            high = np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))


@dataclass(frozen=True)
class Stages:
    """The stages of a transmission, and which one is engaged.

    Attributes:
        solvers: by name.
    """

    solvers: Mapping[str, StageSolver]

    @classmethod
    def of(cls, model: EfficiencyModel) -> Stages:
        """Return the stages of a model, without errors of a bench's meters."""
        physical = model.without_meters()
        return cls({n: StageSolver(part) for n, part in physical.stages.items()})

    @property
    def names(self) -> list[str]:
        """Names in the order of the file."""
        return list(self.solvers)

    def require_known(self, names: NDArray[np.str_], source: str) -> None:
        """Raise an `InputError` where a log names a stage that the model does not have."""
        unknown = sorted(set(np.unique(names).tolist()) - {"", *self.solvers})
        if unknown:
            raise InputError(
                f"{source}: stage {unknown[0]!r} is not known to the model; there is "
                f"{', '.join(self.solvers)} (--stage-names {unknown[0]}="
                f"{self.names[0]} says which it is)"
            )

    def engaged(
        self,
        ratio: Array,
        displacement_ratio: Array | None,
        stated: NDArray[np.str_] | None,
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the stage of each row by number, and a second one that it may be; -1 for none.

        A stated stage is the first; the second is then the one that fits best without it.

        Args:
            ratio: output speed / engine speed [-], shape (n,).
            displacement_ratio: as measured [-], shape (n,), or None.
            stated: names of the stages engaged, shape (n,), empty where unknown; or None.
        """
        distances = self._distances(ratio, displacement_ratio)
        order = np.argsort(distances, axis=0, kind="stable")
        rows = np.arange(len(ratio))
        first = order[0]
        first_distance = distances[first, rows]
        first = np.where(np.isfinite(first_distance), first, -1)
        second = np.full(len(ratio), -1)
        if len(self.solvers) > 1:
            second = order[1]
            second_distance = distances[second, rows]
            second = np.where(np.isfinite(second_distance), second, -1)
        if stated is not None:
            numbers = {name: number for number, name in enumerate(self.solvers)}
            names, index = np.unique(stated, return_inverse=True)
            of_name = [numbers.get(str(name), -1) for name in names]
            number = np.array(of_name, dtype=np.intp)[index]
            is_stated = number >= 0
            second = np.where(is_stated & (first != number), first, second)
            first = np.where(is_stated, number, first)
        return first, second

    def _distances(self, ratio: Array, displacement_ratio: Array | None) -> Array:
        """How badly each stage fits, infinite where it cannot be, shape (stages, n)."""
        distances = np.full((len(self.solvers), len(ratio)), np.inf)
        for row, solver in enumerate(self.solvers.values()):
            low, high = solver.reach
            slack = _REACH_SLACK * max(abs(low), abs(high))
            outside = np.maximum(np.maximum(low - ratio, ratio - high), 0.0)
            fits = outside <= slack
            distance = outside / slack
            if displacement_ratio is not None:
                expected = self._stroke_without_slip(solver, ratio)
                apart = np.abs(expected - displacement_ratio)
                known = np.isfinite(apart)
                fits &= ~known | (apart <= _LARGEST_SLIP + STROKE_SLACK)
                distance = np.where(known, apart, distance)
            distances[row] = np.where(fits, distance, np.inf)
        return distances

    @staticmethod
    def _stroke_without_slip(solver: StageSolver, ratio: Array) -> Array:
        strokes = np.linspace(-1.0, 1.0, 201)
        ratios = speed_ratio(solver.stage, strokes)
        order = np.argsort(ratios)
        return np.interp(ratio, ratios[order], strokes[order])
