# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steady state without effects at one point, in plain floats.

It gives what `SteadyState.solve` gives, to the last digit, in about a microsecond: a control loop
waits for it. Constants are unpacked once, and the equations are written out: a call of a function
or an attribute takes as long as three products.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from .regimes import FORWARD_PULL, Quadrant, Regime, Senses
from .steady_state import STANDING

Point = tuple[float, float, float]
"""Efficiency [-], output speed [rad/s] and engine torque [N m]."""

PointSolver = Callable[[float, float, float], Point]
"""Gives a point for displacement ratio [-], engine speed [rad/s] and load torque [N m]."""

NO_ANSWER: Point = (math.nan, math.nan, math.nan)


class _RowConstants(NamedTuple):
    """Constants of one regime with the pump on the row."""

    square: float
    level: float
    flow: float
    motor: float
    motor_drag: float
    motor_stiffness: float
    brace_stiffness: float
    friction: float


def point_solver(
    quadrant: Callable[[Senses], Quadrant], general: PointSolver
) -> PointSolver:
    """Return what solves one point in range; NaN where no load is carried.

    Args:
        quadrant: gives the constants of a quadrant.
        general: solves a point at which the row turns the pump backward.
    """
    if quadrant(FORWARD_PULL).pump_on_row:
        return _pump_on_row(quadrant, general)
    return _pump_at_engine(quadrant)


def _pump_at_engine(quadrant: Callable[[Senses], Quadrant]) -> PointSolver:
    """Input-coupled and hydrostatic stages."""
    first = quadrant(FORWARD_PULL)
    a, h, stiffness = first.pump_ratios[0], first.hydraulic_ratio, first.stiffness
    friction, damping = first.pump_friction, first.pump_damping
    mean, half = first.pump_gears
    standing, forward, sqrt = first.standing_ratio, first.flow_ratio, math.sqrt

    def constants(output: int, power: int) -> tuple[float, ...]:
        chosen = quadrant(Senses(output, power))
        regimes: list[float] = []
        for each in chosen.regimes:
            regimes += [each.square, each.level, each.flow]
        # As floats: a product with an integer takes three times as long.
        return (
            float(chosen.flow_ratio),
            float(chosen.mechanical_ratio),
            float(chosen.sense),
            float(chosen.reflection),
            float(chosen.stall_load),
            float(chosen.mechanical_load),
            *regimes,
        )

    forward_pull, forward_overrun = constants(1, 1), constants(1, -1)
    backward_pull, backward_overrun = constants(-1, 1), constants(-1, -1)

    def solve(
        displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        if (displacement_ratio - standing) * forward > 0.0:
            chosen = forward_pull if load_torque >= 0.0 else forward_overrun
        else:
            chosen = backward_pull if load_torque >= 0.0 else backward_overrun
        (
            flow_ratio,
            rest,
            sense,
            reflection,
            stall_load,
            mechanical_load,
            square,
            level,
            flow,
            square_1,
            level_1,
            flow_1,
            square_2,
            level_2,
            flow_2,
        ) = chosen
        ratio = flow_ratio * displacement_ratio
        load = load_torque / engine_speed
        # The motor drives.
        middle = (level + flow * ratio) / square
        inside = middle * middle - load / square
        if inside >= 0.0:
            output = middle + sense * sqrt(inside) if load else 2.0 * middle
        elif load > stall_load:
            return NO_ANSWER
        else:
            output = rest
        if not output > rest:
            # The motor is driven, or friction holds it.
            middle = (level_1 + flow_1 * ratio) / square_1
            inside = middle * middle - load / square_1
            is_reversed = True
            if inside >= 0.0:
                output = middle + sense * sqrt(inside) if load else 2.0 * middle
                if output >= rest:
                    output = rest
                    is_reversed = False
                else:
                    is_reversed = ratio * a < (output - rest) / h
            if is_reversed:
                middle = (level_2 + flow_2 * ratio) / square_2
                inside = middle * middle - load / square_2
                if not inside >= 0.0:
                    return NO_ANSWER
                output = middle + sense * sqrt(inside) if load else 2.0 * middle
        if not output * sense > 0.0:
            if load:
                return NO_ANSWER
            output = output or STANDING
        ideal = ratio * (stiffness * (ratio * a - (output - rest) / h))
        torque = ideal + friction * abs(ideal) + damping * a
        torque = mechanical_load * load / output + mean * torque + half * abs(torque)
        torque *= engine_speed
        efficiency = _efficiency(load_torque, torque)
        return efficiency, reflection * engine_speed * output, torque

    return solve


def _pump_on_row(
    quadrant: Callable[[Senses], Quadrant], general: PointSolver
) -> PointSolver:
    """Output-coupled stages."""
    first = quadrant(FORWARD_PULL)
    a, h, stiffness = first.pump_ratios[0], first.hydraulic_ratio, first.stiffness
    friction, damping = first.pump_friction, first.pump_damping
    mean, half = first.pump_gears
    standing, forward, sqrt = first.standing_ratio, first.flow_ratio, math.sqrt
    lowest, highest = standing_band(quadrant)
    # Comparing members of an enumeration would take longer than the equations.
    driving, driven, is_reversed = map(int, list(Regime)[:3])

    def constants(output: int) -> tuple[float, float, float, list[_RowConstants]]:
        chosen = quadrant(Senses(output))
        regimes = [
            _RowConstants(
                each.square,
                each.level,
                each.flow,
                each.motor,
                each.motor_drag,
                stiffness * each.motor,
                stiffness * each.brace,
                each.pump - 1.0,
            )
            for each in chosen.regimes
        ]
        flow_ratio, reflection = float(chosen.flow_ratio), float(chosen.reflection)
        return flow_ratio, chosen.pump_ratios[1], reflection, regimes

    ahead, back = constants(1), constants(-1)

    def solve(
        displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        is_forward = (displacement_ratio - standing) * forward > 0.0
        flow_ratio, c, reflection, regimes = ahead if is_forward else back
        ratio, load = flow_ratio * displacement_ratio, load_torque / engine_speed
        if h * c * ratio >= 1.0:
            return NO_ANSWER
        if not load and lowest <= displacement_ratio <= highest:
            output = STANDING
        else:
            output = math.nan
            for regime, constant in enumerate(regimes):
                square, level, flow, motor, drag, stiff, brace, rubbing = constant
                held = brace * (ratio + rubbing * abs(ratio))
                square = square + held / h - (stiff + held) * c * ratio
                middle = (level + flow * ratio + 0.5 * held * a * ratio) / square
                inside = middle * middle - load / square
                if not inside >= 0.0 or square <= 0.0:
                    if regime == driving:
                        return NO_ANSWER
                    continue
                output = middle + sqrt(inside) if load else 2.0 * middle
                pressure = stiffness * (ratio * (a + c * output) - output / h)
                if regime == driving:
                    if motor * pressure > drag * output / h:
                        break
                elif regime == driven:
                    if pressure >= 0.0:
                        break
                elif regime == is_reversed:
                    ideal = ratio * pressure
                    pump = ideal + friction * abs(ideal) + damping * (a + c * output)
                    if pump >= 0.0:
                        break
            if not load and output == 0.0:
                output = STANDING
            if not output > 0.0:
                return NO_ANSWER
        pump_speed = a + c * output
        if pump_speed < 0.0:
            return general(displacement_ratio, engine_speed, load_torque)
        ideal = ratio * (stiffness * (ratio * pump_speed - output / h))
        torque = ideal + friction * abs(ideal) + damping * pump_speed
        torque = (mean * torque + half * abs(torque)) * engine_speed
        efficiency = _efficiency(load_torque, torque)
        return efficiency, reflection * engine_speed * output, torque

    return solve


def standing_band(quadrant: Callable[[Senses], Quadrant]) -> tuple[float, float]:
    """Return the displacement ratios between which friction holds an output without load."""
    ahead = float(quadrant(Senses(1)).standing_ratio)
    back = float(quadrant(Senses(-1)).standing_ratio)
    return min(ahead, back), max(ahead, back)


def _efficiency(load_torque: float, engine_torque: float) -> float:
    """Return output power / input power [-]; NaN where power flows against the load."""
    if load_torque >= 0.0:
        return load_torque / engine_torque if engine_torque > 0.0 else math.nan
    return engine_torque / load_torque if engine_torque < 0.0 else math.nan
