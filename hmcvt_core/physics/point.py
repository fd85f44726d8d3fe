# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steady state at one point, in plain floats: what a control loop asks for."""

from __future__ import annotations

import math
from collections.abc import Callable

from ..transmission.parameters import Parameters
from ..transmission.stage import Stage
from .steady_state import DRIVEN, REVERSED, STANDING, Quadrant

Point = tuple[float, float, float]


def at_point(
    stage: Stage, parameters: Parameters, turning: int, power: int
) -> Callable[[float, float, float], Point]:
    """Return what solves one quadrant at one point, in plain floats.

    It says what `ArrayQuadrant.solve` says, to the last digit, without a call: a control loop waits
    for it.
    """
    own = Quadrant(stage, parameters, turning, power)
    (a, c), h, rest, braced, sense = (own.pump_ratios, own.hydraulic_ratio, own.mechanical_ratio,
                                      own.braced, own.sense)
    full, stiffness, stall, carried = own.full, own.stiffness, own.stall_load, own.mechanical_load
    rubbing, damping, (mean, half) = own.pump_friction, own.pump_damping, own.pump_gears
    drag, reflection, sqrt, nan = own.regimes[0].motor_drag, own.reflection, math.sqrt, math.nan
    regimes = [(number, each.square, each.level, each.flow, (
        each.motor, stiffness * each.motor, stiffness * each.brace, each.pump - 1.0))
        for number, each in enumerate(own.regimes)]

    def solve(
        displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        ratio, load = full * displacement_ratio, load_torque / engine_speed
        for number, square, level, flow, row in regimes:
            middle = level + flow * ratio
            if braced:
                motor, stiff, brace, rubbed = row
                held = brace * (ratio + rubbed * abs(ratio))
                middle += 0.5 * held * a * ratio
                square = square + held / h - (stiff + held) * c * ratio
            middle /= square
            inside = middle * middle - load / square
            if not inside >= 0.0 or square <= 0.0:
                if number == DRIVEN or (number == 0 and not load > stall):
                    continue
                return nan, nan, nan
            output = middle + sense * sqrt(inside) if load else 2.0 * middle
            if number == 0 and not braced:
                if output > rest:
                    break
                continue
            if number == DRIVEN and not braced and output >= rest:
                output = rest
                break
            pressure = stiffness * (ratio * (a + c * output) - (output - rest) / h)
            if number == 0:
                if motor * pressure > drag * output / h:
                    break
            elif number == DRIVEN:
                if pressure >= 0.0:
                    break
            elif braced:
                ideal = ratio * pressure
                if ideal + rubbing * abs(ideal) + damping * (a + c * output) >= 0.0:
                    break
        if not output * sense > 0.0:
            if load:
                return nan, nan, nan
            output = output or STANDING
        pump = a + c * output if braced else a
        ideal = ratio * (stiffness * (ratio * pump - (output - rest) / h))
        torque = ideal + rubbing * abs(ideal) + damping * pump
        torque = (carried * load / output + mean * torque + half * abs(torque)) * engine_speed
        efficiency = nan
        if torque * power > 0.0:
            efficiency = load_torque / torque if power > 0 else torque / load_torque
        return efficiency, reflection * engine_speed * output, torque

    return solve


class PointSolver:
    """The steady state at one point in range, in plain floats."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        first = Quadrant(stage, parameters)
        self._sense, self._standing = math.copysign(1.0, first.full), first.standing
        self._usual = Quadrant(stage, parameters, -1) if stage.reverse else first
        self._backward, self._forward = ([at_point(stage, parameters, turning, power)
                                          for power in (-1, 1)] for turning in (-1, 1))

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        """What `Solution` holds; NaN where the load cannot be carried."""
        quadrants = self._forward if (
            displacement_ratio - self._standing) * self._sense > 0.0 else self._backward
        return quadrants[load_torque >= 0.0](displacement_ratio, engine_speed, load_torque)

    def resting_ratios(self, engine_speed: float, load_torque: float) -> list[float]:
        """Displacement ratios between which friction holds the motor or it stalls, lowest first.

        Both 0 where the motor is not on the row.
        """
        usual, ratios = self._usual, []
        if usual.braced:
            return [0.0, 0.0]
        load = load_torque / engine_speed
        for regime in usual.regimes[:REVERSED]:
            slowest = max(usual.mechanical_ratio, math.sqrt(load / regime.square))
            level = 0.5 * (regime.square * slowest + load / slowest)
            ratios.append((level - regime.level) / regime.flow / usual.full)
        return sorted(ratios)
