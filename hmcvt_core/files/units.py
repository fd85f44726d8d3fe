# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tests of one hydrostatic unit: losses of flow and torque, as values, and from makers' tables."""

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
from ..transmission.ranges import OIL_TEMPERATURE, Range
from .bench import UNITS
from .columns import Cells, decimal_points, holds_units, read_cells

Array = NDArray[np.float64]
KINDS = ("pump", "motor")
AXES = ("displacement_ratio", "speed", "pressure")

METER_DEVIATION = 0.0035
"""Standard deviation of a flow or torque, as a part, where nobody states one.

ISO 4409, class A: errors up to 0.5 % of flow, torque, speed and pressure each; half of that is one
deviation, and two of them make an efficiency.
"""
PRESSURE_DEVIATION = 5e4  # Pa; the same class near zero, as of a transmission's pressure

_TURN = 2.0 * np.pi
_CM3 = dict.fromkeys(("cm3", "cc", "cm3/r", "cc/r", "cm3/rev", "cc/rev", "ml/r"), 1e-6 / _TURN)
_UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType({
    "displacement_ratio": UNITS["efficiency"],
    "displacement": {"m3/rad": 1.0, "m3/r": 1.0 / _TURN, **_CM3},
    "speed": UNITS["engine_speed"],
    "pressure": UNITS["pressure"],
    "flow_loss": {"m3/s": 1.0, "l/min": 1.0 / 6e4},
    "torque_loss": UNITS["engine_torque"],
    "volumetric_efficiency": UNITS["efficiency"],
    "mechanical_efficiency": UNITS["efficiency"],
    "oil_temperature": UNITS["oil_temperature"],
})
_ALIASES = {"volumetric": "volumetric_efficiency", "mechanical": "mechanical_efficiency",
            "hydromechanical_efficiency": "mechanical_efficiency", "stroke": "displacement_ratio"}
_RANGES = {limits.name: limits for limits in (
    Range("displacement_ratio", 0.01, 1.0, "-", "a fraction of full stroke, not percent"),
    Range("displacement", 1e-7, 1e-3, "m3/rad", "is it in cm3 per revolution?"),
    Range("speed", 0.1, 1200.0, "rad/s", "is it in r/min?"),
    Range("pressure", 0.0, 1e8, "Pa", "difference between the ports, not negative"),
    Range("flow_loss", -0.01, 0.1, "m3/s", "is it in L/min?"),
    Range("torque_loss", -500.0, 5000.0, "N m"),
    # A wrong reference displacement takes them a little above one.
    Range("volumetric_efficiency", 1e-4, 1.1, "-", "a fraction, not percent"),
    Range("mechanical_efficiency", 1e-4, 1.1, "-", "a fraction, not percent"),
    OIL_TEMPERATURE)}
_SIZED_SPEED = 15.0  # m/s, speed x displacement^(1/3): makers' limits lie between 3 and 10
_LEAST_PRESSURE = 1e6  # Pa: no unit's tests end below
TELLING = 1e5
"""Pa; below, a mechanical efficiency says nothing of the torque."""


@dataclass(frozen=True, eq=False)
class UnitSamples:
    """Steady points of one pump or motor; every array has shape (n,).

    Attributes:
        kind: `pump` or `motor`.
        displacement: by which the losses are reckoned, of full stroke [m3/rad].
        displacement_ratio: [-].
        speed: of the shaft [rad/s].
        pressure: difference between the ports [Pa].
        flow_loss: ideal less delivered flow of a pump, taken less ideal flow of a motor [m3/s].
        torque_loss: taken less ideal torque of a pump, ideal less given torque of a motor [N m].
        flow_std, torque_std: their standard deviations.
        noise_source: who states these.
        assumed: whether nobody does.
        oil_temperature: [deg C], or None.
        source, sha256: of the file.
    """

    kind: str
    displacement: float
    displacement_ratio: Array
    speed: Array
    pressure: Array
    flow_loss: Array
    torque_loss: Array
    flow_std: Array
    torque_std: Array
    noise_source: str
    assumed: bool = True
    oil_temperature: Array | None = None
    source: str = "samples"
    sha256: str = ""

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def ideal_flow(self) -> Array:
        """Displacement x stroke x speed [m3/s]."""
        return self.displacement * self.displacement_ratio * self.speed

    @property
    def ideal_torque(self) -> Array:
        """Displacement x stroke x pressure [N m]."""
        return self.displacement * self.displacement_ratio * self.pressure

    def select(self, index: NDArray[Any]) -> UnitSamples:
        """Return the samples at an index array or mask, in that order."""
        return replace(self, **{item.name: value[index] for item in fields(self)
                                if isinstance(value := getattr(self, item.name), np.ndarray)})

    def divided(self, axis: str, part: float) -> tuple[UnitSamples, UnitSamples]:
        """Return the samples up to a part of the highest value along an axis, and those above.

        Raises:
            InputError: one of them is empty.
        """
        values = getattr(self, axis)
        above = values > part * values.max()
        if above.all():
            raise InputError(f"{self.source}: no sample lies below {part:g} of the highest {axis}")
        return self.select(~above), self.select(above)


def unit_samples(
    kind: str, displacement: float, points: Mapping[str, Array], losses: tuple[Array, Array] | None,
    efficiencies: tuple[Array, Array] | None = None, noise: float | None = None, **more: Any,
) -> UnitSamples:
    """Make samples of losses, or of volumetric and mechanical efficiency, with their noise.

    Args:
        kind, displacement: of the unit.
        points: `displacement_ratio`, `speed`, `pressure` and `oil_temperature` if it is known.
        losses: of flow [m3/s] and torque [N m].
        efficiencies: where the losses are not read [-].
        noise: standard deviation of flow and torque, as a part; None for `METER_DEVIATION`.
        more: `source` and `sha256`.
    """
    part = METER_DEVIATION if noise is None else noise
    flow, torque = (displacement * points["displacement_ratio"] * points[name]
                    for name in ("speed", "pressure"))
    if losses is not None:
        flow_slope, torque_slope = np.ones_like(flow), np.ones_like(flow)
    elif efficiencies is None:
        raise InputError("neither losses nor efficiencies are given")
    else:
        volumetric, mechanical = efficiencies
        # Slopes: of the loss by the logarithm of the efficiency, per ideal flow or torque.
        if kind == "pump":
            losses = flow * (1.0 - volumetric), torque * (1.0 / mechanical - 1.0)
            flow_slope, torque_slope = volumetric, 1.0 / mechanical
        else:
            losses = flow * (1.0 / volumetric - 1.0), torque * (1.0 - mechanical)
            flow_slope, torque_slope = 1.0 / volumetric, mechanical
    gauge = displacement * points["displacement_ratio"] * PRESSURE_DEVIATION
    return UnitSamples(
        kind, displacement, points["displacement_ratio"], points["speed"], points["pressure"],
        *losses, part * flow * flow_slope, np.hypot(part * torque, gauge) * torque_slope,
        "given" if noise is not None else "assumed, ISO 4409 class A", noise is None,
        points.get("oil_temperature"), **more)


def read_unit(
    path: str | os.PathLike[str], *, kind: str | None = None, unit: str | None = None,
    noise: float | None = None,
) -> UnitSamples:
    """Read the tests of one unit from CSV, or a maker's table.

    Columns: `kind`, `displacement`, `displacement_ratio` (1 if absent), `speed`, `pressure`, and
    `flow_loss` and `torque_loss` or `volumetric_efficiency` and `mechanical_efficiency`; optional
    `oil_temperature`, and `unit` where the table holds several. SI, or with the unit behind the
    name: `pressure_bar`, `speed [r/min]`, `displacement_cm3`, `flow_loss_L/min`.

    Args:
        path: CSV file, as `read_bench` takes it.
        kind: `pump` or `motor`, where no column says so.
        unit: which one, of several.
        noise: standard deviation of flow and torque, as a part.

    Raises:
        InputError: the file cannot be read, a column is missing, or a value is no number, outside
            its range, in another unit, in percent, or the efficiencies are swapped.
    """
    factors: dict[str, float] = {}

    def names(header: list[str]) -> list[str]:
        known = list(map(_quantity, header))
        factors.update(known)
        return [name for name, _ in known]

    cells = _chosen(read_cells(path, (), names), unit)
    values = _numbers(cells, factors)
    kind = _kind(cells, kind)
    _require_plausible(values, cells)
    stroke = values.setdefault("displacement_ratio", np.ones(len(cells.rows)))
    points = {name: values[name] for name in (*AXES, "oil_temperature") if name in values}
    displacement = float(values["displacement"][0])
    losses = efficiencies = None
    if "flow_loss" in values:
        losses = values["flow_loss"], values["torque_loss"]
        for name, loss, ideal in (("flow_loss", losses[0], displacement * stroke * values["speed"]),
                                  ("torque_loss", losses[1], np.full(len(stroke), (
                                      displacement * values["pressure"].max())))):
            if (wrong := np.flatnonzero(np.abs(loss) > ideal)).size:
                raise InputError(
                    f"{cells.source}: row {cells.rows[wrong[0]]}: {name} = {loss[wrong[0]]:g} "
                    f"{_RANGES[name].unit} is more than the whole of the unit, "
                    f"{ideal[wrong[0]]:.3g}: check its unit, and that of displacement")
    else:
        efficiencies = values["volumetric_efficiency"], values["mechanical_efficiency"]
        _require_in_place(values, cells)
    return unit_samples(kind, displacement, points, losses, efficiencies, noise,
                        source=cells.source, sha256=cells.sha256)


def _quantity(cell: str) -> tuple[str, float]:
    """Name of a column of a table, and size of its unit in SI; others stay as they are."""
    plain = re.sub(r"[\s()\[\]:]+", "_", cell.strip()).strip("_").lower()
    for name in (*_UNITS, *_ALIASES):  # none begins with another and an underscore but the stroke
        quantity = _ALIASES.get(name, name)
        for unit, factor in {"": 1.0, **_UNITS[quantity]}.items():
            if plain == f"{name}_{unit}".lower().replace(" ", "_").rstrip("_"):
                return quantity, factor
    return (plain if plain in ("kind", "unit") else cell.strip()), 1.0


def _chosen(cells: Cells, unit: str | None) -> Cells:
    """The rows of one unit."""
    names = cells.columns.get("unit", [""] * len(cells.rows))
    there = list(dict.fromkeys(names))
    if unit is None and len(there) > 1:
        raise InputError(f"{cells.source}: holds {', '.join(there)}: --unit is needed")
    rows = [i for i, name in enumerate(names) if unit in (None, name)]
    if not rows:
        raise InputError(f"{cells.source}: holds no unit {unit!r}; there is {', '.join(there)}")
    return cells._replace(rows=[cells.rows[i] for i in rows], columns={
        name: [column[i] for i in rows] for name, column in cells.columns.items()})


def _numbers(cells: Cells, factors: Mapping[str, float]) -> dict[str, Array]:
    pairs = (("flow_loss", "torque_loss"), ("volumetric_efficiency", "mechanical_efficiency"))
    pair = next((pair for pair in pairs if pair[0] in cells.columns), pairs[1])
    missing = [name for name in ("displacement", "speed", "pressure", *pair)
               if name not in cells.columns]
    if missing:
        raise InputError(
            f"{cells.source}: column {', '.join(missing)} is missing; there is "
            f"{', '.join(cells.columns)} (a unit may stand behind the name: pressure_bar)")
    names = [name for name in (*missing, "displacement", "displacement_ratio", "speed", "pressure",
                               *pair, "oil_temperature") if name in cells.columns]
    if holds_units([cells.columns["speed"][0]]):
        raise InputError(f"{cells.source}: row {cells.rows[0]}: speed is no number; write units "
                         "behind the names of the columns, such as speed_rpm")
    cells, values = decimal_points(cells, names), {}
    for name in names:
        values[name] = factors[name] * cells.numbers(name)
        cells.require_range(values[name], _RANGES[name])
    return values


def _kind(cells: Cells, given: str | None) -> str:
    there = sorted({cell.strip().lower() for cell in cells.columns.get("kind", [given or ""])})
    if len(there) > 1 or there[0] not in KINDS or given not in (None, there[0]):
        raise InputError(f"{cells.source}: kind is {' and '.join(filter(None, there)) or 'missing'}"
                         f"{'' if given is None else f', --kind {given}'}; needs one of "
                         f"{', '.join(KINDS)}")
    return there[0]


def _require_plausible(values: Mapping[str, Array], cells: Cells) -> None:
    """Refuse what is in range and yet in another unit."""
    displacement, speed, pressure = (values[name] for name in ("displacement", "speed", "pressure"))
    if np.ptp(displacement) > 1e-6 * displacement[0]:
        row = int(np.argmax(np.abs(displacement - displacement[0])))
        raise InputError(f"{cells.source}: row {cells.rows[row]}: displacement = "
                         f"{displacement[row]:g} m3/rad; the rows above have {displacement[0]:g}: "
                         "one unit at a time")
    if pressure.max() < _LEAST_PRESSURE:
        raise InputError(f"{cells.source}: the highest pressure is {pressure.max():g} Pa, below "
                         f"{_LEAST_PRESSURE:g}: is it in bar or MPa? (pressure_bar)")
    fastest, limit = float(speed.max()), _SIZED_SPEED / float(np.cbrt(displacement[0]))
    if fastest > limit:
        raise InputError(f"{cells.source}: the highest speed is {fastest:g} rad/s; a unit of "
                         f"{displacement[0]:.3g} m3/rad runs up to {limit:.0f}: is it in r/min? "
                         "(speed_rpm)")


def _require_in_place(values: Mapping[str, Array], cells: Cells) -> None:
    """Refuse swapped efficiencies.

    The volumetric one falls with pressure and rises with speed, against the mechanical one.
    """
    speed, pressure = (values[name] / values[name].max() for name in ("speed", "pressure"))
    told = values["pressure"] > TELLING
    columns = np.stack([np.ones_like(speed), pressure, speed], axis=1)[told]
    apart = (values["mechanical_efficiency"] - values["volumetric_efficiency"])[told]
    _, by_pressure, by_speed = np.linalg.lstsq(columns, apart)[0]
    if by_pressure < by_speed:
        raise InputError(
            f"{cells.source}: volumetric_efficiency gains on mechanical_efficiency with pressure "
            "and loses with speed: are the two columns swapped?")
