# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Eqs (4), (13)-(15) without effects as one quadratic of the output speed in each regime.

Powers are balanced shaft by shaft: the motor speed follows from the flow, the torques from the
load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole. All quantities are taken per engine speed:

* y, x, z: speeds of output, motor and pump,
* :math:`L = T / \omega`: the load,
* e: the displacement ratio as set, times :math:`V_p / V_m`,
* :math:`\pi = p V_m / \omega`: the pressure as a torque of the motor,
* M, P: torques of motor and pump, :math:`T_e / \omega`: the torque of the engine.

.. math:: y = m + h x, \quad z = a + c y \;(4), \qquad \frac{\pi}{K} = e z - x \;(13)

.. math:: M = (1 \mp c_{fm}) \pi - f_m x \;(14), \qquad
          P = (1 \pm c_{fp}) e \pi + f_p z \;(15), \qquad
          \frac{L}{y} = \alpha M + \rho P, \qquad \frac{T_e}{\omega} = \frac{G L}{y} + \gamma P

Input-coupled, the motor acts on the row: c = 0 and :math:`\rho = 0`. Without a row (hydrostatic),
m and G are 0 too. Output-coupled, the pump braces the row that drives the output, and the motor is
geared to the output: m = 0 and G = 0.

Friction and gears take their signs from the direction in which power flows. In each regime of
these signs y is a root of a quadratic, which follows from pi of (13):

.. math:: A y^2 - B y + L = 0, \qquad S = K (\alpha (1 \mp c_{fm}) + \rho (1 \pm c_{fp}) e)

.. math:: A = S \left(\frac{1}{h} - c e\right) + \frac{\alpha f_m}{h} - \rho f_p c, \qquad
          B = S \left(\frac{m}{h} + a e\right) + \frac{\alpha f_m m}{h} + \rho f_p a

Its larger root tends to eq. (5), y = (m + h a e) / (1 - h c e), as leakage vanishes.

Reflection. An output that turns backward reflects y, x, e, m and c. On the row, a load that drives
the engine (overrun) reflects them too, so that the row always asks the motor for a torque in its
positive sense; overrun then has y < 0, and the lower root. The sense of the output and the sense
of the power make four quadrants, each with its constants.

Two limits of the closed form, both output-coupled:

* Pole. At h c e = 1 the flow that the motor takes equals the flow that the row feeds back to the
  pump, and eq. (5) has a pole. Beyond it no speed follows from the flow: there is no answer.
* Pump turned backward. In fast overrun the row turns the pump backward (z < 0). Its friction and
  the direction of power in its gears change sign with it, so these are separate regimes. In a
  narrow strip between them friction holds the pump at rest; the closed form has no answer there.

The sense of the output is that of the torque that acts on it at standstill without load. Where this
torque is zero or less in both senses, friction holds the output: only zero load has an answer.

Reading of eq. (15): as printed, pump friction c_fp would *help* the engine; here it takes torque.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..transmission.parameters import Parameters
from ..transmission.stage import Stage


class Regime(IntEnum):
    """Directions of power in the hydraulic path, from high pressure to low."""

    DRIVING = 0
    """The motor drives the output."""
    DRIVEN = 1
    """The motor is driven; the pressure is still positive."""
    REVERSED = 2
    """The damping of the motor reverses the pressure."""
    MOTORED = 3
    """The pump drives, too; only a pump on the row can."""
    BACKWARD = 4
    """The row turns the pump backward against its torque: the pump takes power."""
    BACKWARD_MOTORED = 5
    """The row turns the pump backward along its torque: the pump gives power."""


_REGIMES = tuple(Regime)
BACKWARD_REGIMES = (Regime.BACKWARD, Regime.BACKWARD_MOTORED)


class Signs(NamedTuple):
    """Signs of the power of the motor, of the pressure, and of torque and speed of the pump."""

    motor: int
    pressure: int
    pump: int
    turning: int = 1


SIGNS = {
    Regime.DRIVING: Signs(motor=1, pressure=1, pump=1),
    Regime.DRIVEN: Signs(motor=-1, pressure=1, pump=1),
    Regime.REVERSED: Signs(motor=-1, pressure=-1, pump=1),
    Regime.MOTORED: Signs(motor=-1, pressure=-1, pump=-1),
    Regime.BACKWARD: Signs(motor=-1, pressure=-1, pump=-1, turning=-1),
    Regime.BACKWARD_MOTORED: Signs(motor=-1, pressure=-1, pump=1, turning=-1),
}


class Senses(NamedTuple):
    """Which quadrant: numbers, or arrays of shape (n,) where points differ.

    Attributes:
        output: 1 where the output turns forward, -1 where it turns backward.
        power: 1 where the load takes power, -1 in overrun.
    """

    output: Any = 1
    power: Any = 1


FORWARD_PULL = Senses()


class StartingTorque(NamedTuple):
    """Torque on an output at rest without load, B / 2, as a polynomial of e.

    Attributes:
        level: at e = 0.
        slope: of e.
        square: of e squared.
    """

    level: Any
    slope: Any
    square: Any

    def at(self, ratio: Any) -> Any:
        """Return the torque at e."""
        return self.level + (self.slope + self.square * ratio) * ratio


@dataclass(frozen=True)
class RegimeConstants:
    """Constants of one regime; torques per pressure torque pi or per speed x, z.

    Attributes:
        motor: output torque of the motor per pi, alpha (1 -+ c_fm).
        motor_drag: output torque that the damping of the motor takes per x, alpha f_m.
        brace: output torque that the pump braces per P, rho; 0 without a pump on the row.
        brace_drag: the same that its damping makes per z, rho f_p.
        pump: 1 + c_fp or 1 - c_fp, for a positive displacement ratio.
        square: A at e = 0.
        level: B / 2 at e = 0.
        flow: what e adds to B / 2, except for the brace.
    """

    motor: Any
    motor_drag: Any
    brace: float
    brace_drag: Any
    pump: float
    square: Any
    level: Any
    flow: Any


class Quadrant:
    """Constants of one quadrant without effects, and the laws (13)-(15) in them.

    Constants are arrays where an argument is. Points have shape (n,); parameters of shape (..., 1)
    give (..., n).

    Args:
        stage: of any layout.
        parameters: of the units.
        senses: of output and power.

    Attributes:
        stage: as given.
        given: parameters of the units.
        pump_on_row: whether the pump is on the row (output-coupled).
        reflection: sign of what is reflected.
        sense: sign of y.
        mechanical_ratio: m [-].
        hydraulic_ratio: h [-].
        pump_ratios: a and c [-].
        flow_ratio: e at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        mechanical_load: G, engine torque per output torque over the mechanical path [-].
        pump_friction: c_fp [-].
        pump_damping: f_p [N m s/rad].
        pump_gears: mean and half the difference of gamma for a driven and for a driving pump [-].
        backward_gears: the same for a pump that turns backward.
        stall_load: L above which a motor that comes to rest goes on to stall, because a slower
            output asks for more leakage than there is flow [N m s/rad].
    """

    def __init__(
        self, stage: Stage, parameters: Parameters, senses: Senses = FORWARD_PULL
    ) -> None:
        units = stage.pump_motor
        engine_share, output_share = stage.pump_speed_ratios
        self.stage = stage
        self.given = parameters
        self.senses = senses
        self.pump_on_row = stage.layout == "output_coupled"
        self.sense: Any = 1 if self.pump_on_row else senses.power
        self.reflection: Any = senses.output * self.sense
        self.hydraulic_ratio = abs(stage.motor_speed_ratio)
        self.mechanical_ratio: Any = 0.0
        if not self.pump_on_row:
            self.mechanical_ratio = self.reflection * stage.mechanical_speed_ratio
        self.pump_ratios = engine_share, self.reflection * output_share
        displacements = units.pump_displacement / units.motor_displacement
        self.flow_ratio: Any = self.reflection * math.copysign(
            displacements, stage.motor_speed_ratio
        )
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.pump_friction = units.pump_friction
        self.pump_damping: Any = parameters.pump_damping
        # What the gears of the output path pass on to the load.
        self._output_gears = passed(stage.output.efficiency, senses.power)
        self.mechanical_load: Any = self._mechanical_load(stage)
        self.pump_gears, self.backward_gears = self._pump_gears(stage)
        self._constants: list[RegimeConstants | None] = [None] * len(Regime)
        self.stall_load: Any = -math.inf
        if not self.pump_on_row:
            m = self.mechanical_ratio
            stall = m**2 * self.constants(Regime.DRIVING).square
            self.stall_load = np.where(m >= 0.0, stall, -math.inf)

    @property
    def regimes(self) -> list[RegimeConstants]:
        """Constants by `Regime`; a pump that is not on the row needs the first three."""
        regimes = _REGIMES if self.pump_on_row else _REGIMES[: Regime.MOTORED]
        return [self.constants(regime) for regime in regimes]

    def constants(self, regime: Regime) -> RegimeConstants:
        """Return the constants of a regime, which are worked out when they are first needed."""
        constants = self._constants[regime]
        if constants is None:
            constants = self._regime(regime)
            self._constants[regime] = constants
        return constants

    def _mechanical_load(self, stage: Stage) -> Any:
        """G: engine torque per output torque over the mechanical path."""
        if self.pump_on_row:
            return 0.0
        m = self.mechanical_ratio
        # The row drives the mechanical path back where the other one gives more than the load.
        gears = passed(stage.mechanical.efficiency, sign(m >= 0.0))
        return m / (self._output_gears * gears)

    def _pump_gears(
        self, stage: Stage
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Mean and half the difference of gamma for either sign of P, z > 0 and z < 0."""
        pump = stage.pump.efficiency
        mechanical = stage.mechanical.efficiency if self.pump_on_row else 1.0
        engine_share = self.pump_ratios[0]
        # The engine gives torque while P > 0; the pump takes power while P z > 0.
        forward = _mean_and_half(1.0 / (pump * mechanical), pump * mechanical)
        backward = _mean_and_half(pump / mechanical, mechanical / pump)
        return (
            (engine_share * forward[0], engine_share * forward[1]),
            (engine_share * backward[0], engine_share * backward[1]),
        )

    def _regime(self, regime: Regime) -> RegimeConstants:
        stage, parameters = self.stage, self.given
        units, signs = stage.pump_motor, SIGNS[regime]
        h, m = self.hydraulic_ratio, self.mechanical_ratio
        a, c = self.pump_ratios
        gear = stage.motor.efficiency**signs.motor / h
        brace: Any = 0.0
        brace_drag: Any = 0.0
        if self.pump_on_row:
            # The row drives the output while the pump brakes the row, and drives it on while the
            # pump is driven by it.
            output_gears = passed(stage.output.efficiency, signs.pump * sign(c < 0.0))
            pump_gears = stage.pump.efficiency ** -(signs.pump * signs.turning)
            brace = -c * pump_gears * output_gears
            brace_drag = brace * parameters.pump_damping
            friction = units.motor_friction * signs.pressure
        else:
            gear = gear * self._output_gears
            friction = units.motor_friction * signs.pressure * signs.motor
        motor = gear * (1.0 - friction)
        drag = gear * parameters.motor_damping
        stiff = self.stiffness * gear * (1.0 - friction)
        damped = stiff + drag
        level = damped * m / h
        square = damped / h
        if self.pump_on_row:
            level = level + brace_drag * a
            square = square - brace_drag * c
        return RegimeConstants(
            motor=motor,
            motor_drag=drag,
            brace=brace,
            brace_drag=brace_drag,
            pump=1.0 + units.pump_friction * signs.pressure * signs.turning,
            square=square,
            level=0.5 * level,
            flow=0.5 * stiff * a,
        )

    @cached_property
    def standing_ratio(self) -> Any:
        """Displacement ratio at which the output stands without load [-]: B = 0."""
        a, c = self.pump_ratios
        # The regime in which the pump takes torque.
        regime = self.constants(Regime.REVERSED if c < 0.0 else Regime.DRIVING)
        square = self.stiffness * regime.brace * (1.0 + self.pump_friction) * a
        inside = regime.flow * regime.flow - 2.0 * square * regime.level
        root = (inside * (inside > 0.0)) ** 0.5
        return -2.0 * regime.level / (regime.flow + root) / self.flow_ratio

    def resting_ratios(self, load: float) -> list[float]:
        """Displacement ratios between which friction holds the motor or it stalls, lowest first.

        Both are 0 where the motor is not on the row.
        """
        if self.pump_on_row:
            return [0.0, 0.0]
        ratios = []
        for regime in self.regimes[: Regime.REVERSED]:
            slowest = max(self.mechanical_ratio, math.sqrt(load / regime.square))
            level = 0.5 * (regime.square * slowest + load / slowest)
            ratios.append((level - regime.level) / regime.flow / self.flow_ratio)
        return sorted(ratios)

    def beyond_pole(self, ratio: Any) -> Any:
        """Whether e lies at or beyond the pole of eq. (5), where no speed follows from the flow."""
        return self.hydraulic_ratio * self.pump_ratios[1] * ratio >= 1.0

    @cached_property
    def starting_torques(self) -> tuple[StartingTorque, StartingTorque]:
        """Torque on an output at rest without load, for e > 0 and for e <= 0.

        At rest the pressure has the sign of e, the pump turns forward and takes torque.
        """
        torques = []
        for regime in (Regime.DRIVING, Regime.REVERSED):
            constants = self.constants(regime)
            brace = self.stiffness * constants.brace * (1.0 + self.pump_friction)
            square = 0.5 * brace * self.pump_ratios[0]
            torques.append(StartingTorque(constants.level, constants.flow, square))
        return torques[0], torques[1]

    def starts(self, ratio: Any) -> Any:
        """Whether an output at rest without load starts in the sense of the quadrant."""
        positive, negative = self.starting_torques
        torque = np.where(ratio > 0.0, positive.at(ratio), negative.at(ratio))
        return torque > 0.0

    def quadratic(
        self, regime: RegimeConstants, ratio: Any, load: Any
    ) -> tuple[Any, Any, Any]:
        """Return B / 2A, L / A and A in one regime, for e and L."""
        level = self._level(regime, ratio)
        square = self._square(regime, ratio)
        return level / square, load / square, square

    def _level(self, regime: RegimeConstants, ratio: Any) -> Any:
        """Return B / 2 in one regime, for e."""
        level = regime.level + regime.flow * ratio
        if not self.pump_on_row:
            return level
        return level + 0.5 * self._brace(regime, ratio) * self.pump_ratios[0] * ratio

    def _square(self, regime: RegimeConstants, ratio: Any) -> Any:
        """Return A in one regime, for e."""
        if not self.pump_on_row:
            return regime.square
        brace = self._brace(regime, ratio)
        fed_back = (self.stiffness * regime.motor + brace) * self.pump_ratios[1] * ratio
        return regime.square + brace / self.hydraulic_ratio - fed_back

    def _brace(self, regime: RegimeConstants, ratio: Any) -> Any:
        """Return what the pump braces per z, K rho (1 -+ c_fp) e, in one regime."""
        rubbed = ratio + (regime.pump - 1.0) * abs(ratio)
        return self.stiffness * regime.brace * rubbed

    def pump_speed(self, output: Any) -> Any:
        """Return z for y, eq. (4)."""
        a, c = self.pump_ratios
        return a + c * output if self.pump_on_row else a

    def pressure(self, ratio: Any, output: Any) -> Any:
        """Return pi for e and y, eq. (13).

        This holds for a motor that friction holds, too: there the whole flow leaks.
        """
        motor = (output - self.mechanical_ratio) / self.hydraulic_ratio
        return self.stiffness * (ratio * self.pump_speed(output) - motor)

    def pump_torque(
        self, ratio: Any, output: Any, pressure: Any, turning: Any = 1
    ) -> Any:
        """Return P, eq. (15), of a pump that turns forward (1) or backward (-1)."""
        ideal = ratio * pressure
        friction = turning * (self.pump_friction * abs(ideal))
        return ideal + friction + self.pump_damping * self.pump_speed(output)

    def drives(self, pressure: Any, output: Any) -> Any:
        """Whether a motor at the output drives it, M > 0."""
        driving = self.constants(Regime.DRIVING)
        drag = driving.motor_drag * output / self.hydraulic_ratio
        return driving.motor * pressure > drag

    def engine_torque(self, ratio: Any, output: Any, load: Any) -> Any:
        """Return the torque of the engine per engine speed [N m s/rad]."""
        pressure = self.pressure(ratio, output)
        pump = self.pump_torque(ratio, output, pressure)
        mean, half = self.pump_gears
        torque = self.mechanical_load * load / output + mean * pump + half * abs(pump)
        if not self.pump_on_row:
            return torque
        backward = self.pump_speed(output) < 0.0
        if not np.any(backward):
            return torque
        pump = self.pump_torque(ratio, output, pressure, -1)
        mean, half = self.backward_gears
        return np.where(backward, mean * pump + half * abs(pump), torque)


def _mean_and_half(first: float, second: float) -> tuple[float, float]:
    """Return the mean of two numbers and half their difference."""
    return 0.5 * (first + second), 0.5 * (first - second)


def sign(holds: Any) -> Any:
    """Return 1 where a condition holds, else -1; a plain number where it is the same everywhere."""
    holds = np.asarray(holds)
    if holds.all():
        return 1
    return np.where(holds, 1, -1) if holds.any() else -1


def passed(efficiency: float, power_sense: Any) -> Any:
    """Return what gears pass on: their efficiency (sense 1) or its reciprocal (sense -1)."""
    if np.ndim(power_sense):
        return np.where(power_sense > 0, efficiency, efficiency**-1)
    return efficiency**power_sense
