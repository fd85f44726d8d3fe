# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The gear train of one stage as data: what lies on each path between engine and output.

A hydromechanical stage has one planetary row with three members. The engine drives one member
through gears (the mechanical path), the hydraulic motor drives the second (the hydraulic path;
its pump is geared to the engine), the third drives the output. Which pairs lie on which path and
which member each path meets comes from a mapping (YAML), never from code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .mapping import get, number, section
from .ranges import Range

MEMBERS = ("sun", "ring", "carrier")
_PATHS = ("mechanical", "pump", "motor", "output")
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
        pump_displacement, motor_displacement: V_p, V_m at full stroke [m3/rad].
        pump_friction, motor_friction: c_fp, c_fm, friction torque / pressure torque [-].
    """

    pump_displacement: float
    motor_displacement: float
    pump_friction: float = 0.01
    motor_friction: float = 0.01

    def __post_init__(self) -> None:
        for unit in ("pump", "motor"):
            for limits in (Range(f"{unit}_displacement", 1e-7, 1e-3, "m3/rad"),
                           Range(f"{unit}_friction", 0.0, 0.5, "-")):
                limits.check(getattr(self, limits.name), "pump_motor")


@dataclass(frozen=True)
class Stage:
    """One stage: planetary row, paths and pump-motor pair.

    Attributes:
        name: such as `HM4`.
        planetary_constant: k = teeth of ring / teeth of sun [-].
        mechanical, motor, output: the paths engine -> row, motor -> row, row -> output.
        pump: the path engine -> pump, direction 1: the sense of the displacement ratio is that of
            the motor path.
        mechanical_member, motor_member, output_member: `sun`, `ring` or `carrier`, all different.
        pump_motor: the hydraulic units.

    Raises:
        InputError: a value is out of range, members repeat, the pump path states a direction, or
            the mechanical path alone would not drive the output forward.
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

    def __post_init__(self) -> None:
        _require(math.isfinite(self.planetary_constant) and 1.0 < self.planetary_constant <= 20.0,
                 f"stage {self.name}: planetary constant", self.planetary_constant,
                 "more than 1, up to 20")
        members = (self.mechanical_member, self.motor_member, self.output_member)
        _require(sorted(members) == sorted(MEMBERS), f"stage {self.name}: members", members,
                 "sun, ring and carrier, each once")
        _require(self.pump.direction == 1, f"stage {self.name}: pump.direction",
                 self.pump.direction, "1: give the motor path the sense that a positive "
                 "displacement ratio has")
        _require(self.mechanical_speed_ratio > 0.0,
                 f"stage {self.name}: output speed per engine speed at standing motor",
                 self.mechanical_speed_ratio, "more than 0; check the directions")

    @cached_property
    def mechanical_speed_ratio(self) -> float:
        """Output speed / engine speed while the motor stands still [-], eq. (4)."""
        return self._output_share(self.mechanical, self.mechanical_member)

    @cached_property
    def motor_speed_ratio(self) -> float:
        """Change of output speed / change of motor speed [-], eq. (4); may be negative."""
        return self._output_share(self.motor, self.motor_member)

    def _output_share(self, path: Path, member: str) -> float:
        coefficients = member_speed_coefficients(self.planetary_constant)
        row = -coefficients[member] / coefficients[self.output_member]
        return path.direction * self.output.direction * row / (path.ratio * self.output.ratio)

    @property
    def paths(self) -> dict[str, Path]:
        """The four paths by name: mechanical, pump, motor, output."""
        return {name: getattr(self, name) for name in _PATHS}

    @property
    def gear_pairs(self) -> tuple[GearPair, ...]:
        """Every pair of the stage in the order mechanical, pump, motor, output."""
        return tuple(pair for path in self.paths.values() for pair in path.gear_pairs)

    def with_gear_efficiency(self, efficiency: float) -> Stage:
        """Return the stage with the same efficiency in every gear pair."""
        return self._with_gear_efficiencies(lambda pair: efficiency)

    def with_gear_loss(self, loss: float) -> Stage:
        """Return the stage with a further part of the power lost in every gear pair."""
        return self._with_gear_efficiencies(lambda pair: min(pair.efficiency * (1.0 - loss), 1.0))

    def _with_gear_efficiencies(self, efficiency: Callable[[GearPair], float]) -> Stage:
        renewed: dict[str, Any] = {
            name: replace(path, gear_pairs=tuple(
                replace(pair, efficiency=efficiency(pair)) for pair in path.gear_pairs))
            for name, path in self.paths.items()}
        return replace(self, **renewed)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], name: str | None = None) -> Stage:
        """Build a stage from the mapping that a YAML file holds (see `params/transmission.yaml`).

        Args:
            data: keys `gear_pairs`, `gear_efficiency`, `planetary_rows`, `pump_motor`, `stages`.
            name: the stage wanted; may be left out when `stages` holds one.

        Raises:
            InputError: a field is missing or wrong; it is named.
        """
        stages = section(data, "stages")
        if name is None:
            if len(stages) != 1:
                raise InputError(f"stages holds {', '.join(map(str, stages))}: say which one")
            name = str(next(iter(stages)))
        paths = section(stages, name, "stages.")
        where = f"stages.{name}."
        rows = section(data, "planetary_rows")
        row = get(paths, "planetary_row", where)
        made: dict[str, Any] = {key: _path(data, paths, key, where) for key in _PATHS}
        for key in ("mechanical", "motor", "output"):
            member = get(section(paths, key, where), "member", f"{where}{key}.")
            made[f"{key}_member"] = str(member)
        return cls(name=name, planetary_constant=number(rows, row, "planetary_rows."),
                   pump_motor=_pump_motor(section(data, "pump_motor")), **made)

    def to_mapping(self) -> dict[str, Any]:
        """Return the mapping that `from_mapping` reads, with nothing but this stage in it."""
        paths: dict[str, dict[str, Any]] = {
            key: {"gear_pairs": [pair.name for pair in path.gear_pairs],
                  "direction": path.direction} for key, path in self.paths.items()}
        for key in ("mechanical", "motor", "output"):
            paths[key]["member"] = getattr(self, f"{key}_member")
        units = self.pump_motor
        return {
            "gear_pairs": {pair.name: pair.ratio for pair in self.gear_pairs},
            "gear_efficiency": {pair.name: pair.efficiency for pair in self.gear_pairs},
            "planetary_rows": {"k": self.planetary_constant},
            "pump_motor": {
                "pump_displacement_cm3_per_rev": _round(units.pump_displacement / CM3_PER_REV),
                "motor_displacement_cm3_per_rev": _round(units.motor_displacement / CM3_PER_REV),
                "pump_friction": units.pump_friction,
                "motor_friction": units.motor_friction,
            },
            "stages": {self.name: {"planetary_row": "k", **paths}},
        }


def speed_ratio(stage: Stage, displacement_ratio: NDArray[np.float64]) -> NDArray[np.float64]:
    """Output speed / engine speed without slip, eq. (5) [-]."""
    units = stage.pump_motor
    motor = displacement_ratio * units.pump_displacement / units.motor_displacement
    return stage.mechanical_speed_ratio + stage.motor_speed_ratio * motor / stage.pump.ratio


def member_speed_coefficients(planetary_constant: float) -> dict[str, float]:
    """Coefficients of eq. (4) written as: sum of coefficient x speed = 0."""
    return {"sun": 1.0, "ring": planetary_constant, "carrier": -(1.0 + planetary_constant)}


def _path(data: Mapping[str, Any], paths: Mapping[str, Any], key: str, where: str) -> Path:
    ratios, efficiency = section(data, "gear_pairs"), data.get("gear_efficiency", 0.98)
    entry = section(paths, key, where)
    names = get(entry, "gear_pairs", f"{where}{key}.")
    if not isinstance(names, list):
        raise InputError(f"{where}{key}.gear_pairs = {names!r} is not a list")
    pairs = []
    for name in names:
        ratio = number(ratios, name, "gear_pairs.")
        eta = (number(efficiency, name, "gear_efficiency.") if isinstance(efficiency, Mapping)
               else number({"gear_efficiency": efficiency}, "gear_efficiency"))
        pairs.append(GearPair(str(name), ratio, eta))
    direction = entry.get("direction", 1)
    _require(direction in (1, -1), f"{where}{key}.direction", direction, "1 or -1")
    return Path(tuple(pairs), int(direction))


def _pump_motor(data: Mapping[str, Any]) -> PumpMotor:
    pump, motor = (number(data, f"{unit}_displacement_cm3_per_rev", "pump_motor.") * CM3_PER_REV
                   for unit in ("pump", "motor"))
    return PumpMotor(pump, motor, **{
        name: number(data, name, "pump_motor.")
        for name in ("pump_friction", "motor_friction") if name in data})


def _round(value: float) -> float:
    return float(np.format_float_positional(value, precision=12, fractional=False))


def _require(holds: bool, field: str, value: object, allowed: str) -> None:
    if not holds:
        raise InputError(f"{field} = {value!r} is not allowed; allowed: {allowed}")
