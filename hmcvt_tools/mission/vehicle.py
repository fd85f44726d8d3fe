# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The tractor around the transmission, and what its parts can do in a second."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from hmcvt_core.errors import InputError
from hmcvt_core.files.plain_yaml import named, read_tree, require_known
from hmcvt_core.transmission.mapping import quantity
from hmcvt_core.transmission.ranges import RPM, Range

from ..tables.units import to_si, unit_of

SCHEMA = "hmcvt-vehicle/1"

_UNITS = {"r/min": RPM, "r/min/s": RPM}
"""Units of a vehicle file that are not SI, and their size."""
_SI_UNITS = {"r/min": "rad/s", "r/min/s": "rad/s2"}

_VEHICLE_RANGES = (
    Range("mass", 100.0, 1e5, "kg", "is it in tonnes?"),
    Range("tyre_radius", 0.1, 3.0, "m"),
    Range("final_drive", 0.5, 500.0, "-"),
    Range("final_drive_efficiency", 0.5, 1.0, "-", "a fraction, not percent"),
    Range("rolling_resistance", 0.0, 0.6, "-", "a fraction of the weight"),
    Range("slip", 0.0, 0.6, "-", "a fraction, not percent"),
    Range("pto_efficiency", 0.5, 1.0, "-", "a fraction, not percent"),
    Range("pto_speed_low", 100.0, 3000.0, "r/min"),
    Range("pto_speed_high", 100.0, 3000.0, "r/min"),
)
_LIMIT_RANGES = (
    Range("engine_speed_low", 100.0, 3000.0, "r/min"),
    Range("engine_speed_high", 100.0, 3000.0, "r/min"),
    Range("engine_speed_rate", 10.0, 1e4, "r/min/s"),
    Range("displacement_rate", 0.05, 100.0, "1/s"),
    Range("stage_change_time", 0.0, 10.0, "s"),
    Range("stage_change_loss", 0.0, 1e6, "J"),
    Range("torque_reserve", 0.0, 0.9, "-", "a part of the full-load torque"),
)


@dataclass(frozen=True)
class Limits:
    """What the machine can do; no strategy and no bound goes beyond.

    Attributes:
        engine_speed_low: lowest engine speed [rad/s].
        engine_speed_high: highest engine speed [rad/s].
        engine_speed_rate: highest change of the engine speed [rad/s2].
        displacement_rate: highest change of the displacement ratio [1/s].
        stage_change_time: time of a stage change, in which the swash plate rests [s].
        stage_change_loss: energy that a stage change takes from the engine [J].
        torque_reserve: part of the full-load torque that is kept where the demand leaves it [-].

    Raises:
        InputError: a value is no number or out of range.
    """

    engine_speed_low: float = 800.0 * RPM
    engine_speed_high: float = 2200.0 * RPM
    engine_speed_rate: float = 300.0 * RPM
    displacement_rate: float = 2.0
    stage_change_time: float = 0.3
    stage_change_loss: float = 5000.0
    torque_reserve: float = 0.1

    def __post_init__(self) -> None:
        _require_ranges(self, _LIMIT_RANGES, "limits")
        _require_order(
            self.engine_speed_low, self.engine_speed_high, "limits.engine_speed"
        )


@dataclass(frozen=True)
class Vehicle:
    """What lies between output shaft and ground, and between engine and PTO shaft.

    Attributes:
        mass: of the tractor [kg].
        tyre_radius: rolling radius [m].
        final_drive: output shaft speed / wheel speed [-].
        final_drive_efficiency: of final drive and axles [-].
        rolling_resistance: force / weight [-].
        slip: 1 - ground speed / wheel speed [-].
        pto_efficiency: PTO power / power taken from the engine [-].
        pto_speed_low: lowest engine speed while the PTO works [rad/s].
        pto_speed_high: highest engine speed while the PTO works [rad/s].
        limits: of the machine.

    Raises:
        InputError: a value is no number or out of range.
    """

    mass: float = 7500.0
    tyre_radius: float = 0.85
    final_drive: float = 21.0
    final_drive_efficiency: float = 0.97
    rolling_resistance: float = 0.06
    slip: float = 0.08
    pto_efficiency: float = 0.95
    pto_speed_low: float = 1850.0 * RPM
    pto_speed_high: float = 2050.0 * RPM
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        _require_ranges(self, _VEHICLE_RANGES, "vehicle")
        _require_order(self.pto_speed_low, self.pto_speed_high, "pto_speed")

    def output_speed(self, ground_speed: Any, slip: Any) -> Any:
        """Return the speed of the output shaft [rad/s] at ground speeds [m/s] and slips [-]."""
        return ground_speed / (1.0 - slip) / self.tyre_radius * self.final_drive


_MEASURED = {"r/min": "speed", "-": "part", "s": "time"}
"""What units of keys measure whose other units are those of tables."""
_OTHER_UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "kg": {"t": 1e3, "lb": 0.45359237},
        "m": {"mm": 1e-3, "cm": 1e-2, "in": 0.0254},
        "r/min/s": {"rpm/s": 1.0, "rad/s2": 1.0 / RPM},
        "J": {"kJ": 1e3},
    }
)
"""Other units that a value of the rest may state, and their size in the one of its key."""

_QUANTITY = {"value": None, "unit": None}
_KNOWN: dict[str, Any] = {
    "schema": None,
    "name": None,
    "source": None,
    "limits": {limits.name: _QUANTITY for limits in _LIMIT_RANGES},
    **{limits.name: _QUANTITY for limits in _VEHICLE_RANGES},
}


def load_vehicle(path: str | os.PathLike[str]) -> Vehicle:
    """Read a vehicle file (`params/vehicle.yaml`); a key left out has the shipped value.

    Raises:
        InputError: the file is missing or damaged, a key is not known, a unit is another one, or a
            value is out of range; file and key are named.
    """
    with named(path):
        data, tree = read_tree(path, SCHEMA)
        require_known(tree, _KNOWN)
        section = data.get("limits", {})
        if not isinstance(section, Mapping):
            raise InputError(f"limits = {section!r} is not a mapping")
        limits = Limits(**_values(section, _LIMIT_RANGES, "limits."))
        return Vehicle(**_values(data, _VEHICLE_RANGES, ""), limits=limits)


def _values(
    data: Mapping[Any, Any], ranges: tuple[Range, ...], where: str
) -> dict[str, float]:
    """Return the stated values of a mapping in SI."""
    values = {}
    for limits in ranges:
        if limits.name not in data:
            continue
        entry = _in_unit(data[limits.name], limits.unit)
        value, stated_at = quantity(entry, limits.unit, f"{where}{limits.name}")
        checked = Range(stated_at, limits.low, limits.high, limits.unit, limits.hint)
        values[limits.name] = float(checked.check(value)) * _UNITS.get(limits.unit, 1.0)
    return values


def _in_unit(entry: Any, unit: str) -> Any:
    """Return `{value, unit}` in the unit of its key; anything else as it is."""
    if not isinstance(entry, Mapping):
        return entry
    size = _size_in(str(entry.get("unit", unit)), unit)
    value = entry.get("value")
    if size is None or isinstance(value, bool) or not isinstance(value, (int, float)):
        return entry
    return {**entry, "value": size * value, "unit": unit}


def _size_in(text: str, unit: str) -> float | None:
    """Return the size of a unit in that of a key; None where it is no such unit.

    Args:
        text: as the file states it.
        unit: of the key.
    """
    kind = _MEASURED.get(unit)
    if kind is None:
        return _OTHER_UNITS.get(unit, {}).get(text)
    known = unit_of(text)
    try:
        size, zero = to_si(kind, text if known is None else known.name)
    except KeyError:
        return None
    if zero:
        return None
    return size / to_si(kind, unit)[0]


def _require_ranges(
    part: Vehicle | Limits, ranges: tuple[Range, ...], where: str
) -> None:
    """Raise an `InputError` where a value in SI is no number or out of its range."""
    for limits in ranges:
        size = _UNITS.get(limits.unit, 1.0)
        unit = _SI_UNITS.get(limits.unit, limits.unit)
        in_si = replace(
            limits, low=size * limits.low, high=size * limits.high, unit=unit
        )
        in_si.check(getattr(part, limits.name), where)


def _require_order(low: float, high: float, name: str) -> None:
    if not low < high:
        raise InputError(
            f"{name}_low = {low / RPM:g} r/min is not below {name}_high = "
            f"{high / RPM:g} r/min"
        )
