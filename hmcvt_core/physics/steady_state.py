# SPDX-License-Identifier: Apache-2.0
r"""The power balance of eqs (4), (13)-(15) without effects: at one point, and at many.

Powers are balanced shaft by shaft: the motor speed follows from the flow, the torques from the
load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole. With, per engine speed, the motor speed x, the output
speed y and the flow s of the pump (the motor speed that it gives without leakage), and with the
pressure as a torque of the motor :math:`\pi = p V_m`:

.. math:: y = m + h x \;(4), \qquad x = s - \frac{\pi}{K \omega} \;(13), \qquad
          \pi = \frac{L T / y + f_m \omega x}{1 \mp c_{fm}} \;(14), \qquad
          T_e = \frac{G T}{y} + \frac{(1 \pm c_{fp})\, \pi s + f_p \omega}{\eta_p^{\pm 1}} \;(15)

Eqs (4), (13), (14) together are a quadratic in x in each regime of the motor: where it drives the
row (motoring), where the row drives it (pumping), and where it is driven so fast that its damping
reverses the pressure. Between motoring and pumping friction holds the motor, as any stiction does.

`PointSolver` (plain floats, what a control loop calls) and `ArraySolver` say the same line by line.
Reading of eq. (15): as printed, pump friction c_fp would *help* the engine; here it takes torque.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.ranges import Answer, OperatingPoints
from ..transmission.stage import Stage

Array = NDArray[np.float64]


class Regime(NamedTuple):
    """Constants in one regime of the motor.

    Attributes:
        load: L, motor torque per output torque [-].
        friction: +c_fm or -c_fm, with the sign that it has in eq. (14) [-].
        square, linear, constant: of the quadratic in x; `constant` per load torque / engine speed.
    """

    load: Any
    friction: Any
    square: Any
    linear: Any
    constant: Any


class SteadyState:
    """The constants of one model without effects; arrays where its parameters are.

    Attributes:
        mechanical_ratio: m, output speed per engine speed while the motor stands [-].
        hydraulic_ratio: h, change of output speed per motor speed [-].
        full_flow: s at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        motor_damping: f_m [N m s/rad].
        motoring_load, pumping_load: L while the motor drives, and while it is driven [-].
        motor_friction, pump_friction: c_fm, c_fp [-].
        mechanical_load: G, engine torque per output torque, over the mechanical path [-].
        pump_damping: f_p, referred to the engine [N m s/rad].
        pump_gears: efficiency of the pairs between engine and pump [-].
        stall_load: load torque / engine speed [N m s/rad] above which a motor that comes to rest
            goes on to stall: a slower output then asks for more leakage than flow.
    """

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        units, ratio = stage.pump_motor, stage.motor_speed_ratio
        self.mechanical_ratio, self.hydraulic_ratio = stage.mechanical_speed_ratio, abs(ratio)
        pump_gear = 1.0 / stage.pump.ratio
        self.full_flow = (math.copysign(pump_gear, ratio)
                          * units.pump_displacement / units.motor_displacement)
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.motor_damping: Any = parameters.motor_damping
        output_load = self.hydraulic_ratio / stage.output.efficiency
        self.motoring_load = output_load / stage.motor.efficiency
        self.pumping_load = output_load * stage.motor.efficiency
        self.motor_friction, self.pump_friction = units.motor_friction, units.pump_friction
        self.mechanical_load = (self.mechanical_ratio
                                / (stage.output.efficiency * stage.mechanical.efficiency))
        self.pump_damping: Any = parameters.pump_damping * pump_gear**2
        self.pump_gears = stage.pump.efficiency
        self.stall_load: Any = (
            (self.stiffness * (1.0 - units.motor_friction) + self.motor_damping)
            * self.mechanical_ratio**2 / (self.hydraulic_ratio * self.motoring_load))

    def regime(self, load: Any, friction: Any) -> Regime:
        """Return the constants of (4), (13), (14) with so much load and signed friction."""
        compliance = 1.0 / ((1.0 - friction) * self.stiffness)
        damped = 1.0 + compliance * self.motor_damping
        return Regime(load, friction, self.hydraulic_ratio * damped,
                      self.mechanical_ratio * damped, compliance * load)


class PointSolver(SteadyState):
    """The steady state at one point in range, in plain floats."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        super().__init__(stage, parameters)
        friction = self.motor_friction
        self.motoring = self.regime(self.motoring_load, friction)
        self.pumping = self.regime(self.pumping_load, -friction)
        self.reversal = self.regime(self.pumping_load, friction)

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> tuple[float, float]:
        """Efficiency and output speed with slip; NaN where the load cannot be carried."""
        flow = self.full_flow * displacement_ratio
        motor, pressure = self._motor(flow, engine_speed, load_torque)
        output = self.mechanical_ratio + self.hydraulic_ratio * motor  # (4)
        if not output > 0.0:
            return math.nan, math.nan
        ideal = pressure * flow
        pump = ideal + self.pump_friction * abs(ideal) + self.pump_damping * engine_speed  # (15)
        gears = self.pump_gears
        engine_torque = self.mechanical_load * load_torque / output + (
            pump / gears if pump > 0.0 else pump * gears)
        return (load_torque / engine_torque if engine_torque > 0.0 else math.nan,
                engine_speed * output)

    def resting_ratios(self, engine_speed: float, load_torque: float) -> list[float]:
        """Displacement ratios between which friction holds the motor [-], the lower one first."""
        leaks = self.stiffness * engine_speed
        return sorted(self._pressure(regime, 0.0, engine_speed, load_torque)
                      / leaks / self.full_flow  # (13)
                      for regime in (self.motoring, self.pumping))

    def _motor(self, flow: float, engine_speed: float, load_torque: float) -> tuple[float, float]:
        """Motor speed x and pressure torque [N m] for a flow s."""
        load = load_torque / engine_speed
        speed = self._root(self.motoring, flow, load)
        if speed > 0.0:
            return speed, self._pressure(self.motoring, speed, engine_speed, load_torque)
        if math.isnan(speed) and load > self.stall_load:
            return math.nan, math.nan
        speed = self._root(self.pumping, flow, load)
        if speed >= 0.0:
            return 0.0, flow * self.stiffness * engine_speed  # (13): the whole flow leaks
        pressure = self._pressure(self.pumping, speed, engine_speed, load_torque)
        if not pressure >= 0.0:
            faster = self._root(self.reversal, flow, load)
            reversed_ = self._pressure(self.reversal, faster, engine_speed, load_torque)
            if reversed_ < 0.0:
                return faster, reversed_
        return speed, pressure

    def _pressure(
        self, regime: Regime, speed: float, engine_speed: float, load_torque: float
    ) -> float:
        output = self.mechanical_ratio + self.hydraulic_ratio * speed  # (4)
        return (regime.load * load_torque / output
                + self.motor_damping * engine_speed * speed) / (1.0 - regime.friction)  # (14)

    def _root(self, regime: Regime, flow: float, load: float) -> float:
        _, _, square, linear, constant = regime
        b = linear - self.hydraulic_ratio * flow
        c = constant * load - self.mechanical_ratio * flow
        inside = b * b - 4.0 * square * c
        if inside < 0.0:
            return math.nan
        # The larger root is the one that tends to the flow as leakage vanishes.
        root = math.sqrt(inside)
        return -2.0 * c / (b + root) if b > 0.0 else (root - b) / (2.0 * square)


class ArraySolver(SteadyState):
    """The steady state at points of shape (n,); parameters of shape (..., 1) give (..., n)."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        super().__init__(stage, parameters)
        shape = (3, *(1,) * max(1, np.ndim(self.stiffness), np.ndim(self.motor_damping)))
        loads, friction = [self.motoring_load, *2 * [self.pumping_load]], self.motor_friction
        # Motoring, pumping and reversal along a first axis: a call on arrays costs more than their
        # numbers.
        self._regimes = self.regime(np.array(loads).reshape(shape),
                                    np.array([friction, -friction, friction]).reshape(shape))

    def solve(self, points: OperatingPoints) -> Answer:
        """Efficiency and output speed; NaN where the load cannot be carried."""
        _, engine_speed, load_torque, _ = points
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            flow = self.full_flow * points.displacement_ratio
            motoring, pumping, pressures = self.motor_speeds(flow, engine_speed, load_torque)
            motor = self.selected(motoring, pumping, load_torque / engine_speed)
            pressure = np.where(motor > 0.0, *pressures)
            # (13) with the motor held by friction: the whole flow leaks.
            pressure = np.where(motor == 0.0, flow * self.stiffness * engine_speed, pressure)
            output = self.mechanical_ratio + self.hydraulic_ratio * motor  # (4)
            ideal = pressure * flow
            pump = ideal + self.pump_friction * np.abs(ideal) + self.pump_damping * engine_speed
            gears = self.pump_gears
            engine_torque = self.mechanical_load * load_torque / output + (
                np.maximum(pump, 0.0) / gears + np.minimum(pump, 0.0) * gears)  # (15)
            answered = (output > 0.0) & (engine_torque > 0.0)
            return Answer(np.where(answered, load_torque / engine_torque, np.nan),
                          np.where(output > 0.0, engine_speed * output, np.nan))

    def motor_speeds(
        self, flow: Array, engine_speed: Array, load_torque: Array
    ) -> tuple[Array, Array, tuple[Array, Array]]:
        """Motor speed x while motoring and while pumping, and the pressure torque of both [N m].

        Each is where its regime has its balance, valid or not: see `selected`.
        """
        regimes = self._regimes
        b = regimes.linear - self.hydraulic_ratio * flow
        c = regimes.constant * (load_torque / engine_speed) - self.mechanical_ratio * flow
        root = np.sqrt(b * b - 4.0 * regimes.square * c)
        # The larger root is the one that tends to the flow as leakage vanishes.
        speeds = np.where(b > 0.0, -2.0 * c / (b + root), (root - b) / (2.0 * regimes.square))
        torques = regimes.load * load_torque / (
            self.mechanical_ratio + self.hydraulic_ratio * speeds)
        pressures = ((torques + self.motor_damping * engine_speed * speeds)
                     / (1.0 - regimes.friction))  # (14)
        (motoring, pumping, reversal), (driving, driven, reversed_) = speeds, pressures
        fast = ~(driven >= 0.0) & (reversed_ < 0.0)
        return (motoring, np.where(fast, reversal, pumping),
                (driving, np.where(fast, reversed_, driven)))

    def selected(self, motoring: Array, pumping: Array, load: Array) -> Array:
        """Motor speed that the motor takes, of those in either regime; 0 where friction holds it.

        Friction asks for more pressure while motoring, so motoring < pumping: at most one is valid.
        """
        stalls = np.isnan(motoring) & (load > self.stall_load)
        slow = np.where(stalls, np.nan, np.minimum(pumping, 0.0))
        return np.where(motoring > 0.0, motoring, slow)

    def displacement_ratio(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> Array:
        """Displacement ratio that makes an output speed [-]; beyond -1 to 1 where none does.

        With the motor at rest many do: the least is given, which leaks least.
        """
        motor = (output_speed / engine_speed - self.mechanical_ratio) / self.hydraulic_ratio  # (4)
        drives = motor > 0.0
        load = np.where(drives, self.motoring_load, self.pumping_load)
        torque = (load * load_torque * engine_speed / output_speed
                  + self.motor_damping * engine_speed * motor)
        friction = self.motor_friction * np.where(drives, 1.0, -1.0) * np.sign(torque)
        pressure = torque / (1.0 - friction)  # (14)
        return (motor + pressure / (self.stiffness * engine_speed)) / self.full_flow  # (13)
