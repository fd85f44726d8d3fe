# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The steady state without effects at many points: the quadratics of `regimes`, regime by regime.

From high pressure to low the regimes are: the motor drives; it is driven; its damping reverses the
pressure; the pump drives. Between the first two, friction holds a motor on the row, as stiction
does.
"""

import math
from typing import Any

import numpy as np

from ..transmission.ranges import Array, OperatingPoints, Solution
from .regimes import BACKWARD_REGIMES, SIGNS, Quadrant, Regime

STANDING = math.ulp(0.0)
"""y of an output at rest without load: the smallest number, so that no torque is 0 / 0."""

ROUNDING = 1e-9
"""Torque of the wrong sign, against K y, that is rounding where two regimes meet."""

_DRIVEN_REGIMES = (Regime.DRIVEN, Regime.REVERSED, Regime.MOTORED)

MOTOR_REST_BOUND = 1e-14
"""x below which a motor rests but for rounding."""


class SteadyState(Quadrant):
    """The steady state of one quadrant at points of shape (n,)."""

    def solve(
        self, points: OperatingPoints, resting: np.ndarray | None = None
    ) -> Solution:
        """Return efficiency, output speed and engine torque; NaN where there is no steady state.

        Args:
            points: with displacement ratio, engine speed and load torque.
            resting: where friction holds the output, shape (n,); None for nowhere.
        """
        engine_speed, load_torque = points.engine_speed, points.load_torque
        ratio = self.flow_ratio * points.displacement_ratio
        load = load_torque / engine_speed
        output = self.output(ratio, load)
        has_sense = output * self.sense > 0.0
        if resting is not None:
            has_sense = has_sense & ~resting
        if not load.all():
            if resting is not None:
                output = np.where(resting, STANDING, output)
            output = np.where(output == 0.0, STANDING, output)
            has_sense = has_sense | ((load == 0.0) & np.isfinite(output))
        output = np.where(has_sense, output, np.nan)
        torque = self.engine_torque(ratio, output, load) * engine_speed
        speed = self.reflection * engine_speed * output
        if not load.all():
            speed = np.where(output == STANDING, 0.0, speed)
        return Solution.of(load_torque, torque, speed)

    def output(self, ratio: Array, load: Array) -> Array:
        """Return the output speed y for e and L, shape (..., n); NaN where there is none."""
        driving, driven = self.output_speeds(ratio, load)
        if not self.pump_on_row:
            return self.selected(driving, driven, self.mechanical_ratio, load)
        drives = self.drives(self.pressure(ratio, driving), driving)
        # At e <= 0 the pressure is never positive, so that only the other regimes count.
        is_not_carried = np.isnan(driving) & (ratio > 0.0)
        output = np.where(drives | is_not_carried, driving, driven)
        backward = self.pump_speed(output) < 0.0
        if backward.any():
            output = np.where(backward, self._backward_output(ratio, load), output)
        return np.where(self.beyond_pole(ratio), np.nan, output)

    def _reversed_output(self, ratio: Array, load: Array, output: Array) -> Array:
        """Return y at reversed pressure with the pump on the row; NaN where the signs differ.

        Args:
            ratio: e.
            load: L.
            output: y while the pump takes torque.
        """
        pump = self.pump_torque(ratio, output, self.pressure(ratio, output))
        is_motored = ~(pump >= 0.0)
        motored = self._root(Regime.MOTORED, ratio, load)
        output = np.where(is_motored, motored, output)
        pressure = self.pressure(ratio, output)
        pump = self.pump_torque(ratio, output, pressure)
        bound = ROUNDING * self.stiffness * output
        is_wrong = (pressure > bound) | (is_motored & (pump > bound))
        return np.where(is_wrong, np.nan, output)

    def _backward_output(self, ratio: Array, load: Array) -> Array:
        """Return y with the pump turned backward; NaN where it does not turn so."""
        output = np.asarray(np.nan)
        for regime in reversed(BACKWARD_REGIMES):
            candidate = self._root(regime, ratio, load)
            pressure = self.pressure(ratio, candidate)
            pump = self.pump_torque(ratio, candidate, pressure, -1)
            is_consistent = (pump * SIGNS[regime].pump >= 0.0) & (pressure <= 0.0)
            is_backward = self.pump_speed(candidate) < 0.0
            output = np.where(is_consistent & is_backward, candidate, output)
        return output

    def output_speeds(self, ratio: Array, load: Array) -> tuple[Array, Array]:
        """Return y while the motor drives, and while it is driven, valid or not."""
        driving = self._root(Regime.DRIVING, ratio, load)
        driven = self._root(Regime.DRIVEN, ratio, load)
        is_reversed = ~(self.pressure(ratio, driven) >= 0.0)
        if is_reversed.any():
            slower = self._root(Regime.REVERSED, ratio, load)
            if self.pump_on_row:
                slower = self._reversed_output(ratio, load, slower)
            driven = np.where(is_reversed, slower, driven)
        return driving, driven

    def _root(self, regime: Regime, ratio: Array, load: Array) -> Array:
        constants = self.constants(regime)
        middle, product, square = self.quadratic(constants, ratio, load)
        root = middle + self.sense * np.sqrt(middle * middle - product)
        if not load.all():
            root = np.where(load == 0.0, 2.0 * middle, root)
        if self.pump_on_row:
            # A negative A makes the stage self-locking: no load moves with its speed.
            root = np.where(square > 0.0, root, np.nan)
        return np.asarray(root)

    def selected(
        self, driving: Array, driven: Array, rest: float, load: Array
    ) -> Array:
        """Return the speed that a motor on the row takes; `rest` where friction holds it.

        Friction asks for more pressure while the motor drives, so driving < driven: at most one
        of the two is valid.

        Args:
            driving: speed while the motor drives, shape (..., n).
            driven: speed while it is driven, shape (..., n).
            rest: the same speed of a motor at rest.
            load: L, shape (n,).
        """
        stalls = np.isnan(driving) & (load > self.stall_load)
        slower = np.where(stalls, np.nan, np.minimum(driven, rest))
        return np.where(driving > rest, driving, slower)

    def held(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> tuple[Array, Array]:
        """Return the displacement ratio and engine torque that make an output speed.

        The torque is NaN where no steady motor keeps the state. With the motor at rest many
        ratios do: the least is given, which leaks least.

        Args:
            engine_speed: [rad/s], shape (n,).
            output_speed: to make [rad/s], shape (n,).
            load_torque: output power / engine speed [N m], shape (n,).
        """
        output = self.reflection * output_speed / engine_speed
        load = load_torque / engine_speed
        motor = (output - self.mechanical_ratio) / self.hydraulic_ratio  # (4)
        pressure, ratio, square = self._held_in(Regime.DRIVING, output, load)
        if self.pump_on_row:
            is_driven = ~self.drives(pressure, output)
        else:
            is_driven = ~(motor > MOTOR_REST_BOUND)
        is_lower = is_driven
        lower_regimes = _DRIVEN_REGIMES if self.pump_on_row else _DRIVEN_REGIMES[:2]
        for regime in lower_regimes:
            if not is_lower.any():
                break
            lower = self._held_in(regime, output, load)
            pressure = np.where(is_lower, lower[0], pressure)
            ratio = np.where(is_lower, lower[1], ratio)
            square = np.where(is_lower, lower[2], square)
            if regime is Regime.DRIVEN:
                holds = pressure >= 0.0
            else:
                holds = self.pump_torque(ratio, output, pressure) >= 0.0
            is_lower = is_lower & ~holds
        keeps = square * output * output >= load  # the larger root
        if self.pump_on_row:
            keeps &= ~self.beyond_pole(ratio)
        else:
            keeps &= ~is_driven | (load <= self.stall_load)
        torque = self.engine_torque(ratio, output, load) * engine_speed
        return ratio / self.flow_ratio, np.where(keeps, torque, np.nan)

    def _held_in(
        self, regime: Regime, output: Array, load: Array
    ) -> tuple[Array, Array, Any]:
        """Return pi, e and A that make an output speed in one regime."""
        constants = self.constants(regime)
        motor = (output - self.mechanical_ratio) / self.hydraulic_ratio
        pump = self.pump_speed(output)
        asked = load / output + constants.motor_drag * motor
        if not self.pump_on_row:
            pressure = asked / constants.motor
            return (
                pressure,
                (motor + pressure / self.stiffness) / pump,
                constants.square,
            )
        # L / y = alpha M + rho P with e of (13) is a quadratic of pi.
        brace = constants.brace * constants.pump
        rest = asked - constants.brace_drag * pump
        linear = constants.motor + brace * motor / pump
        curvature = 4.0 * brace * rest / (self.stiffness * pump)
        pressure = 2.0 * rest / (linear + np.sqrt(linear * linear + curvature))
        ratio = (motor + pressure / self.stiffness) / pump  # (13)
        return pressure, ratio, self.quadratic(constants, ratio, load)[2]
