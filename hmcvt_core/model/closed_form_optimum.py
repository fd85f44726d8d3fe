# SPDX-License-Identifier: Apache-2.0
r"""The optimum of a model without effects at one point, from the slopes of its closed form.

Held engine speed: with the motor speed x as the variable every quantity of `closed_form` is an
explicit function of x, hence also the slope of the engine torque, and the best x is where it
changes sign: a root on a smooth piece, or a corner (the motor at rest, the pump at zero stroke).
Friction sets a step between rest and motion, so that the best of both sides is taken.

Held output speed and power: with the engine speed as the variable the engine's power is a quadratic
on each piece between two corners, and the best is the vertex of one of them or a corner.

Both give None where that reasoning does not hold (next to stall, or where power that flows back
would pay); a search on a grid then finds what there is to find.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from ..physics.closed_form import ClosedForm, Side

State = tuple[float, float, float, float]
"""Flow at a motor speed x and its slope over x; slope of the engine torque and slope of that."""
Along = Callable[[float], State]

_NEWTON_STEPS = 30
# Motor speed per engine speed: after a Newton step this small the next would be some 1e-8.
_LAST_STEP = 1e-4


def best_flow(form: ClosedForm, engine_speed: float, load_torque: float) -> float | None:
    """Return the flow s that asks least torque of the engine at a held engine speed.

    Args:
        form: the model.
        engine_speed: [rad/s].
        load_torque: [N m].
    """
    if load_torque / engine_speed > form.collapse:
        return None
    driven = _best_while_driven(form, engine_speed, load_torque)
    ahead = _along(form, form.forward, engine_speed, load_torque)
    # Friction sets a step between the motor at rest and turning: either side can hold the best.
    if driven is None or ahead(0.0)[2] >= 0.0:
        return driven
    fastest, _ = form.motor(abs(form.full_flow), engine_speed, load_torque)
    if not fastest > 0.0:
        return driven
    faster = _where_flat(ahead, 0.0, fastest, ahead(fastest))
    if faster is None:
        return None
    return max(driven, faster, key=lambda flow: form.efficiency(
        flow / form.full_flow, engine_speed, load_torque))


def _best_while_driven(
    form: ClosedForm, engine_speed: float, load_torque: float
) -> float | None:
    """Best flow among those that leave the motor at rest or turn it back."""
    behind = _along(form, form.backward, engine_speed, load_torque)
    # At rest every flow between two limits gives the same output; the least leaks least.
    at_rest = behind(0.0)
    if at_rest[0] > abs(form.full_flow):
        return None
    if at_rest[2] <= 0.0:
        return at_rest[0]
    motor, pressure = form.motor(0.0, engine_speed, load_torque)
    if not (motor < 0.0 and pressure > 0.0):
        return None
    if behind(motor)[2] < 0.0:
        return _where_flat(behind, motor, 0.0, at_rest)
    # With the stroke beyond zero the pump drives the engine: friction takes its part both ways.
    share = (1.0 - form.pump_friction) / (1.0 + form.pump_friction)
    back = _along(form, form.backward, engine_speed, load_torque, share)(motor)[2]
    return 0.0 if back <= 0.0 else None


def _along(
    form: ClosedForm,
    side: Side,
    engine_speed: float,
    load_torque: float,
    pump_share: float = 1.0,
) -> Along:
    """Return the function that goes along the motor speeds at one engine speed and load."""
    # Worked out once: the search calls the function some ten times.
    idle, hydraulic, grip = form.idle, form.hydraulic, side.grip
    leak = 1.0 / (form.stiffness * engine_speed)
    drag = form.motor_damping * engine_speed
    side_load, gear_load = side.load * load_torque, form.mechanical_load * load_torque
    pump = pump_share * (1.0 + form.pump_friction) / form.pump_gear_efficiency

    def along(motor: float) -> State:
        output = idle + hydraulic * motor
        bend = hydraulic / output
        load = side_load / output
        pressure = (load + drag * motor) * grip
        slope = (drag - load * bend) * grip
        flow = motor + pressure * leak
        flow_slope = 1.0 + slope * leak
        mechanical = gear_load / output * bend
        curvature = 2.0 * load * bend * bend * grip
        return (
            flow,
            flow_slope,
            pump * (slope * flow + pressure * flow_slope) - mechanical,
            pump * (curvature * (flow + pressure * leak) + 2.0 * slope * flow_slope)
            + 2.0 * mechanical * bend,
        )

    return along


def _where_flat(along: Along, low: float, high: float, at_high: State) -> float | None:
    """Flow where the engine torque is least in an interval of motor speeds at whose start it falls.

    `at_high` is what `along` gives at the end of the interval.
    """
    motor, (flow, flow_slope, slope, curvature) = high, at_high
    if slope < 0.0:
        return flow
    for _ in range(_NEWTON_STEPS):
        if slope < 0.0:
            low = motor
        else:
            high = motor
        step = -slope / curvature if curvature > 0.0 else math.inf
        if -_LAST_STEP < step < _LAST_STEP:
            return flow + flow_slope * min(max(step, low - motor), high - motor)
        motor += step
        if not low < motor < high:
            motor = 0.5 * (low + high)
        flow, flow_slope, slope, curvature = along(motor)
    return None


def best_engine_speed(
    form: ClosedForm, output_speed: float, power: float, limits: tuple[float, float]
) -> tuple[float, float] | None:
    """Return engine speed [rad/s] and flow s that ask least power at a held output.

    NaN for both where no pair within the limits gives that output.

    Args:
        form: the model.
        output_speed: to hold [rad/s].
        power: that the output delivers [W].
        limits: lowest and highest engine speed [rad/s].
    """
    line = _Line(form, output_speed, power)
    best: tuple[float, float, float] | None = None
    for speed in line.candidates(limits):
        if not limits[0] <= speed <= limits[1]:
            continue
        flow, engine_power = line.state(speed)
        if abs(flow) <= abs(form.full_flow) * (1.0 + 1e-12) and (
                best is None or engine_power < best[0]):
            best = engine_power, speed, flow
    if best is None:
        return math.nan, math.nan
    _, speed, flow = best
    # The line also holds states that no steady motor keeps; the lookup must lead back to it.
    motor, _ = form.motor(flow, speed, power / speed)
    reached = (form.idle + form.hydraulic * motor) * speed
    return (speed, flow) if abs(reached - output_speed) < 1e-9 * output_speed else None


class _Line:
    """Pairs of engine speed and stroke that give one output speed and power."""

    def __init__(self, form: ClosedForm, output_speed: float, power: float) -> None:
        self.form, self.output_speed = form, output_speed
        self.torque = power / output_speed
        self.resting = output_speed / form.idle  # engine speed at which the motor stands

    def pressure(self, side: Side) -> tuple[float, float]:
        """Pressure torque at rest, and its change per motor speed [rad/s]."""
        return (side.load * self.torque * side.grip, self.form.motor_damping * side.grip)

    def motor(self, engine_speed: float) -> float:
        """Motor speed [rad/s]."""
        return (self.output_speed - self.form.idle * engine_speed) / self.form.hydraulic

    def state(self, engine_speed: float) -> tuple[float, float]:
        """Flow s and power of the engine [W]."""
        form = self.form
        motor = self.motor(engine_speed)
        if engine_speed == self.resting:
            motor = 0.0
        side = form.forward if motor > 0.0 else form.backward
        rest, slope = self.pressure(side)
        if rest + slope * motor < 0.0:
            side = form.turned
            rest, slope = self.pressure(side)
        pressure = rest + slope * motor
        flow = (motor + pressure / form.stiffness) / engine_speed
        torque = form.engine_torque(flow, motor / engine_speed, pressure, engine_speed,
                                    self.torque * self.output_speed / engine_speed)
        return flow, torque * engine_speed

    def candidates(self, limits: tuple[float, float]) -> Iterator[float]:
        """Yield every engine speed at which the power can be least: corners and vertices."""
        yield from limits
        yield self.resting
        for side in (self.form.forward, self.form.backward, self.form.turned):
            yield from self._candidates_of(side)

    def _candidates_of(self, side: Side) -> Iterator[float]:
        form = self.form
        rest, slope = self.pressure(side)
        # Over the engine speed: motor speed, pressure torque p + q w, flow a + b w [rad/s].
        motor, motor_slope = self.output_speed / form.hydraulic, -form.idle / form.hydraulic
        p, q = rest + slope * motor, slope * motor_slope
        a, b = motor + p / form.stiffness, motor_slope + q / form.stiffness
        if q != 0.0:
            yield -p / q  # the pressure turns round
        for flow in (0.0, form.full_flow, -form.full_flow):
            if b != flow:
                yield a / (flow - b)
        friction, gears, drag = form.pump_friction, form.pump_gear_efficiency, form.pump_drag
        mechanical = form.mechanical_load * self.torque
        for share, drag_share in (((1.0 + friction) / gears, drag / gears),
                                  ((1.0 - friction) / gears, drag / gears),
                                  ((1.0 - friction) * gears, drag * gears)):
            bend = share * q * b + drag_share
            if bend > 0.0:
                yield -(mechanical + share * (p * b + q * a)) / (2.0 * bend)
        yield from _roots((1.0 - friction) * q * b + drag, (1.0 - friction) * (p * b + q * a),
                          (1.0 - friction) * p * a)  # the pump begins to drive the engine


def _roots(square: float, linear: float, constant: float) -> Iterator[float]:
    inside = linear * linear - 4.0 * square * constant
    if square != 0.0 and inside >= 0.0:
        yield (math.sqrt(inside) - linear) / (2.0 * square)
        yield (-math.sqrt(inside) - linear) / (2.0 * square)
