# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The steady state of an output-coupled stage without effects: the row stands at the engine.

The engine and the output drive the pump through the row, the motor is geared to the output, and
what the pump takes from the row braces the member that drives the output. Per engine speed, with
the pump speed z, the motor speed x, the ratio e of their displacements as set, and the pressure as
a torque of the motor :math:`\pi = p V_m`:

.. math:: z = a + c y, \quad x = b y \;(4), \qquad \frac{\pi}{K\omega} = e z - x \;(13), \qquad
          M = \eta_m^{\pm 1} \left((1 \mp c_{fm}) \pi - f_m \omega x\right) \;(14), \qquad
          P = \eta_p^{\mp 1} \left((1 \pm c_{fp}) e \pi + f_p \omega z\right) \;(15)

.. math:: \frac{T}{y} = b M - \eta_o^{\pm 1} c P, \qquad T_e = \eta_e^{\mp 1} a P

Again a quadratic in y, in each of four regimes: from high pressure to low, the motor drives, is
driven by its damping, pumps, and turns the pump into a motor. The signs follow the regime. An
output that turns backward reflects y, x, e, c and the pressure.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.ranges import OperatingPoints, Solution
from ..transmission.stage import Stage

Array = NDArray[np.float64]


class _Regime(NamedTuple):
    """Constants of one regime, per pressure torque and per e times it, per y and per z.

    Attributes:
        signs: 1 or -1: the motor drives, the pump takes torque, and the pressure.
        motor, motor_drag: output torque of the motor, less friction.
        brace, brace_drag: output torque that the pump braces.
        engine, engine_drag: engine torque.
    """

    signs: tuple[int, int, int]
    motor: Any
    motor_drag: Any
    brace: Any
    brace_drag: Any
    engine: Any
    engine_drag: Any


class OutputCoupledState:
    """One sense of the output; arrays where the parameters are."""

    def __init__(self, stage: Stage, parameters: Parameters, turning: int = 1) -> None:
        units = stage.pump_motor
        self.turning = turning
        self.driven, fed = stage.pump_speed_ratios
        self.fed = turning * fed
        self.motor_ratio = 1.0 / abs(stage.motor_speed_ratio)
        self.full = (math.copysign(1.0, turning * stage.motor_speed_ratio)
                     * units.pump_displacement / units.motor_displacement)
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.pump_friction = units.pump_friction
        self._regimes = [self._regime(stage, parameters, signs) for signs in (
            (1, 1, 1), (-1, 1, 1), (-1, 1, -1), (-1, -1, -1))]

    def _regime(
        self, stage: Stage, parameters: Parameters, signs: tuple[int, int, int]
    ) -> _Regime:
        (drives, takes, pressure), units = signs, stage.pump_motor
        motor = self.motor_ratio * stage.motor.efficiency**drives
        pump = stage.pump.efficiency**-takes
        # The row drives the output while the pump brakes it; where the output drives, it drives on.
        gives = takes if self.fed < 0.0 else -takes
        brace = -self.fed * pump * stage.output.efficiency**gives
        engine = self.driven * pump / stage.mechanical.efficiency**takes
        return _Regime(
            signs, motor * (1.0 - units.motor_friction * pressure),
            motor * parameters.motor_damping * self.motor_ratio,
            brace, brace * parameters.pump_damping, engine, engine * parameters.pump_damping)

    def solve(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque; NaN where the load cannot be carried."""
        speed = points.engine_speed
        output, torque = self.output(
            self.full * points.displacement_ratio, points.load_torque / speed)
        return Solution.of(points.load_torque, torque * speed, self.turning * speed * output)

    def output(self, ratio: Array, load: Array) -> tuple[Array, Array]:
        """Output speed y and engine torque, per engine speed, for e and a load per engine speed."""
        output = torque = np.array(np.nan)
        for regime in self._regimes:
            rubbed = ratio * (1.0 + self.pump_friction * regime.signs[2] * np.sign(ratio))
            stiff = (regime.motor + regime.brace * rubbed) * self.stiffness
            square = (stiff * (self.motor_ratio - ratio * self.fed)
                      + regime.motor_drag - regime.brace_drag * self.fed)
            middle = (stiff * ratio + regime.brace_drag) * self.driven / (2.0 * square)
            root = middle + np.sqrt(middle * middle - load / square)
            y = np.where(load == 0.0, 2.0 * middle, np.where(root > 0.0, root, np.nan))
            pump = self.driven + self.fed * y
            pressure = self.stiffness * (ratio * pump - self.motor_ratio * y)  # (13)
            given, holds = self._torque(regime, pressure, rubbed, pump, y)
            first = holds & (square > 0.0) & np.isnan(output)
            output, torque = np.where(first, y, output), np.where(first, given, torque)
        return output, torque

    def _torque(
        self, regime: _Regime, pressure: Array, ratio: Array, pump: Array, output: Array
    ) -> tuple[Array, Array]:
        """Engine torque per engine speed, and whether the regime is in force."""
        torque = regime.engine * ratio * pressure + regime.engine_drag * pump
        drives = regime.motor * pressure > regime.motor_drag * output
        wanted = [sign > 0 for sign in regime.signs]
        return torque, np.asarray((drives == wanted[0]) & ((torque > 0.0) == wanted[1])
                                  & ((pressure > 0.0) == wanted[2]) & (pump > 0.0))

    def displacement_ratio(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> Array:
        """As `ArraySolver.displacement_ratio`: the same equations, for e and the pressure."""
        y = self.turning * output_speed / engine_speed
        pump = self.driven + self.fed * y
        found = np.array(np.nan)
        for regime in self._regimes:
            rubbed = 1.0 + self.pump_friction * regime.signs[2]
            square = regime.brace * rubbed / (self.stiffness * pump)
            linear = regime.motor + regime.brace * rubbed * self.motor_ratio * y / pump
            rest = (load_torque / engine_speed / y + regime.motor_drag * y
                    - regime.brace_drag * pump)
            pressure = 2.0 * rest / (linear + np.sqrt(linear * linear + 4.0 * square * rest))
            ratio = (self.motor_ratio * y + pressure / self.stiffness) / pump
            holds = self._torque(regime, pressure, rubbed * ratio, pump, y)[1]
            found = np.where(holds & np.isnan(found), ratio, found)
        return found / self.full
