# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steady state without effects at one point, in plain floats.

It gives what `SteadyState.solve` gives, to the last digit, in about a microsecond: a control loop
waits for it. Constants are floats that are unpacked once, and the usual regime, in which the motor
drives, is written out: a call of a function takes as long as three products.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from .regimes import (
    BACKWARD_REGIMES,
    FORWARD_PULL,
    SIGNS,
    Quadrant,
    Regime,
    RegimeConstants,
    Senses,
    StartingTorque,
)
from .steady_state import ROUNDING, STANDING

Point = tuple[float, float, float]
"""Efficiency [-], output speed [rad/s] and engine torque [N m]."""

PointSolver = Callable[[float, float, float], Point]
"""Gives a point for displacement ratio [-], engine speed [rad/s] and load torque [N m]."""

NO_ANSWER: Point = (math.nan, math.nan, math.nan)


def point_solver(
    quadrant: Callable[[Senses], Quadrant],
) -> PointSolver:
    """Return what solves one point in range; NaN where no load is carried.

    Args:
        quadrant: gives the constants of a quadrant.
    """
    if quadrant(FORWARD_PULL).pump_on_row:
        return _PumpOnRow(quadrant).solve
    return _PumpAtEngine(quadrant).solve


@dataclass(frozen=True, slots=True)
class _EngineRegime:
    """Constants of one regime with the pump at the engine."""

    square: float
    level: float
    flow: float


@dataclass(frozen=True, slots=True)
class _EngineQuadrant:
    """Constants of one quadrant with the pump at the engine; `rest`: y of a motor at rest."""

    flow_ratio: float
    rest: float
    sense: float
    reflection: float
    stall_load: float
    mechanical_load: float
    driving: _EngineRegime
    driven: _EngineRegime
    reversed: _EngineRegime


class _PumpAtEngine:
    """Input-coupled and hydrostatic stages."""

    def __init__(self, quadrant: Callable[[Senses], Quadrant]) -> None:
        first = quadrant(FORWARD_PULL)
        self._engine_share = first.pump_ratios[0]
        self._hydraulic_ratio = first.hydraulic_ratio
        self._standing_ratio = first.standing_ratio
        self._forward = first.flow_ratio
        self._stiffness = first.stiffness
        self._friction = first.pump_friction
        self._damping = first.pump_damping
        self._gear_mean, self._gear_half = first.pump_gears
        self._ahead = (
            _engine_quadrant(quadrant(Senses(1, 1))),
            _engine_quadrant(quadrant(Senses(1, -1))),
        )
        self._back = (
            _engine_quadrant(quadrant(Senses(-1, 1))),
            _engine_quadrant(quadrant(Senses(-1, -1))),
        )

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        if (displacement_ratio - self._standing_ratio) * self._forward > 0.0:
            pull, overrun = self._ahead
        else:
            pull, overrun = self._back
        chosen = pull if load_torque >= 0.0 else overrun
        rest = chosen.rest
        sense = chosen.sense
        ratio = chosen.flow_ratio * displacement_ratio
        load = load_torque / engine_speed
        regime = chosen.driving
        middle = (regime.level + regime.flow * ratio) / regime.square
        inside = middle * middle - load / regime.square
        if inside >= 0.0:
            output = middle + sense * math.sqrt(inside) if load else 2.0 * middle
        elif load > chosen.stall_load:
            return NO_ANSWER
        else:
            output = rest
        if not output > rest:
            output = self._slower_output(chosen, ratio, load)
        if not output * sense > 0.0:
            if load:
                return NO_ANSWER
            output = output or STANDING
        a = self._engine_share
        motor = (output - rest) / self._hydraulic_ratio
        ideal = ratio * (self._stiffness * (ratio * a - motor))
        pump = ideal + self._friction * abs(ideal) + self._damping * a
        carried = chosen.mechanical_load * load / output
        torque = carried + self._gear_mean * pump + self._gear_half * abs(pump)
        torque *= engine_speed
        efficiency = _efficiency(load_torque, torque)
        if output == STANDING:
            return efficiency, 0.0, torque
        return efficiency, chosen.reflection * engine_speed * output, torque

    def _slower_output(
        self, chosen: _EngineQuadrant, ratio: float, load: float
    ) -> float:
        """Return y of a motor that is driven, or held by friction; NaN where there is none."""
        rest = chosen.rest
        output = _engine_root(chosen.driven, chosen.sense, ratio, load)
        if output >= rest:
            return rest
        if output < rest:
            motor = (output - rest) / self._hydraulic_ratio
            is_reversed = ratio * self._engine_share < motor
            if not is_reversed:
                return output
        return _engine_root(chosen.reversed, chosen.sense, ratio, load)


def _engine_quadrant(quadrant: Quadrant) -> _EngineQuadrant:
    regimes = []
    for regime in quadrant.regimes:
        regimes.append(_EngineRegime(regime.square, regime.level, regime.flow))
    # As floats: a product with an integer takes three times as long.
    return _EngineQuadrant(
        float(quadrant.flow_ratio),
        float(quadrant.mechanical_ratio),
        float(quadrant.sense),
        float(quadrant.reflection),
        float(quadrant.stall_load),
        float(quadrant.mechanical_load),
        *regimes,
    )


def _engine_root(
    regime: _EngineRegime, sense: float, ratio: float, load: float
) -> float:
    """Return y in one regime; NaN without a root."""
    middle = (regime.level + regime.flow * ratio) / regime.square
    inside = middle * middle - load / regime.square
    if not inside >= 0.0:
        return math.nan
    return middle + sense * math.sqrt(inside) if load else 2.0 * middle


@dataclass(frozen=True, slots=True)
class _RowRegime:
    """Constants of one regime with the pump on the row."""

    square: float
    level: float
    flow: float
    motor_stiffness: float
    brace_stiffness: float
    friction: float


@dataclass(frozen=True, slots=True)
class _RowSense:
    """Constants of one sense of the output with the pump on the row.

    `feedback` times e is the flow that the row feeds back, by the flow that the motor takes.
    """

    flow_ratio: float
    output_share: float
    reflection: float
    motor: float
    motor_drag: float
    feedback: float
    starting_torques: tuple[StartingTorque, StartingTorque]
    regimes: list[_RowRegime]


# Comparing members of an enumeration would take longer than the equations.
_DRIVING = int(Regime.DRIVING)
_DRIVEN = int(Regime.DRIVEN)
_REVERSED = int(Regime.REVERSED)
_MOTORED = int(Regime.MOTORED)


class _PumpOnRow:
    """Output-coupled stages."""

    def __init__(self, quadrant: Callable[[Senses], Quadrant]) -> None:
        first = quadrant(FORWARD_PULL)
        self._engine_share = first.pump_ratios[0]
        self._hydraulic_ratio = first.hydraulic_ratio
        self._stiffness = first.stiffness
        self._friction = first.pump_friction
        self._damping = first.pump_damping
        self._gears = first.pump_gears
        self._backward_gears = first.backward_gears
        self._ahead = _row_sense(quadrant(Senses(1)))
        self._back = _row_sense(quadrant(Senses(-1)))

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        chosen = self._ahead
        ratio = chosen.flow_ratio * displacement_ratio
        stands = False
        positive, negative = chosen.starting_torques
        level, slope, square = positive if ratio > 0.0 else negative
        if not level + (slope + square * ratio) * ratio > 0.0:
            chosen = self._back
            ratio = chosen.flow_ratio * displacement_ratio
            stands = not _starts(chosen, ratio)
        load = load_torque / engine_speed
        if chosen.feedback * ratio >= 1.0 or (stands and load):
            return NO_ANSWER
        output = STANDING if stands else self._output(chosen, ratio, load)
        if not load and output == 0.0:
            output = STANDING
        if not output > 0.0:
            return NO_ANSWER
        c = chosen.output_share
        pump_speed = self._engine_share + c * output
        gears = self._gears
        turning = 1.0
        if pump_speed < 0.0:
            output = self._backward_output(chosen, ratio, load)
            pump_speed = self._engine_share + c * output
            gears = self._backward_gears
            turning = -1.0
        motor = output / self._hydraulic_ratio
        ideal = ratio * (self._stiffness * (ratio * pump_speed - motor))
        friction = turning * (self._friction * abs(ideal))
        torque = ideal + friction + self._damping * pump_speed
        torque = (gears[0] * torque + gears[1] * abs(torque)) * engine_speed
        efficiency = _efficiency(load_torque, torque)
        if output == STANDING:
            return efficiency, 0.0, torque
        return efficiency, chosen.reflection * engine_speed * output, torque

    def _output(self, chosen: _RowSense, ratio: float, load: float) -> float:
        """Return y while the pump turns forward; NaN where there is none."""
        c = chosen.output_share
        regimes = chosen.regimes
        a = self._engine_share
        h = self._hydraulic_ratio
        stiffness = self._stiffness
        regime = regimes[_DRIVING]
        held = regime.brace_stiffness * (ratio + regime.friction * abs(ratio))
        fed_back = (regime.motor_stiffness + held) * c * ratio
        square = regime.square + held / h - fed_back
        level = regime.level + regime.flow * ratio
        middle = (level + 0.5 * held * a * ratio) / square
        inside = middle * middle - load / square
        if inside >= 0.0 and square > 0.0:
            output = middle + math.sqrt(inside) if load else 2.0 * middle
            pressure = stiffness * (ratio * (a + c * output) - output / h)
            if chosen.motor * pressure > chosen.motor_drag * output / h:
                return output
        elif ratio > 0.0:
            # The load is not carried. At e <= 0 the pressure is never positive, so that only the
            # other regimes count.
            return math.nan
        output = self._root(regimes[_DRIVEN], c, ratio, load)
        pressure = stiffness * (ratio * (a + c * output) - output / h)
        if pressure >= 0.0:
            return output
        output = self._root(regimes[_REVERSED], c, ratio, load)
        pressure, pump = self._pressure_and_pump(c, ratio, output)
        is_motored = not pump >= 0.0
        if is_motored:
            output = self._root(regimes[_MOTORED], c, ratio, load)
            pressure, pump = self._pressure_and_pump(c, ratio, output)
        bound = ROUNDING * stiffness * output
        is_wrong = pressure > bound or (is_motored and pump > bound)
        return math.nan if is_wrong else output

    def _backward_output(self, chosen: _RowSense, ratio: float, load: float) -> float:
        """Return y with the pump turned backward; NaN where it does not turn so."""
        c = chosen.output_share
        for regime in BACKWARD_REGIMES:
            output = self._root(chosen.regimes[regime], c, ratio, load)
            pressure, pump = self._pressure_and_pump(c, ratio, output, -1.0)
            is_consistent = pump * SIGNS[regime].pump >= 0.0 and pressure <= 0.0
            if is_consistent and self._engine_share + c * output < 0.0:
                return output
        return math.nan

    def _root(self, regime: _RowRegime, c: float, ratio: float, load: float) -> float:
        """Return y in one regime; NaN without a root."""
        held = regime.brace_stiffness * (ratio + regime.friction * abs(ratio))
        fed_back = (regime.motor_stiffness + held) * c * ratio
        square = regime.square + held / self._hydraulic_ratio - fed_back
        level = regime.level + regime.flow * ratio
        middle = (level + 0.5 * held * self._engine_share * ratio) / square
        inside = middle * middle - load / square
        if not inside >= 0.0 or square <= 0.0:
            return math.nan
        return middle + math.sqrt(inside) if load else 2.0 * middle

    def _pressure_and_pump(
        self, c: float, ratio: float, output: float, turning: float = 1.0
    ) -> tuple[float, float]:
        """Return pi and P for a y; the pump turns forward (1) or backward (-1)."""
        pump_speed = self._engine_share + c * output
        motor = output / self._hydraulic_ratio
        pressure = self._stiffness * (ratio * pump_speed - motor)
        ideal = ratio * pressure
        friction = turning * (self._friction * abs(ideal))
        return pressure, ideal + friction + self._damping * pump_speed


def _starts(chosen: _RowSense, ratio: float) -> bool:
    """Whether an output at rest without load starts in a sense."""
    positive, negative = chosen.starting_torques
    torque = positive if ratio > 0.0 else negative
    return bool(torque.at(ratio) > 0.0)


def _row_sense(quadrant: Quadrant) -> _RowSense:
    driving = quadrant.regimes[_DRIVING]
    regimes = []
    for regime in quadrant.regimes:
        regimes.append(_row_regime(regime, quadrant.stiffness))
    return _RowSense(
        float(quadrant.flow_ratio),
        quadrant.pump_ratios[1],
        float(quadrant.reflection),
        driving.motor,
        driving.motor_drag,
        quadrant.hydraulic_ratio * quadrant.pump_ratios[1],
        quadrant.starting_torques,
        regimes,
    )


def _row_regime(regime: RegimeConstants, stiffness: float) -> _RowRegime:
    return _RowRegime(
        regime.square,
        regime.level,
        regime.flow,
        stiffness * regime.motor,
        stiffness * regime.brace,
        regime.pump - 1.0,
    )


def _efficiency(load_torque: float, engine_torque: float) -> float:
    """Return output power / input power [-]; NaN where power flows against the load."""
    if load_torque >= 0.0:
        return load_torque / engine_torque if engine_torque > 0.0 else math.nan
    return engine_torque / load_torque if engine_torque < 0.0 else math.nan
