# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the power goes at one point without effects, in plain floats.

It gives what `BalanceSolver.breakdown` gives, to rounding, in less time than ten lookups. The
steady state is that of `single_point`; the shafts are those of `shafts`, from the load back.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..transmission.parameters import Parameters
from ..transmission.stage import Path, Stage
from .regimes import Quadrant, Senses
from .single_point import PointSolver

_Pairs = tuple[tuple[str, float], ...]
"""Name and efficiency of gear pairs."""


class PointShares(NamedTuple):
    """Power in, power out and every loss between them [W], as `PowerShares`."""

    input_power: float
    output_power: float
    losses: dict[str, float]


class _Speeds(NamedTuple):
    """Speeds of the shafts [rad/s]; motor and output (`geared`) are reflected."""

    engine: float
    pump: float
    motor: float
    geared: float


class PointLosses:
    """Losses of one stage at single points.

    Args:
        stage: of any layout.
        parameters: of the units, plain numbers.
        quadrant: gives the constants of a quadrant.
        at_point: gives the steady state.
    """

    def __init__(
        self,
        stage: Stage,
        parameters: Parameters,
        quadrant: Callable[[Senses], Quadrant],
        at_point: PointSolver,
    ) -> None:
        self._stage = stage
        self._units = stage.pump_motor
        self._leakage = float(parameters.leakage)
        self._motor_damping = float(parameters.motor_damping)
        self._pump_damping = float(parameters.pump_damping)
        self._quadrant = quadrant
        self._at_point = at_point
        # Back from the output end, as `_along` goes; the output of a braced row the other way.
        self._output = _pairs(stage.output)[::-1]
        self._braced_output = _pairs(stage.output)
        self._motor = _pairs(stage.motor)[::-1]
        self._mechanical = _pairs(stage.mechanical)[::-1]
        self._pump = _pairs(stage.pump)[::-1]
        paths = (*self._output, *self._motor, *self._mechanical, *self._pump)
        self._no_gear_losses = {name: 0.0 for name, _ in paths}

    def shares(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> PointShares | None:
        """Return the shares at a point in range; None where the output stands or has no answer."""
        _, output_speed, engine_torque = self._at_point(
            displacement_ratio, engine_speed, load_torque
        )
        if not abs(output_speed) > 0.0:
            return None
        pull = 1 if load_torque >= 0.0 else -1
        constants = self._quadrant(Senses(1 if output_speed > 0.0 else -1, pull))
        speeds = self._speeds(constants, engine_speed, output_speed)
        volume = self._units.motor_displacement
        stroke_volume = float(constants.flow_ratio) * displacement_ratio * volume
        delivered = stroke_volume * speeds.pump
        leaked = delivered - volume * speeds.motor
        pressure = leaked / self._leakage  # (13)
        losses = self._unit_losses(
            pressure, delivered, leaked, speeds.pump, speeds.motor
        )
        pump_torque = self._pump_torque(pressure * stroke_volume, speeds.pump)
        load = load_torque * engine_speed / speeds.geared
        self._add_gear_losses(losses, constants, speeds, pump_torque, load)
        if self._stage.has_row:
            losses["planetary_row"] = 0.0
        return PointShares(
            engine_torque * engine_speed, load_torque * engine_speed, losses
        )

    def _speeds(
        self, constants: Quadrant, engine_speed: float, output_speed: float
    ) -> _Speeds:
        """Return the speeds of the shafts, eq. (4)."""
        geared = float(constants.reflection) * output_speed
        engine_share, output_share = constants.pump_ratios
        pump = engine_share * engine_speed
        if constants.pump_on_row:
            pump += output_share * geared
        rest = float(constants.mechanical_ratio)
        motor = (geared - rest * engine_speed) / constants.hydraulic_ratio
        return _Speeds(engine_speed, pump, motor, geared)

    def _pump_torque(self, ideal: float, speed: float) -> float:
        """Return the torque of the pump, eq. (15), for its pressure torque [N m]."""
        friction = self._units.pump_friction * abs(ideal)
        torque = ideal + math.copysign(friction, speed)
        return torque + self._pump_damping * speed

    def _add_gear_losses(
        self,
        losses: dict[str, float],
        constants: Quadrant,
        speeds: _Speeds,
        pump_torque: float,
        load: float,
    ) -> None:
        """Add the losses of all gear pairs, from the load back.

        Args:
            losses: to add to.
            constants: of the quadrant.
            speeds: of the shafts.
            pump_torque: of the pump [N m].
            load: torque of the output [N m].
        """
        is_pumping = pump_torque * speeds.pump > 0.0
        braking = _along(losses, self._pump, pump_torque, speeds.pump, is_pumping)
        if constants.pump_on_row:
            engine_share, output_share = constants.pump_ratios
            braced = -output_share * braking
            is_given = braced * speeds.geared < 0.0
            given = _along(
                losses, self._braced_output, braced, -speeds.geared, is_given
            )
            reaction = engine_share * braking
            is_forward = braking > 0.0
            asked = load - given
            is_driving = asked * speeds.motor > 0.0
        else:
            rest = float(constants.mechanical_ratio)
            is_pull = float(constants.sense) > 0.0
            asked = _along(losses, self._output, load, speeds.geared, is_pull)
            reaction = asked * rest
            is_forward = rest >= 0.0
            is_driving = speeds.motor > 0.0
        asked *= constants.hydraulic_ratio
        _along(losses, self._motor, asked, speeds.motor, is_driving)
        _along(losses, self._mechanical, reaction, speeds.engine, is_forward)

    def _unit_losses(
        self,
        pressure: float,
        delivered: float,
        leaked: float,
        pump_speed: float,
        motor_speed: float,
    ) -> dict[str, float]:
        """Return the losses of pump and motor [W], and none of the gears.

        Args:
            pressure: over the motor [Pa].
            delivered: ideal flow of the pump [m3/s].
            leaked: what of it does not reach the motor [m3/s].
            pump_speed: [rad/s].
            motor_speed: [rad/s].
        """
        taken = self._units.motor_displacement * motor_speed
        return {
            "leakage": pressure * leaked,
            "pump_damping": float(self._pump_damping * pump_speed * pump_speed),
            "pump_friction": float(
                self._units.pump_friction * abs(pressure * delivered)
            ),
            "motor_damping": float(self._motor_damping * motor_speed * motor_speed),
            "motor_friction": float(self._units.motor_friction * abs(pressure * taken)),
            **self._no_gear_losses,
        }


def _pairs(path: Path) -> _Pairs:
    return tuple(
        (f"gear_pair_{pair.name}", pair.efficiency) for pair in path.gear_pairs
    )


def _along(
    losses: dict[str, float], pairs: _Pairs, torque: float, speed: float, forward: bool
) -> float:
    """Go along a path back from its output end, add the losses of its pairs, return the torque.

    Args:
        losses: to add to; a pair that serves two paths loses on both.
        pairs: in the order in which they are met.
        torque: at the output end [N m].
        speed: of the shaft at that end [rad/s].
        forward: whether power runs towards the output.
    """
    for name, efficiency in pairs:
        before = torque / efficiency if forward else torque * efficiency
        losses[name] += (before - torque) * speed
        torque = before
    return torque
