# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What answers at many points: the balance without effects, and with them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..transmission.parameters import Parameters
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage, speed_ratio
from .effects.base import Effect
from .shafts import PowerFlow, Shafts
from .steady_state import Point, Quadrant, Ways, at_point, sign

_HELD = 1e-6  # of the output speed


@dataclass(frozen=True)
class Breakdown:
    """Power in, power out and every loss between them [W]; arrays of one shape.

    Attributes:
        input_power: from the engine.
        output_power: to the load.
        losses: by part: `gear_pair_<name>`, `leakage`, `pump_damping`, `pump_friction`,
            `motor_damping`, `motor_friction`, `planetary_row`, and the name of each effect that
            drags a shaft. Their sum is input_power - output_power.
    """

    input_power: Array
    output_power: Array
    losses: Mapping[str, Array]


class BalanceSolver:
    """The steady state at points of shape (n,); parameters of shape (..., 1) give (..., n).

    Effects act each at its own place; without any the state has a closed form.
    """

    def __init__(
        self, stage: Stage, parameters: Parameters, effects: Sequence[Effect] = ()
    ) -> None:
        self.stage, self._parameters, self._effects = stage, parameters, tuple(effects)
        self._quadrants: dict[Ways, Quadrant] = {}
        self.mechanical_ratio = stage.mechanical_speed_ratio

    @cached_property
    def at_point(self) -> Callable[[float, float, float], Point] | None:
        """What solves single points in a microsecond; None with effects."""
        return None if self._effects else at_point(self.quadrant)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def solve(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque as read; NaN where no load is carried."""
        if not self._effects:
            return self.quadrant(self.ways(points)).solve(points)
        efficiency, speed, _, torque = self.readings(points)
        return Solution(efficiency, speed, torque)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def readings(
        self, points: OperatingPoints, ways: Ways | None = None
    ) -> tuple[Array, ...]:
        """Efficiency [-], output speed [rad/s], pressure [Pa] and engine torque [N m] as read.

        The pressure is the difference over the motor, eq. (14).
        """
        shafts, flow = self.flow(points, ways)
        state, torque = flow.state, flow.engine_power / points.engine_speed
        efficiency, speed, torque = Solution.of(
            state.load_power / points.engine_speed,
            torque,
            shafts.reflection * flow.output_speed,
        )
        pressure = shafts.turning * state.pressure
        # Of powers, not of meters: an effect on a meter comes after.
        for effect in self._effects:
            efficiency = effect.reading(efficiency, state)
            speed = effect.output_speed_reading(speed)
            pressure = effect.pressure_reading(pressure)
        return efficiency, speed, pressure, torque

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def flow(
        self, points: OperatingPoints, ways: Ways | None = None
    ) -> tuple[Shafts, PowerFlow]:
        """Constants and power flow at points; NaN where there is none."""
        shafts = Shafts(
            self.stage,
            self._parameters,
            self._effects,
            points,
            ways or self.ways(points),
        )
        return shafts, shafts.power_flow()

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def breakdown(self, points: OperatingPoints) -> Breakdown:
        """Share the lost power among the parts that take it."""
        stage, (shafts, flow) = self.stage, self.flow(points)
        state, units, given = flow.state, stage.pump_motor, shafts.given
        delivered = (
            units.pump_displacement * state.displacement_ratio * state.pump_speed
        )
        taken = units.motor_displacement * state.motor_speed
        losses = {
            # What leaks does so at the pressure of the motor, eq. (13), as if behind the lines.
            "leakage": state.pressure * (delivered - taken),
            "pump_damping": given.pump_damping * state.pump_speed**2,
            "pump_friction": units.pump_friction
            * np.abs(flow.pump_pressure * delivered),
            "motor_damping": given.motor_damping * state.motor_speed**2,
            "motor_friction": units.motor_friction * np.abs(state.pressure * taken),
        }
        losses["pressure_drop"] = (flow.pump_pressure - state.pressure) * delivered
        # Torques of output and motor are reflected, speeds are not.
        speeds = {
            "output": flow.output_speed,
            "motor": shafts.sense * state.motor_speed,
            "mechanical": state.engine_speed,
            "pump": state.pump_speed,
        }
        for path, speed in speeds.items():
            pairs = reversed(getattr(stage, path).gear_pairs)
            for pair, (after, before) in zip(
                pairs, pairwise(flow.torques[path]), strict=True
            ):
                name = f"gear_pair_{pair.name}"
                # A pair that serves two paths loses on both.
                losses[name] = losses.get(name, 0.0) + (before - after) * speed
        if stage.has_row:
            hydraulic = (
                -flow.torques["pump"][-1] * speeds["pump"]
                if shafts.braced
                else flow.torques["motor"][0] * speeds["motor"]
            )
            losses["planetary_row"] = (
                hydraulic
                + flow.torques["mechanical"][0] * state.engine_speed
                - flow.torques["output"][-1] * speeds["output"]
            )
        for effect in self._effects:
            watts = np.asarray(
                effect.engine_drag(state) * state.engine_speed
                + effect.at("pump_drag", state) * state.pump_speed
                + effect.at("motor_drag", state) * np.abs(state.motor_speed)
                + effect.output_drag(state) * state.output_speed
            )
            losses[effect.name] = losses.get(effect.name, 0.0) + watts
        optional = {"pressure_drop", *(effect.name for effect in self._effects)}
        return Breakdown(
            np.asarray(flow.engine_power),
            flow.output_power,
            {
                name: lost
                for name, lost in losses.items()
                if name not in optional or lost.any()
            },
        )

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def held(
        self, speed: Array, output: Array, load: Array, *, ways: Ways | None = None
    ) -> tuple[Array, Array]:
        """As `Quadrant.held` for arrays of one shape; `ways`: senses of output and power, if known.

        With effects by a search, and a look at where it leads.
        """
        ways = ways or (sign(output > 0.0), sign(load >= 0.0))
        stroke, torque = self.quadrant(ways).held(speed, output, load)
        if not self._effects:
            return stroke, torque
        points = OperatingPoints(stroke, speed, load)
        shafts = Shafts(self.stage, self._parameters, self._effects, points, ways)
        stroke = shafts.stroke_for(output)
        _, reached, _, torque = self.readings(
            points._replace(displacement_ratio=stroke), ways
        )
        return stroke, np.where(
            np.abs(reached - output) < _HELD * np.abs(output), torque, np.nan
        )

    def quadrant(self, ways: Ways) -> Quadrant:
        """Constants without effects."""
        if any(isinstance(way, np.ndarray) for way in ways):
            return Quadrant(self.stage, self._parameters, *ways)
        if ways not in self._quadrants:
            self._quadrants[ways] = Quadrant(self.stage, self._parameters, *ways)
        return self._quadrants[ways]

    def ways(self, points: OperatingPoints) -> Ways:
        """Senses of output and power: the output turns as it does without load.

        Of many candidates, without damping too.
        """
        stroke = points.displacement_ratio
        if np.ndim(self._parameters.motor_damping) > 0:
            forward = speed_ratio(self.stage, stroke) > 0.0
        else:
            first = self.quadrant((1, 1))
            forward = (stroke - first.standing) * first.full > 0.0
        return sign(forward), sign(points.load_torque >= 0.0)
