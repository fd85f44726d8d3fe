# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The power balance of eqs (4), (13)-(15) without effects: at one point, and at many.

Powers are balanced shaft by shaft: the motor speed follows from the flow, the torques from the
load, and every loss is paid on the shaft where it arises. Positive losses then give
0 < efficiency < 1 everywhere, without a pole. With, per engine speed, the motor speed x, the output
speed y and the flow s of the pump (the motor speed that it gives without leakage), and with the
pressure as a torque of the motor :math:`\pi = p V_m`:

.. math:: y = m + h x \;(4), \qquad x = s - \frac{\pi}{K \omega} \;(13), \qquad
          \pi = \frac{L T / y + f_m \omega x}{1 \mp c_{fm}} \;(14), \qquad
          T_e = \frac{G T}{y} + \frac{(1 \pm c_{fp})\, \pi s + f_p \omega}{\eta_p^{\pm 1}} \;(15)

Eqs (4), (13), (14) together are a quadratic in y in each regime of the motor: where it drives the
row (motoring), where the row drives it (pumping), and where it is driven so fast that its damping
reverses the pressure:

.. math:: y^2 - 2 y \left(\frac{m}{2} + k s\right) + g \frac{T}{\omega} = 0, \qquad
          k = \frac{h}{2 d}, \qquad g = \frac{h L}{(1 \mp c_{fm}) K d}, \qquad
          d = 1 + \frac{f_m}{(1 \mp c_{fm}) K}

Its larger root tends to m + h s, eq. (5), as leakage vanishes. Between motoring and pumping
friction holds the motor, as any stiction does. Without a planetary row (hydrostatic) m = 0.

An output that turns backward and a load that drives the engine (overrun) reflect the signs of x, y,
s, m and of every torque between, so that the row always asks the motor for a torque in its positive
sense; overrun then has y < 0, and the lower root. Each of these four quadrants has its constants.

`PointState` (plain floats, what a control loop calls) and `ArrayState` say the same line by line.
Reading of eq. (15): as printed, pump friction c_fp would *help* the engine; here it takes torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.ranges import OperatingPoints, Solution
from ..transmission.stage import Stage, speed_ratio
from .output_coupled import OutputCoupledState

Array = NDArray[np.float64]
_ROUNDED = 1e-14  # x that is none but for rounding
_STANDING = math.ulp(0.0)  # y of an output at rest without load: no torque over no speed is none


class Regime(NamedTuple):
    """k and g of the quadratic in y, in one regime of the motor."""

    flow_share: Any
    load_share: Any


class SteadyState:
    """The constants of one quadrant without effects; arrays where its parameters are.

    Args:
        stage: input-coupled or hydrostatic.
        parameters: of the units.
        turning: sense of the output, 1 forward or -1 backward.
        power: 1 where the load takes power, -1 in overrun.

    Attributes:
        reflection: sign of what is reflected, `turning` x `power`.
        sense: sign of y, `power`.
        mechanical_ratio: m, output speed per engine speed while the motor stands [-].
        hydraulic_ratio: h, change of output speed per motor speed [-].
        full_flow: s at displacement ratio 1 [-]; negative where that slows the output.
        stiffness: K = V_m^2 / leakage [N m s/rad].
        leak_torque: K / h: pressure torque per output speed lost to leakage [N m s/rad].
        motor_damping: f_m [N m s/rad].
        motoring, pumping, reversal: k and g in each regime.
        motoring_load, pumping_load: L while the motor drives, and while it is driven [-].
        motor_friction, pump_friction: c_fm, c_fp [-].
        mechanical_load: G, engine torque per output torque, over the mechanical path [-].
        pump_damping: f_p, referred to the engine [N m s/rad].
        pump_gears: mean and half the difference of what the engine gives per torque of the pump,
            driving it and driven by it, over the pairs between the two [-].
        idle_ratio: change of output speed per flow s without load [-]: the sense in which the
            output turns then is the one it keeps.
        stall_load: load torque / engine speed [N m s/rad] above which a motor that comes to rest
            goes on to stall: a slower output then asks for more leakage than flow.
    """

    def __init__(
        self, stage: Stage, parameters: Parameters, turning: int = 1, power: int = 1
    ) -> None:
        units, ratio = stage.pump_motor, stage.motor_speed_ratio
        self.reflection, self.sense = turning * power, power
        self.mechanical_ratio = self.reflection * stage.mechanical_speed_ratio
        self.hydraulic_ratio = abs(ratio)
        pump_gear = 1.0 / stage.pump.ratio
        self.full_flow = (math.copysign(pump_gear, self.reflection * ratio)
                          * units.pump_displacement / units.motor_displacement)
        self.stiffness: Any = units.motor_displacement**2 / parameters.leakage
        self.leak_torque: Any = self.stiffness / self.hydraulic_ratio
        self.motor_damping: Any = parameters.motor_damping
        output_load = self.hydraulic_ratio / stage.output.efficiency**power
        self.motoring_load = output_load / stage.motor.efficiency
        self.pumping_load = output_load * stage.motor.efficiency
        self.motor_friction, self.pump_friction = units.motor_friction, units.pump_friction
        # The row drives the mechanical path back where the other one gives more than the load.
        way = -1 if self.mechanical_ratio < 0.0 else 1
        self.mechanical_load = self.mechanical_ratio / (
            stage.output.efficiency**power * stage.mechanical.efficiency**way)
        self.pump_damping: Any = parameters.pump_damping * pump_gear**2
        gears = stage.pump.efficiency
        self.pump_gears = 0.5 * (1.0 / gears + gears), 0.5 * (1.0 / gears - gears)
        friction = self.motor_friction
        self.motoring = self._regime(self.motoring_load, friction)
        self.pumping = self._regime(self.pumping_load, -friction)
        self.reversal = self._regime(self.pumping_load, friction)
        self.idle_ratio: Any = 2.0 * self.motoring.flow_share
        self.stall_load: Any = self.mechanical_ratio**2 / self.motoring.load_share

    def _regime(self, load: float, friction: float) -> Regime:
        """Return the constants of (4), (13), (14) with so much load and signed friction."""
        stiffness = (1.0 - friction) * self.stiffness
        damped = 1.0 + self.motor_damping / stiffness
        return Regime(self.hydraulic_ratio / (2.0 * damped),
                      self.hydraulic_ratio * load / (stiffness * damped))

    def engine_torque(
        self, flow: Any, free: Any, output: Any, engine_speed: Any, load_torque: Any
    ) -> Any:
        """Torque T_e for a flow s, with the output speeds y without leakage and with it [N m]."""
        # (13), with what friction holds too: the whole flow leaks there.
        ideal = self.leak_torque * (free - output) * engine_speed * flow
        pump = ideal + self.pump_friction * abs(ideal) + self.pump_damping * engine_speed
        mean, half = self.pump_gears
        row = self.mechanical_load * load_torque / output
        return row + mean * pump + half * abs(pump)  # (15)


class PointState(SteadyState):
    """One quadrant at one point, in plain floats."""

    def solve(
        self, flow: float, free: float, engine_speed: float, load_torque: float
    ) -> tuple[float, float]:
        """Engine torque and output speed; NaN where the load cannot be carried."""
        output = self._output(flow, free, load_torque / engine_speed)  # (4)
        if not output * self.sense > 0.0:
            if load_torque:
                return math.nan, math.nan
            output = output or _STANDING
        torque = self.engine_torque(flow, free, output, engine_speed, load_torque)
        return torque, self.reflection * engine_speed * output

    def _output(self, flow: float, free: float, load: float) -> float:
        """Output speed y for a flow s."""
        rest = self.mechanical_ratio
        output = self._root(self.motoring, flow, load)
        if output > rest:
            return output
        if math.isnan(output) and (load > self.stall_load or rest < 0.0):
            return math.nan
        output = self._root(self.pumping, flow, load)
        if output >= rest:
            return rest
        if not output <= free:
            faster = self._root(self.reversal, flow, load)
            if faster > free:
                return faster
        return output

    def _root(self, regime: Regime, flow: float, load: float) -> float:
        middle = 0.5 * self.mechanical_ratio + regime.flow_share * flow
        if not load:
            return 2.0 * middle
        inside = middle * middle - regime.load_share * load
        return middle + self.sense * math.sqrt(inside) if inside >= 0.0 else math.nan


class PointSolver:
    """The steady state at one point in range, in plain floats."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        self._states = {(turning, power): PointState(stage, parameters, turning, power)
                        for turning in (1, -1) for power in (1, -1)}
        self._usual = self._states[-1 if stage.reverse else 1, 1]

    def solve(
        self, displacement_ratio: float, engine_speed: float, load_torque: float
    ) -> tuple[float, float, float]:
        """What `Solution` holds; NaN where the load cannot be carried."""
        state = self._usual
        flow = state.full_flow * displacement_ratio
        free = state.mechanical_ratio + state.hydraulic_ratio * flow  # (5)
        forward = state.mechanical_ratio + state.idle_ratio * flow > 0.0
        if not (forward and load_torque >= 0.0):
            turning = state.reflection if forward else -state.reflection
            power = 1 if load_torque >= 0.0 else -1
            if state.reflection != turning * power:
                flow, free = -flow, -free
            state = self._states[turning, power]
        torque, speed = state.solve(flow, free, engine_speed, load_torque)
        if load_torque < 0.0:
            return torque / load_torque if torque < 0.0 else math.nan, speed, torque
        return load_torque / torque if torque > 0.0 else math.nan, speed, torque

    def resting_ratios(self, engine_speed: float, load_torque: float) -> list[float]:
        """Displacement ratios between which friction holds the motor or it stalls, lowest first."""
        state, ratios = self._usual, []
        rest = state.mechanical_ratio
        for regime in (state.motoring, state.pumping):
            product = regime.load_share * load_torque / engine_speed
            slowest = max(rest, math.sqrt(product))
            flow = (slowest + product / slowest - rest) / (2.0 * regime.flow_share)
            ratios.append(flow / state.full_flow)
        return sorted(ratios)


class ArrayState(SteadyState):
    """One quadrant at points of shape (n,); parameters of shape (..., 1) give (..., n)."""

    def solve(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque; NaN where the load cannot be carried."""
        engine_speed, load_torque = points.engine_speed, points.load_torque
        flow, load = self.full_flow * points.displacement_ratio, load_torque / engine_speed
        free = self.mechanical_ratio + self.hydraulic_ratio * flow  # (5)
        output = self.selected(*self.output_speeds(flow, load), self.mechanical_ratio, load)
        output = self.turning(output, load_torque)
        torque = self.engine_torque(flow, free, output, engine_speed, load_torque)
        return Solution.of(load_torque, torque, self.reflection * engine_speed * output)

    def turning(self, output: Array, load_torque: Array) -> Array:
        """Return y where it has its sign, or nothing loads the output; NaN elsewhere."""
        known = output * self.sense > 0.0
        if load_torque.all():
            return np.where(known, output, np.nan)
        known |= load_torque == 0.0
        return np.where(known, np.where(output == 0.0, _STANDING, output), np.nan)

    def output_speeds(self, flow: Array, load: Array) -> tuple[Array, Array]:
        """Output speed y while motoring and while pumping, valid or not: see `selected`."""
        motoring, pumping = (self._root(regime, flow, load)
                             for regime in (self.motoring, self.pumping))
        free = self.mechanical_ratio + self.hydraulic_ratio * flow
        reverses = ~(pumping <= free)
        if reverses.any():
            faster = self._root(self.reversal, flow, load)
            pumping = np.where(reverses & (faster > free), faster, pumping)
        return motoring, pumping

    def _root(self, regime: Regime, flow: Array, load: Array) -> Array:
        middle = 0.5 * self.mechanical_ratio + regime.flow_share * flow
        root = middle + self.sense * np.sqrt(middle * middle - regime.load_share * load)
        return np.asarray(root) if load.all() else np.where(load == 0.0, 2.0 * middle, root)

    def selected(self, motoring: Array, pumping: Array, rest: float, load: Array) -> Array:
        """Speed that is taken, of those in either regime; that at rest where friction holds it.

        Friction asks for more pressure while motoring, so motoring < pumping: at most one is valid.
        """
        slow = np.minimum(pumping, rest)
        stalls = np.isnan(motoring) & (
            (load > self.stall_load) if self.mechanical_ratio >= 0.0 else True)
        return np.where(motoring > rest, motoring, np.where(stalls, np.nan, slow))

    def displacement_ratio(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> Array:
        """As `ArraySolver.displacement_ratio`."""
        output = self.reflection * output_speed / engine_speed
        motor = (output - self.mechanical_ratio) / self.hydraulic_ratio  # (4)
        drives = motor > _ROUNDED  # a motor at rest does not
        load = np.where(drives, self.motoring_load, self.pumping_load)
        torque = load * load_torque / output + self.motor_damping * engine_speed * motor
        friction = self.motor_friction * np.where(drives, 1.0, -1.0) * np.sign(torque)
        pressure = torque / (1.0 - friction)  # (14)
        return (motor + pressure / (self.stiffness * engine_speed)) / self.full_flow  # (13)


class ArraySolver:
    """The steady state at points of shape (n,); parameters of shape (..., 1) give (..., n)."""

    def __init__(self, stage: Stage, parameters: Parameters) -> None:
        self._stage, self._parameters = stage, parameters
        self._states: dict[tuple[int, int], ArrayState | OutputCoupledState] = {}
        self.mechanical_ratio = stage.mechanical_speed_ratio

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def solve(self, points: OperatingPoints) -> Solution:
        """Efficiency, output speed and engine torque; NaN where the load cannot be carried."""
        return Solution(*self._together(points, self.solve_in))

    def solve_in(self, part: tuple[int, int], points: OperatingPoints) -> Solution:
        """As `solve`, of points in one quadrant (sense of the output, of the power)."""
        return self._state(part).solve(points)

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def displacement_ratio(
        self, engine_speed: Array, output_speed: Array, load_torque: Array
    ) -> Array:
        """Displacement ratio that makes an output speed [-]; beyond -1 to 1 where none does.

        With the motor at rest many do: the least is given, which leaks least.
        """
        columns = np.broadcast_arrays(engine_speed, output_speed, load_torque)
        found = np.empty(columns[0].shape)
        for part, chosen in quadrants(columns[1], columns[2]):
            found[chosen] = self.stroke_in(part, *(column[chosen] for column in columns))
        return found

    def _state(self, part: tuple[int, int]) -> ArrayState | OutputCoupledState:
        if part not in self._states:
            given = self._stage, self._parameters
            self._states[part] = (OutputCoupledState(*given, part[0])
                                  if self._stage.layout == "output_coupled"
                                  else ArrayState(*given, *part))
        return self._states[part]

    def stroke_in(self, part: tuple[int, int], *columns: Array) -> Array:
        """As `displacement_ratio`, in one quadrant."""
        return self._state(part).displacement_ratio(*columns)

    def idle_speed(self, points: OperatingPoints) -> Array:
        """Output speed per engine speed without load; of many candidates, without damping too."""
        stroke, state = points.displacement_ratio, self._state((1, 1))
        if np.ndim(self._parameters.motor_damping) > 0:
            return speed_ratio(self._stage, stroke)
        if isinstance(state, OutputCoupledState):
            return state.output(state.full * stroke, np.zeros_like(stroke))[0]
        return np.asarray(state.mechanical_ratio + state.idle_ratio * state.full_flow * stroke)

    def _together(
        self, points: OperatingPoints,
        function: Callable[[tuple[int, int], OperatingPoints], tuple[Array, ...]],
    ) -> tuple[Array, ...]:
        """Columns that a function gives for each quadrant and its points, put together."""
        parts = list(quadrants(self.idle_speed(points), points.load_torque))
        if len(parts) == 1:
            return function(parts[0][0], points)
        found = [function(part, points.map(lambda axis, i=chosen: axis[i]))
                 for part, chosen in parts]
        columns = []
        for pieces in zip(*found, strict=True):
            columns.append(np.empty((*pieces[0].shape[:-1], len(points.load_torque))))
            for (_, chosen), piece in zip(parts, pieces, strict=True):
                columns[-1][..., chosen] = piece
        return tuple(columns)


def quadrants(speed: Array, load: Array) -> Iterator[tuple[tuple[int, int], NDArray[np.bool_]]]:
    """Yield the quadrants (turning, power) that occur, each with where it does."""
    code = 2 * (speed > 0.0) + (load >= 0.0)
    first = code.ravel()[:1]
    for each in (3, 2, 1, 0) if (code != first).any() else first.tolist() or (3,):
        chosen = code == each
        if chosen.any() or not chosen.size:
            yield (1 if each > 1 else -1, 1 if each % 2 else -1), chosen
