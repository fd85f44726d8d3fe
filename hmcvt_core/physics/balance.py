# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What answers at many points: the balance without effects, and with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.quantities import PREDICTED
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage, speed_ratio
from . import readings
from .effects.base import Effect, ShaftState
from .point_losses import PointLosses
from .readings import BenchState
from .regimes import FORWARD_PULL, Senses, sign
from .shafts import PowerFlow, Shafts
from .single_point import PointSolver, point_solver
from .steady_state import SteadyState

STALLED = "the load cannot be carried: the leakage takes the whole flow of the pump"
BEYOND_POLE = (
    "the displacement ratio is beyond the pole of eq. (5): the row feeds more flow back to the "
    "pump than the motor takes; not served beyond the pole of eq. (5)"
)
HELD_MOTOR = (
    "the load cannot be carried: friction holds the motor at this displacement ratio, where even "
    "without load the output stands"
)
SELF_LOCKING = (
    "the stage is self-locking: without load no turning output balances its losses"
)
HELD_OUTPUT = (
    "friction holds the output at rest at this displacement ratio: it carries no load, and the "
    "sense in which wheels would turn it is not determined"
)
HELD_PUMP = (
    "in overrun the row brings the pump to rest, where its friction changes direction: the "
    "model has no answer in this strip"
)
DRAGGED = "in overrun the wheels give less than the losses take, and the engine gives the rest"

_HELD = 1e-6
"""Relative difference of the output speed up to which a search holds it."""


class PowerShares(NamedTuple):
    """Power in, power out and every loss between them [W], arrays of one shape.

    Attributes:
        input_power: from the engine.
        output_power: to the load.
        losses: by part, see `breakdown`; their sum is input_power - output_power.
    """

    input_power: Array
    output_power: Array
    losses: Mapping[str, Array]


class BalanceSolver:
    """The steady state of a stage at points of shape (n,).

    Without effects the state has a closed form; with effects, each where it acts, it is found by
    iteration.

    Args:
        stage: of any layout.
        parameters: of the units; parameters of shape (..., 1) give results of shape (..., n). So do
            gear efficiencies of the stage.
        effects: further losses; those of another stage do not act.
        oil_temperature: at points that state none [deg C]; None where it is not known.
    """

    def __init__(
        self,
        stage: Stage,
        parameters: Parameters,
        effects: Sequence[Effect] = (),
        oil_temperature: float | None = None,
    ) -> None:
        self.stage = stage
        self.mechanical_ratio = stage.mechanical_speed_ratio
        self._parameters = parameters
        self._oil_temperature = oil_temperature
        self._effects = tuple(
            effect for effect in effects if effect.stage in ("", stage.name)
        )
        self._pump_on_row = stage.layout == "output_coupled"
        self._has_candidates = np.ndim(parameters.motor_damping) > 0
        self._quadrants: dict[Senses, SteadyState] = {}

    def at_oil_temperature(self, oil_temperature: float | None) -> BalanceSolver:
        """Return a solver of all points at an oil temperature [deg C]; None leaves it unknown."""
        if oil_temperature is None or not self._effects:
            return self
        return BalanceSolver(
            self.stage, self._parameters, self._effects, oil_temperature
        )

    @cached_property
    def at_point(self) -> PointSolver | None:
        """What solves single points in a microsecond; None with effects."""
        if self._effects:
            return None
        return point_solver(self.quadrant)

    @cached_property
    def losses_at_point(self) -> PointLosses | None:
        """What shares the lost power at single points; None with effects."""
        if self.at_point is None:
            return None
        return PointLosses(self.stage, self._parameters, self.quadrant, self.at_point)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def solve(self, points: OperatingPoints) -> Solution:
        """Return efficiency, output speed and engine torque as read; NaN is no answer."""
        if self._effects:
            return self._iterated(points)
        if self._pump_on_row and not self._has_candidates:
            return self._solved_on_row(points)
        if self._has_candidates:
            return self.quadrant(self._senses_of_candidates(points)).solve(points)
        return self.quadrant(self.senses(points)).solve(points)

    def _iterated(self, points: OperatingPoints) -> Solution:
        state = self._bench_state(points)
        return Solution(
            readings.efficiency(state),
            readings.output_speed(state),
            state.true.engine_torque,
        )

    def _solved_on_row(self, points: OperatingPoints) -> Solution:
        """Solve an output-coupled stage; the constants depend on the sense of the output alone."""
        is_forward = self._starts(1, points)
        # Numbers of points pick faster than a mask does.
        forward = np.flatnonzero(is_forward)
        backward = np.flatnonzero(~is_forward)
        columns = np.empty((3, is_forward.size))
        ahead = points.map(lambda values: values[forward])
        columns[:, forward] = self.quadrant(Senses(1)).solve(ahead)
        back = points.map(lambda values: values[backward])
        resting = self._rests(back)
        columns[:, backward] = self.quadrant(Senses(-1)).solve(back, resting)
        return Solution(*columns)

    def resting(self, points: OperatingPoints) -> NDArray[np.bool_] | None:
        """Where friction holds the output: no sense has a torque at standstill; None: nowhere."""
        if not self._pump_on_row:
            return None
        stands = ~self._starts(1, points) & self._rests(points)
        return stands if stands.any() else None

    def _rests(self, points: OperatingPoints) -> NDArray[np.bool_]:
        """Where friction holds an output that does not start forward (output-coupled)."""
        starts_backward = self._starts(-1, points)
        return ~starts_backward & ~self.beyond_pole(points.displacement_ratio)

    def _starts(self, output_sense: int, points: OperatingPoints) -> NDArray[np.bool_]:
        """Where an output at rest without load starts in a sense (output-coupled)."""
        quadrant = self.quadrant(Senses(output_sense))
        ratio = quadrant.flow_ratio * points.displacement_ratio
        return np.asarray(quadrant.starts(ratio))

    def beyond_pole(self, displacement_ratio: Array) -> NDArray[np.bool_]:
        """Return whether displacement ratios lie at or beyond the pole of eq. (5), shape (n,).

        Only output-coupled stages have a pole: where the flow that the motor takes equals the flow
        that the row feeds back to the pump.
        """
        first = self.quadrant(FORWARD_PULL)
        return np.asarray(first.beyond_pole(first.flow_ratio * displacement_ratio))

    def refusal(
        self, displacement_ratio: float, load_torque: float, engine_torque: float
    ) -> str:
        """Return why there is no efficiency at a point with this engine torque [N m]."""
        if np.isfinite(engine_torque).all():
            return DRAGGED
        if self.beyond_pole(np.asarray(displacement_ratio)).any():
            return BEYOND_POLE
        if self._pump_on_row:
            return self._refusal_on_row(displacement_ratio, load_torque)
        return HELD_MOTOR if self._stands_unloaded(displacement_ratio) else STALLED

    def _stands_unloaded(self, displacement_ratio: float) -> bool:
        """Whether the output stands even without load, which no leakage under load explains."""
        # The closed form is in proportion to the engine speed: any speed serves.
        columns = np.array([[displacement_ratio], [100.0], [0.0]])
        speed = self.solve(OperatingPoints(*columns)).output_speed
        return bool((speed == 0.0).all())

    def _refusal_on_row(self, displacement_ratio: float, load_torque: float) -> str:
        """Return why an output-coupled stage has no answer at a point before the pole."""
        # Where friction holds the output depends on the displacement ratio alone.
        columns = np.array([[displacement_ratio], [1.0], [load_torque]], dtype=float)
        if self.resting(OperatingPoints(*columns)) is not None:
            return HELD_OUTPUT
        if load_torque == 0.0:
            return SELF_LOCKING
        return HELD_PUMP if load_torque < 0.0 else STALLED

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def readings(self, points: OperatingPoints) -> dict[str, Array]:
        """Return what a bench reads of each predicted quantity, by name; shape (n,) each."""
        state = self._bench_state(points)
        return {
            channel.name: readings.READINGS[channel.name](state)
            for channel in PREDICTED
        }

    def _bench_state(
        self, points: OperatingPoints, senses: Senses | None = None
    ) -> BenchState:
        """Return the steady state of which a bench reads its quantities."""
        shafts, flow = self.flow(points, senses)
        true = Solution.of(
            flow.state.load_power / points.engine_speed,
            flow.engine_power / points.engine_speed,
            # A sum with 0 is never -0.
            shafts.reflection * flow.output_speed + 0.0,
        )
        return BenchState(shafts, flow, true, self._effects)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def flow(
        self, points: OperatingPoints, senses: Senses | None = None
    ) -> tuple[Shafts, PowerFlow]:
        """Return constants and power flow at points; NaN where there is none."""
        shafts = Shafts(
            self.stage,
            self._parameters,
            self._effects,
            self._with_oil(points),
            senses or self.senses(points),
            self.resting(points),
        )
        return shafts, shafts.power_flow()

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def breakdown(self, points: OperatingPoints) -> PowerShares:
        """Share the lost power among the parts that take it.

        Parts are `gear_pair_<name>`, `leakage`, `pump_damping`, `pump_friction`, `motor_damping`,
        `motor_friction`, `planetary_row`, and the name of each effect that drags a shaft.
        """
        shafts, flow = self.flow(points)
        losses = self._unit_losses(shafts, flow)
        speeds = {
            # Torques of output and motor are reflected, speeds are not.
            "output": flow.geared_speed,
            "motor": shafts.sense * flow.state.motor_speed,
            "mechanical": shafts.mechanical_speed(flow),
            "pump": flow.state.pump_speed,
        }
        for name, watts in self._gear_losses(flow, speeds):
            # A pair that serves two paths loses on both.
            losses[name] = losses.get(name, 0.0) + watts
        if self.stage.has_row:
            losses["planetary_row"] = _row_loss(shafts, flow, speeds)
        for effect in self._effects:
            slipping = shafts.slip_loss(effect, flow)
            watts = _drag_loss(effect, flow.state) + slipping
            losses[effect.name] = losses.get(effect.name, 0.0) + watts
        optional = {"pressure_drop", *(effect.name for effect in self._effects)}
        shown = {
            name: watts
            for name, watts in losses.items()
            if name not in optional or watts.any()
        }
        return PowerShares(np.asarray(flow.engine_power), flow.output_power, shown)

    def _unit_losses(self, shafts: Shafts, flow: PowerFlow) -> dict[str, Array]:
        """Losses of pump and motor and of the lines between them [W]."""
        units, state, given = self.stage.pump_motor, flow.state, shafts.given
        stroke_volume = units.pump_displacement * state.displacement_ratio
        delivered = stroke_volume * state.pump_speed
        taken = units.motor_displacement * state.motor_speed
        pump_friction = np.abs(flow.pump_pressure * delivered)
        return {
            # What leaks does so at the pressure of the motor, eq. (13), as if behind the lines.
            "leakage": state.pressure * (delivered - taken),
            "pump_damping": given.pump_damping * state.pump_speed**2,
            "pump_friction": units.pump_friction * pump_friction,
            "motor_damping": given.motor_damping * state.motor_speed**2,
            "motor_friction": units.motor_friction * np.abs(state.pressure * taken),
            "pressure_drop": (flow.pump_pressure - state.pressure) * delivered,
        }

    def _gear_losses(
        self, flow: PowerFlow, speeds: Mapping[str, Array]
    ) -> Iterator[tuple[str, Array]]:
        """Loss of each gear pair of each path [W]."""
        for path, speed in speeds.items():
            pairs = reversed(getattr(self.stage, path).gear_pairs)
            torques = pairwise(flow.torques[path])
            for pair, (after, before) in zip(pairs, torques, strict=True):
                yield f"gear_pair_{pair.name}", (before - after) * speed

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def held(
        self,
        engine_speed: Array,
        output_speed: Array,
        load_torque: Array,
        *,
        senses: Senses | None = None,
        oil_temperature: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the displacement ratio and engine torque that make an output speed.

        The torque is NaN where no steady state does.

        Args:
            engine_speed: [rad/s], shape (n,).
            output_speed: to make [rad/s], shape (n,).
            load_torque: output power / engine speed [N m], shape (n,).
            senses: of output and power, if known.
            oil_temperature: [deg C], shape (n,), which only effects read; None where it is not
                known.
        """
        if senses is None:
            senses = Senses(sign(output_speed > 0.0), sign(load_torque >= 0.0))
        stroke, torque = self.quadrant(senses).held(
            engine_speed, output_speed, load_torque
        )
        engine_share, output_share = self.stage.pump_speed_ratios
        backward = engine_share * engine_speed + output_share * output_speed < 0.0
        if not self._effects and not backward.any():
            return stroke, torque
        points = OperatingPoints(stroke, engine_speed, load_torque, oil_temperature)
        searched = self._searched(points, output_speed, senses)
        if self._effects:
            return searched
        return (
            np.where(backward, searched[0], stroke),
            np.where(backward, searched[1], torque),
        )

    def _searched(
        self, points: OperatingPoints, output_speed: Array, senses: Senses
    ) -> tuple[Array, Array]:
        """Search the displacement ratio from a first one, and check the speed that it makes."""
        points = self._with_oil(points)
        shafts = Shafts(self.stage, self._parameters, self._effects, points, senses)
        stroke = shafts.stroke_for(output_speed)
        state = self._bench_state(points._replace(displacement_ratio=stroke), senses)
        reached = readings.output_speed(state)
        holds = np.abs(reached - output_speed) < _HELD * np.abs(output_speed)
        return stroke, np.where(holds, state.true.engine_torque, np.nan)

    def _with_oil(self, points: OperatingPoints) -> OperatingPoints:
        """Return points that state the oil temperature where the solver knows it."""
        if self._oil_temperature is None or points.oil_temperature is not None:
            return points
        column = np.full(np.shape(points.engine_speed), self._oil_temperature)
        return points._replace(oil_temperature=column)

    def quadrant(self, senses: Senses) -> SteadyState:
        """Return the closed form in one quadrant, without effects."""
        if any(isinstance(sense, np.ndarray) for sense in senses):
            return SteadyState(self.stage, self._parameters, senses)
        if senses not in self._quadrants:
            self._quadrants[senses] = SteadyState(self.stage, self._parameters, senses)
        return self._quadrants[senses]

    def senses(self, points: OperatingPoints) -> Senses:
        """Return the senses of output and power: the output turns as it does without load."""
        if self._pump_on_row:
            forward = self._starts(1, points)
        else:
            first = self.quadrant(FORWARD_PULL)
            from_standing = points.displacement_ratio - first.standing_ratio
            forward = from_standing * first.flow_ratio > 0.0
        return Senses(sign(forward), sign(points.load_torque >= 0.0))

    def _senses_of_candidates(self, points: OperatingPoints) -> Senses:
        """Return the senses that many candidates share: those without load and damping."""
        forward = speed_ratio(self.stage, points.displacement_ratio) > 0.0
        return Senses(sign(forward), sign(points.load_torque >= 0.0))


def _row_loss(shafts: Shafts, flow: PowerFlow, speeds: Mapping[str, Array]) -> Array:
    """Power that enters the planetary row and does not leave it [W]."""
    if shafts.pump_on_row:
        hydraulic = -flow.torques["pump"][-1] * speeds["pump"]
    else:
        hydraulic = flow.torques["motor"][0] * speeds["motor"]
    mechanical = flow.torques["mechanical"][0] * speeds["mechanical"]
    output = flow.torques["output"][-1] * speeds["output"]
    return np.asarray(hydraulic + mechanical - output)


def _drag_loss(effect: Effect, state: ShaftState) -> Array:
    """Power that an effect takes from the shafts [W]."""
    return np.asarray(
        effect.engine_drag(state) * state.engine_speed
        + effect.at("pump_drag", state) * state.pump_speed
        + effect.at("motor_drag", state) * np.abs(state.motor_speed)
        + effect.output_drag(state) * state.output_speed
    )
