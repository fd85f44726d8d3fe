# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tests of one pump or motor: losses of flow and torque, from a bench or a maker's table."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..transmission.ranges import OIL_TEMPERATURE, Array, Range
from .guess import UNITS
from .table import Table, read_plain

KINDS = ("pump", "motor")
AXES = ("displacement_ratio", "speed", "pressure")

METER_DEVIATION = 0.0034
"""Standard deviation of a flow or torque against the ideal one, as a part, if nobody states it.

ISO 4409, class A: errors up to 0.5 % of each reading, three deviations. Four readings are in it:
flow and speed, or torque and pressure, and those two by which the displacement was found.
"""
_GAUGE_DEVIATION = 5e4  # Pa; the same class near zero, as of a transmission's pressure

_TURN = 2.0 * np.pi
_CM3 = dict.fromkeys(
    ("cm3", "cc", "cm3/r", "cc/r", "cm3/rev", "cc/rev", "ml/r"), 1e-6 / _TURN
)
_PART = UNITS["efficiency"]
_UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "displacement_ratio": _PART,
        "stroke": _PART,
        "displacement": {"m3/rad": 1.0, "m3/r": 1.0 / _TURN, **_CM3},
        "speed": UNITS["engine_speed"],
        "pressure": UNITS["pressure"],
        "flow_loss": {"m3/s": 1.0, "l/min": 1.0 / 6e4},
        "torque_loss": UNITS["engine_torque"],
        "volumetric_efficiency": _PART,
        "volumetric": _PART,
        "mechanical_efficiency": _PART,
        "mechanical": _PART,
        "oil_temperature": dict.fromkeys(
            ("deg C", "degC", "C", "\N{DEGREE SIGN}C"), 1.0
        ),
    }
)
_MEANT = {
    "stroke": "displacement_ratio",
    "volumetric": "volumetric_efficiency",
    "mechanical": "mechanical_efficiency",
}
_WRITTEN = {
    f"{name}_{unit}".lower().replace(" ", "_").rstrip("_"): (
        _MEANT.get(name, name),
        size,
    )
    for name, units in _UNITS.items()
    for unit, size in {"": 1.0, **units}.items()
}
_LOSSES = ("flow_loss", "torque_loss")
_EFFICIENCIES = ("volumetric_efficiency", "mechanical_efficiency")
_RANGES = {
    limits.name: limits
    for limits in (
        Range(
            "displacement_ratio",
            0.01,
            1.0,
            "-",
            "a fraction of full stroke, not percent",
        ),
        Range("displacement", 1e-7, 1e-3, "m3/rad", "is it in cm3 per revolution?"),
        Range("pressure", 0.0, 1e8, "Pa", "difference between the ports, not negative"),
        # Another displacement than the one stated takes them a little above one.
        *(
            Range(name, 1e-4, 1.1, "-", "a fraction, not percent")
            for name in _EFFICIENCIES
        ),
        Range("noise", 1e-6, 0.2, "-", "a part of flow and torque"),
        OIL_TEMPERATURE,
    )
}
_SIZED_SPEED = (
    15.0  # m/s, speed x displacement^(1/3): makers' limits lie between 3 and 10
)
_LEAST_PRESSURE = 1e6  # Pa: no unit's tests end below
TELLING = 1e5
"""Pressure below which a mechanical efficiency tells no torque [Pa]."""


@dataclass(frozen=True, eq=False)
class UnitSamples:
    """Steady points of one pump or motor; every array has shape (n,).

    Attributes:
        kind: `pump` or `motor`.
        displacement: of full stroke, by which the losses are reckoned [m3/rad].
        displacement_ratio, speed, pressure: [-], [rad/s], [Pa] between the ports.
        flow_loss: what a pump does not deliver or a motor takes too much [m3/s].
        torque_loss: what a pump takes too much or a motor does not give [N m].
        oil_temperature: [deg C], or None.
        noise: standard deviation of flow and torque, as a part, or None for `METER_DEVIATION`.
        source, sha256: of the file.
    """

    kind: str
    displacement: float
    displacement_ratio: Array
    speed: Array
    pressure: Array
    flow_loss: Array
    torque_loss: Array
    oil_temperature: Array | None = None
    noise: float | None = None
    source: str = "samples"
    sha256: str = ""

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def losses(self) -> Array:
        """Loss of flow and of torque, shape (2, n)."""
        return np.stack([self.flow_loss, self.torque_loss])

    @property
    def ideal(self) -> Array:
        """Flow [m3/s] and torque [N m] without any loss, shape (2, n)."""
        return (
            self.displacement
            * self.displacement_ratio
            * np.stack([self.speed, self.pressure])
        )

    @property
    def deviation(self) -> Array:
        """Standard deviation of `losses`: that of what the meters read, shape (2, n)."""
        part = METER_DEVIATION if self.noise is None else self.noise
        read = self.ideal + self.losses * np.array([[-1.0], [1.0]]) * sign_of(self.kind)
        gauge = np.stack(
            [0.0 * self.pressure, _GAUGE_DEVIATION / np.maximum(self.pressure, 1.0)]
        )
        return np.asarray(np.abs(read) * np.hypot(part, gauge))

    def select(self, index: NDArray[Any]) -> UnitSamples:
        """Return the samples at an index array or mask, in that order."""
        return replace(
            self,
            **{
                item.name: value[index]
                for item in fields(self)
                if isinstance(value := getattr(self, item.name), np.ndarray)
            },
        )

    def divided(self, axis: str, part: float) -> tuple[UnitSamples, UnitSamples]:
        """Return the samples up to a part of the highest value along an axis, and those above.

        Raises:
            InputError: none lies above, or none that tells a torque below.
        """
        above = (values := getattr(self, axis)) > part * values.max()
        if not above.any() or self.pressure[~above].max(initial=0.0) < TELLING:
            raise InputError(
                f"{self.source}: {part:g} of the highest {axis} parts no samples"
            )
        return self.select(~above), self.select(above)


def sign_of(kind: str) -> float:
    """1 for a pump, -1 for a motor, whose power goes the other way."""
    return 1.0 if kind == "pump" else -1.0


def read_unit(
    path: str | os.PathLike[str],
    *,
    kind: str | None = None,
    unit: str | None = None,
    noise: float | None = None,
) -> UnitSamples:
    """Read the tests of one unit from CSV, or a maker's table; its columns are in docs/units.md.

    Args:
        path: CSV file, as `read_bench` takes it.
        kind: `pump` or `motor`, where no column says so.
        unit: which one, of several.
        noise: standard deviation of flow and torque, as a part.

    Raises:
        InputError: the file cannot be read, a column is missing, or a value is no number, outside
            its range, in another unit, in percent, or the efficiencies are swapped.
    """
    if noise is not None:
        noise = float(_RANGES["noise"].check(noise))
    factors: dict[str, float] = {}  # from the unit of a column to SI

    def name_of(cell: str) -> str:
        plain = re.sub(r"[\s()\[\]:]+", "_", cell.strip()).strip("_").lower()
        name, factors[name] = _WRITTEN.get(
            plain, (plain if plain in ("kind", "unit") else cell.strip(), 1.0)
        )
        return name

    cells = _of_unit(read_plain(path, name_of=name_of), unit)
    given = {cell.strip().lower() for cell in cells.columns.get("kind", [])} | {
        kind
    } - {None}
    if len(given) != 1 or not given <= {*KINDS}:
        told = " and ".join(sorted(map(str, given))) or "missing"
        raise InputError(
            f"{cells.source}: kind is {told}; needs one of {', '.join(KINDS)}, "
            "in a column or by --kind"
        )
    read = _numbers(cells, factors)
    nothing = np.zeros(len(cells.rows))
    columns = {
        "displacement_ratio": nothing + 1.0,
        **dict.fromkeys(_LOSSES, nothing),
        **read,
    }
    displacement = float(columns.pop("displacement")[0])
    parts = [columns.pop(name) for name in _EFFICIENCIES if name in columns]
    samples = UnitSamples(
        str(*given),
        displacement,
        **columns,
        noise=noise,
        source=cells.source,
        sha256=cells.sha256,
    )
    if not parts:
        return samples
    _require_in_place(samples, *parts)
    # Against the ideal one: what a pump gives, or a motor takes, and the torque the other way.
    sign = sign_of(samples.kind)
    flow, torque = (
        sign
        * samples.ideal
        * np.stack([1.0 - parts[0] ** sign, parts[1] ** -sign - 1.0])
    )
    return replace(samples, flow_loss=flow, torque_loss=torque)


def _of_unit(cells: Table, unit: str | None) -> Table:
    names = cells.columns.get("unit", [unit or ""] * len(cells.rows))
    there = ", ".join(dict.fromkeys(names))
    rows = [i for i, name in enumerate(names) if unit in (None, name)]
    if not rows or (unit is None and len(set(names)) > 1):
        raise InputError(f"{cells.source}: --unit names one of {there}")
    return replace(
        cells,
        rows=[cells.rows[i] for i in rows],
        columns={
            name: [column[i] for i in rows] for name, column in cells.columns.items()
        },
    )


def _numbers(cells: Table, factors: Mapping[str, float]) -> dict[str, Array]:
    there = cells.columns.keys()
    pair = next(
        (pair for pair in (_LOSSES, _EFFICIENCIES) if there >= {*pair}),
        _LOSSES if {*_LOSSES} & there else _EFFICIENCIES,
    )
    needed = ("displacement", "speed", "pressure", *pair)
    missing = [name for name in needed if name not in cells.columns]
    if missing:
        raise InputError(
            f"{cells.source}: column {', '.join(missing)} is missing; there is "
            f"{', '.join(cells.columns)} (a unit may stand behind the name: pressure_bar)"
        )
    names = [
        *needed,
        *({"displacement_ratio", "oil_temperature"} & cells.columns.keys()),
    ]
    values: dict[str, Array] = {}
    for name in names:
        values[name] = factors[name] * cells.numbers(name)
        if name == _EFFICIENCIES[1]:  # whatever stands there without pressure
            values[name] = np.where(values["pressure"] < TELLING, 1.0, values[name])
        cells.require_range(values[name], _RANGES.get(name) or _sized(name, values))
    if np.ptp(values["displacement"]) > 1e-6 * values["displacement"][0]:
        raise InputError(
            f"{cells.source}: displacement differs between rows: one unit at a time"
        )
    if (highest := values["pressure"].max()) < _LEAST_PRESSURE:
        raise InputError(
            f"{cells.source}: the highest pressure is {highest:g} Pa, below "
            f"{_LEAST_PRESSURE:g}: is it in bar or MPa? (pressure_bar)"
        )
    return values


def _sized(name: str, read: Mapping[str, Array]) -> Range:
    """Range of a quantity for a unit of the size read: in another unit it may suit a larger one."""
    displacement = float(read["displacement"][0])
    if name == "speed":
        return Range(
            name,
            0.1,
            _SIZED_SPEED / float(np.cbrt(displacement)),
            "rad/s",
            "a unit of this displacement runs slower: is it in r/min? (speed_rpm)",
        )
    driver, unit, other = {
        "flow_loss": ("speed", "m3/s", "L/min"),
        "torque_loss": ("pressure", "N m", "lb ft"),
    }[name]
    most = displacement * float(read[driver].max())
    return Range(
        name,
        -most,
        most,
        unit,
        "more than all that the unit moves: is it in "
        f"{other}, or displacement in another unit?",
    )


def _require_in_place(
    samples: UnitSamples, volumetric: Array, mechanical: Array
) -> None:
    """Refuse swapped efficiencies.

    The mechanical one gains on the volumetric one with pressure, and loses with speed.
    """
    told = samples.pressure > TELLING
    drivers = [
        driver[told] / driver.max() for driver in (samples.pressure, samples.speed)
    ]
    columns = np.stack([np.ones(int(told.sum())), *drivers], axis=1)
    (_, gained, lost), _, rank, _ = np.linalg.lstsq(
        columns, (mechanical - volumetric)[told], rcond=None
    )
    if rank == columns.shape[1] and gained < lost:
        raise InputError(
            f"{samples.source}: volumetric_efficiency gains on mechanical_efficiency "
            "with pressure, and loses with speed: are the two columns swapped?"
        )
