# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The power balance with effects: the whole power flow, shaft by shaft.

The problem has one unknown, the motor speed u:

.. math:: u = \varepsilon\omega_p V_p/V_m - q(\Delta p)/V_m \;(13), \qquad
          \Delta p = \Delta p(u, T_{out}) \;(14), \quad T_{out} = P_{out}/\omega_{out}(u) \;(4)

`steady_state` solves it with the losses of the equations alone. Effects bend the terms; secant
steps from that solution then find u, in each regime of the motor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Candidates, Parameters
from ..transmission.ranges import Answer, OperatingPoints
from ..transmission.stage import Stage, member_speed_coefficients
from .effects.base import Effect, ShaftState, Value
from .steady_state import ArraySolver

Array = NDArray[np.float64]
_ITERATIONS = 40
_HOLDING_STEPS = 5  # the flow is nearly linear in the friction
_TOLERANCE = 1e-12  # of the unknown, relative to its scale
_SETTLED = 1e-6  # the same, where the last digits of the terms are noise


class PowerFlow(NamedTuple):
    """Steady state at operating points; arrays of one shape, NaN where there is none.

    Attributes:
        state: speeds and pressure, and the power that the bench reads at the output.
        direction: +1 where power flows from motor to row, -1 back, between where it stands.
        output_power: power that really leaves [W].
        pump_pressure: pressure over the pump [Pa].
        leakage_flow: flow that does not reach the motor [m3/s].
        torques: by path, before and after each gear pair from the output end back, referred to the
            shaft at that end (output, motor) or to the engine [N m].
        engine_power: power that the engine gives [W]; NaN as long as the pump is left out.
    """

    state: ShaftState
    direction: Array
    output_power: Array
    pump_pressure: Array
    leakage_flow: Array
    torques: dict[str, list[Array]]
    engine_power: Value = np.nan


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
    """The steady state with effects, each acting at its own place; as `ArraySolver`."""

    def __init__(
        self, stage: Stage, parameters: Parameters, effects: Sequence[Effect] = ()
    ) -> None:
        super().__init__(stage, parameters)
        self._given = stage, parameters, tuple(effects)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def solve(self, points: OperatingPoints) -> Answer:
        """Efficiency and output speed that a bench reads, through its meters."""
        return Answer(*self.readings(points)[:2])

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def readings(self, points: OperatingPoints) -> Array:
        """Efficiency [-], output speed [rad/s] and pressure [Pa] that a bench reads, shape (3, n).

        The pressure is the difference over the motor, eq. (14).
        """
        flow = self.flow(points)
        state, speed, pressure = flow.state, flow.state.output_speed, flow.state.pressure
        efficiency = np.asarray(state.load_power / flow.engine_power)
        # Of powers, not of meters: an effect on a meter comes after.
        for effect in self._given[-1]:
            efficiency = effect.reading(efficiency, state)
            speed = effect.output_speed_reading(speed)
            pressure = effect.pressure_reading(pressure)
        return np.stack([efficiency, speed, pressure])

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def flow(self, points: OperatingPoints) -> PowerFlow:
        """The whole power flow of eqs (4), (13)-(15); NaN where the load cannot be carried."""
        shafts = _Shafts(*self._given, points)
        return shafts.with_pump(*shafts.motor_speed())

    def breakdown(self, points: OperatingPoints) -> Breakdown:
        """Share the lost power among the parts that take it."""
        (stage, parameters, effects), flow = self._given, self.flow(points)
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
        drop = (flow.pump_pressure - state.pressure) * delivered
        if drop.any():
            losses["pressure_drop"] = drop
        speeds = {"output": state.output_speed, "motor": state.motor_speed,
                  "mechanical": state.engine_speed, "pump": state.engine_speed}
        for path, speed in speeds.items():
            pairs = reversed(getattr(stage, path).gear_pairs)
            for pair, (after, before) in zip(pairs, pairwise(flow.torques[path]), strict=True):
                name = f"gear_pair_{pair.name}"
                # A pair that serves two paths loses on both.
                losses[name] = losses.get(name, 0.0) + (before - after) * speed
        losses["planetary_row"] = (flow.torques["motor"][0] * state.motor_speed
                                   + flow.torques["mechanical"][0] * state.engine_speed
                                   - flow.torques["output"][-1] * state.output_speed)
        for effect in effects:
            watts = np.asarray(
                effect.engine_drag(state) * state.engine_speed
                + effect.pump_drag(state) * state.pump_speed
                + effect.motor_drag(state) * np.abs(state.motor_speed)
                + effect.output_drag(state) * state.output_speed
            )
            if watts.any():
                losses[effect.name] = losses.get(effect.name, 0.0) + watts
        return Breakdown(np.asarray(flow.engine_power), flow.output_power, losses)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def displacement_ratio(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> Array:
        """Displacement ratio that makes an output speed, as `ArraySolver.displacement_ratio`."""
        first = super().displacement_ratio(engine_speed, output_speed, load_torque)
        shafts = _Shafts(*self._given, OperatingPoints(first, engine_speed, load_torque))
        return shafts.stroke_for(output_speed)


class _Shafts(ArraySolver):
    """One call's constants; the functions of the unknown read them."""

    def __init__(
        self, stage: Stage, parameters: Parameters, effects: tuple[Effect, ...],
        points: OperatingPoints,
    ) -> None:
        self.stage, self.effects, self.points = stage, effects, points
        self.viscosity: Value = 1.0
        if points.oil_temperature is not None:
            for effect in effects:
                self.viscosity = self.viscosity * effect.viscosity_ratio(points.oil_temperature)
        self.given = Candidates(
            parameters.leakage / self.viscosity, parameters.motor_damping * self.viscosity,
            parameters.pump_damping * self.viscosity)
        super().__init__(stage, self.given)
        self.engine_speed = points.engine_speed
        self.pump_speed = points.engine_speed / stage.pump.ratio
        self.load_power = points.load_torque * points.engine_speed
        self.sense = np.sign(stage.motor_speed_ratio)
        row = member_speed_coefficients(stage.planetary_constant)
        self.sun_share = abs(row["sun"] / row[stage.output_member]) / stage.output.ratio
        self.stroke = self.true_stroke(points.displacement_ratio)

    def true_stroke(self, displacement_ratio: Array) -> Array:
        """Displacement ratio that the swash plate really has."""
        for effect in self.effects:
            displacement_ratio = effect.true_displacement_ratio(displacement_ratio)
        return displacement_ratio

    # --- the unknown -------------------------------------------------------------------------

    def motor_speed(self) -> tuple[Array, Array]:
        """Return motor speed and direction (the part of friction in use where it stands)."""
        load = self.points.load_torque / self.engine_speed
        motoring, pumping = (
            self.engine_speed * (output - self.mechanical_ratio) / self.hydraulic_ratio  # (4)
            for output in self.output_speeds(self.full_flow * self.stroke, load))
        if self.effects:
            motoring, pumping = self._with_effects(motoring, pumping)
        speed = self.selected(motoring, pumping, 0.0, load)
        standing = speed == 0.0
        held = self._holding(speed) if standing.any() else 0.0
        return speed, np.where(standing, held, np.sign(speed))

    def _holding(self, speed: Array) -> Array:
        """Part of the friction, -1 to 1, that holds a standing motor in balance with the flow."""
        part, before = -np.ones_like(speed), np.ones_like(speed)
        surplus = self._flow_at(before)(speed, self.stroke)
        for _ in range(_HOLDING_STEPS):
            flow = self._flow_at(part)(speed, self.stroke)
            step = np.nan_to_num(flow * (part - before) / (flow - surplus))  # 0 / 0: settled
            before, surplus = part, flow
            part = np.clip(part - step, -1.0, 1.0)
        return part

    def _with_effects(self, motoring: Array, pumping: Array) -> tuple[Array, Array]:
        likely = np.where(motoring + pumping >= 0.0, 1.0, -1.0)
        speed = self._settled(np.where(likely > 0.0, motoring, pumping), likely)
        other = speed
        if (speed * likely <= 0.0).any():
            other = self._settled(np.where(likely > 0.0, pumping, motoring), -likely)
        return (np.where(likely > 0.0, speed, other), np.where(likely > 0.0, other, speed))

    def _settled(self, speed: Array, direction: Array) -> Array:
        """Motor speed with every effect, from a first estimate."""
        flow = self._flow_at(direction)
        return _fixed_point(lambda speed: flow(speed, self.stroke), speed, self.pump_speed)

    def stroke_for(self, output_speed: Array) -> Array:
        """Commanded displacement ratio that makes an output speed, from the points' own."""
        speed = (output_speed - self.mechanical_ratio * self.engine_speed) / (
            self.hydraulic_ratio)  # (4)
        flow = self._flow_at(np.where(speed > 0.0, 1.0, -1.0))

        def corrected(commanded: Array) -> Array:
            excess = flow(speed, self.true_stroke(commanded)) - speed
            return np.asarray(commanded - excess / (self.full_flow * self.engine_speed))

        return _fixed_point(corrected, self.points.displacement_ratio, 1.0)

    def _flow_at(self, direction: Array) -> Callable[[Array, Array], Array]:
        """Motor speed that the flow gives, eq. (13), for an assumed one and a true stroke.

        Each pass begins with the pressure that the last one found.
        """
        pressure = None

        def flow(speed: Array, stroke: Array) -> Array:
            nonlocal pressure
            found = self.torques(speed, direction, stroke, pressure)
            pressure = found.state.pressure
            delivered = abs(self.full_flow) * found.state.displacement_ratio * self.engine_speed
            return np.asarray(
                delivered - found.leakage_flow / self.stage.pump_motor.motor_displacement)

        return flow

    # --- the shafts ---------------------------------------------------------------------------

    def torques(
        self, speed: Array, direction: Array, stroke: Array, pressure: Array | None = None
    ) -> PowerFlow:
        """Go from the load back to the pressure and from it to the leakage."""
        ratio, hydraulic = self.mechanical_ratio, self.hydraulic_ratio
        output_speed = ratio * self.engine_speed + hydraulic * speed  # (4)
        output_speed = np.where(output_speed > 0.0, output_speed, np.nan)
        power = self.load_power
        for effect in self.effects:
            power = effect.true_load_power(power, output_speed)
        if pressure is None:
            pressure = self._pressure(power / output_speed * hydraulic, speed, direction)
        state = self._state(speed, output_speed, stroke, pressure)
        output_torque = power / output_speed + self._sum("output_drag", state)
        output = self._geared("output", output_torque, output_speed, 1.0)
        # Ideal row: virtual work shares the output torque by the speed ratios.
        motor_share, mechanical_share = self._row_shares(state)
        motor = self._geared("motor", output[-1] * hydraulic * motor_share, speed, direction)
        mechanical = self._geared(
            "mechanical", output[-1] * ratio * mechanical_share, self.engine_speed, 1.0)
        drag = self._sum("motor_drag", state)
        pressure = self._pressure(motor[-1] + drag * direction, speed, direction)
        state = state._replace(pressure=pressure)
        state = state._replace(
            displacement_ratio=state.displacement_ratio - self._sum("stroke_lag", state))
        # Eq. (13) takes the pressure of the motor; lines between the units do not leak.
        lost = self.given.leakage * pressure + self._sum("leakage_flow", state)
        return PowerFlow(state, direction, power, pressure + self._sum("pressure_drop", state),
                         np.asarray(lost),
                         {"output": output, "motor": motor, "mechanical": mechanical})

    def _state(
        self, speed: Array, output_speed: Array, stroke: Array, pressure: Array
    ) -> ShaftState:
        """Return what effects may read."""
        units = self.stage.pump_motor
        return ShaftState(
            self.engine_speed, self.pump_speed, output_speed, speed, stroke * self.sense, pressure,
            self.viscosity, _sun_against_carrier(self.stage, self.engine_speed, self.sense * speed),
            self.load_power / output_speed * self.sun_share, self.load_power,
            max(units.pump_displacement, units.motor_displacement),
        )

    def _pressure(self, torque: Array, speed: Array, direction: Array) -> Array:
        # Eq. (14); friction resists the motion, also where the pressure is reversed.
        units, torque = self.stage.pump_motor, torque + self.motor_damping * speed
        friction = units.motor_friction * direction * np.sign(torque)
        return np.asarray(torque / (units.motor_displacement * (1.0 - friction)))

    def _sum(self, hook: str, state: ShaftState) -> Value:
        total: Value = 0.0
        for effect in self.effects:
            total = total + getattr(effect, hook)(state)
        return total

    def _geared(
        self, path: str, torque: Array, speed: Array, direction: Value
    ) -> list[Array]:
        """Torques of a path back from `torque` at its output end, for the shaft at `speed`."""
        torques = [torque]
        for pair in reversed(getattr(self.stage, path).gear_pairs):
            passed: Value = pair.efficiency
            for effect in self.effects:
                passed = passed * (1.0 - effect.gear_loss(torques[-1] * speed, speed))
            torques.append(np.asarray(torques[-1] / passed**direction))
        return torques

    def _row_shares(self, state: ShaftState) -> tuple[Value, Value]:
        """Torque of motor and mechanical member against an ideal row, with mesh loss."""
        lost = self._sum("planetary_loss", state)
        if not np.any(lost):
            return 1.0, 1.0
        stage = self.stage
        k = stage.planetary_constant
        ideal = member_speed_coefficients(k)
        # Output torque acts on the row against its motion; the sun's share has its sign by (4).
        sun_torque = -stage.output.direction * np.sign(ideal["sun"] / ideal[stage.output_member])
        drives = sun_torque * np.tanh(state.sun_speed / 2.0)
        real = {"sun": 1.0, "ring": k * (1.0 - lost) ** drives}
        real["carrier"] = -(real["sun"] + real["ring"])
        output = real[stage.output_member] / ideal[stage.output_member]
        return (real[stage.motor_member] / ideal[stage.motor_member] / output,
                real[stage.mechanical_member] / ideal[stage.mechanical_member] / output)

    # --- the answer -----------------------------------------------------------------------------

    def with_pump(self, speed: Array, direction: Array) -> PowerFlow:
        """Return the whole power flow at a motor speed found."""
        found = self.torques(speed, direction, self.stroke)
        for _ in range(_ITERATIONS if self.effects else 0):
            # Friction that an effect ties to the pressure settles in a few passes.
            before = found.state.pressure
            found = self.torques(speed, direction, self.stroke, before)
            if not (np.abs(found.state.pressure - before) > _TOLERANCE * np.abs(before)).any():
                break
        state, units = found.state, self.stage.pump_motor
        ideal = found.pump_pressure * units.pump_displacement * state.displacement_ratio
        # Eq. (15) in the steady state, with friction that takes torque.
        pump_torque = (ideal + units.pump_friction * np.abs(ideal)
                       + self.given.pump_damping * self.pump_speed + self._sum("pump_drag", state))
        pump = self._geared("pump", np.asarray(pump_torque / self.stage.pump.ratio),
                            self.engine_speed, np.sign(pump_torque))
        torque = pump[-1] + found.torques["mechanical"][-1] + self._sum("engine_drag", state)
        power = np.asarray(torque * self.engine_speed)
        return found._replace(torques={**found.torques, "pump": pump},
                              engine_power=np.where(power > 0.0, power, np.nan))


def _fixed_point(function: Callable[[Array], Array], first: Array, scale: Value) -> Array:
    """Solve x = function(x) by secant steps, element by element; NaN where they do not settle."""
    previous, value = first, function(first)
    shortfall, x = value - first, value
    for _ in range(_ITERATIONS):
        error = function(x) - x
        open_ = np.abs(error) > _TOLERANCE * scale
        if not open_.any():
            return x
        slope = (error - shortfall) / (x - previous)
        # The function answers x weakly: a slope far from -1 is noise of the last digits.
        slope = np.where((slope < -0.2) & (slope > -5.0), slope, -1.0)
        previous, shortfall = x, error
        x = np.where(open_, x - error / slope, x)
    return np.where(open_ & (np.abs(error) > _SETTLED * scale), np.nan, x)


def _sun_against_carrier(stage: Stage, engine_speed: Array, motor_speed: Array) -> Array:
    engine, motor, output = stage.mechanical_member, stage.motor_member, stage.output_member
    speeds: dict[str, Array] = {
        engine: stage.mechanical.direction * engine_speed / stage.mechanical.ratio,
        motor: stage.motor.direction * motor_speed / stage.motor.ratio,
    }
    row = member_speed_coefficients(stage.planetary_constant)
    speeds[output] = -(row[engine] * speeds[engine] + row[motor] * speeds[motor]) / row[output]
    return np.asarray(speeds["sun"] - speeds["carrier"])
