# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The power balance with effects: the whole power flow, shaft by shaft.

The problem has one unknown, the motor speed u:

.. math:: u = \varepsilon\omega_p V_p/V_m - q(\Delta p)/V_m \;(13), \qquad
          \Delta p = \Delta p(u, T_{out}) \;(14), \quad T_{out} = P_{out}/\omega_{out}(u) \;(4)

`steady_state` solves it with the losses of the equations alone. Effects bend the terms; secant
steps from that solution then find u, in each regime of the motor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.ranges import OperatingPoints, Solution
from ..transmission.stage import Stage
from .effects.base import Effect
from .shafts import PowerFlow, Shafts
from .steady_state import ArraySolver

Array = NDArray[np.float64]
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


class BalanceSolver(ArraySolver):
    """The steady state with effects, each acting at its own place; without any, `ArraySolver`."""

    def __init__(
        self, stage: Stage, parameters: Parameters, effects: Sequence[Effect] = ()
    ) -> None:
        super().__init__(stage, parameters)
        self._effects = tuple(effects)
        self._optional = {"pressure_drop", *(effect.name for effect in effects)}

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def readings(self, points: OperatingPoints) -> Array:
        """Efficiency [-], output speed [rad/s] and pressure [Pa] that a bench reads, shape (3, n).

        The pressure is the difference over the motor, eq. (14).
        """
        efficiency, speed, _, pressure = self.in_quadrants(points, self._readings)
        return np.stack([efficiency, speed, pressure])

    def solve_in(self, part: tuple[int, int], points: OperatingPoints) -> Solution:
        """What a bench reads in one quadrant, through its meters."""
        if not self._effects:
            return super().solve_in(part, points)
        return Solution(*self._readings(part, points)[:3])

    def _readings(self, part: tuple[int, int], points: OperatingPoints) -> tuple[Array, ...]:
        shafts, flow = self.flow(part, points)
        state, torque = flow.state, flow.engine_power / points.engine_speed
        efficiency, speed, torque = Solution.of(
            state.load_power / points.engine_speed, torque, shafts.reflection * flow.output_speed)
        pressure = shafts.turns * state.pressure
        # Of powers, not of meters: an effect on a meter comes after.
        for effect in self._effects:
            efficiency = effect.reading(efficiency, state)
            speed = effect.output_speed_reading(speed)
            pressure = effect.pressure_reading(pressure)
        return efficiency, speed, torque, pressure

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def flow(
        self, part: tuple[int, int], points: OperatingPoints
    ) -> tuple[Shafts, PowerFlow]:
        """Constants of a quadrant and the power flow at points there; NaN where there is none."""
        shafts = Shafts(self.stage, self._parameters, self._effects, points, *part)
        return shafts, shafts.with_pump(*shafts.motor_speed())

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def breakdown(self, points: OperatingPoints) -> Breakdown:
        """Share the lost power among the parts that take it."""
        names: list[str] = []

        def watts(part: tuple[int, int], at: OperatingPoints) -> list[Array]:
            found = self._breakdown(*self.flow(part, at))
            names[:] = found.losses
            return [found.input_power, found.output_power, *found.losses.values()]

        into, out, *losses = self.in_quadrants(points, watts)
        return Breakdown(into, out, {name: lost for name, lost in zip(names, losses, strict=True)
                                     if name not in self._optional or lost.any()})

    def _breakdown(self, shafts: Shafts, flow: PowerFlow) -> Breakdown:
        (stage, parameters), effects = (self.stage, self._parameters), self._effects
        state, units = flow.state, stage.pump_motor
        delivered = units.pump_displacement * state.displacement_ratio * state.pump_speed
        taken = units.motor_displacement * state.motor_speed
        viscosity = state.viscosity_ratio
        losses = {
            # What leaks does so at the pressure of the motor, eq. (13), behind the lines that all
            # flow passes.
            "leakage": state.pressure * (delivered - taken),
            "pump_damping": parameters.pump_damping * viscosity * state.pump_speed**2,
            "pump_friction": units.pump_friction * np.abs(flow.pump_pressure * delivered),
            "motor_damping": parameters.motor_damping * viscosity * state.motor_speed**2,
            "motor_friction": units.motor_friction * np.abs(state.pressure * taken),
        }
        losses["pressure_drop"] = (flow.pump_pressure - state.pressure) * delivered
        sense = shafts.sense  # torques of output and motor are reflected, speeds are not
        speeds = {"output": flow.output_speed, "motor": sense * state.motor_speed,
                  "mechanical": state.engine_speed, "pump": state.pump_speed}
        for path, speed in speeds.items():
            pairs = reversed(getattr(stage, path).gear_pairs)
            for pair, (after, before) in zip(pairs, pairwise(flow.torques[path]), strict=True):
                name = f"gear_pair_{pair.name}"
                # A pair that serves two paths loses on both.
                losses[name] = losses.get(name, 0.0) + (before - after) * speed
        if stage.has_row:
            hydraulic = (-flow.torques["pump"][-1] * speeds["pump"] if shafts.braced
                         else flow.torques["motor"][0] * speeds["motor"])
            losses["planetary_row"] = (hydraulic
                                       + flow.torques["mechanical"][0] * state.engine_speed
                                       - flow.torques["output"][-1] * speeds["output"])
        for effect in effects:
            watts = np.asarray(
                effect.engine_drag(state) * state.engine_speed
                + effect.at("pump_drag", state) * state.pump_speed
                + effect.at("motor_drag", state) * np.abs(state.motor_speed)
                + effect.output_drag(state) * state.output_speed
            )
            losses[effect.name] = losses.get(effect.name, 0.0) + watts
        return Breakdown(np.asarray(flow.engine_power), flow.output_power, losses)

    def held_in(self, part: tuple[int, int], *columns: Array) -> tuple[Array, Array]:
        """As `held`, in one quadrant; by a search and a look at where it leads."""
        first, exact = super().held_in(part, *columns)
        if not self._effects:
            return first, exact
        speed, output, torque = columns
        points = OperatingPoints(first, speed, torque)
        shafts = Shafts(self.stage, self._parameters, self._effects, points, *part)
        stroke = shafts.stroke_for(output)
        _, reached, given = self.solve_in(part, points._replace(displacement_ratio=stroke))
        return stroke, np.where(np.abs(reached - output) < _HELD * np.abs(output), given, np.nan)
