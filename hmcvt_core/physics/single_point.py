# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steady state without effects at one point, in plain floats.

It gives what `SteadyState.solve` gives, to the last digit, in about a microsecond: a control loop
waits for it. Constants are unpacked once, and the equations are written out: a call of a function
or an attribute takes as long as three products.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from .regimes import BACKWARD_REGIMES, FORWARD_PULL, SIGNS, Quadrant, Regime, Senses
from .steady_state import ROUNDING, STANDING

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
    quadrant: Callable[[Senses], Quadrant],
) -> PointSolver:
    """Return what solves one point in range; NaN where no load is carried.

    Args:
        quadrant: gives the constants of a quadrant.
    """
    if quadrant(FORWARD_PULL).pump_on_row:
        return _pump_on_row(quadrant)
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


def _pump_on_row(quadrant: Callable[[Senses], Quadrant]) -> PointSolver:
    """Output-coupled stages."""
    first = quadrant(FORWARD_PULL)
    a, h, stiffness = first.pump_ratios[0], first.hydraulic_ratio, first.stiffness
    friction, damping = first.pump_friction, first.pump_damping
    mean, half = first.pump_gears
    backward_mean, backward_half = first.backward_gears
    sqrt = math.sqrt
    # Comparing members of an enumeration would take longer than the equations.
    driving, driven, is_reversed = map(int, list(Regime)[:3])
    turning_forward = range(int(Regime.BACKWARD))

    def constants(output: int) -> tuple[float, float, float, list[_RowConstants]]:
        chosen = quadrant(Senses(output))
        every_regime = [
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
        return flow_ratio, chosen.pump_ratios[1], reflection, every_regime

    ahead, back = constants(1), constants(-1)

    def starts(ratio: float, every_regime: list[_RowConstants]) -> bool:
        constant = every_regime[driving if ratio > 0.0 else is_reversed]
        held = constant.brace_stiffness * (ratio + constant.friction * abs(ratio))
        level = constant.level + constant.flow * ratio
        return level + 0.5 * held * a * ratio > 0.0

    def backward_point(
        chosen: tuple[float, float, float, list[_RowConstants]],
        ratio: float,
        load_torque: float,
        engine_speed: float,
    ) -> Point:
        _, c, reflection, every_regime = chosen
        load = load_torque / engine_speed
        for regime in BACKWARD_REGIMES:
            square, level, flow, _, _, stiff, brace, rubbing = every_regime[regime]
            held = brace * (ratio + rubbing * abs(ratio))
            square = square + held / h - (stiff + held) * c * ratio
            middle = (level + flow * ratio + 0.5 * held * a * ratio) / square
            inside = middle * middle - load / square
            if not inside >= 0.0 or square <= 0.0:
                continue
            output = middle + sqrt(inside) if load else 2.0 * middle
            pump_speed = a + c * output
            pressure = stiffness * (ratio * pump_speed - output / h)
            ideal = ratio * pressure
            pump = ideal - friction * abs(ideal) + damping * pump_speed
            if pump * SIGNS[regime].pump < 0.0 or pressure > 0.0:
                continue
            if not pump_speed < 0.0:
                continue
            torque = backward_mean * pump + backward_half * abs(pump)
            torque *= engine_speed
            efficiency = _efficiency(load_torque, torque)
            return efficiency, reflection * engine_speed * output, torque
        return NO_ANSWER

    def solve(
        displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        chosen = ahead
        flow_ratio, c, reflection, every_regime = ahead
        ratio = flow_ratio * displacement_ratio
        stands = False
        if not starts(ratio, every_regime):
            chosen = back
            flow_ratio, c, reflection, every_regime = back
            ratio = flow_ratio * displacement_ratio
            stands = not starts(ratio, every_regime)
        load = load_torque / engine_speed
        if h * c * ratio >= 1.0 or (stands and load):
            return NO_ANSWER
        if stands:
            output = STANDING
        else:
            output = math.nan
            for regime in turning_forward:
                constant = every_regime[regime]
                square, level, flow, motor, drag, stiff, brace, rubbing = constant
                held = brace * (ratio + rubbing * abs(ratio))
                square = square + held / h - (stiff + held) * c * ratio
                middle = (level + flow * ratio + 0.5 * held * a * ratio) / square
                inside = middle * middle - load / square
                if not inside >= 0.0 or square <= 0.0:
                    if regime == driving:
                        return NO_ANSWER
                    continue
                speed = middle + sqrt(inside) if load else 2.0 * middle
                pressure = stiffness * (ratio * (a + c * speed) - speed / h)
                if regime == driving:
                    if motor * pressure > drag * speed / h:
                        output = speed
                        break
                elif regime == driven:
                    if pressure >= 0.0:
                        output = speed
                        break
                else:
                    ideal = ratio * pressure
                    pump = ideal + friction * abs(ideal) + damping * (a + c * speed)
                    bound = ROUNDING * stiffness * speed
                    if regime == is_reversed:
                        if pump >= 0.0:
                            output = speed if pressure <= bound else math.nan
                            break
                    elif pressure <= bound and pump <= bound:
                        output = speed
            if not load and output == 0.0:
                output = STANDING
            if not output > 0.0:
                return NO_ANSWER
        pump_speed = a + c * output
        if pump_speed < 0.0:
            return backward_point(chosen, ratio, load_torque, engine_speed)
        ideal = ratio * (stiffness * (ratio * pump_speed - output / h))
        torque = ideal + friction * abs(ideal) + damping * pump_speed
        torque = (mean * torque + half * abs(torque)) * engine_speed
        efficiency = _efficiency(load_torque, torque)
        return efficiency, reflection * engine_speed * output, torque

    return solve


def _efficiency(load_torque: float, engine_torque: float) -> float:
    """Return output power / input power [-]; NaN where power flows against the load."""
    if load_torque >= 0.0:
        return load_torque / engine_torque if engine_torque > 0.0 else math.nan
    return engine_torque / load_torque if engine_torque < 0.0 else math.nan
