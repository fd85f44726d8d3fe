# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The gear train of one stage as data: what lies on each path between engine and output.

A hydromechanical stage has one planetary row. The engine drives one member through gears (the
mechanical path), the output hangs on another, the hydraulic path takes the third:

* `input_coupled`: the pump is geared to the engine, the motor drives the third member;
* `output_coupled`: the third member drives the pump, the motor is geared to the output;
* `hydrostatic`: there is no row; the pump is geared to the engine, the motor to the output.

Which pairs lie on which path and which member each path meets comes from a mapping (YAML), never
from code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .clutches import MEMBERS, check_names, open_clutches
from .mapping import Section, number
from .ranges import Range
from .teeth import gear_ratio, stated_ratio

LAYOUTS = ("input_coupled", "output_coupled", "hydrostatic")
PATHS = ("mechanical", "pump", "motor", "output")
"""Names of the power paths: engine to row, engine to pump, motor to row, row to output."""
_MAX_STAGES = 64
"""Stages of a file; transmissions have up to a dozen."""
CM3_PER_REV = 1e-6 / (2.0 * math.pi)  # in m3/rad


@dataclass(frozen=True)
class GearPair:
    """One gear pair.

    Attributes:
        name: its number or name in the gear train.
        ratio: driving speed / driven speed in the direction engine -> output [-].
        efficiency: part of the power that passes, in either direction [-].
    """

    name: str
    ratio: float
    efficiency: float = 0.98

    def __post_init__(self) -> None:
        Range(f"gear_pairs.{self.name}", 0.01, 100.0, "-").check(self.ratio)
        Range(f"gear_efficiency.{self.name}", 0.5, 1.0, "-").check(self.efficiency)


@dataclass(frozen=True)
class Path:
    """Gear pairs in series and the sense of rotation they leave.

    Attributes:
        gear_pairs: the pairs in the order from the engine side to the output side.
        direction: +1 or -1, the sense of the last shaft against the first.
    """

    gear_pairs: tuple[GearPair, ...]
    direction: int = 1

    def __post_init__(self) -> None:
        _require(self.direction in (1, -1), "direction", self.direction, "1 or -1")

    @cached_property
    def ratio(self) -> float:
        """Speed of the first shaft / speed of the last, without sign [-]."""
        return math.prod(pair.ratio for pair in self.gear_pairs)

    @cached_property
    def efficiency(self) -> float:
        """Product of the pair efficiencies [-]."""
        return math.prod(pair.efficiency for pair in self.gear_pairs)


@dataclass(frozen=True)
class PumpMotor:
    """Variable pump and constant-displacement motor in closed circuit.

    Attributes:
        pump_displacement: V_p at full stroke [m3/rad].
        motor_displacement: V_m [m3/rad].
        pump_friction: c_fp, friction torque / pressure torque [-].
        motor_friction: c_fm, friction torque / pressure torque [-].
    """

    pump_displacement: float
    motor_displacement: float
    pump_friction: float = 0.01
    motor_friction: float = 0.01

    def __post_init__(self) -> None:
        for unit in ("pump", "motor"):
            for limits in (
                Range(f"{unit}_displacement", 1e-7, 1e-3, "m3/rad"),
                Range(f"{unit}_friction", 0.0, 0.5, "-"),
            ):
                limits.check(getattr(self, limits.name), "pump_motor")


@dataclass(frozen=True)
class Stage:
    """One stage: planetary row, paths and pump-motor pair.

    Attributes:
        name: such as `HM4`.
        planetary_constant: k = teeth of ring / teeth of sun [-]; 0 without a row.
        mechanical: the path engine -> row; empty in a hydrostatic stage.
        output: the path row -> output; in a hydrostatic stage it follows the motor path.
        motor: the path motor -> row, or motor -> output shaft.
        pump: the path engine -> pump, or row -> pump; direction 1: the sense of the displacement
            ratio is that of the motor path.
        mechanical_member: `sun`, `ring` or `carrier`; empty without a row.
        motor_member: another one, of the hydraulic path: output-coupled that of the pump.
        output_member: the third one.
        pump_motor: the hydraulic units.
        layout: one of `LAYOUTS`.
        reverse: whether the mechanical path drives the output backward: its speed is negative.
        open_clutches: by name, what a clutch that is open slips by per engine speed and per output
            speed [-]; empty where it is not known.

    Raises:
        InputError: a value is out of range, members repeat, the pump path states a direction, or
            the mechanical path alone would not drive the output forward (backward in reverse).
    """

    name: str
    planetary_constant: float
    mechanical: Path
    mechanical_member: str
    pump: Path
    motor: Path
    motor_member: str
    output: Path
    output_member: str
    pump_motor: PumpMotor
    layout: str = "input_coupled"
    reverse: bool = False
    open_clutches: tuple[tuple[str, float, float], ...] = ()

    def __post_init__(self) -> None:
        where = f"stage {self.name}: "
        _require(
            self.layout in LAYOUTS, f"{where}layout", self.layout, ", ".join(LAYOUTS)
        )
        _require(
            self.pump.direction == 1,
            f"{where}pump.direction",
            self.pump.direction,
            "1: give the motor path the sense that a positive displacement ratio has",
        )
        if not self.has_row:
            _require(
                not self.reverse,
                f"{where}reverse",
                self.reverse,
                "false: a hydrostatic stage turns either way",
            )
            return
        _require(
            math.isfinite(self.planetary_constant)
            and 1.0 < self.planetary_constant <= 20.0,
            f"{where}planetary constant",
            self.planetary_constant,
            "more than 1, up to 20",
        )
        members = (self.mechanical_member, self.motor_member, self.output_member)
        _require(
            sorted(members) == sorted(MEMBERS),
            f"{where}members",
            members,
            "sun, ring and carrier, each once",
        )
        standing_unit = "pump" if self.layout == "output_coupled" else "motor"
        allowed = "more than 0; check the directions, or say reverse: true"
        if self.reverse:
            allowed = "less than 0 in a reverse stage"
        _require(
            (self.mechanical_speed_ratio < 0.0) == self.reverse,
            f"{where}output speed per engine speed at standing {standing_unit}",
            self.mechanical_speed_ratio,
            allowed,
        )

    @property
    def has_row(self) -> bool:
        """Whether there is a planetary row."""
        return self.layout != "hydrostatic"

    @cached_property
    def mechanical_speed_ratio(self) -> float:
        """Output speed / engine speed while the unit on the row stands still [-], eq. (4).

        That is the motor, output-coupled the pump; 0 without a row.
        """
        if not self.has_row:
            return 0.0
        return self._output_share(self.mechanical, self.mechanical_member)

    @cached_property
    def motor_speed_ratio(self) -> float:
        """Change of output speed / change of motor speed [-], eq. (4); may be negative."""
        if self.layout == "output_coupled":
            return self.motor.direction / self.motor.ratio
        return self._output_share(self.motor, self.motor_member)

    @cached_property
    def pump_speed_ratios(self) -> tuple[float, float]:
        """Pump speed per engine speed and per output speed [-]; the first is positive."""
        if self.layout != "output_coupled":
            return 1.0 / self.pump.ratio, 0.0
        row = self._member_ratio(self.mechanical_member, self.motor_member)
        engine = abs(row) / (self.mechanical.ratio * self.pump.ratio)
        return engine, -engine / self.mechanical_speed_ratio

    @cached_property
    def sun_speed_ratios(self) -> tuple[float, float]:
        """Sun speed against the carrier per engine and per output speed [-]; 0 without a row."""
        if not self.has_row:
            return 0.0, 0.0
        engine = self.mechanical.direction / self.mechanical.ratio
        output = self.output.direction * self.output.ratio
        return (
            self._rolling(self.mechanical_member, engine),
            self._rolling(self.output_member, output),
        )

    def _rolling(self, member: str, speed: float) -> float:
        """Sun speed against the carrier, from one member that drives that of the motor alone."""
        speeds = {
            member: speed,
            self.motor_member: speed * self._member_ratio(member, self.motor_member),
        }
        return speeds.get("sun", 0.0) - speeds.get("carrier", 0.0)

    def _output_share(self, path: Path, member: str) -> float:
        row = 1.0
        if self.has_row:
            row = self._member_ratio(member, self.output_member)
        return (
            path.direction
            * self.output.direction
            * row
            / (path.ratio * self.output.ratio)
        )

    @property
    def member_coefficients(self) -> Mapping[str, float]:
        """Coefficients of the speeds of the members in eq. (4); their sum is zero."""
        return member_speed_coefficients(self.planetary_constant)

    def _member_ratio(self, driving: str, driven: str) -> float:
        """Speed of one member per speed of another while the third stands, eq. (4)."""
        coefficients = self.member_coefficients
        return -coefficients[driving] / coefficients[driven]

    @property
    def paths(self) -> dict[str, Path]:
        """The four paths by name: mechanical, pump, motor, output."""
        return {name: getattr(self, name) for name in PATHS}

    @property
    def gear_pairs(self) -> tuple[GearPair, ...]:
        """Every pair of the stage in the order mechanical, pump, motor, output."""
        return tuple(pair for path in self.paths.values() for pair in path.gear_pairs)

    def with_gear_efficiency(self, efficiency: float) -> Stage:
        """Return the stage with the same efficiency in every gear pair."""
        return self._with_gear_efficiencies(lambda pair: efficiency)

    def with_gear_loss(self, loss: Any) -> Stage:
        """Return the stage with a further part of the power lost in every gear pair.

        Args:
            loss: that part [-]; a number, or an array of shape (..., 1) for many candidates.
        """

        def efficiency(pair: GearPair) -> Any:
            passed = pair.efficiency * (1.0 - loss)
            # A plain number stays one, because files hold it.
            return np.minimum(passed, 1.0) if np.ndim(loss) else min(passed, 1.0)

        return self._with_gear_efficiencies(efficiency)

    def _with_gear_efficiencies(self, efficiency: Callable[[GearPair], Any]) -> Stage:
        renewed: dict[str, Any] = {}
        for name, path in self.paths.items():
            pairs = []
            for pair in path.gear_pairs:
                pairs.append(replace(pair, efficiency=efficiency(pair)))
            renewed[name] = replace(path, gear_pairs=tuple(pairs))
        return replace(self, **renewed)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], name: str | None = None) -> Stage:
        """Build a stage from the mapping that a YAML file holds (see `params/transmission.yaml`).

        Args:
            data: keys `gear_pairs`, `gear_efficiency`, `planetary_rows`, `pump_motor`, `stages`,
                and `clutches`, from which the slips of open clutches follow.
            name: the stage wanted; may be left out when `stages` holds one.

        Raises:
            InputError: a field is missing or wrong; it is named.
        """
        file = Section(data)
        if name is None:
            name = _only_name(file.section("stages"))
        stage = cls._with_listed_clutches(file, name)
        derived = open_clutches(
            file, stage, lambda other: cls._with_listed_clutches(file, other)
        )
        check_names(stage.open_clutches, derived, f"stages.{name}.")
        return replace(stage, open_clutches=(*stage.open_clutches, *derived))

    @classmethod
    def _with_listed_clutches(cls, file: Section, name: str) -> Stage:
        """Build a stage with the open clutches whose slips its entry lists."""
        entry = file.section("stages").section(name)
        layout = str(entry.data.get("layout", LAYOUTS[0]))
        reverse = entry.data.get("reverse", False)
        where = entry.where
        _require(layout in LAYOUTS, f"{where}layout", layout, ", ".join(LAYOUTS))
        _require(isinstance(reverse, bool), f"{where}reverse", reverse, "true or false")
        if layout == "hydrostatic":
            _require(
                "mechanical" not in entry.data,
                f"{where}mechanical",
                "given",
                "nothing: a hydrostatic stage has no mechanical path",
            )
        return cls(
            name=name,
            layout=layout,
            reverse=reverse,
            **_row_and_paths(file, entry, layout),
            open_clutches=_listed_clutches(entry),
            pump_motor=_pump_motor(file.section("pump_motor")),
        )

    def _entry(self, rows: Mapping[float, str]) -> dict[str, Any]:
        """Return the entry of a file for this stage, with names of the planetary constants."""
        entry: dict[str, Any] = {}
        if self.layout != LAYOUTS[0]:
            entry["layout"] = self.layout
        if self.reverse:
            entry["reverse"] = True
        if self.open_clutches:
            slips = {}
            for clutch, *slip in self.open_clutches:
                slips[clutch] = list(slip)
            entry["open_clutches"] = slips
        if self.has_row:
            entry["planetary_row"] = rows[self.planetary_constant]
        on_row = _members_of(self.layout)
        for key, path in self.paths.items():
            if key == "mechanical" and not self.has_row:
                continue
            entry[key] = {
                "gear_pairs": [pair.name for pair in path.gear_pairs],
                "direction": path.direction,
            }
            if key in on_row:
                entry[key]["member"] = getattr(self, on_row[key])
        return entry


def stages_from_mapping(data: Mapping[str, Any]) -> tuple[Stage, ...]:
    """Build every stage of a mapping, in its order; see `Stage.from_mapping`."""
    names = [str(name) for name in Section(data).section("stages").data]
    _require(bool(names), "stages", {}, "at least one stage")
    _require(len(names) <= _MAX_STAGES, "stages", len(names), f"at most {_MAX_STAGES}")
    return tuple(Stage.from_mapping(data, name) for name in names)


def stages_to_mapping(stages: Sequence[Stage]) -> dict[str, Any]:
    """Return the mapping that `stages_from_mapping` reads.

    Raises:
        InputError: the stages are not of one transmission: units, or a pair of one name, differ.
    """
    units = stages[0].pump_motor
    constants = sorted({stage.planetary_constant for stage in stages if stage.has_row})
    rows = {}
    for i, value in enumerate(constants, 1):
        rows[value] = f"k{i}" if len(constants) > 1 else "k"
    pairs: dict[str, GearPair] = {}
    for stage in stages:
        _require(
            stage.pump_motor == units,
            f"stages.{stage.name}: pump_motor",
            stage.pump_motor,
            "that of the other stages",
        )
        for pair in stage.gear_pairs:
            _require(
                pairs.setdefault(pair.name, pair) == pair,
                f"stages.{stage.name}: gear pair",
                pair,
                f"{pairs[pair.name]}, as in another stage",
            )
    pump = float(f"{units.pump_displacement / CM3_PER_REV:.12g}")
    motor = float(f"{units.motor_displacement / CM3_PER_REV:.12g}")
    return {
        "gear_pairs": {name: pair.ratio for name, pair in pairs.items()},
        "gear_efficiency": {name: pair.efficiency for name, pair in pairs.items()},
        "planetary_rows": {name: value for value, name in rows.items()},
        "pump_motor": {
            "pump_displacement_cm3_per_rev": pump,
            "motor_displacement_cm3_per_rev": motor,
            "pump_friction": units.pump_friction,
            "motor_friction": units.motor_friction,
        },
        "stages": {stage.name: stage._entry(rows) for stage in stages},
    }


def speed_ratio(
    stage: Stage, displacement_ratio: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Output speed / engine speed without slip, eq. (5) [-]."""
    units = stage.pump_motor
    engine, output = stage.pump_speed_ratios
    # What the motor adds to the output speed per pump speed.
    share = (
        displacement_ratio
        * stage.motor_speed_ratio
        * units.pump_displacement
        / units.motor_displacement
    )
    fixed = 0.0 if stage.layout == "output_coupled" else stage.mechanical_speed_ratio
    return (fixed + share * engine) / (1.0 - share * output)


def _require_row(stage: Mapping[Any, Any], where: str) -> None:
    """Refuse a stage with neither a row nor a mechanical path that is not `hydrostatic`."""
    if "planetary_row" in stage or "mechanical" in stage:
        return
    raise InputError(
        f"{where}planetary_row is missing; there is {', '.join(map(str, stage))}; a stage "
        "without a row needs layout: hydrostatic"
    )


def _members_of(layout: str) -> dict[str, str]:
    """Member of the row that each path drives or is driven by, as `Stage` names it."""
    if layout == "hydrostatic":
        return {}
    hydraulic = "pump" if layout == "output_coupled" else "motor"
    return {
        "mechanical": "mechanical_member",
        hydraulic: "motor_member",
        "output": "output_member",
    }


def member_speed_coefficients(planetary_constant: float) -> dict[str, float]:
    """Coefficients of eq. (4) written as: sum of coefficient x speed = 0."""
    return {
        "sun": 1.0,
        "ring": planetary_constant,
        "carrier": -(1.0 + planetary_constant),
    }


def _only_name(stages: Section) -> str:
    """Return the name of the only stage of a file."""
    if len(stages.data) != 1:
        names = ", ".join(map(str, stages.data))
        raise InputError(f"stages holds {names}: say which one")
    return str(next(iter(stages.data)))


def _row_and_paths(file: Section, entry: Section, layout: str) -> dict[str, Any]:
    """Return the planetary constant, the paths and their members, as `Stage` takes them."""
    on_row = _members_of(layout)
    fields: dict[str, Any] = {
        "planetary_constant": 0.0,
        "mechanical": Path(()),
        "mechanical_member": "",
        "motor_member": "",
        "output_member": "",
    }
    if on_row:
        _require_row(entry.data, entry.where)
        row = entry.get("planetary_row")
        rows = file.section("planetary_rows")
        constant = stated_ratio(rows.get(row), f"{rows.where}{row}")
        fields["planetary_constant"] = constant
    for key in PATHS:
        if key == "mechanical" and not on_row:
            continue
        path = entry.section(key)
        fields[key] = _path(file, path)
        if key in on_row:
            fields[on_row[key]] = str(path.get("member"))
        else:
            _require(
                "member" not in path.data,
                f"{path.where}member",
                "given",
                f"nothing: {layout} this path does not end at the row",
            )
    return fields


def _listed_clutches(entry: Section) -> tuple[tuple[str, float, float], ...]:
    """Return names and slips of the open clutches that a stage lists."""
    place = f"{entry.where}open_clutches"
    allowed = "name: [slip per engine speed, per output speed]"
    slips = entry.data.get("open_clutches", {})
    _require(isinstance(slips, Mapping), place, slips, allowed)
    clutches = []
    for name, slip in slips.items():
        is_pair = isinstance(slip, list) and len(slip) == 2
        _require(is_pair, place, slips, allowed)
        per_engine = number(slip[0], place)
        per_output = number(slip[1], place)
        clutches.append((str(name), per_engine, per_output))
    return tuple(clutches)


def _path(file: Section, entry: Section) -> Path:
    names = entry.get("gear_pairs")
    direction = entry.data.get("direction", 1)
    if not isinstance(names, list):
        raise InputError(f"{entry.where}gear_pairs = {names!r} is not a list")
    _require(direction in (1, -1), f"{entry.where}direction", direction, "1 or -1")
    ratios = file.section("gear_pairs")
    pairs = []
    for name in names:
        ratio = gear_ratio(ratios.get(name), f"{ratios.where}{name}")
        pairs.append(GearPair(str(name), ratio, _gear_efficiency(file, name)))
    return Path(tuple(pairs), int(direction))


def _gear_efficiency(file: Section, pair: object) -> float:
    """Return the efficiency of a pair, which a file states for all pairs or for each."""
    efficiency = file.data.get("gear_efficiency", 0.98)
    if isinstance(efficiency, Mapping):
        return file.section("gear_efficiency").number(pair)
    return number(efficiency, "gear_efficiency")


def _pump_motor(units: Section) -> PumpMotor:
    pump = units.number("pump_displacement_cm3_per_rev") * CM3_PER_REV
    motor = units.number("motor_displacement_cm3_per_rev") * CM3_PER_REV
    frictions = {}
    for name in ("pump_friction", "motor_friction"):
        if name in units.data:
            frictions[name] = units.number(name)
    return PumpMotor(pump, motor, **frictions)


def _require(holds: bool, field: str, value: object, allowed: str) -> None:
    if not holds:
        raise InputError(f"{field} = {value!r} is not allowed; allowed: {allowed}")
