# SPDX-License-Identifier: Apache-2.0
r"""The power balance without effects, solved on paper: what a control loop calls.

Without effects the balance of `power_balance`, where every term is explained, is a quadratic in the
motor speed on either side of standstill. Its constants are worked out once for a model, so that a
lookup costs a square root and some forty products.

With, per engine speed, the motor speed x, the output speed y and the flow s of the pump (the motor
speed that it gives without leakage), and with the pressure as a torque of the motor
:math:`\pi = p V_m`:

.. math:: y = m + h x, \qquad x = s - \frac{\pi}{K \omega}, \qquad
          \pi = \frac{L T / y + f_m \omega x}{1 \mp c_{fm}}, \qquad
          T_e = \frac{G T}{y} + \frac{(1 \pm c_{fp})\, \pi s + f_p \omega}{\eta_p^{\pm 1}}
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..transmission.parameters import Parameters
from ..transmission.stage import Stage


class Side(NamedTuple):
    """Constants of the balance on one side of the motor's standstill.

    Attributes:
        load: L, motor torque per output torque [-].
        grip: pressure torque / motor torque, 1 / (1 -+ c_fm) [-].
        square, linear, constant: of the quadratic in x; `constant` per load torque / engine speed.
    """

    load: Any
    grip: Any
    square: Any
    linear: Any
    constant: Any


class Constants:
    """The constants of one model without effects.

    Attributes:
        idle: m, output speed per engine speed while the motor stands [-].
        hydraulic: h, change of output speed per motor speed [-].
        full_flow: s at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        motor_damping: f_m [N m s/rad].
        driving, driven: L while the motor drives, and while it is driven [-].
        motor_friction, pump_friction: c_fm, c_fp [-].
        mechanical_load: G, engine torque per output torque, over the mechanical path [-].
        pump_drag: f_p, referred to the engine [N m s/rad].
        pump_gear_efficiency: of the pairs between engine and pump [-].
        collapse: load torque / engine speed [N m s/rad] above which a motor that comes to rest
            goes on to stall: a slower output then asks for more leakage than flow.
    """

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        units, ratio = stage.pump_motor, stage.motor_speed_ratio
        self.idle, self.hydraulic = stage.mechanical_speed_ratio, abs(ratio)
        pump_gear = 1.0 / stage.pump.ratio
        self.full_flow = (math.copysign(pump_gear, ratio)
                          * units.pump_displacement / units.motor_displacement)
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.motor_damping: Any = parameters.motor_damping
        self.driving = self.hydraulic / (stage.output.efficiency * stage.motor.efficiency)
        self.driven = self.hydraulic / stage.output.efficiency * stage.motor.efficiency
        self.motor_friction, self.pump_friction = units.motor_friction, units.pump_friction
        self.mechanical_load = self.idle / (stage.output.efficiency * stage.mechanical.efficiency)
        self.pump_drag: Any = parameters.pump_damping * pump_gear**2
        self.pump_gear_efficiency = stage.pump.efficiency
        self.collapse: Any = ((self.stiffness * (1.0 - units.motor_friction) + self.motor_damping)
                         * self.idle**2 / (self.hydraulic * self.driving))

    def side(self, load: Any, friction: Any) -> Side:
        """Return the constants of a side with so much motor torque and signed friction."""
        grip = 1.0 / (1.0 - friction)
        compliance = grip / self.stiffness
        stiff = 1.0 + compliance * self.motor_damping
        return Side(load, grip, self.hydraulic * stiff, self.idle * stiff, compliance * load)


class ClosedForm(Constants):
    """Lookups at one point, in plain floats.

    Attributes:
        forward, backward: while the motor drives, while it is driven.
        turned: while it is driven so fast that its damping turns the pressure round.
    """

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        super().__init__(stage, parameters)
        # Plain attributes: a lookup that costs a microsecond feels anything else.
        self.forward = self.side(self.driving, self.motor_friction)
        self.backward = self.side(self.driven, -self.motor_friction)
        self.turned = self.side(self.driven, self.motor_friction)

    def efficiency(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> float:
        """Efficiency [-] at one point in range; NaN where the load cannot be carried."""
        return self.point(displacement_ratio, engine_speed, load_torque)[0]

    def output_speed(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> float:
        """Output speed with slip [rad/s] at one point in range; NaN as for `efficiency`."""
        motor, _ = self.motor(self.full_flow * displacement_ratio, engine_speed, load_torque)
        output = self.idle + self.hydraulic * motor
        return engine_speed * output if output > 0.0 else math.nan

    def point(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> tuple[float, float]:
        """Efficiency [-] and output speed [rad/s] at once."""
        flow = self.full_flow * displacement_ratio
        motor, pressure = self.motor(flow, engine_speed, load_torque)
        engine_torque = self.engine_torque(flow, motor, pressure, engine_speed, load_torque)
        output = self.idle + self.hydraulic * motor
        return (load_torque / engine_torque if engine_torque > 0.0 else math.nan,
                engine_speed * output if output > 0.0 else math.nan)

    def motor(self, flow: float, engine_speed: float, load_torque: float) -> tuple[float, float]:
        """Return motor speed per engine speed and pressure torque [N m] for a flow s."""
        load = load_torque / engine_speed
        speed = self._root(self.forward, flow, load)
        if speed > 0.0:
            return speed, self._pressure(self.forward, speed, engine_speed, load_torque)
        if math.isnan(speed) and load > self.collapse:
            return math.nan, math.nan
        speed = self._root(self.backward, flow, load)
        if speed >= 0.0:
            # Friction holds the motor, and the whole flow leaks.
            return 0.0, flow * self.stiffness * engine_speed
        pressure = self._pressure(self.backward, speed, engine_speed, load_torque)
        if not pressure >= 0.0:
            faster = self._root(self.turned, flow, load)
            turned = self._pressure(self.turned, faster, engine_speed, load_torque)
            if turned < 0.0:
                return faster, turned
        return speed, pressure

    def _pressure(self, side: Side, speed: float, engine_speed: float, load_torque: float) -> float:
        torque = side.load * load_torque / (self.idle + self.hydraulic * speed)
        return (torque + self.motor_damping * engine_speed * speed) * side.grip

    def _root(self, side: Side, flow: float, load: float) -> float:
        _, _, square, linear, constant = side
        b = linear - self.hydraulic * flow
        c = constant * load - self.idle * flow
        inside = b * b - 4.0 * square * c
        if inside < 0.0:
            return math.nan
        # The larger root is the one that tends to the flow as leakage vanishes.
        root = math.sqrt(inside)
        return -2.0 * c / (b + root) if b > 0.0 else (root - b) / (2.0 * square)

    def engine_torque(
        self, flow: float, motor: float, pressure: float, engine_speed: float, load_torque: float
    ) -> float:
        """Torque of the engine [N m] at a state of the motor found; NaN without an output."""
        output = self.idle + self.hydraulic * motor
        if not output > 0.0:
            return math.nan
        ideal = pressure * flow
        pump = ideal + self.pump_friction * abs(ideal) + self.pump_drag * engine_speed
        gears = self.pump_gear_efficiency
        return self.mechanical_load * load_torque / output + (
            pump / gears if pump > 0.0 else pump * gears)
