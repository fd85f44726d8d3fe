# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The power balance of eqs (4), (13)-(15) without effects: at one point, and at many.

Powers are balanced shaft by shaft: the motor speed follows from the flow, the torques from the
load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole. With, per engine speed, the motor speed x, the output
speed y and the flow s of the pump (the motor speed that it gives without leakage), and with the
pressure as a torque of the motor :math:`\pi = p V_m`:

.. math:: y = m + h x \;(4), \qquad x = s - \frac{\pi}{K \omega} \;(13), \qquad
          \pi = \frac{L T / y + f_m \omega x}{1 \mp c_{fm}} \;(14), \qquad
          T_e = \frac{G T}{y} + \frac{(1 \pm c_{fp})\, \pi s + f_p \omega}{\eta_p^{\pm 1}} \;(15)

Eqs (4), (13), (14) together are a quadratic in y in each regime of the motor: where it drives the
row (motoring), where the row drives it (pumping), and where it is driven so fast that its damping
reverses the pressure:

.. math:: y^2 - 2 y \left(\frac{m}{2} + k s\right) + g \frac{T}{\omega} = 0, \qquad
          k = \frac{h}{2 d}, \qquad g = \frac{h L}{(1 \mp c_{fm}) K d}, \qquad
          d = 1 + \frac{f_m}{(1 \mp c_{fm}) K}

Its larger root tends to m + h s, eq. (5), as leakage vanishes. Between motoring and pumping
friction holds the motor, as any stiction does.

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
    """k and g of the quadratic in y, in one regime of the motor."""

    flow_share: Any
    load_share: Any


class SteadyState:
    """The constants of one model without effects; arrays where its parameters are.

    Attributes:
        mechanical_ratio: m, output speed per engine speed while the motor stands [-].
        hydraulic_ratio: h, change of output speed per motor speed [-].
        full_flow: s at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        leak_torque: K / h: pressure torque per output speed lost to leakage [N m s/rad].
        motor_damping: f_m [N m s/rad].
        motoring, pumping, reversal: k and g in each regime.
        motoring_load, pumping_load: L while the motor drives, and while it is driven [-].
        motor_friction, pump_friction: c_fm, c_fp [-].
        mechanical_load: G, engine torque per output torque, over the mechanical path [-].
        pump_damping: f_p, referred to the engine [N m s/rad].
        pump_gears: mean and half the difference of what the engine gives per torque of the pump,
            driving it and driven by it, over the pairs between the two [-].
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
        self.leak_torque: Any = self.stiffness / self.hydraulic_ratio
        self.motor_damping: Any = parameters.motor_damping
        output_load = self.hydraulic_ratio / stage.output.efficiency
        self.motoring_load = output_load / stage.motor.efficiency
        self.pumping_load = output_load * stage.motor.efficiency
        self.motor_friction, self.pump_friction = units.motor_friction, units.pump_friction
        self.mechanical_load = (self.mechanical_ratio
                                / (stage.output.efficiency * stage.mechanical.efficiency))
        self.pump_damping: Any = parameters.pump_damping * pump_gear**2
        gears = stage.pump.efficiency
        self.pump_gears = 0.5 * (1.0 / gears + gears), 0.5 * (1.0 / gears - gears)
        friction = self.motor_friction
        self.motoring = self._regime(self.motoring_load, friction)
        self.pumping = self._regime(self.pumping_load, -friction)
        self.reversal = self._regime(self.pumping_load, friction)
        self.stall_load: Any = self.mechanical_ratio**2 / self.motoring.load_share

    def _regime(self, load: float, friction: float) -> Regime:
        """Return the constants of (4), (13), (14) with so much load and signed friction."""
        stiffness = (1.0 - friction) * self.stiffness
        damped = 1.0 + self.motor_damping / stiffness
        return Regime(self.hydraulic_ratio / (2.0 * damped),
                      self.hydraulic_ratio * load / (stiffness * damped))

    def engine_torque(
        self, flow: Any, free: Any, output: Any, engine_speed: Any, load_torque: Any
    ) -> Any:
        """Torque T_e for a flow s, with the output speeds y without leakage and with it [N m]."""
        # (13), with what friction holds too: the whole flow leaks there.
        ideal = self.leak_torque * (free - output) * engine_speed * flow
        pump = ideal + self.pump_friction * abs(ideal) + self.pump_damping * engine_speed
        mean, half = self.pump_gears
        return self.mechanical_load * load_torque / output + mean * pump + half * abs(pump)  # (15)


class PointSolver(SteadyState):
    """The steady state at one point in range, in plain floats."""

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> tuple[float, float]:
        """Efficiency and output speed with slip; NaN where the load cannot be carried."""
        flow = self.full_flow * displacement_ratio
        free = self.mechanical_ratio + self.hydraulic_ratio * flow  # (5)
        output = self._output(flow, free, load_torque / engine_speed)  # (4)
        if not output > 0.0:
            return math.nan, math.nan
        torque = self.engine_torque(flow, free, output, engine_speed, load_torque)
        return load_torque / torque if torque > 0.0 else math.nan, engine_speed * output

    def resting_ratios(self, engine_speed: float, load_torque: float) -> list[float]:
        """Displacement ratios between which friction holds the motor or it stalls, lowest first."""
        rest, ratios = self.mechanical_ratio, []
        for regime in (self.motoring, self.pumping):
            product = regime.load_share * load_torque / engine_speed
            slowest = max(rest, math.sqrt(product))
            flow = (slowest + product / slowest - rest) / (2.0 * regime.flow_share)
            ratios.append(flow / self.full_flow)
        return sorted(ratios)

    def _output(self, flow: float, free: float, load: float) -> float:
        """Output speed y for a flow s."""
        rest = self.mechanical_ratio
        output = self._root(self.motoring, flow, load)
        if output > rest:
            return output
        if math.isnan(output) and load > self.stall_load:
            return math.nan
        output = self._root(self.pumping, flow, load)
        if output >= rest:
            return rest
        if not output <= free:
            faster = self._root(self.reversal, flow, load)
            if faster > free:
                return faster
        return output

    def _root(self, regime: Regime, flow: float, load: float) -> float:
        middle = 0.5 * self.mechanical_ratio + regime.flow_share * flow
        inside = middle * middle - regime.load_share * load
        return middle + math.sqrt(inside) if inside >= 0.0 else math.nan


class ArraySolver(SteadyState):
    """The steady state at points of shape (n,); parameters of shape (..., 1) give (..., n)."""

    def solve(self, points: OperatingPoints) -> Answer:
        """Efficiency and output speed; NaN where the load cannot be carried."""
        _, engine_speed, load_torque, _ = points
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            flow, load = self.full_flow * points.displacement_ratio, load_torque / engine_speed
            free = self.mechanical_ratio + self.hydraulic_ratio * flow  # (5)
            output = self.selected(*self.output_speeds(flow, load), self.mechanical_ratio, load)
            output = np.where(output > 0.0, output, np.nan)
            torque = self.engine_torque(flow, free, output, engine_speed, load_torque)
            return Answer(np.where(torque > 0.0, load_torque / torque, np.nan),
                          engine_speed * output)

    def output_speeds(self, flow: Array, load: Array) -> tuple[Array, Array]:
        """Output speed y while motoring and while pumping, valid or not: see `selected`."""
        motoring, pumping = (self._root(regime, flow, load)
                             for regime in (self.motoring, self.pumping))
        free = self.mechanical_ratio + self.hydraulic_ratio * flow
        reverses = ~(pumping <= free)
        if reverses.any():
            faster = self._root(self.reversal, flow, load)
            pumping = np.where(reverses & (faster > free), faster, pumping)
        return motoring, pumping

    def _root(self, regime: Regime, flow: Array, load: Array) -> Array:
        middle = 0.5 * self.mechanical_ratio + regime.flow_share * flow
        return np.asarray(middle + np.sqrt(middle * middle - regime.load_share * load))

    def selected(self, motoring: Array, pumping: Array, rest: float, load: Array) -> Array:
        """Speed that is taken, of those in either regime; that at rest where friction holds it.

        Friction asks for more pressure while motoring, so motoring < pumping: at most one is valid.
        """
        slow = np.minimum(pumping, rest)
        stalls = np.isnan(motoring) & (load > self.stall_load)
        return np.where(motoring > rest, motoring, np.where(stalls, np.nan, slow))

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
