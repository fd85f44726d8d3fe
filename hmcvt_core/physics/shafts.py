# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The whole power flow with effects, shaft by shaft, solved for the motor speed u.

.. math:: u = \varepsilon\omega_p V_p/V_m - q(\Delta p)/V_m \;(13), \qquad
          \Delta p = \Delta p(u, T_{out}) \;(14), \quad T_{out} = P_{out}/\omega_{out}(u) \;(4)

`steady_state` solves it with the losses of the equations alone. Effects bend the terms; steps of
Broyden's method from that solution then find u and the pressure, in each regime of the motor.
"""

import math
from collections.abc import Callable
from operator import methodcaller
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Candidates, Parameters
from ..transmission.ranges import Array, OperatingPoints
from ..transmission.stage import Stage, member_speed_coefficients
from .effects.base import Effect, ShaftState, Value
from .steady_state import Quadrant, Ways

_ITERATIONS = 40
_MEMORY = 8  # steps that are remembered
_TOLERANCE = (
    1e-7  # of the unknown, relative to its scale: the step from there is the last
)
_PRESSURE = 2e7  # Pa, its scale
_SHORT = 0.5  # of the scales, where longer steps lead nowhere
_LEAST = 1e-300  # a step that is none has no direction
_SETTLED = 1e-6  # the same, where the last digits of the terms are noise
_HOOKS = (
    "true_load_power",
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


class PowerFlow(NamedTuple):
    """Steady state at operating points; arrays of one shape, NaN where there is none.

    Attributes:
        state: speeds and pressure, and the power that the bench reads at the output.
        output_speed: y times engine speed, with its sign [rad/s].
        output_power: power that really leaves [W].
        leakage_flow: flow that does not reach the motor [m3/s].
        torques: by path, before and after each gear pair from the output end back, referred to the
            shaft at that end (output, motor) or to the engine [N m].
        pump_pressure: pressure over the pump [Pa]; NaN while only the motor's is sought, for which
            `torques` has the paths that it needs.
        engine_power: power that the engine gives [W]; the same.
    """

    state: ShaftState
    output_speed: Array
    output_power: Array
    leakage_flow: Array
    torques: dict[str, list[Array]]
    pump_pressure: Value = np.nan
    engine_power: Value = np.nan


class Shafts(Quadrant):
    """One call's constants; the functions of the unknown read them.

    With the pump on the row (output-coupled) the row's member that drives the output is braced by
    the pump, so that pump and motor share the output torque: m = 0, and nothing is reflected but
    the turning.
    """

    def __init__(
        self,
        stage: Stage,
        parameters: Parameters,
        effects: tuple[Effect, ...],
        points: OperatingPoints,
        ways: Ways,
    ) -> None:
        self.stage, self.effects, self.points = stage, effects, points
        self.acting = {
            hook: [each for each in effects if each.acts_at(hook)] for hook in _HOOKS
        }
        film: Value = 1.0
        self.viscosity: Value = 1.0
        if (warm := points.oil_temperature) is not None:
            film, self.viscosity = (
                math.prod(map(hook, effects))
                for hook in (
                    methodcaller("film_viscosity_ratio", warm),
                    methodcaller("viscosity_ratio", warm),
                )
            )
        self.given = Candidates(
            parameters.leakage / self.viscosity,
            parameters.motor_damping * film,
            parameters.pump_damping * film,
        )
        super().__init__(stage, self.given, *ways)
        self.engine_speed = points.engine_speed
        self.load_power = points.load_torque * points.engine_speed
        self.idle = self.load_power == 0.0
        self.row = member_speed_coefficients(stage.planetary_constant)
        # Torque of the sun per load power / output speed; braced, per pressure times stroke.
        self.sun_share = (
            0.0
            if not stage.has_row
            else self.row["sun"]
            / (
                self.row[stage.motor_member]
                / (stage.pump_motor.pump_displacement * stage.pump.ratio)
                if self.braced
                else self.row[stage.output_member] * stage.output.ratio
            )
        )
        self.stroke = self.true_stroke(points.displacement_ratio)

    def true_stroke(self, displacement_ratio: Array) -> Array:
        """Displacement ratio that the swash plate really has."""
        for effect in self.effects:
            displacement_ratio = effect.true_displacement_ratio(displacement_ratio)
        return displacement_ratio

    def power_flow(self) -> PowerFlow:
        """Return the whole power flow."""
        speed, direction, pressure = self._motor_speed()
        found = self.torques(speed, direction, self.stroke, pressure)
        state, torques = found.state, found.torques
        engine_torque = self._sum("engine_drag", state)
        if not self.braced:
            reaction = (
                torques["output"][-1]
                * self.mechanical_ratio
                * self._output_shares(state)[1]
            )
            torques = {
                **torques,
                "pump": self._pump(state),
                "mechanical": self._geared(
                    "mechanical",
                    reaction,
                    self.engine_speed,
                    np.sign(self.mechanical_ratio),
                ),
            }
            engine_torque = engine_torque + torques["pump"][-1] * self.pump_ratios[0]
        engine_torque = engine_torque + torques["mechanical"][-1]
        return found._replace(
            torques=torques,
            pump_pressure=self._pump_pressure(state),
            engine_power=np.asarray(engine_torque * self.engine_speed),
        )

    # --- the unknown -------------------------------------------------------------------------

    def _motor_speed(self) -> tuple[Array, Array, Array]:
        """Return motor speed, direction (the part of friction where it stands) and pressure."""
        ratio, load = (
            self.full * self.stroke,
            self.points.load_torque / self.engine_speed,
        )
        if self.braced:
            speed = self.output(ratio, load) * self.engine_speed / self.hydraulic_ratio
            speed, pressure = self._settled(speed, np.sign(speed))
            return speed, np.sign(speed), pressure
        first = np.stack(
            [
                self.engine_speed
                * (output - self.mechanical_ratio)
                / self.hydraulic_ratio  # (4)
                for output in self.output_speeds(ratio, load)
            ]
        )
        (motoring, pumping), (high, low) = self._settled(
            first,
            np.stack([np.ones_like(first[0]), -np.ones_like(first[0])]),
            # As `selected` has it: the one regime is not asked for where the other holds.
            lambda found: (
                np.isnan(found)
                & ~np.stack(
                    [(found[1] < 0.0) & (load <= self.stall_load), found[0] > 0.0]
                )
            ),
        )
        speed = self.selected(motoring, pumping, 0.0, load)
        direction, standing = np.sign(speed), speed == 0.0
        pressure = np.where(motoring > 0.0, high, low)
        if standing.any():
            part, leaking = self._held(np.where(standing, speed, np.nan))
            direction = np.where(standing, part, direction)
            pressure = np.where(standing, leaking, pressure)
        return speed, direction, pressure

    def _held(self, speed: Array) -> Array:
        """Part of the friction, -1 to 1, that balances a standing motor; its pressure; (2, n)."""
        whole = np.stack([np.ones_like(speed), -np.ones_like(speed)])
        (ahead, back), _ = self._surplus(
            speed, whole, self.stroke, self._estimate(speed, whole, self.stroke)
        )
        share = np.where(ahead == back, np.inf, 0.5 * (back - ahead))
        part, pressure = self._found(  # without friction there is nothing to find
            np.clip(0.5 * (ahead + back) / share, -1.0, 1.0),
            1.0,
            lambda part: (speed, part, self.stroke),
            share,
        )
        return np.stack([np.clip(part, -1.0, 1.0), pressure])

    def _settled(
        self,
        speed: Array,
        direction: Array,
        lost: Callable[[Array], NDArray[np.bool_]] = np.isnan,
    ) -> Array:
        """Motor speed and pressure with every effect, from an estimate of the speed, (2, n)."""
        # Eqs (13), (14): the motor's damping asks for pressure, which leaks.
        leaking = self.given.leakage * self.given.motor_damping
        return self._found(
            speed,
            self.pump_ratios[0] * self.engine_speed,
            lambda speed: (speed, direction, self.stroke),
            1.0
            - self._row_share(self.stroke)
            + leaking / self.stage.pump_motor.motor_displacement**2,
            lost,
        )

    def stroke_for(self, output_speed: Array) -> Array:
        """Commanded displacement ratio that makes an output speed, from the points' own."""
        turned = self.reflection * output_speed
        speed = (
            turned - self.mechanical_ratio * self.engine_speed
        ) / self.hydraulic_ratio  # (4)
        direction = np.where(speed > 0.0, 1.0, -1.0)
        return np.asarray(
            self._found(
                self.points.displacement_ratio,
                1.0,
                lambda commanded: (speed, direction, self.true_stroke(commanded)),
                -self.full * self._pump_speed(turned),
            )[0]
        )

    def _found(
        self,
        first: Array,
        scale: Value,
        given: Callable[[Array], tuple[Array, Array, Array]],
        gain: Array,
        lost: Callable[[Array], NDArray[np.bool_]] = np.isnan,
    ) -> Array:
        """Unknown and pressure, (2, n), with which flow and motor speed agree; NaN where none do.

        Args:
            first: where to start.
            scale: of the unknown.
            given: motor speed, direction and stroke for an unknown.
            gain: what the unknown adds to the speed above the flow's, about.
            lost: which of those found at first are to be sought again.
        """

        def better(unknown: Array, pressure: Array) -> Array:
            surplus, pressure = self._surplus(*given(unknown), pressure)
            return np.array([unknown + surplus / gain, pressure])

        start = np.stack([first, self._estimate(*given(first))])
        found = _stepped(better, start, scale, np.inf)
        # Where an answer was in sight a step may have turned the output back.
        if (lost(found[0]) & np.isfinite(start).all(axis=0)).any():
            found = np.where(
                np.isnan(found), _stepped(better, start, scale, _SHORT), found
            )
        return found

    def _estimate(self, speed: Array, direction: Array, stroke: Array) -> Array:
        """Pressure without effects, eq. (14)."""
        output_speed = (
            self.mechanical_ratio * self.engine_speed + self.hydraulic_ratio * speed
        )
        # Without load none, also where the output stands.
        torque = (
            np.where(self.idle, 0.0, self.load_power / output_speed)
            * self.hydraulic_ratio
        )
        return self._pressure(
            torque / (1.0 - self._row_share(stroke)), speed, direction
        )

    def _surplus(
        self, speed: Array, direction: Array, stroke: Array, pressure: Array
    ) -> tuple[Array, Array]:
        """Motor speed that the flow gives, eq. (13), above one assumed; and the pressure."""
        found = self.torques(speed, direction, stroke, pressure)
        leaked = found.leakage_flow / self.stage.pump_motor.motor_displacement
        return (
            np.asarray(self.sense * (found.state.delivered_speed - leaked) - speed),
            self.sense * found.state.pressure,
        )

    def _pump_speed(self, turned: Array) -> Array:
        engine, output = self.pump_ratios
        return np.asarray(engine * self.engine_speed + output * turned)

    def _row_share(self, stroke: Array) -> Array:
        """What a motor speed adds to the flow of a pump on the row, per motor speed [-]."""
        return np.asarray(
            self.full * stroke * self.hydraulic_ratio * self.pump_ratios[1]
        )

    # --- the shafts ---------------------------------------------------------------------------

    def torques(
        self, speed: Array, direction: Array, stroke: Array, pressure: Array
    ) -> PowerFlow:
        """Go from the load back to the pressure, from one assumed, and from it to the leakage."""
        hydraulic, idle, power = self.hydraulic_ratio, self.idle, self.load_power
        output_speed = (
            self.mechanical_ratio * self.engine_speed + hydraulic * speed
        )  # (4)
        output_speed = np.where(
            (output_speed * self.sense > 0.0) | idle, output_speed, np.nan
        )
        for effect in self.acting["true_load_power"]:
            power = effect.true_load_power(_like(power, speed), np.abs(output_speed))
        load = np.where(idle & (power == 0.0), 0.0, power / output_speed)
        state = self._state(speed, output_speed, stroke, pressure)
        load = load + self.sense * self._sum("output_drag", state)
        drag = self._sum("motor_drag", state)
        torques = {}
        if self.braced:
            torques = self._braced(self._lagged(state), output_speed)
            load, direction = load - torques["output"][0], np.sign(speed)
            motor = self._geared(
                "motor", load * hydraulic, speed, np.sign(load * speed)
            )
        else:
            output = self._geared("output", load, output_speed, self.power)
            # Ideal row: virtual work shares the output torque by the speed ratios.
            motor = self._geared(
                "motor",
                output[-1] * hydraulic * self._output_shares(state)[0],
                speed,
                direction,
            )
            torques = {"output": output}
        found = self._pressure(motor[-1] + drag * direction, speed, direction)
        # What pump and motor share answers the pressure assumed: a step of Newton.
        pressure = pressure + (found - pressure) / (1.0 - self._row_share(stroke))
        state = self._lagged(state._replace(pressure=self.sense * pressure))
        # Eq. (13) takes the pressure of the motor; lines between the units do not leak.
        lost = self.given.leakage * state.pressure + self._sum("leakage_flow", state)
        return PowerFlow(
            state, output_speed, power, np.asarray(lost), {**torques, "motor": motor}
        )

    def _lagged(self, state: ShaftState) -> ShaftState:
        return (
            state._replace(
                displacement_ratio=state.displacement_ratio
                - self._sum("stroke_lag", state)
            )
            if self.acting["stroke_lag"]
            else state
        )

    def _braced(self, state: ShaftState, output_speed: Array) -> dict[str, list[Array]]:
        """Torques of pump, engine and output paths where the pump braces the row."""
        pump = self._pump(state)
        engine, output = self.pump_ratios
        # The pump holds its member against the sense in which the engine turns it.
        braked, driven = self.stage.motor_member, self.stage.mechanical_member
        held = self.stage.mechanical.direction * np.sign(
            self.row[driven] / self.row[braked]
        )
        output_share, engine_share = self._row_shares(
            state, braked, self.stage.output_member, held * np.sign(pump[-1])
        )
        reaction = -output * pump[-1] * output_share
        given = self._geared(
            "output",
            np.asarray(reaction),
            output_speed,
            -np.sign(reaction * output_speed),
            from_row=True,
        )
        return {
            "pump": pump,
            "output": given[::-1],
            "mechanical": self._geared(
                "mechanical",
                np.asarray(engine * pump[-1] * engine_share),
                self.engine_speed,
                np.sign(pump[-1]),
            ),
        }

    def _pump(self, state: ShaftState) -> list[Array]:
        """Torques of the pump path; eq. (15) in the steady state, with friction that takes."""
        units, way = self.stage.pump_motor, np.sign(state.pump_speed)
        ideal = (
            self._pump_pressure(state)
            * units.pump_displacement
            * state.displacement_ratio
        )
        rubbing = units.pump_friction * np.abs(ideal) + self._sum("pump_drag", state)
        torque = ideal + way * rubbing + self.given.pump_damping * state.pump_speed
        return self._geared(
            "pump", np.asarray(torque), state.pump_speed, way * np.sign(torque)
        )

    def _pump_pressure(self, state: ShaftState) -> Array:
        return np.asarray(state.pressure + self._sum("pressure_drop", state))

    def _state(
        self, speed: Array, output_speed: Array, stroke: Array, pressure: Array
    ) -> ShaftState:
        """Return what effects may read: as if the output turned forward."""
        units, output, still = (
            self.stage.pump_motor,
            np.abs(output_speed),
            np.zeros_like(speed),
        )
        per_engine, per_output = self.stage.sun_speed_ratios
        sun_torque = (
            still
            if not self.stage.has_row
            else self.sun_share
            * (pressure * stroke if self.braced else self.load_power / output)
        )
        return ShaftState(
            self.engine_speed + still,
            self._pump_speed(output_speed),
            output,
            self.sense * speed,
            self.sense * np.sign(self.full) * stroke + still,
            self.sense * pressure,
            self.viscosity + still,
            per_engine * self.engine_speed + per_output * self.turning * output,
            np.abs(sun_torque),
            self.load_power + still,
            max(units.pump_displacement, units.motor_displacement),
            [
                (engine, self.turning * output)
                for _, engine, output in self.stage.open_clutches
            ]
            or ((0.0, 1.0),),
            abs(self.full),
        )

    def _pressure(self, torque: Array, speed: Array, direction: Array) -> Array:
        # Eq. (14); friction resists the motion, also where the pressure is reversed.
        units, torque = self.stage.pump_motor, torque + self.given.motor_damping * speed
        friction = units.motor_friction * direction * np.sign(torque)
        return np.asarray(torque / (units.motor_displacement * (1.0 - friction)))

    def _sum(self, hook: str, state: ShaftState) -> Value:
        acting = self.acting[hook]
        return (
            sum((effect.at(hook, state) for effect in acting), 0.0) if acting else 0.0
        )

    def _geared(
        self,
        path: str,
        torque: Array,
        speed: Array,
        direction: Value,
        from_row: bool = False,
    ) -> list[Array]:
        """Torques of a path back from `torque` at its output end, for the shaft at `speed`.

        With `from_row` it goes the other way; the direction is that of the power against it.
        """
        torques, pairs = [torque], getattr(self.stage, path).gear_pairs
        for pair in pairs if from_row else reversed(pairs):
            passed: Value = pair.efficiency
            for effect in self.acting["gear_loss"]:
                power = torques[-1] * speed
                passed = passed * (1.0 - effect.gear_loss(power, _like(speed, power)))
            torques.append(np.asarray(torques[-1] / passed**direction))
        return torques

    def _output_shares(self, state: ShaftState) -> tuple[Value, Value]:
        return self._row_shares(
            state,
            self.stage.output_member,
            self.stage.motor_member,
            -self.reflection * self.stage.output.direction,
        )

    def _row_shares(
        self, state: ShaftState, known: str, other: str, way: Value
    ) -> tuple[Value, Value]:
        """Torque of another member and of the mechanical one against an ideal row, with mesh loss.

        `way` is the sign of the torque on the member `known`.
        """
        lost = self._sum("planetary_loss", state)
        if not self.stage.has_row or not np.any(lost):
            return 1.0, 1.0
        k, ideal = self.stage.planetary_constant, self.row
        # Output torque acts on the row against its motion; the sun's share has its sign by (4).
        drives = (
            way * np.sign(ideal["sun"] / ideal[known]) * np.tanh(state.sun_speed / 2.0)
        )
        real = {"sun": 1.0, "ring": k * (1.0 - lost) ** drives}
        real["carrier"] = -(real["sun"] + real["ring"])
        reference = real[known] / ideal[known]
        return tuple(
            real[member] / ideal[member] / reference
            for member in (other, self.stage.mechanical_member)
        )


def _stepped(
    function: Callable[..., Array], first: Array, scale: Value, longest: float
) -> Array:
    """Solve x, p = function(x, p), p a pressure; NaN where that does not settle.

    No step changes either by more than `longest` of its scale. Steps of Broyden's method, from what
    each has shown (Kelley 1995, Iterative Methods, brsol).
    """
    size = np.stack(np.broadcast_arrays(scale, np.full(first.shape[1:], _PRESSURE)))
    x, steps, along = first / size, list[Array](), list[Array]()
    for _ in range(_ITERATIONS):
        step = error = function(*(x * size)) / size - x
        if len(steps) == _MEMORY:
            steps, along = [], []
        for way, after in zip(along, steps[1:], strict=False):
            step = step + after * _along(step, way)
        if steps:
            slope = 1.0 - _along(step, along[-1])
            step = step / slope
            # The function answers x weakly: a slope far from 1 is noise of the last digits, or a
            # bend behind which nothing holds that earlier steps have shown.
            bent = (slope < 0.05) | (slope > 20.0)
            if bent.any():
                step = np.where(bent, error, step)
                along = [np.where(bent, 0.0, way) for way in along]
        if longest < np.inf:
            step = step / np.maximum(1.0, np.abs(step).max(axis=0) / longest)
        x = x + step
        if not (np.abs(error) > _TOLERANCE).any():
            break
        steps.append(step)
        along.append(step / np.maximum(_along(step, step), _LEAST))
    return np.where((np.abs(error) <= _SETTLED).all(axis=0), x * size, np.nan)


def _like(value: Value, other: Array) -> Array:
    """A value in the shape of another."""
    return np.asarray(value + np.zeros_like(other))


def _along(one: Array, other: Array) -> Array:
    return np.asarray(np.einsum("k...,k...->...", one, other))
