# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The whole power flow with effects, shaft by shaft, solved for the motor speed u.

.. math:: u = \varepsilon\omega_p V_p/V_m - q(\Delta p)/V_m \;(13), \qquad
          \Delta p = \Delta p(u, T_{out}) \;(14), \quad T_{out} = P_{out}/\omega_{out}(u) \;(4)

`steady_state` solves it in closed form with the losses of the equations alone. Effects bend the
terms; Broyden's method then finds u and the pressure from that solution, in each regime of the
motor.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Candidates, Parameters
from ..transmission.ranges import Array, OperatingPoints
from ..transmission.stage import Stage, member_speed_coefficients
from .broyden import broyden
from .effects.base import Effect, ShaftState, Value
from .regimes import Senses
from .steady_state import SteadyState

_PRESSURE_SCALE = 2e7
"""Scale of a pressure in the iteration [Pa]: half of what the loop of a tractor reaches."""

_SHORT_STEP = 0.5
"""Longest step, in scales, of a second attempt where longer steps lead nowhere."""

_ROLLING_SPEED = 2.0
"""Sun speed against the carrier over which the sense of the mesh loss turns round [rad/s]."""

_SLIP_ROUNDS = 20
"""Maximum number of Newton steps between a slip and the torque that causes it."""

_SLIP_TOLERANCE = 1e-11
"""Relative error of the output speed at which they agree."""

_SLIP_DIFFERENCE = 1e-6
"""Relative change of the output speed by which their slope is taken."""

_HOOKS = (
    "true_load_power",
    "output_slip",
    "mechanical_slip",
    "stroke_lag",
    "output_drag",
    "engine_drag",
    "pump_drag",
    "motor_drag",
    "gear_loss",
    "planetary_loss",
    "leakage_flow",
    "pressure_drop",
)

# Motor speed, direction of its friction, and stroke.
_MotorState = tuple[Array, Array, Array]


class PowerFlow(NamedTuple):
    """Steady state at operating points; arrays of one shape, NaN where there is none.

    Attributes:
        state: speeds and pressure, and the power that the bench reads at the output.
        output_speed: of the output shaft, with its sign [rad/s].
        geared_speed: y times engine speed, with its sign: the same before a closed clutch that
            slips [rad/s].
        output_power: power that really leaves [W].
        leakage_flow: flow that does not reach the motor [m3/s].
        torques: by path, before and after each gear pair from the output end back, at the shaft
            of that end (output, motor, pump) or, for the mechanical path, at the engine [N m].
        pump_pressure: pressure over the pump [Pa]; NaN while only that of the motor is sought, for
            which `torques` holds the paths that it needs.
        engine_power: power that the engine gives [W]; NaN in the same case.
    """

    state: ShaftState
    output_speed: Array
    geared_speed: Array
    output_power: Array
    leakage_flow: Array
    torques: dict[str, list[Array]]
    pump_pressure: Value = np.nan
    engine_power: Value = np.nan


class Shafts(SteadyState):
    """Constants of one call; its functions take the unknown.

    With the pump on the row (output-coupled), the member of the row that drives the output is
    braced by the pump, so that pump and motor share the output torque: m = 0, and only the sense of
    the output is reflected.

    Args:
        stage: of any layout.
        parameters: of the units.
        effects: further losses.
        points: of shape (n,).
        senses: of output and power.
        resting: where friction holds the output, shape (n,); None for nowhere.
    """

    def __init__(
        self,
        stage: Stage,
        parameters: Parameters,
        effects: tuple[Effect, ...],
        points: OperatingPoints,
        senses: Senses,
        resting: NDArray[np.bool_] | None = None,
    ) -> None:
        self._parameters = parameters
        self.effects = effects
        self.points = points
        self.resting = resting
        self.acting = {
            hook: [effect for effect in effects if effect.acts_at(hook)]
            for hook in _HOOKS
        }
        film: Value = 1.0
        self.viscosity: Value = 1.0
        if points.oil_temperature is not None:
            for effect in effects:
                film = film * effect.film_viscosity_ratio(points.oil_temperature)
                self.viscosity = self.viscosity * effect.viscosity_ratio(
                    points.oil_temperature
                )
        warmed = Candidates(
            parameters.leakage / self.viscosity,
            parameters.motor_damping * film,
            parameters.pump_damping * film,
        )
        super().__init__(stage, warmed, senses)
        # Braced by the pump, a clutch ahead of the row slows the pump instead of the output.
        slips = ["output_slip"]
        if not self.pump_on_row:
            slips.append("mechanical_slip")
        self.slipping = [effect for effect in effects if effect.acts_at(*slips)]
        self.engine_speed = points.engine_speed
        self.load_power = points.load_torque * points.engine_speed
        self.idle = self.load_power == 0.0
        self.row = member_speed_coefficients(stage.planetary_constant)
        self.sun_share = self._sun_share()
        self.stroke = self.true_stroke(points.displacement_ratio)

    def _sun_share(self) -> float:
        """Torque of the sun per load power / output speed; braced: per pressure times stroke."""
        stage = self.stage
        if not stage.has_row:
            return 0.0
        if self.pump_on_row:
            pump = stage.pump_motor.pump_displacement * stage.pump.ratio
            return self.row["sun"] / (self.row[stage.motor_member] / pump)
        return self.row["sun"] / (self.row[stage.output_member] * stage.output.ratio)

    def true_stroke(self, displacement_ratio: Array) -> Array:
        """Return the displacement ratio that the swash plate really has."""
        for effect in self.effects:
            displacement_ratio = effect.true_displacement_ratio(displacement_ratio)
        return displacement_ratio

    def power_flow(self) -> PowerFlow:
        """Return the whole power flow."""
        speed, direction, pressure = self._motor_state()
        flow = self.torques(speed, direction, self.stroke, pressure)
        state = flow.state
        torques = dict(flow.torques)
        engine_torque = self._sum("engine_drag", state)
        if not self.pump_on_row:
            _, mechanical_share = self._output_shares(state)
            reaction = torques["output"][-1] * self.mechanical_ratio * mechanical_share
            torques["pump"] = self._pump(state)
            torques["mechanical"] = self._geared(
                "mechanical",
                reaction,
                self.engine_speed,
                np.sign(self.mechanical_ratio),
            )
            engine_torque = engine_torque + torques["pump"][-1] * self.pump_ratios[0]
        engine_torque = engine_torque + torques["mechanical"][-1]
        return flow._replace(
            torques=torques,
            pump_pressure=self._pump_pressure(state),
            engine_power=np.asarray(engine_torque * self.engine_speed),
        )

    # --- the unknown -------------------------------------------------------------------------

    def _motor_state(self) -> tuple[Array, Array, Array]:
        """Return motor speed, direction (the part of friction where it rests) and pressure."""
        ratio = self.flow_ratio * self.stroke
        load = self.points.load_torque / self.engine_speed
        if self.pump_on_row:
            return self._motor_at_output(ratio, load)
        return self._motor_on_row(ratio, load)

    def _motor_at_output(self, ratio: Array, load: Array) -> tuple[Array, Array, Array]:
        output = self.output(ratio, load)
        first = output * self.engine_speed / self.hydraulic_ratio
        pressure_unit = self.engine_speed / self.stage.pump_motor.motor_displacement
        speed = first
        pressure = self.pressure(ratio, output) * pressure_unit
        if self.effects:
            speed, pressure = self._settled(
                first, np.sign(first), closed_form_pressure=pressure
            )
        if self.resting is not None:
            # The whole flow of the pump leaks while friction holds the output.
            leaking = self.pressure(ratio, 0.0) * pressure_unit
            standing = np.where(self.idle, 0.0, np.nan)
            speed = np.where(self.resting, standing, speed)
            pressure = np.where(self.resting, leaking, pressure)
        return speed, np.sign(speed), pressure

    def _motor_on_row(self, ratio: Array, load: Array) -> tuple[Array, Array, Array]:
        outputs = np.stack(self.output_speeds(ratio, load))
        first = (
            self.engine_speed * (outputs - self.mechanical_ratio) / self.hydraulic_ratio
        )  # (4)
        forward = np.ones_like(first[0])

        def is_missed(speeds: Array) -> NDArray[np.bool_]:
            # As `selected` has it: neither regime is needed where the other one holds.
            driven_holds = (speeds[1] < 0.0) & (load <= self.stall_load)
            driving_holds = speeds[0] > 0.0
            return np.isnan(speeds) & ~np.stack([driven_holds, driving_holds])

        speeds, pressures = self._settled(
            first, np.stack([forward, -forward]), is_missed
        )
        driving, driven = speeds
        speed = self.selected(driving, driven, 0.0, load)
        direction = np.sign(speed)
        pressure = np.where(driving > 0.0, pressures[0], pressures[1])
        rests = speed == 0.0
        if rests.any():
            # Few points rest, and they take the most iterations.
            of_points = np.flatnonzero(rests.reshape(-1, rests.shape[-1]).any(axis=0))
            resting = np.where(rests, speed, np.nan)[..., of_points]
            part, leaking = self._at_points(of_points)._at_rest(resting)
            rests = rests[..., of_points]
            direction[..., of_points] = np.where(rests, part, direction[..., of_points])
            pressure[..., of_points] = np.where(
                rests, leaking, pressure[..., of_points]
            )
        return speed, direction, pressure

    def _at_points(self, index: NDArray[np.intp]) -> "Shafts":
        """Return the constants at some of the points."""
        senses = [_at_index(sense, index) for sense in self.senses]
        return Shafts(
            self.stage,
            self._parameters,
            self.effects,
            self.points.map(lambda values: values[..., index]),
            Senses(*senses),
            None if self.resting is None else self.resting[..., index],
        )

    def _at_rest(self, speed: Array) -> Array:
        """Fraction of the friction, -1 to 1, that balances a motor at rest; pressure; (2, n)."""
        forward = np.ones_like(speed)
        whole = np.stack([forward, -forward])
        estimate = self._estimate(speed, whole, self.stroke)
        (ahead, back), _ = self._surplus(speed, whole, self.stroke, estimate)
        # Without friction there is nothing to find.
        share = np.where(ahead == back, np.inf, 0.5 * (back - ahead))
        part, pressure = self._solved(
            np.clip(0.5 * (ahead + back) / share, -1.0, 1.0),
            1.0,
            lambda shafts, part, index: (speed[..., index], part, shafts.stroke),
            share,
        )
        return np.stack([np.clip(part, -1.0, 1.0), pressure])

    def _settled(
        self,
        speed: Array,
        direction: Array,
        is_missed: Callable[[Array], NDArray[np.bool_]] = np.isnan,
        closed_form_pressure: Array | None = None,
    ) -> Array:
        """Motor speed and pressure with every effect, from an estimate of the speed, (2, n)."""
        # Eqs (13), (14): the damping of the motor asks for pressure, which leaks.
        leaking = self.given.leakage * self.given.motor_damping
        displacement = self.stage.pump_motor.motor_displacement
        return self._solved(
            speed,
            self.pump_ratios[0] * self.engine_speed,
            lambda shafts, speed, index: (speed, direction[..., index], shafts.stroke),
            1.0 - self._row_share(self.stroke) + leaking / displacement**2,
            is_missed,
            closed_form_pressure,
        )

    def stroke_for(self, output_speed: Array) -> Array:
        """Return the displacement ratio to command for an output speed, from the points' ratio."""
        reflected = self.reflection * self._geared_speed(output_speed)
        motor = reflected - self.mechanical_ratio * self.engine_speed
        speed = motor / self.hydraulic_ratio  # (4)
        direction = np.where(speed > 0.0, 1.0, -1.0)
        stroke, _ = self._solved(
            self.points.displacement_ratio,
            1.0,
            lambda shafts, commanded, index: (
                speed[..., index],
                direction[..., index],
                shafts.true_stroke(commanded),
            ),
            -self.flow_ratio * self._pump_speed(reflected),
        )
        return np.asarray(stroke)

    def _solved(
        self,
        first: Array,
        scale: Value,
        motor_state: Callable[["Shafts", Array, Any], _MotorState],
        gain: Array,
        is_missed: Callable[[Array], NDArray[np.bool_]] = np.isnan,
        closed_form_pressure: Array | None = None,
    ) -> Array:
        """Return the unknown and the pressure at which flow and motor speed agree, (2, n).

        NaN where they do nowhere.

        Args:
            first: unknown to start from, shape (..., n).
            scale: of the unknown.
            motor_state: gives motor speed, direction and stroke for an unknown at some points,
                from the constants and the index of these points.
            gain: what the unknown adds to the speed above that of the flow, about.
            is_missed: which solutions of the first attempt are to be sought again.
            closed_form_pressure: to start from in a last attempt [Pa], shape (..., n).
        """
        everywhere = slice(None)

        def improved(
            unknown: Array,
            pressure: Array,
            shafts: Shafts = self,
            index: Any = everywhere,
        ) -> Array:
            state = motor_state(shafts, unknown, index)
            surplus, pressure = shafts._surplus(*state, pressure)
            return np.array([unknown + surplus / gain[..., index], pressure])

        def improved_at(index: NDArray[np.intp]) -> Callable[..., Array]:
            return partial(improved, shafts=self._at_points(index), index=index)

        def retried(solution: Array, pressure: Array) -> Array:
            """Seek what is missed once more in short steps, from another pressure."""
            start = np.stack([first, pressure])
            # Where the closed form has an answer, a long step may have turned the output back.
            has_start = np.isfinite(start).all(axis=0)
            if not (is_missed(solution[0]) & has_start).any():
                return solution
            careful = broyden(improved, start, scales, _SHORT_STEP, improved_at)
            return np.where(np.isnan(solution), careful, solution)

        estimate = self._estimate(*motor_state(self, first, everywhere))
        pressure_scale = np.full(estimate.shape, _PRESSURE_SCALE)
        scales = np.stack(np.broadcast_arrays(scale, pressure_scale))
        start = np.stack([first, estimate])
        solution = broyden(improved, start, scales, restricted=improved_at)
        solution = retried(solution, estimate)
        if closed_form_pressure is not None:
            # Next to the pole the torques barely determine a pressure, but the flow does.
            solution = retried(solution, closed_form_pressure)
        return solution

    def _estimate(self, speed: Array, direction: Array, stroke: Array) -> Array:
        """Pressure without effects, eq. (14)."""
        output_speed = (
            self.mechanical_ratio * self.engine_speed + self.hydraulic_ratio * speed
        )
        # No load has no torque, also where the output rests.
        load = np.where(self.idle, 0.0, self.load_power / output_speed)
        torque = load * self.hydraulic_ratio / (1.0 - self._row_share(stroke))
        return self._motor_pressure(torque, speed, direction)

    def _surplus(
        self, speed: Array, direction: Array, stroke: Array, pressure: Array
    ) -> tuple[Array, Array]:
        """Return how far the flow, eq. (13), exceeds a motor speed assumed; and the pressure."""
        flow = self.torques(speed, direction, stroke, pressure)
        leaked = flow.leakage_flow / self.stage.pump_motor.motor_displacement
        surplus = self.sense * (flow.state.delivered_speed - leaked) - speed
        return np.asarray(surplus), self.sense * flow.state.pressure

    def _pump_speed(self, reflected_output: Array) -> Array:
        a, c = self.pump_ratios
        return np.asarray(a * self.engine_speed + c * reflected_output)

    def _row_share(self, stroke: Array) -> Array:
        """What a motor speed adds to the flow of a pump on the row, per motor speed [-]."""
        fed_back = self.hydraulic_ratio * self.pump_ratios[1]
        return np.asarray(self.flow_ratio * stroke * fed_back)

    # --- the shafts ---------------------------------------------------------------------------

    def torques(
        self, speed: Array, direction: Array, stroke: Array, pressure: Array
    ) -> PowerFlow:
        """Go from the load back to the pressure, from one assumed, and from it to the leakage."""
        hydraulic = self.hydraulic_ratio
        geared_speed = (
            self.mechanical_ratio * self.engine_speed + hydraulic * speed
        )  # (4)
        has_sense = (geared_speed * self.sense > 0.0) | self.idle
        geared_speed = np.where(has_sense, geared_speed, np.nan)
        output_speed = self._output_speed(geared_speed)
        power = self._output_power(output_speed)
        without_load = self.idle & (power == 0.0)
        load = np.where(without_load, 0.0, power / output_speed)
        state = self._state(speed, geared_speed, stroke, pressure)
        load = load + self.sense * self._sum("output_drag", state)
        drag = self._sum("motor_drag", state)
        if self.pump_on_row:
            torques = self._braced(self._loaded(state), geared_speed)
            load = load - torques["output"][0]
            direction = np.sign(speed)
            motor = self._geared(
                "motor", load * hydraulic, speed, np.sign(load * speed)
            )
        else:
            output = self._geared("output", load, geared_speed, self.senses.power)
            torques = {"output": output}
            # Ideal row: virtual work shares the output torque by the speed ratios.
            motor_share, _ = self._output_shares(state)
            asked = output[-1] * hydraulic * motor_share
            motor = self._geared("motor", asked, speed, direction)
        torques["motor"] = motor
        answer = self._motor_pressure(motor[-1] + drag * direction, speed, direction)
        if self.resting is not None:
            # Friction takes the torque of a motor at rest, whatever its pressure.
            answer = np.where(self.resting, pressure, answer)
        # What pump and motor share answers the pressure assumed: a step of Newton.
        pressure = pressure + (answer - pressure) / (1.0 - self._row_share(stroke))
        state = self._loaded(state._replace(pressure=self.sense * pressure))
        # Eq. (13) takes the pressure of the motor; lines between the units do not leak.
        leakage = self.given.leakage * state.pressure + self._sum("leakage_flow", state)
        return PowerFlow(
            state, output_speed, geared_speed, power, np.asarray(leakage), torques
        )

    def _output_power(self, output_speed: Array) -> Array:
        """Return the power that really leaves at a speed of the output shaft [W]."""
        power = self.load_power
        for effect in self.acting["true_load_power"]:
            power = effect.true_load_power(
                _in_shape_of(output_speed, power), np.abs(output_speed)
            )
        return power

    def _output_speed(self, geared_speed: Array) -> Array:
        """Return the speed behind closed clutches; NaN where they cannot pass the load."""
        if not self.slipping:
            return geared_speed
        direction = np.sign(geared_speed)
        before = np.abs(geared_speed)
        behind = before
        # More torque slips more, so that Newton's method comes nearer from one side.
        for _ in range(_SLIP_ROUNDS):
            slip = self._slip(behind)
            surplus = behind + slip - before
            is_off = np.abs(surplus) > _SLIP_TOLERANCE * before
            if not is_off.any():
                return np.asarray(direction * behind)
            change = self._slip(behind * (1.0 + _SLIP_DIFFERENCE)) - slip
            slope = 1.0 + change / (_SLIP_DIFFERENCE * behind)
            closer = np.where(slope > 0.0, behind - surplus / slope, np.nan)
            closer = np.where(closer > 0.0, closer, np.nan)
            behind = np.where(is_off, closer, behind)
        # What has not converged by then has no answer.
        return np.asarray(direction * np.where(is_off, np.nan, behind))

    def _geared_speed(self, output_speed: Array) -> Array:
        """Return the speed before closed clutches."""
        if not self.slipping:
            return output_speed
        behind = np.abs(output_speed)
        return np.asarray(np.sign(output_speed) * (behind + self._slip(behind)))

    def _slip(self, behind: Array) -> Array:
        """Return what closed clutches take from the speed; negative in overrun."""
        power = self._output_power(behind)
        torque = np.where(power == 0.0, 0.0, np.abs(power) / behind)
        slip: Value = 0.0
        for effect in self.slipping:
            slip = slip + self._slip_at_output(effect, torque)
        return np.asarray(np.sign(power) * slip)

    def _slip_at_output(self, effect: Effect, torque: Array) -> Value:
        """Return the output speed that an effect takes under a torque of the output."""
        # The mechanical path has m times that torque, and slows the output by m times its slip.
        ratio = np.abs(self.mechanical_ratio)
        return effect.output_slip(torque) + ratio * effect.mechanical_slip(
            ratio * torque
        )

    def _mechanical_slip(self, effect: Effect, state: ShaftState) -> Value:
        """Return the speed that a clutch before a row braced by the pump takes from the engine."""
        displacement = self.stage.pump_motor.pump_displacement
        pump_torque = displacement * state.displacement_ratio * state.pressure
        torque = self.pump_ratios[0] * pump_torque
        return np.sign(torque) * effect.mechanical_slip(np.abs(torque))

    def _loaded(self, state: ShaftState) -> ShaftState:
        """Return a state whose stroke and pump speed yield to the load."""
        if self.acting["stroke_lag"]:
            lag = self._sum("stroke_lag", state)
            state = state._replace(displacement_ratio=state.displacement_ratio - lag)
        if not self.pump_on_row:
            return state
        for effect in self.acting["mechanical_slip"]:
            slip = self._mechanical_slip(effect, state)
            slowed = state.pump_speed - self.pump_ratios[0] * slip
            state = state._replace(pump_speed=slowed)
        return state

    def mechanical_speed(self, flow: PowerFlow) -> Array:
        """Return the speed of the mechanical path behind its closed clutch [rad/s].

        Input-coupled that of the engine: the slip counts at the output.
        """
        if not self.pump_on_row:
            return flow.state.engine_speed
        lost = self._pump_speed(flow.geared_speed) - flow.state.pump_speed
        return np.asarray(flow.state.engine_speed - lost / self.pump_ratios[0])

    def slip_loss(self, effect: Effect, flow: PowerFlow) -> Array:
        """Return the power that an effect takes in closed clutches [W]."""
        power = np.abs(flow.output_power)
        torque = np.where(power == 0.0, 0.0, power / np.abs(flow.output_speed))
        loss = torque * self._slip_at_output(effect, torque)
        if self.pump_on_row:
            slip = self._mechanical_slip(effect, flow.state)
            loss = loss + flow.torques["mechanical"][-1] * slip
        return np.asarray(loss)

    def _braced(self, state: ShaftState, output_speed: Array) -> dict[str, list[Array]]:
        """Torques of pump, engine and output paths where the pump braces the row."""
        pump = self._pump(state)
        engine_share, output_share = self.pump_ratios
        # The pump holds its member against the sense in which the engine turns it.
        braked, driven = self.stage.motor_member, self.stage.mechanical_member
        held = self.stage.mechanical.direction * np.sign(
            self.row[driven] / self.row[braked]
        )
        to_output, to_engine = self._row_shares(
            state, braked, self.stage.output_member, held * np.sign(pump[-1])
        )
        reaction = -output_share * pump[-1] * to_output
        given = self._geared(
            "output",
            np.asarray(reaction),
            output_speed,
            -np.sign(reaction * output_speed),
            from_row=True,
        )
        mechanical = self._geared(
            "mechanical",
            np.asarray(engine_share * pump[-1] * to_engine),
            self.engine_speed,
            np.sign(pump[-1]),
        )
        return {"pump": pump, "output": given[::-1], "mechanical": mechanical}

    def _pump(self, state: ShaftState) -> list[Array]:
        """Torques of the pump path; eq. (15) in the steady state, with friction that takes."""
        units = self.stage.pump_motor
        turning = np.sign(state.pump_speed)
        displacement = units.pump_displacement * state.displacement_ratio
        ideal = self._pump_pressure(state) * displacement
        friction = units.pump_friction * np.abs(ideal) + self._sum("pump_drag", state)
        damping = self.given.pump_damping * state.pump_speed
        torque = ideal + turning * friction + damping
        return self._geared(
            "pump", np.asarray(torque), state.pump_speed, turning * np.sign(torque)
        )

    def _pump_pressure(self, state: ShaftState) -> Array:
        return np.asarray(state.pressure + self._sum("pressure_drop", state))

    def _state(
        self, speed: Array, output_speed: Array, stroke: Array, pressure: Array
    ) -> ShaftState:
        """Return what effects may read: as if the output turned forward."""
        units, turning = self.stage.pump_motor, self.senses.output
        output = np.abs(output_speed)
        zeros = np.zeros_like(speed)
        per_engine, per_output = self.stage.sun_speed_ratios
        sun_torque = zeros
        if self.stage.has_row:
            loading = (
                pressure * stroke if self.pump_on_row else self.load_power / output
            )
            sun_torque = self.sun_share * loading
        clutches = [
            (engine, turning * output) for _, engine, output in self.stage.open_clutches
        ]
        return ShaftState(
            self.engine_speed + zeros,
            self._pump_speed(output_speed),
            output,
            self.sense * speed,
            self.sense * np.sign(self.flow_ratio) * stroke + zeros,
            self.sense * pressure,
            self.viscosity + zeros,
            per_engine * self.engine_speed + per_output * turning * output,
            np.abs(sun_torque),
            self.load_power + zeros,
            max(units.pump_displacement, units.motor_displacement),
            clutches or ((0.0, 1.0),),
            abs(self.flow_ratio),
            self.points.oil_temperature,
            self.points.displacement_ratio + zeros,
        )

    def _motor_pressure(self, torque: Array, speed: Array, direction: Array) -> Array:
        # Eq. (14); friction resists the motion, also where the pressure is reversed.
        units = self.stage.pump_motor
        torque = torque + self.given.motor_damping * speed
        friction = units.motor_friction * direction * np.sign(torque)
        return np.asarray(torque / (units.motor_displacement * (1.0 - friction)))

    def _sum(self, hook: str, state: ShaftState) -> Value:
        total: Value = 0.0
        for effect in self.acting[hook]:
            total = total + effect.at(hook, state)
        return total

    def _geared(
        self,
        path: str,
        torque: Array,
        speed: Array,
        direction: Value,
        from_row: bool = False,
    ) -> list[Array]:
        """Torques of a path back from `torque` at its output end, for the shaft at `speed`.

        Args:
            path: name of the path.
            torque: at its output end [N m].
            speed: of the shaft at that end [rad/s].
            direction: of the power, 1 towards the output.
            from_row: go the other way, from the row on; the direction is that against the power.
        """
        torques = [torque]
        pairs = getattr(self.stage, path).gear_pairs
        for pair in pairs if from_row else reversed(pairs):
            efficiency: Value = pair.efficiency
            for effect in self.acting["gear_loss"]:
                power = torques[-1] * speed
                loss = effect.gear_loss(power, _in_shape_of(power, speed))
                efficiency = efficiency * (1.0 - loss)
            torques.append(np.asarray(torques[-1] / efficiency**direction))
        return torques

    def _output_shares(self, state: ShaftState) -> tuple[Value, Value]:
        return self._row_shares(
            state,
            self.stage.output_member,
            self.stage.motor_member,
            -self.reflection * self.stage.output.direction,
        )

    def _row_shares(
        self, state: ShaftState, known: str, other: str, torque_sign: Value
    ) -> tuple[Value, Value]:
        """Torques of two members of a row with mesh loss, against those of an ideal row.

        Args:
            state: of the shafts.
            known: member whose torque is known.
            other: the first member wanted; the second is the mechanical one.
            torque_sign: sign of the torque on the known member.
        """
        loss = self._sum("planetary_loss", state)
        if not self.stage.has_row or not np.any(loss):
            return 1.0, 1.0
        ideal = self.row
        # Output torque acts on the row against its motion; that of the sun has its sign by (4).
        rolling = np.tanh(state.sun_speed / _ROLLING_SPEED)
        drives = torque_sign * np.sign(ideal["sun"] / ideal[known]) * rolling
        ring = self.stage.planetary_constant * (1.0 - loss) ** drives
        real = {"sun": 1.0, "ring": ring, "carrier": -(1.0 + ring)}
        reference = real[known] / ideal[known]
        mechanical = self.stage.mechanical_member
        return (
            real[other] / ideal[other] / reference,
            real[mechanical] / ideal[mechanical] / reference,
        )


def _at_index(value: Value, index: NDArray[np.intp]) -> Value:
    """Return an array at some of the points; a number is the same at all."""
    return value if np.ndim(value) == 0 else np.asarray(value)[..., index]


def _in_shape_of(other: Array, value: Value) -> Array:
    """Return a value in the shape of another."""
    return np.asarray(value + np.zeros_like(other))
