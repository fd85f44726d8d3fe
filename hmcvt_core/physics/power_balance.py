# SPDX-License-Identifier: Apache-2.0
r"""The served formulation: powers balanced shaft by shaft.

Same gear train, same eqs (4), (13)-(15) and same three parameters as the published formulas, but
a balance instead of a product of efficiencies: the motor speed follows from flow, the torques from
the load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole.

The whole problem has one unknown, the motor speed u:

.. math:: u = \varepsilon\omega_p V_p/V_m - q(\Delta p)/V_m, \qquad
          \Delta p = \Delta p(u, T_{out}), \quad T_{out} = P_{out}/\omega_{out}(u)

With the losses of eqs (13)-(15) alone this is a quadratic, solved in closed form. Friction and gear
loss that follow the direction of motion make it a quadratic on each side of u = 0; where the motor
must stand still between the two, friction takes the value that balances (as any stiction does).
Effects bend the terms; the equation is then solved by a secant iteration from the closed form.

Reading of eq. (15): as printed, pump friction c_fp would *help* the engine; here it takes torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.stage import Path, Stage, member_speed_coefficients
from .effects.base import Effect, ShaftState, Value

Array = NDArray[np.float64]
_ITERATIONS = 40
_HOLDING_STEPS = 5  # the flow is nearly linear in the friction
_TOLERANCE = 1e-12  # of the motor speed, relative to the pump speed


class OperatingPoints(NamedTuple):
    """Where the transmission works; arrays of one shape (or None), SI units."""

    displacement_ratio: Array
    engine_speed: Array
    load_torque: Array
    oil_temperature: Array | None = None


@dataclass(frozen=True)
class PowerFlow:
    """Steady state at operating points; arrays of one shape, NaN where there is none.

    Attributes:
        state: speeds and pressure.
        load_power: power that the bench reads at the output [W].
        output_power: power that really leaves [W].
        output_torque: torque on the output shaft including drag [N m].
        row_motor_torque: torque of the row on the motor path, referred to the motor [N m].
        row_mechanical_torque: torque of the row on the mechanical path, referred to the engine.
        pump_pressure: pressure over the pump [Pa].
        pump_torque: T_p of eq. (15) with every drag [N m]; negative where it drives the engine.
        engine_power: power that the engine gives [W].
        direction: +1 where power flows from motor to row, -1 back, between where it stands.
    """

    state: ShaftState
    load_power: Array
    output_power: Array
    output_torque: Array
    row_motor_torque: Array
    row_mechanical_torque: Array
    pump_pressure: Array
    pump_torque: Array
    engine_power: Array
    direction: Array


class _Geometry(NamedTuple):
    """Stage constants in the sense of the motor that adds to the output speed."""

    mechanical: float  # output speed per engine speed
    motor: float  # output speed per motor speed, positive
    sense: float  # sign that makes it so
    pump: float  # pump speed per engine speed
    pump_displacement: float
    motor_displacement: float


class _Torques(NamedTuple):
    """What one pass over the shafts finds for an assumed motor speed."""

    state: ShaftState
    output_power: Array
    output_torque: Array
    row_motor_torque: Array
    row_mechanical_torque: Array
    mechanical_torque: Array  # of the engine
    pressure: Array
    pump_pressure: Array
    flow: Array  # motor speed that the flow then gives


def power_flow(
    stage: Stage,
    parameters: Parameters,
    points: OperatingPoints,
    effects: Sequence[Effect] = (),
) -> PowerFlow:
    """Solve the steady state of eqs (4), (13)-(15) at operating points.

    Args:
        stage: the gear train.
        parameters: the hydraulic parameters at identification viscosity.
        points: arrays of one shape.
        effects: what acts besides; each at its own place.

    Returns:
        The steady state, NaN where the load cannot be carried (the leakage takes all the flow).
    """
    balance = _Balance(stage, parameters, points, tuple(effects))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # NaN is the answer where nothing can be delivered: see the docstring.
        speed, direction = balance.motor_speed()
        return balance.flow_at(speed, direction)


def efficiency(flow: PowerFlow, effects: Sequence[Effect] = ()) -> Array:
    """Efficiency that a bench reads: output power / engine power, through its meters [-]."""
    with np.errstate(invalid="ignore", divide="ignore"):
        # Of powers, not of meters: an effect on a meter comes after.
        reading = np.asarray(flow.load_power / flow.engine_power)
        for effect in effects:
            reading = effect.reading(reading, flow.state)
        return reading


class _Balance:
    """One call's constants; the functions of the unknown motor speed read them."""

    def __init__(
        self,
        stage: Stage,
        parameters: Parameters,
        points: OperatingPoints,
        effects: tuple[Effect, ...],
    ) -> None:
        ratio = stage.motor_speed_ratio
        units = stage.pump_motor
        self.stage, self.effects = stage, effects
        self.geometry = _Geometry(
            stage.mechanical_speed_ratio, abs(ratio), float(np.sign(ratio)),
            1.0 / stage.pump.ratio, units.pump_displacement, units.motor_displacement,
        )
        row = member_speed_coefficients(stage.planetary_constant)
        self.sun_share = abs(row["sun"] / row[stage.output_member]) / stage.output.ratio
        stroke = points.displacement_ratio
        viscosity: Value = 1.0
        for effect in effects:
            stroke = effect.true_displacement_ratio(stroke)
            if points.oil_temperature is not None:
                viscosity = viscosity * effect.viscosity_ratio(points.oil_temperature)
        self.stroke = stroke * self.geometry.sense
        self.viscosity = viscosity
        self.leakage = parameters.leakage / viscosity
        self.motor_damping = parameters.motor_damping * viscosity
        self.pump_damping = parameters.pump_damping * viscosity
        self.engine_speed = points.engine_speed
        self.load_power = points.load_torque * points.engine_speed
        self.pump_speed = points.engine_speed * self.geometry.pump
        # Motor speed without leakage, eq. (13).
        displacements = units.pump_displacement / units.motor_displacement
        self.tight_speed = self.stroke * self.pump_speed * displacements

    # --- the unknown -------------------------------------------------------------------------

    def motor_speed(self) -> tuple[Array, Array]:
        """Return motor speed and direction (the part of friction in use where it stands)."""
        forward, backward = self.closed_form(1.0), self.closed_form(-1.0)
        if self.effects:
            forward, backward = self._with_effects(forward, backward)
        # Friction asks for more pressure forward, so forward < backward: at most one is valid.
        slow = np.where(np.isnan(forward) & self._collapses(), np.nan, np.minimum(backward, 0.0))
        speed = np.where(forward > 0.0, forward, slow)
        standing = speed == 0.0
        held = self._holding(speed) if standing.any() else 0.0
        return speed, np.where(standing, held, np.sign(speed))

    def _holding(self, speed: Array) -> Array:
        """Part of the friction, -1 to 1, that holds a standing motor in balance with the flow."""
        part, before = -np.ones_like(speed), np.ones_like(speed)
        surplus = self.torques(speed, before).flow
        for _ in range(_HOLDING_STEPS):
            flow = self.torques(speed, part).flow
            step = np.nan_to_num(flow * (part - before) / (flow - surplus))  # 0 / 0: settled
            before, surplus = part, flow
            part = np.clip(part - step, -1.0, 1.0)
        return part

    def _collapses(self) -> Array:
        """Tell where a forward motor that loses its balance stalls rather than comes to rest.

        A slower motor gives a slower output, more torque, more leakage. Where that gain exceeds one
        already at rest, a motor held by friction is out of reach without a jump.
        """
        units, idle = self.stage.pump_motor, self.geometry.mechanical * self.engine_speed
        gain = self._motor_load(np.zeros(1), 1.0) * self.geometry.motor / idle - self.motor_damping
        stiffness = units.motor_displacement**2 * (1.0 - units.motor_friction) / self.leakage
        return np.asarray(gain > stiffness)

    def _with_effects(self, forward: Array, backward: Array) -> tuple[Array, Array]:
        likely = np.where(forward + backward >= 0.0, 1.0, -1.0)
        speed = self.iterate(np.where(likely > 0.0, forward, backward), likely)
        other = speed
        if (speed * likely <= 0.0).any():
            other = self.iterate(np.where(likely > 0.0, backward, forward), -likely)
        return (np.where(likely > 0.0, speed, other), np.where(likely > 0.0, other, speed))

    def closed_form(self, direction: float) -> Array:
        """Motor speed with the losses of eqs (13)-(15) alone, friction on one side."""
        units = self.stage.pump_motor
        speed = self._quadratic(direction, direction * units.motor_friction)
        if direction < 0.0:
            # Far backward the damping alone may turn the pressure round, and friction with it.
            turned = self._quadratic(direction, units.motor_friction)
            torque = self._motor_load(turned, direction) + self.motor_damping * turned
            speed = np.where(torque < 0.0, turned, speed)
        return speed

    def _motor_load(self, speed: Array, direction: float) -> Array:
        output = self.geometry.mechanical * self.engine_speed + self.geometry.motor * speed
        gears = self.stage.output.efficiency * self.stage.motor.efficiency**direction
        return self.load_power * self.geometry.motor / (output * gears)

    def _quadratic(self, direction: float, friction: float) -> Array:
        g = self.geometry
        compliance = self.leakage / (g.motor_displacement**2 * (1.0 - friction))
        gears = self.stage.output.efficiency * self.stage.motor.efficiency**direction
        idle = g.mechanical * self.engine_speed
        stiff = 1.0 + compliance * self.motor_damping
        a = g.motor * stiff
        b = idle * stiff - g.motor * self.tight_speed
        c = compliance * self.load_power * g.motor / gears - idle * self.tight_speed
        root = np.sqrt(b * b - 4.0 * a * c)
        # The larger root is the one that tends to the tight speed as leakage vanishes.
        return np.asarray(np.where(b > 0.0, -2.0 * c / (b + root), (root - b) / (2.0 * a)))

    def iterate(self, speed: Array, side: Array) -> Array:
        """Motor speed with every effect, by secant steps from a first estimate."""
        found = self.torques(speed, side)
        previous, shortfall = speed, found.flow - speed
        speed = found.flow
        for _ in range(_ITERATIONS):
            found = self.torques(speed, side, found.pressure)
            error = found.flow - speed
            open_ = np.abs(error) > _TOLERANCE * self.pump_speed
            if not open_.any():
                return speed
            slope = (error - shortfall) / (speed - previous)
            # The flow answers speed weakly: a slope far from -1 is noise of the last digits.
            slope = np.where((slope < -0.2) & (slope > -5.0), slope, -1.0)
            previous, shortfall = speed, error
            speed = np.where(open_, speed - error / slope, speed)
        return np.where(open_ & (np.abs(error) > 1e-6 * self.pump_speed), np.nan, speed)

    # --- the shafts ---------------------------------------------------------------------------

    def torques(self, speed: Array, direction: Array, pressure: Array | None = None) -> _Torques:
        """Go from the load back to the pressure and from it to the flow."""
        output_speed = (self.geometry.mechanical * self.engine_speed
                        + self.geometry.motor * speed)
        output_speed = np.where(output_speed > 0.0, output_speed, np.nan)
        power = self.load_power
        for effect in self.effects:
            power = effect.true_load_power(power, output_speed)
        if pressure is None:
            pressure = self._pressure(power / output_speed * self.geometry.motor, speed, direction)
        state = self.state(speed, output_speed, pressure)
        output_torque = power / output_speed + self._sum("output_drag", state)
        row_torque = self._geared(self.stage.output, output_torque, output_speed, 1.0)
        # Ideal row: virtual work shares the output torque by the speed ratios.
        row_motor = row_torque * self.geometry.motor
        row_mechanical = row_torque * self.geometry.mechanical
        if self.effects:
            motor_share, mechanical_share = self._row_shares(state)
            row_motor, row_mechanical = row_motor * motor_share, row_mechanical * mechanical_share
        motor_torque = self._geared(self.stage.motor, row_motor, speed, direction)
        mechanical = self._geared(self.stage.mechanical, row_mechanical, self.engine_speed, 1.0)
        drag = self._sum("motor_drag", state)
        pressure = self._pressure(motor_torque + drag * direction, speed, direction)
        state = state._replace(pressure=pressure)
        pump_pressure = pressure + self._sum("pressure_drop", state)
        # Eq. (13) takes the pressure of the motor; lines between the units do not leak.
        lost = self.leakage * pressure + self._sum("leakage_flow", state)
        flow = self.tight_speed - lost / self.geometry.motor_displacement
        return _Torques(state, power, output_torque, row_motor, row_mechanical, mechanical,
                        pressure, pump_pressure, np.asarray(flow))

    def state(self, speed: Array, output_speed: Array, pressure: Array) -> ShaftState:
        """Return what effects may read."""
        stage, g = self.stage, self.geometry
        return ShaftState(
            self.engine_speed, self.pump_speed, output_speed, speed, self.stroke, pressure,
            self.viscosity, _sun_against_carrier(stage, self.engine_speed, g.sense * speed),
            self.load_power / output_speed * self.sun_share,
            self.load_power, max(g.pump_displacement, g.motor_displacement),
        )

    def _pressure(self, torque: Array, speed: Array, direction: Array) -> Array:
        # Eq. (14); friction resists the motion, also where the pressure has turned round.
        torque = torque + self.motor_damping * speed
        friction = self.stage.pump_motor.motor_friction * direction * np.sign(torque)
        return np.asarray(torque / (self.geometry.motor_displacement * (1.0 - friction)))

    def _sum(self, hook: str, state: ShaftState) -> Value:
        total: Value = 0.0
        for effect in self.effects:
            total = total + getattr(effect, hook)(state)
        return total

    def _geared(self, path: Path, torque: Array, speed: Array, direction: Value) -> Array:
        if not self.effects:
            return np.asarray(torque / path.efficiency**direction)
        return through_gears(path, torque, speed, direction, self.effects)[-1]

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

    def flow_at(self, speed: Array, direction: Array) -> PowerFlow:
        """Return the whole power flow at a motor speed found."""
        found = self.torques(speed, direction)
        for _ in range(_ITERATIONS if self.effects else 0):
            # Friction that an effect ties to the pressure settles in a few passes.
            before, found = found.pressure, self.torques(speed, direction, found.pressure)
            if not (np.abs(found.pressure - before) > _TOLERANCE * np.abs(before)).any():
                break
        state, units, g = found.state, self.stage.pump_motor, self.geometry
        ideal = found.pump_pressure * g.pump_displacement * self.stroke
        # Eq. (15) in the steady state, with friction that takes torque.
        pump_torque = (ideal + units.pump_friction * np.abs(ideal)
                       + self.pump_damping * self.pump_speed + self._sum("pump_drag", state))
        at_engine = self._geared(self.stage.pump, pump_torque * g.pump,
                                 self.engine_speed, np.sign(pump_torque))
        torque = at_engine + found.mechanical_torque + self._sum("engine_drag", state)
        power = np.asarray(torque * self.engine_speed)
        return PowerFlow(
            state, self.load_power, found.output_power, found.output_torque,
            found.row_motor_torque, found.row_mechanical_torque,
            found.pump_pressure, np.asarray(pump_torque),
            np.where(power > 0.0, power, np.nan), direction,
        )


def through_gears(
    path: Path, torque: Array, speed: Array, direction: Value, effects: Sequence[Effect]
) -> list[Array]:
    """Torque before and after each gear pair of a path, from its output end back [N m].

    Args:
        path: pairs that lose power.
        torque: at the output end, referred to the shaft that turns at `speed`.
        speed: of that shaft [rad/s].
        direction: +1 where power flows towards the output end, -1 where back, between at rest.
        effects: what adds to the mesh loss.
    """
    torques = [torque]
    for pair in reversed(path.gear_pairs):
        passed: Value = pair.efficiency
        for effect in effects:
            passed = passed * (1.0 - effect.gear_loss(torques[-1] * speed, speed))
        torques.append(np.asarray(torques[-1] / passed**direction))
    return torques


def _sun_against_carrier(stage: Stage, engine_speed: Array, motor_speed: Array) -> Array:
    speeds: dict[str, Array] = {
        stage.mechanical_member: stage.mechanical.direction * engine_speed / stage.mechanical.ratio,
        stage.motor_member: stage.motor.direction * motor_speed / stage.motor.ratio,
    }
    coefficients = member_speed_coefficients(stage.planetary_constant)
    total = (coefficients[stage.mechanical_member] * speeds[stage.mechanical_member]
             + coefficients[stage.motor_member] * speeds[stage.motor_member])
    speeds[stage.output_member] = -total / coefficients[stage.output_member]
    return np.asarray(speeds["sun"] - speeds["carrier"])
