# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The plant on the bench: losses shaft by shaft, its steady state by bracketing.

The dynamometer holds the output power, the engine its speed. For an assumed motor speed the torques
follow from the load back to the motor, and eq. (14) gives the loop pressure; eq. (13) then says how
much flow is left. The motor speed at which none is left is sought from the fastest down, so that
the stable state is met first. Friction is as sharp as in the equations: a motor that neither drives
nor is driven stands still.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from studies.blind.bench.roots import bracketed_root
from studies.blind.bench.trains import GearPath, Train
from studies.blind.effect import Conditions, Effect, FloatArray, acting
from studies.blind.twin import BaseTruth

#: Loop pressure beyond which the relief valves of the loop are wide open: a stall [Pa].
STALL_PRESSURE = 45e6
#: Pressures between which a state is sought [Pa].
_PRESSURES = (-8e7, 2.5e8)
#: Output speeds below this count as a stall [rad/s].
_MIN_OUTPUT_SPEED = 5.0
#: Motor speeds at which the search begins, from the slowest to the fastest.
_SCAN = np.linspace(0.0, 1.0, 40)[:, None]
#: What counts as zero: torque [N m] and flow [m3/s], and intervals [Pa], [rad/s].
_NO_TORQUE = 1e-10
_NO_FLOW = 1e-16
_PRESSURE_TOLERANCE = 1e-5
_SPEED_TOLERANCE = 1e-11
#: The same torque where the search only begins [N m].
_LITTLE_TORQUE = 1e-2
#: Passes in which the slip of a clutch has to settle, and within what [-].
_SLIP_PASSES = 40
_SLIP_TOLERANCE = 1e-9
#: Motor speed below which friction holds the motor [rad/s]: width of a root at its jump.
_STANDING = 1e-9
#: Speed of the sun against the carrier over which the sense of the mesh loss turns [rad/s].
_ROLLING_SPEED = 1.0


#: Places of the machine where effects add up.
_HOOKS = (
    "true_stroke",
    "lost_flow",
    "pressure_drop",
    "pump_drag",
    "motor_drag",
    "engine_drag_power",
    "output_drag_power",
    "mesh_loss",
    "planetary_loss",
    "clutch_slip",
)


@dataclass(frozen=True)
class BenchConditions(Conditions):
    """Conditions of a stage, with what only a bench knows.

    Attributes:
        oil_temperature: of the tank [deg C].
        approach: 1 where the load rose to the test, -1 where it fell, 0 where neither is known.
        load_power: true output power [W].
    """

    oil_temperature: FloatArray
    approach: FloatArray
    load_power: FloatArray


@dataclass(frozen=True)
class Settings:
    """True settings of the tests of one stage; arrays of shape (n,).

    Attributes:
        displacement_ratio: commanded [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        oil_temperature: of the tank [deg C].
        film_temperature: in the lubricated gaps [deg C].
        approach: 1 where the load rose to the test, -1 where it fell.
    """

    displacement_ratio: FloatArray
    engine_speed: FloatArray
    load_torque: FloatArray
    oil_temperature: FloatArray
    film_temperature: FloatArray
    approach: FloatArray

    def __len__(self) -> int:
        return len(self.engine_speed)

    def select(self, index: npt.NDArray[np.generic]) -> "Settings":
        """Return the tests at an index array or mask."""
        chosen = {name: values[index] for name, values in vars(self).items()}
        return Settings(**chosen)


@dataclass(frozen=True)
class State:
    """Steady state of a plant; arrays of shape (n,), without any meter.

    Attributes:
        runs: False where the plant stalls; everything else is then nan or without meaning.
        output_speed: [rad/s].
        engine_torque, output_torque: at the two meters [N m].
        pressure: over the motor, positive where the load loads it [Pa].
        motor_speed: positive where the motor speeds the output up [rad/s].
    """

    runs: npt.NDArray[np.bool_]
    output_speed: FloatArray
    engine_torque: FloatArray
    output_torque: FloatArray
    pressure: FloatArray
    motor_speed: FloatArray

    def efficiency(self, engine_speed: FloatArray) -> FloatArray:
        """Output power / engine power [-]."""
        power = self.output_torque * self.output_speed
        return np.asarray(power / (self.engine_torque * engine_speed))


@dataclass(frozen=True)
class Stand:
    """One stage with base parameters and effects."""

    train: Train
    base: BaseTruth
    effects: tuple[Effect, ...] = ()

    def run(self, settings: Settings) -> State:
        """Bring every test to rest."""
        with np.errstate(all="ignore"):
            return _Solver(self, settings).state()


class _Solver:
    """The equations of one stage at the settings of n tests."""

    def __init__(self, stand: Stand, settings: Settings) -> None:
        self.train = stand.train
        self.base = stand.base
        self.effects = stand.effects
        self.acting = {hook: acting(stand.effects, hook) for hook in _HOOKS}
        self.settings = settings
        self.power = settings.load_torque * settings.engine_speed
        self.command = self.train.sense * settings.displacement_ratio
        #: Of the closed clutch of the mechanical path, against its speed.
        self.slip = np.zeros(len(settings))
        self.gap = np.ones(len(settings))
        self.film = np.ones(len(settings))
        for effect in self.effects:
            in_gap, _ = effect.viscosity(settings.oil_temperature)
            _, in_film = effect.viscosity(settings.film_temperature)
            self.gap = self.gap * in_gap
            self.film = self.film * in_film

    # --- the state ----------------------------------------------------------------------------

    def state(self) -> State:
        """Return the steady state with the fastest output."""
        state = self._state_at_slip()
        if not self.acting["clutch_slip"]:
            return state
        for _ in range(_SLIP_PASSES):
            before = self.slip
            self.slip = self._slip_under(state)
            state = self._state_at_slip()
            settled = np.abs(self.slip - before) < _SLIP_TOLERANCE
            if np.all(settled | ~state.runs):
                break
        # Where the slip does not settle, the clutch has broken away.
        return replace(state, runs=state.runs & settled)

    def _slip_under(self, state: State) -> FloatArray:
        """Slip of the clutch under the torque of a state [-].

        Torques at a row stand in a fixed ratio: the clutch follows that of the row.
        """
        torque = self._mechanical_torque(
            self._conditions(state.motor_speed, state.pressure)
        )
        sliding = np.zeros_like(torque)
        for effect in self.acting["clutch_slip"]:
            sliding = sliding + effect.clutch_slip(np.abs(torque))
        slip = np.sign(torque) * sliding / self.settings.engine_speed
        return np.where(state.runs, slip, 0.0)

    def _state_at_slip(self) -> State:
        """Return the steady state with the fastest output, the slip given."""
        low, high = self._bracket()
        stalls = ~np.isfinite(low)
        low = np.where(stalls, 0.0, low)
        high = np.where(stalls, 0.0, high)
        speed = bracketed_root(
            self._missing_flow, low, high, _SPEED_TOLERANCE, _NO_FLOW
        )
        stands = np.abs(speed) < _STANDING
        speed = np.where(stands, 0.0, speed)
        pressure = self._pressure(speed, np.sign(speed))
        if np.any(stands):
            pressure = np.where(stands, self._standing_pressure(), pressure)
        conditions = self._conditions(speed, pressure)
        output = conditions.output_speed
        return State(
            runs=~stalls & (np.abs(pressure) < STALL_PRESSURE),
            output_speed=output,
            engine_torque=self._engine_power(conditions) / self.settings.engine_speed,
            output_torque=self.power / output,
            pressure=pressure,
            motor_speed=speed,
        )

    def _bracket(self) -> tuple[FloatArray, FloatArray]:
        """Return motor speeds between which flow runs out; nan where the plant stalls."""
        train = self.train
        slowest = np.zeros(len(self.settings))
        if not train.pump_on_row:
            mechanical = train.mechanical_share * self.settings.engine_speed
            slowest = (-mechanical * (1.0 - self.slip)) / train.motor_share
        slowest = slowest + _MIN_OUTPUT_SPEED / train.motor_share
        fastest = np.maximum(self._free_speed(), slowest)
        fastest = fastest + 0.1 * np.abs(fastest) + 60.0
        scanned = slowest + (fastest - slowest) * _SCAN
        missing = self._missing_flow(scanned, _LITTLE_TORQUE)
        flows = missing < 0.0
        last = len(_SCAN) - 1 - np.argmax(flows[::-1], axis=0)
        usable = np.any(flows, axis=0) & (last < len(_SCAN) - 1)
        column = np.arange(len(self.settings))
        after = np.minimum(last + 1, len(_SCAN) - 1)
        low = np.where(usable, scanned[last, column], np.nan)
        return low, scanned[after, column]

    def _free_speed(self) -> FloatArray:
        """Motor speed without leakage, eq. (5)."""
        train = self.train
        ratio = self.command * train.pump_displacement / train.motor_displacement
        still = np.zeros(len(self.settings))
        at_rest = self._pump_speed(still)
        if not train.pump_on_row:
            return np.asarray(ratio * at_rest)
        # The faster the output, the slower the row turns the pump.
        fed_back = at_rest - self._pump_speed(still + 1.0)
        return np.asarray(ratio * at_rest / (1.0 + ratio * fed_back))

    def _pump_speed(self, motor_speed: FloatArray) -> FloatArray:
        engine = self.settings.engine_speed
        output = self.train.output_speed(engine, motor_speed, self.slip)
        members = self.train.members(engine, output, self.slip)
        return self.train.pump_speed(engine, members)

    def _missing_flow(
        self, speed: FloatArray, negligible: float = _NO_TORQUE
    ) -> FloatArray:
        """Flow that a motor speed asks for beyond what arrives [m3/s]."""
        direction = np.where(speed >= 0.0, 1.0, -1.0)
        pressure = self._pressure(speed, direction, negligible)
        return -self._spare_flow(self._conditions(speed, pressure))

    def _pressure(
        self, speed: FloatArray, direction: FloatArray, negligible: float = _NO_TORQUE
    ) -> FloatArray:
        """Pressure at which the torques of a motor speed balance, eq. (14) [Pa]."""
        unloaded = self._conditions(speed, np.zeros_like(speed))
        load = self._load_torque(unloaded)

        def surplus(pressure: FloatArray) -> FloatArray:
            loaded = self._at_pressure(unloaded, pressure)
            return self._torque_surplus(loaded, load, direction)

        low = np.full_like(speed, _PRESSURES[0])
        high = np.full_like(speed, _PRESSURES[1])
        return bracketed_root(surplus, low, high, _PRESSURE_TOLERANCE, negligible)

    def _standing_pressure(self) -> FloatArray:
        """Pressure at which a motor at rest lets all flow leak, eq. (13) [Pa]."""
        still = np.zeros(len(self.settings))

        def leaks_more(pressure: FloatArray) -> FloatArray:
            return -self._spare_flow(self._conditions(still, pressure))

        low = np.full_like(still, _PRESSURES[0])
        high = np.full_like(still, _PRESSURES[1])
        return bracketed_root(leaks_more, low, high, _PRESSURE_TOLERANCE, _NO_FLOW)

    # --- the equations ------------------------------------------------------------------------

    def _conditions(self, speed: FloatArray, pressure: FloatArray) -> BenchConditions:
        """Return what the effects may see, in arrays of the shape of `speed`."""
        shape = np.shape(speed)
        settings = self.settings
        engine = np.broadcast_to(settings.engine_speed, shape)
        output = self.train.output_speed(engine, speed, self.slip)
        members = self.train.members(engine, output, self.slip)
        command = np.broadcast_to(self.command, shape)
        conditions = BenchConditions(
            command=command,
            stroke=command,
            engine_speed=engine,
            pump_speed=self.train.pump_speed(engine, members),
            motor_speed=speed,
            carrier_speed=np.abs(members["carrier"]),
            output_speed=np.maximum(output, 0.1),
            pressure=pressure,
            load_torque=np.broadcast_to(settings.load_torque, shape),
            gap_viscosity=np.broadcast_to(self.gap, shape),
            film_viscosity=np.broadcast_to(self.film, shape),
            pump_displacement=self.train.pump_displacement,
            motor_displacement=self.train.motor_displacement,
            leakage=self.base.leakage,
            oil_temperature=np.broadcast_to(settings.oil_temperature, shape),
            approach=np.broadcast_to(settings.approach, shape),
            load_power=np.broadcast_to(self.power, shape),
        )
        return self._at_pressure(conditions, pressure)

    def _at_pressure(
        self, at: BenchConditions, pressure: FloatArray
    ) -> BenchConditions:
        """Return conditions at another pressure, with the stroke that the plate takes there.

        The plate is the same in every stage, so that its errors have the sense of the bench.
        """
        sense = self.train.sense
        of_plate = sense * at.command
        for effect in self.acting["true_stroke"]:
            of_plate = effect.true_stroke(of_plate, sense * pressure)
        return replace(at, pressure=pressure, stroke=sense * of_plate)

    def _spare_flow(self, at: BenchConditions) -> FloatArray:
        """Flow that neither leaks nor turns the motor, eq. (13) [m3/s]."""
        leaked = self.base.leakage * at.pressure / at.gap_viscosity
        leaked = leaked + self._total("lost_flow", at)
        pumped = at.pump_displacement * at.stroke * at.pump_speed
        return np.asarray(pumped - leaked - at.motor_displacement * at.motor_speed)

    def _load_torque(self, at: BenchConditions) -> FloatArray:
        """Torque that the load asks of the motor, or output-coupled of the output shaft [N m].

        No loss between the load and the row depends on the pressure of the loop.
        """
        if self.train.pump_on_row:
            return self._load_at_output(at)
        hydraulic, _ = self._row_torques(at)
        path = self.train.motor
        # In the sense that speeds the output up.
        shaft = self.train.sense * path.direction * hydraulic / path.ratio
        return self._gears(path, np.asarray(shaft), at.motor_speed, -1.0)

    def _torque_surplus(
        self, at: BenchConditions, load: FloatArray, direction: FloatArray
    ) -> FloatArray:
        """Torque of the motor beyond what the load asks of it, eq. (14) [N m]."""
        given = self._motor_torque(at, direction)
        if not self.train.pump_on_row:
            return given - load
        braced, _ = self._braced(at)
        shaft = (load - braced) * self.train.motor_share
        return given - self._gears(self.train.motor, shaft, at.motor_speed, -1.0)

    def _motor_torque(self, at: BenchConditions, direction: FloatArray) -> FloatArray:
        ideal = at.pressure * at.motor_displacement
        rubbing = self.train.friction * np.abs(ideal)
        rubbing = rubbing + self._total("motor_drag", at)
        damping = self.base.motor_damping * at.film_viscosity * at.motor_speed
        return np.asarray(ideal - rubbing * direction - damping)

    def _pump_torque(self, at: BenchConditions) -> FloatArray:
        """Torque that the pump takes from its shaft, eq. (15) [N m]."""
        pressure = at.pressure + self._total("pressure_drop", at)
        ideal = at.stroke * pressure * at.pump_displacement
        rubbing = self.train.friction * np.abs(ideal)
        rubbing = rubbing + self._total("pump_drag", at)
        damping = self.base.pump_damping * at.film_viscosity * at.pump_speed
        return np.asarray(ideal + rubbing * np.sign(at.pump_speed) + damping)

    def _gears(
        self, path: GearPath, torque: FloatArray, speed: FloatArray, against: float
    ) -> FloatArray:
        """Return the torque with the losses of a path, at the same shaft.

        Args:
            path: its gear pairs.
            torque: known at one end, referred to the shaft at `speed` [N m].
            speed: of that shaft [rad/s].
            against: -1 where the torque wanted is nearer to the source of positive power, so that
                losses raise it; 1 where it is nearer to the receiver.
        """
        sense = np.sign(torque * speed)
        passed = np.ones_like(torque)
        for number in range(len(path.ratios)):
            label = path.labels[number % len(path.labels)]
            efficiency = np.full_like(torque, path.efficiency)
            for effect in self.acting["mesh_loss"]:
                efficiency = efficiency - effect.mesh_loss(label, torque, speed)
            passed = passed * efficiency
        return np.asarray(torque * passed ** (against * sense))

    def _load_at_output(self, at: BenchConditions) -> FloatArray:
        """Torque that load and drag ask of the output shaft [N m]."""
        drag = self._total("output_drag_power", at)
        return np.asarray((at.load_power + drag) / at.output_speed)

    def _row_torques(self, at: BenchConditions) -> tuple[FloatArray, FloatArray]:
        """Torques that pass to the row at its hydraulic and mechanical members [N m]."""
        train = self.train
        load = self._gears(
            train.output, self._load_at_output(at), at.output_speed, -1.0
        )
        on_row = -load * train.output.direction / train.output.ratio
        willis = self._lossy_willis(at, train.output_member, on_row)
        known = willis[train.output_member]
        hydraulic = on_row * willis[train.hydraulic_member] / known
        mechanical = on_row * willis[train.mechanical_member] / known
        return hydraulic, mechanical

    def _braced(self, at: BenchConditions) -> tuple[FloatArray, FloatArray]:
        """Torque at the output shaft from a row that the pump braces, and that at the engine."""
        train = self.train
        pump = self._gears(train.pump, self._pump_torque(at), at.pump_speed, -1.0)
        on_row = -train.pump_sense * pump / train.pump.ratio
        willis = self._lossy_willis(at, train.hydraulic_member, on_row)
        known = willis[train.hydraulic_member]
        output = -on_row * willis[train.output_member] / known
        shaft = train.output.direction * output * train.output.ratio
        given = self._gears(train.output, shaft, at.output_speed, 1.0)
        mechanical = on_row * willis[train.mechanical_member] / known
        return given, mechanical

    def _lossy_willis(
        self, at: BenchConditions, member: str, torque: FloatArray
    ) -> dict[str, FloatArray]:
        """Torques of sun, ring and carrier in proportion, with the loss of the meshes."""
        ideal = self.train.willis
        members = self.train.members(at.engine_speed, at.output_speed, self.slip)
        rolling = members["sun"] - members["carrier"]
        share = np.zeros_like(torque)
        for effect in self.acting["planetary_loss"]:
            share = share + effect.planetary_loss(at, torque, rolling)
        # Where the sun drives the ring, seen from the carrier, the ring gets less than k.
        sun_torque = np.sign(torque) * np.sign(ideal[member])
        drives = sun_torque * np.tanh(rolling / _ROLLING_SPEED)
        ring = self.train.ring_ratio * (1.0 - share) ** drives
        return {"sun": np.ones_like(ring), "ring": ring, "carrier": -(1.0 + ring)}

    def _mechanical_torque(self, at: BenchConditions) -> FloatArray:
        """Torque that the mechanical path takes from the engine [N m]."""
        train = self.train
        if train.pump_on_row:
            _, mechanical = self._braced(at)
        else:
            _, mechanical = self._row_torques(at)
        path = train.mechanical
        shaft = path.direction * mechanical / path.ratio
        return self._gears(path, shaft, at.engine_speed, -1.0)

    def _engine_power(self, at: BenchConditions) -> FloatArray:
        """Power that the engine gives [W]."""
        train = self.train
        power = self._mechanical_torque(at) * at.engine_speed
        if not train.pump_on_row:
            pump = self._gears(train.pump, self._pump_torque(at), at.pump_speed, -1.0)
            power = power + pump * at.pump_speed
        return np.asarray(power + self._total("engine_drag_power", at))

    def _total(self, hook: str, at: BenchConditions) -> FloatArray:
        """Return what the effects add at one place of the machine."""
        total = np.zeros_like(at.pressure)
        for effect in self.acting[hook]:
            total = total + getattr(effect, hook)(at)
        return total
