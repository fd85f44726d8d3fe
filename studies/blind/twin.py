# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The plant: stage HM4 with hidden effects, brought to rest and read by its meters.

The dynamometer holds the output power, a governor the engine speed; pump, loop and motor follow eqs
(13)-(15) in time with their inertias and the oil's compressibility. Friction opposes motion,
whichever way power flows; where the motor stands still, its sense is smoothed with tanh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from studies.blind.effect import Conditions, Effect, FloatArray, acting
from studies.blind.steady import settle

#: Speed (rad/s) and torque (N m) over which the sense of friction turns round.
TURNING_SPEED = 1.0
TURNING_TORQUE = 1.0
#: Governor of the engine: N m per rad/s, N m per rad.
_GOVERNOR = (10.0, 40.0)
#: Loop pressure (Pa) at which the relief valves open, output speed (rad/s) that counts as stall.
_RELIEF = 45e6
_STALL = 10.0
_SCALE = np.array([1e6, 50.0, 200.0, 50.0])
#: 55 cm3 per revolution; the paper does not publish it, so it is assumed.
DISPLACEMENT_PER_RADIAN = 55e-6 / (2.0 * 3.141592653589793)


#: Gear pairs (Table 1, figure 1): mechanical path 2, 3; pump 4; motor 5; output 6, 11.
_TABLE_1 = {2: 0.969, 3: 1.484, 4: 0.678, 5: 1.96, 6: 0.982, 11: 0.823}


@dataclass(frozen=True)
class GearTrain:
    """Stage HM4 (Table 1) with its pump and motor; SI units.

    `ratios` are driving / driven speed of each pair in the direction engine to output; `k1` is
    ring teeth / sun teeth; inertias are those given below eq. (15). `engine_inertia` (at the pump
    shaft), `load_inertia` (at the motor shaft), V0 and beta_e of eq. (13) are assumed; no steady
    state depends on them.
    """

    ratios: Mapping[int, float] = field(default_factory=lambda: _TABLE_1)
    k1: float = 2.56
    gear_efficiency: float = 0.98
    pump_displacement: float = DISPLACEMENT_PER_RADIAN
    motor_displacement: float = DISPLACEMENT_PER_RADIAN
    pump_inertia: float = 0.0054
    motor_inertia: float = 0.0049
    engine_inertia: float = 0.5
    load_inertia: float = 0.06
    oil_volume: float = 8e-4
    bulk_modulus: float = 1.3e9

    def carrier_speed(self, engine_speed: FloatArray) -> FloatArray:
        """Speed of the planet carrier, rad/s."""
        return engine_speed / (self.ratios[2] * self.ratios[3])

    def ring_speed(
        self, carrier_speed: FloatArray, motor_speed: FloatArray
    ) -> FloatArray:
        """Eq. (4); the motor turns the sun against the carrier, so it adds, as in eq. (5)."""
        sun = motor_speed / self.ratios[5]
        return ((1.0 + self.k1) * carrier_speed + sun) / self.k1

    def output_speed(self, ring_speed: FloatArray) -> FloatArray:
        """Speed of the output shaft, rad/s."""
        return ring_speed / (self.ratios[6] * self.ratios[11])


@dataclass(frozen=True)
class BaseTruth:
    """Base parameters: leakage C_s(V_p+V_m)/mu in m3/(s Pa), dampings in N m s/rad."""

    leakage: float
    motor_damping: float
    pump_damping: float
    motor_friction: float = 0.01
    pump_friction: float = 0.01


@dataclass(frozen=True)
class OperatingPoints:
    """True operating points, shape (n,): rad/s, N m referred to the engine, deg C."""

    displacement_ratio: FloatArray
    engine_speed: FloatArray
    load_torque: FloatArray
    oil_temperature: FloatArray

    def __len__(self) -> int:
        return len(self.engine_speed)

    def select(self, index: npt.NDArray[np.generic]) -> OperatingPoints:
        """Pick the points at `index` (integers or booleans)."""
        return OperatingPoints(
            self.displacement_ratio[index],
            self.engine_speed[index],
            self.load_torque[index],
            self.oil_temperature[index],
        )


@dataclass(frozen=True)
class Readings:
    """A steady plant; shape (n,) each.

    `settled` is false where it stalled: there `efficiency` is nan and the rest means nothing.
    `efficiency` and `load_torque` are what the torque meters make of it; powers and `losses` (W,
    added up place by place) are true.
    """

    settled: npt.NDArray[np.bool_]
    efficiency: FloatArray
    load_torque: FloatArray
    output_speed: FloatArray
    input_power: FloatArray
    output_power: FloatArray
    losses: dict[str, FloatArray]
    state: FloatArray


@dataclass(frozen=True)
class _Balance:
    """Torques, flows and losses at one state."""

    flow_excess: FloatArray
    motor_surplus: FloatArray
    pump_torque: FloatArray
    input_power: FloatArray
    output_speed: FloatArray
    losses: dict[str, FloatArray]


@dataclass(frozen=True)
class Plant:
    """A transmission with base parameters and effects."""

    base: BaseTruth
    effects: tuple[Effect, ...] = ()
    train: GearTrain = field(default_factory=GearTrain)

    def read(
        self, points: OperatingPoints, start: FloatArray | None = None
    ) -> Readings:
        """Run every operating point to rest and read it.

        `start` (4, n) may be the `state` of an earlier reading at the same points. Where the
        transmission stalls, `settled` is false and `efficiency` is nan.
        """
        first = self.guess(points) if start is None else start
        # A stalling point runs away; what it overflows to is thrown away.
        with np.errstate(all="ignore"):
            state, settled = settle(lambda y: self.rates(y, points), first, _SCALE)
            balance = self._balance(state, points)
            # On its relief valves or at a stand it has stalled.
            settled &= (state[0] < _RELIEF) & (balance.output_speed > _STALL)
            power = points.load_torque * points.engine_speed
            engine, output = (
                balance.input_power / points.engine_speed,
                power / balance.output_speed,
            )
            for effect in self.effects:
                engine, output = effect.read(engine, output)
            load = output * balance.output_speed / points.engine_speed
            return Readings(
                settled,
                np.where(settled, load / engine, np.nan),
                load,
                balance.output_speed,
                balance.input_power,
                power,
                balance.losses,
                state,
            )

    def guess(self, points: OperatingPoints) -> FloatArray:
        """State without leakage, (4, n): pressure, motor and pump speed, torque of the governor."""
        pump = points.engine_speed / self.train.ratios[4]
        motor = pump * points.displacement_ratio
        ring = self.train.ring_speed(
            self.train.carrier_speed(points.engine_speed), motor
        )
        sun_torque = points.load_torque * points.engine_speed / ring / self.train.k1
        torque = sun_torque / self.train.ratios[5] + self.base.motor_damping * motor
        pressure = torque / self.train.motor_displacement
        drive = points.displacement_ratio * pressure * self.train.pump_displacement
        return np.stack([pressure, motor, pump, drive + self.base.pump_damping * pump])

    def rates(self, state: FloatArray, points: OperatingPoints) -> FloatArray:
        """Eqs (13)-(15) and the governor: time derivative of the state, (4, ..., n)."""
        balance = self._balance(state, points)
        short = points.engine_speed / self.train.ratios[4] - state[2]
        stiffness = self.train.bulk_modulus / self.train.oil_volume
        motor_inertia = self.train.motor_inertia + self.train.load_inertia
        pump_inertia = self.train.pump_inertia + self.train.engine_inertia
        drive = state[3] + _GOVERNOR[0] * short
        return np.stack(
            [
                balance.flow_excess * stiffness,
                balance.motor_surplus / motor_inertia,
                (drive - balance.pump_torque) / pump_inertia,
                np.broadcast_to(_GOVERNOR[1] * short, state[3].shape),
            ]
        )

    def _conditions(self, state: FloatArray, points: OperatingPoints) -> Conditions:
        pressure, motor, pump = state[0], state[1], state[2]
        engine = pump * self.train.ratios[4]
        shape = pressure.shape
        command = np.broadcast_to(points.displacement_ratio, shape)
        load = np.broadcast_to(points.load_torque, shape)
        stroke = command
        gap, film = np.ones(shape), np.ones(shape)
        for effect in self.effects:
            stroke = effect.true_stroke(stroke, pressure)
            in_gap, in_film = effect.viscosity(points.oil_temperature)
            gap, film = gap * in_gap, film * in_film
        sliding = np.zeros(shape)
        for effect in acting(self.effects, "clutch_slip"):
            torque = self._clutch_torque(engine, motor, points)
            sliding = sliding + effect.clutch_slip(torque)
        carrier = self.train.carrier_speed(engine - sliding)
        ring = np.maximum(self.train.ring_speed(carrier, motor), 1.0)
        return Conditions(
            command,
            stroke,
            engine,
            pump,
            motor,
            carrier,
            self.train.output_speed(ring),
            pressure,
            load,
            gap,
            film,
            self.train.pump_displacement,
            self.train.motor_displacement,
            self.base.leakage,
        )

    def _clutch_torque(
        self, engine: FloatArray, motor: FloatArray, points: OperatingPoints
    ) -> FloatArray:
        """Torque of the mechanical path as it is before the clutch slips [N m].

        Torques at a row stand in a fixed ratio: the clutch follows the torque of the output.
        """
        carrier = self.train.carrier_speed(engine)
        output = self.train.output_speed(self.train.ring_speed(carrier, motor))
        ratio = self.train.output_speed(self.train.ring_speed(carrier, 0.0 * motor))
        ratio = ratio / engine
        power = points.load_torque * points.engine_speed
        return np.asarray(power / np.maximum(output, _STALL) * ratio)

    def _mesh(self, pair: int, torque: FloatArray, speed: FloatArray) -> FloatArray:
        """Efficiency of a gear pair under `torque` at `speed` of its faster side."""
        loss = sum(
            (e.mesh_loss(pair, torque, speed) for e in self.effects),
            np.zeros_like(torque),
        )
        return self.train.gear_efficiency - loss

    def _output_side(
        self, at: Conditions, points: OperatingPoints
    ) -> tuple[FloatArray, ...]:
        """Ring torque, and the losses of pairs 11 and 6 and of drag on the output shaft."""
        power = points.load_torque * points.engine_speed
        drag = _total(self.effects, "output_drag_power", at)
        needed = power + drag
        torque = needed / at.output_speed
        behind = needed / self._mesh(11, torque, at.output_speed)
        ring_power = behind / self._mesh(6, torque, at.output_speed)
        ring_speed = at.output_speed * self.train.ratios[6] * self.train.ratios[11]
        return ring_power / ring_speed, ring_power - needed, drag

    def _balance(self, state: FloatArray, points: OperatingPoints) -> _Balance:
        at = self._conditions(state, points)
        train, losses = self.train, dict[str, FloatArray]()
        ring, losses["output gears"], losses["output drag"] = self._output_side(
            at, points
        )
        rolling = at.carrier_speed + at.motor_speed / train.ratios[5]
        share = np.zeros_like(ring)
        for effect in self.effects:
            share = share + effect.planetary_loss(at, ring, rolling)
        # In the frame of the carrier the sun drives the ring; where it overtakes it, the reverse.
        sun = ring / train.k1 * (1.0 - share) ** (-np.tanh(rolling / TURNING_SPEED))
        losses["planetary row"] = (sun - ring / train.k1) * rolling
        carrier = ring + sun
        motor_surplus = self._motor_side(at, sun, losses)
        flow_excess = self._loop(at, losses)
        pump_torque = self._pump_torque(at, losses)
        flow = np.tanh(pump_torque / TURNING_TORQUE)
        eta_4 = self._mesh(4, pump_torque, at.pump_speed)
        pump_power = pump_torque * at.pump_speed
        pump_input = pump_power * eta_4 ** (-flow)
        losses["gear 4"] = pump_input - pump_power
        # A slipping clutch passes its torque on and loses speed.
        whole_speed = train.carrier_speed(at.engine_speed)
        eta_23 = self._mesh(2, carrier, whole_speed) * self._mesh(
            3, carrier, whole_speed
        )
        carrier_input = carrier * whole_speed / eta_23
        losses["gears 2, 3"] = carrier_input * (1.0 - eta_23)
        losses["clutch slip"] = carrier * (whole_speed - at.carrier_speed)
        losses["engine drag"] = _total(self.effects, "engine_drag_power", at)
        total = carrier_input + pump_input + losses["engine drag"]
        return _Balance(
            flow_excess, motor_surplus, pump_torque, total, at.output_speed, losses
        )

    def _motor_side(
        self, at: Conditions, sun: FloatArray, losses: dict[str, FloatArray]
    ) -> FloatArray:
        """Torque left to speed the motor up, eq. (14)."""
        sense = np.tanh(at.motor_speed / TURNING_SPEED)
        reached = sun / self.train.ratios[5]
        demanded = reached * self._mesh(5, reached, at.motor_speed) ** (-sense)
        dry = self.base.motor_friction * np.abs(at.pressure) * at.motor_displacement
        dry = dry + _total(self.effects, "motor_drag", at)
        drag = (
            self.base.motor_damping * at.film_viscosity * at.motor_speed + dry * sense
        )
        losses["gear 5"] = (demanded - reached) * at.motor_speed
        losses["motor friction"] = drag * at.motor_speed
        return at.pressure * at.motor_displacement - drag - demanded

    def _loop(self, at: Conditions, losses: dict[str, FloatArray]) -> FloatArray:
        """Flow left to raise the pressure, eq. (13)."""
        lost = self.base.leakage * at.pressure / at.gap_viscosity
        lost = lost + _total(self.effects, "lost_flow", at)
        drop = _total(self.effects, "pressure_drop", at)
        pumped = at.pump_displacement * at.pump_speed * at.stroke
        losses["flow"] = lost * at.pressure
        losses["ports"] = drop * pumped
        return pumped - at.motor_displacement * at.motor_speed - lost

    def _pump_torque(self, at: Conditions, losses: dict[str, FloatArray]) -> FloatArray:
        """Torque that the pump takes from its shaft, eq. (15); negative where it drives."""
        pressure = at.pressure + _total(self.effects, "pressure_drop", at)
        ideal = at.stroke * pressure * at.pump_displacement
        drag = self.base.pump_damping * at.film_viscosity * at.pump_speed
        drag = drag + self.base.pump_friction * np.abs(ideal)
        drag = drag + _total(self.effects, "pump_drag", at)
        losses["pump friction"] = drag * at.pump_speed
        return ideal + drag


def _total(effects: Sequence[Effect], hook: str, at: Conditions) -> FloatArray:
    total = np.zeros_like(at.pressure)
    for effect in effects:
        total = total + getattr(effect, hook)(at)
    return total
