# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The power balance of eqs (4), (13)-(15) without effects, of every layout: at one point, at many.

Powers are balanced shaft by shaft: the motor speed follows from the flow, the torques from the
load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole. With, per engine speed, the output speed y, the motor
speed x, the pump speed z, the load :math:`L = T / \omega`, the displacement ratio e as set times
:math:`V_p / V_m`, and the pressure as a torque of the motor :math:`\pi = p V_m / \omega`:

.. math:: y = m + h x, \quad z = a + c y \;(4), \qquad \frac{\pi}{K} = e z - x \;(13)

.. math:: M = (1 \mp c_{fm}) \pi - f_m x \;(14), \qquad
          P = (1 \pm c_{fp}) e \pi + f_p z \;(15), \qquad
          \frac{L}{y} = \alpha M + \rho P, \qquad \frac{T_e}{\omega} = \frac{G L}{y} + \gamma P

Input-coupled the motor acts on the row: c = 0 and :math:`\rho = 0`. Without a row (hydrostatic) m
and G are 0 too. Output-coupled the pump braces the row that drives the output, and the motor is
geared to the output: m = 0 and G = 0. Friction and gears take their signs from the way in which
power flows; in each regime of them y is a root of a quadratic, from pi of (13):

.. math:: A y^2 - B y + L = 0, \qquad S = K (\alpha (1 \mp c_{fm}) + \rho (1 \pm c_{fp}) e)

.. math:: A = S \left(\frac{1}{h} - c e\right) + \frac{\alpha f_m}{h} - \rho f_p c, \qquad
          B = S \left(\frac{m}{h} + a e\right) + \frac{\alpha f_m m}{h} + \rho f_p a

Its larger root tends to m + h a e, eq. (5), as leakage vanishes. From high pressure to low the
regimes are: the motor drives; it is driven; its damping reverses the pressure; the pump drives.
Between the first two friction holds a motor on the row, as any stiction does.

An output that turns backward reflects y, x, e, m, c. On the row a load that drives the engine
(overrun) reflects them too, so that the row always asks the motor for a torque in its positive
sense; overrun then has y < 0, and the lower root. These signs make four quadrants, each with its
constants.

Reading of eq. (15): as printed, pump friction c_fp would *help* the engine; here it takes torque.
"""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..transmission.parameters import Parameters
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage

Point = tuple[float, float, float]
Ways = tuple[Any, Any]
"""Sense of the output and of the power: 1, -1, or arrays of these where points differ."""
_ROUNDED = 1e-14  # x that is none but for rounding
STANDING = math.ulp(
    0.0
)  # y of an output at rest without load: no torque over no speed is none
DRIVEN, REVERSED, MOTORED = (
    1,
    2,
    3,
)  # regimes after the first, in which the motor drives
_SIGNS = (
    (1, 1, 1),
    (-1, 1, 1),
    (-1, -1, 1),
    (-1, -1, -1),
)  # of motor, pressure and pump torque


class Regime(NamedTuple):
    """Constants of one regime; per pressure torque, per speed of motor or pump.

    Attributes:
        motor, motor_drag: output torque of the motor.
        brace, brace_drag: output torque that the pump braces; 0 but on the row.
        pump: 1 + c_fp or 1 - c_fp, for a positive displacement ratio.
        square, level, flow: A and B / 2 at e = 0, and what e adds to B / 2 but for the brace.
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
    """One quadrant without effects: its constants, arrays where an argument is, and the state.

    Points have shape (n,); parameters of shape (..., 1) give (..., n).

    Args:
        stage: of any layout.
        parameters: of the units.
        turning: sense of the output, 1 forward or -1 backward.
        power: 1 where the load takes power, -1 in overrun.

    Attributes:
        braced: whether the pump is on the row (output-coupled).
        reflection, sense: signs of what is reflected, and of y.
        mechanical_ratio, hydraulic_ratio: m, h [-].
        pump_ratios: a, c [-].
        full: e at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        regimes: from high pressure to low; a pump that is not on the row needs three.
        mechanical_load: G, engine torque per output torque, over the mechanical path [-].
        pump_friction, pump_damping: c_fp, f_p.
        pump_gears: mean and half the difference of gamma where the pump is driven and drives.
        stall_load: L above which a motor that comes to rest goes on to stall: a slower output then
            asks for more leakage than flow [N m s/rad].
    """

    def __init__(
        self, stage: Stage, parameters: Parameters, turning: Any = 1, power: Any = 1
    ) -> None:
        units, ratio = stage.pump_motor, stage.motor_speed_ratio
        self.turning, self.power, self.braced = (
            turning,
            power,
            stage.layout == "output_coupled",
        )
        self.sense: Any = 1 if self.braced else power
        self.reflection: Any = turning * self.sense
        self.hydraulic_ratio = h = abs(ratio)
        self.mechanical_ratio: Any = (
            0.0 if self.braced else (self.reflection * stage.mechanical_speed_ratio)
        )
        m = self.mechanical_ratio
        a, fed = stage.pump_speed_ratios
        self.pump_ratios = a, c = a, self.reflection * fed
        self.full: Any = self.reflection * math.copysign(
            units.pump_displacement / units.motor_displacement, ratio
        )
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.pump_friction = units.pump_friction
        self.pump_damping: Any = parameters.pump_damping
        self.mechanical_load: Any = 0.0
        pump_gears, output_gears = stage.pump.efficiency, stage.output.efficiency
        if self.braced:
            pump_gears *= stage.mechanical.efficiency
        else:
            # The row drives the mechanical path back where the other one gives more than the load.
            given = _passed(output_gears, power)
            self.mechanical_load = m / (
                given * _passed(stage.mechanical.efficiency, sign(m >= 0.0))
            )
        self.pump_gears = (
            0.5 * a * (1.0 / pump_gears + pump_gears),
            (0.5 * a * (1.0 / pump_gears - pump_gears)),
        )
        self.regimes = []
        for drives, pressure, takes in _SIGNS if self.braced else _SIGNS[:MOTORED]:
            gear, brace, brace_drag = stage.motor.efficiency**drives / h, 0.0, 0.0
            if self.braced:
                # The row drives the output while the pump brakes it; driven by it, it drives on.
                brace = (
                    -c
                    * stage.pump.efficiency**-takes
                    * _passed(output_gears, takes * sign(c < 0.0))
                )
                brace_drag = brace * parameters.pump_damping
                friction = units.motor_friction * pressure
            else:
                gear = gear * given
                friction = units.motor_friction * pressure * drives
            drag, stiff = (
                gear * parameters.motor_damping,
                self.stiffness * gear * (1.0 - friction),
            )
            level = (stiff + drag) * m / h + brace_drag * a
            self.regimes.append(
                Regime(
                    gear * (1.0 - friction),
                    drag,
                    brace,
                    brace_drag,
                    1.0 + units.pump_friction * pressure,
                    (stiff + drag) / h - brace_drag * c,
                    0.5 * level,
                    0.5 * stiff * a,
                )
            )
        self.stall_load = (
            -math.inf
            if self.braced
            else np.where(m >= 0.0, m**2 * self.regimes[0].square, -math.inf)
        )

    @cached_property
    def standing(self) -> Any:
        """Displacement ratio at which an output without load stands [-]: B = 0."""
        a, c = self.pump_ratios
        regime = self.regimes[REVERSED if c < 0.0 else 0]  # where the pump takes torque
        square = self.stiffness * regime.brace * (1.0 + self.pump_friction) * a
        inside = regime.flow * regime.flow - 2.0 * square * regime.level
        root = (inside * (inside > 0.0)) ** 0.5
        return -2.0 * regime.level / (regime.flow + root) / self.full

    def resting_ratios(self, load: float) -> list[float]:
        """Displacement ratios between which friction holds the motor or it stalls, lowest first.

        Both 0 where the motor is not on the row.
        """
        if self.braced:
            return [0.0, 0.0]
        ratios = []
        for regime in self.regimes[:REVERSED]:
            slowest = max(self.mechanical_ratio, math.sqrt(load / regime.square))
            level = 0.5 * (regime.square * slowest + load / slowest)
            ratios.append((level - regime.level) / regime.flow / self.full)
        return sorted(ratios)

    def quadratic(self, regime: Regime, ratio: Any, load: Any) -> tuple[Any, Any, Any]:
        """B / 2A, L / A and A in one regime, for e and L."""
        square, level = regime.square, regime.level + regime.flow * ratio
        if self.braced:
            a, c = self.pump_ratios
            brace = (
                self.stiffness
                * regime.brace
                * (ratio + (regime.pump - 1.0) * abs(ratio))
            )
            level = level + 0.5 * brace * a * ratio
            square = (
                square
                + brace / self.hydraulic_ratio
                - (self.stiffness * regime.motor + brace) * c * ratio
            )
        return level / square, load / square, square

    def pump_speed(self, output: Any) -> Any:
        """Return z for y, eq. (4)."""
        engine, fed = self.pump_ratios
        return engine + fed * output if self.braced else engine

    def pressure(self, ratio: Any, output: Any) -> Any:
        """Return pi for e and y, eq. (13); what friction holds too: the whole flow leaks there."""
        return self.stiffness * (
            ratio * self.pump_speed(output)
            - (output - self.mechanical_ratio) / self.hydraulic_ratio
        )

    def pump_torque(self, ratio: Any, output: Any, pressure: Any) -> Any:
        """Return P, eq. (15)."""
        ideal = ratio * pressure
        return (
            ideal
            + self.pump_friction * abs(ideal)
            + self.pump_damping * self.pump_speed(output)
        )

    def drives(self, pressure: Any, output: Any) -> Any:
        """Whether a motor at the output drives it, M > 0."""
        first = self.regimes[0]
        return first.motor * pressure > first.motor_drag * output / self.hydraulic_ratio

    def engine_torque(self, ratio: Any, output: Any, load: Any) -> Any:
        """Torque of the engine per engine speed [N m s/rad]."""
        pump, (mean, half) = (
            self.pump_torque(ratio, output, self.pressure(ratio, output)),
            (self.pump_gears),
        )
        return self.mechanical_load * load / output + mean * pump + half * abs(pump)

    # --- at many points -----------------------------------------------------------------------

    def solve(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque; NaN where the load cannot be carried."""
        engine_speed, load_torque = points.engine_speed, points.load_torque
        ratio, load = self.full * points.displacement_ratio, load_torque / engine_speed
        output = self.output(ratio, load)
        known = output * self.sense > 0.0  # of the sign that the load asks for
        if not load.all():
            known, output = (
                known | (load == 0.0),
                np.where(output == 0.0, STANDING, output),
            )
        output = np.where(known, output, np.nan)
        torque = self.engine_torque(ratio, output, load) * engine_speed
        return Solution.of(load_torque, torque, self.reflection * engine_speed * output)

    def output(self, ratio: Array, load: Array) -> Array:
        """Output speed y for e."""
        driving, driven = self.output_speeds(ratio, load)
        if not self.braced:
            return self.selected(driving, driven, self.mechanical_ratio, load)
        drives = self.drives(self.pressure(ratio, driving), driving) | np.isnan(driving)
        return np.where(drives, driving, driven)

    def output_speeds(self, ratio: Array, load: Array) -> tuple[Array, Array]:
        """Output speed y while the motor drives and while it is driven, valid or not."""
        driving, driven = (self._root(regime, ratio, load) for regime in (0, DRIVEN))
        reversed_ = ~(self.pressure(ratio, driven) >= 0.0)
        if reversed_.any():
            slower = self._root(REVERSED, ratio, load)
            if self.braced:
                motored = ~(
                    self.pump_torque(ratio, slower, self.pressure(ratio, slower)) >= 0.0
                )
                slower = np.where(motored, self._root(MOTORED, ratio, load), slower)
            driven = np.where(reversed_, slower, driven)
        return driving, driven

    def _root(self, regime: int, ratio: Array, load: Array) -> Array:
        middle, product, square = self.quadratic(self.regimes[regime], ratio, load)
        root = middle + self.sense * np.sqrt(middle * middle - product)
        if self.braced:
            root = np.where(square > 0.0, root, np.nan)
        return (
            np.asarray(root)
            if load.all()
            else np.where(load == 0.0, 2.0 * middle, root)
        )

    def selected(
        self, driving: Array, driven: Array, rest: float, load: Array
    ) -> Array:
        """Speed that is taken of a motor on the row; that at rest where friction holds it.

        Friction asks for more pressure while it drives, so driving < driven: at most one is valid.
        """
        stalls = np.isnan(driving) & (load > self.stall_load)
        return np.where(
            driving > rest, driving, np.where(stalls, np.nan, np.minimum(driven, rest))
        )

    def held(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> tuple[Array, Array]:
        """Displacement ratio and engine torque that make an output speed.

        The torque is NaN where no steady motor keeps the state. With the motor at rest many
        ratios do: the least is given, which leaks least.
        """
        output, load = (
            self.reflection * output_speed / engine_speed,
            load_torque / engine_speed,
        )
        motor, pump = (
            (output - self.mechanical_ratio) / self.hydraulic_ratio,
            self.pump_speed(output),
        )  # (4)

        def found_in(regime: Regime) -> tuple[Array, ...]:
            gear, drag, brace, brace_drag, rubbed, square, *_ = regime
            pressure = (load / output + drag * motor) / gear
            ratio = (motor + pressure / self.stiffness) / pump  # (13)
            if self.braced:
                brace = brace * rubbed
                rest, linear = (
                    pressure * gear - brace_drag * pump,
                    gear + brace * motor / pump,
                )
                pressure = (
                    2.0
                    * rest
                    / (
                        linear
                        + np.sqrt(
                            linear * linear
                            + 4.0 * brace * rest / (self.stiffness * pump)
                        )
                    )
                )
                ratio = (motor + pressure / self.stiffness) / pump
                square = self.quadratic(regime, ratio, load)[2]
            return pressure, ratio, square

        found = found_in(self.regimes[0])
        past = driven = ~(
            self.drives(found[0], output) if self.braced else motor > _ROUNDED
        )
        for number, regime in enumerate(self.regimes[1:], 1):
            if not past.any():
                break
            found = tuple(map(np.where, (past, past, past), found_in(regime), found))
            past = past & ~(
                (
                    found[0]
                    if number == DRIVEN
                    else self.pump_torque(found[1], output, found[0])
                )
                >= 0.0
            )
        _, ratio, square = found
        # The larger root, and no motor that stalls.
        keeps = square * output * output >= load
        if not self.braced:
            keeps &= ~driven | (load <= self.stall_load)
        torque = self.engine_torque(ratio, output, load) * engine_speed
        return ratio / self.full, np.where(keeps, torque, np.nan)


def sign(holds: Any) -> Any:
    """1 where a condition holds, else -1; a plain number where that is the same everywhere."""
    if np.all(holds):
        return 1
    return np.where(holds, 1, -1) if np.any(holds) else -1


def _passed(efficiency: float, way: Any) -> Any:
    """What gears pass on: their efficiency where power flows forward (1), or its reciprocal."""
    return (
        np.where(way > 0, efficiency, efficiency**-1)
        if np.ndim(way)
        else efficiency**way
    )


def at_point(
    quadrant: Callable[[tuple[int, int]], Quadrant],
) -> Callable[[float, float, float], Point]:
    """Return what solves one point in range in plain floats; NaN where no load is carried.

    It says what `Quadrant.solve` says, to the last digit, in one call: a control loop waits for it.
    """
    first = quadrant((1, 1))
    a, h, braced, stiffness = (
        first.pump_ratios[0],
        first.hydraulic_ratio,
        first.braced,
        first.stiffness,
    )
    rubbing, damping, (mean, half) = (
        first.pump_friction,
        first.pump_damping,
        first.pump_gears,
    )
    standing, forward, sqrt, nan = first.standing, first.full, math.sqrt, math.nan

    def constants(turning: int, power: int) -> tuple[Any, ...]:
        own = quadrant((turning, power))
        regimes = [
            (
                number,
                each.square,
                each.level,
                each.flow,
                (
                    each.motor,
                    each.motor_drag,
                    stiffness * each.motor,
                    stiffness * each.brace,
                    each.pump - 1.0,
                ),
            )
            for number, each in enumerate(own.regimes)
        ]
        # As floats: a product with an integer takes three times as long.
        sense, power_sign, reflection = map(float, (own.sense, power, own.reflection))
        return (
            own.full,
            own.pump_ratios[1],
            own.mechanical_ratio,
            sense,
            power_sign,
            reflection,
            own.stall_load,
            own.mechanical_load,
            regimes,
        )

    ahead, back = (
        (constants(turning, 1), constants(turning, -1)) for turning in (1, -1)
    )

    def solve(
        displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> Point:
        pull, overrun = (
            ahead if (displacement_ratio - standing) * forward > 0.0 else back
        )
        full, c, rest, sense, power, reflection, stall, carried, regimes = (
            pull if load_torque >= 0.0 else overrun
        )
        ratio, load = full * displacement_ratio, load_torque / engine_speed
        for number, square, level, flow, row in regimes:
            middle = level + flow * ratio
            if braced:
                motor, drag, stiff, brace, rubbed = row
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
        torque = (
            carried * load / output + mean * torque + half * abs(torque)
        ) * engine_speed
        efficiency = nan
        if torque * power > 0.0:
            efficiency = load_torque / torque if power > 0.0 else torque / load_torque
        return efficiency, reflection * engine_speed * output, torque

    return solve
