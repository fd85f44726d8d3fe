# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tests of one pump or motor: losses of flow and torque, from a bench or a maker's table."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from hmcvt_core.benches.unit.samples import (
    KINDS,
    LOSSES,
    MIN_TORQUE_PRESSURE,
    UnitSamples,
    sign_of,
)
from hmcvt_core.errors import InputError
from hmcvt_core.files.table import Table, read_plain
from hmcvt_core.transmission.ranges import OIL_TEMPERATURE, Array, Range

from .agreement import NEEDED, agree, agreeing_units
from .rules import unit_bench_meaning
from .units import holds_units, to_si, unit_of

AXES = ("displacement_ratio", "speed", "pressure")

_TURN = 2.0 * np.pi
_SHORT = {
    "stroke": "displacement_ratio",
    "volumetric": "volumetric_efficiency",
    "mechanical": "mechanical_efficiency",
    "overall": "overall_efficiency",
    "total_efficiency": "overall_efficiency",
    "etav": "volumetric_efficiency",
    "eta_v": "volumetric_efficiency",
    "etam": "mechanical_efficiency",
    "eta_m": "mechanical_efficiency",
    "eta_hm": "mechanical_efficiency",
    "etat": "overall_efficiency",
    "eta_t": "overall_efficiency",
    "qout": "flow",
    "q_out": "flow",
}
_QUANTITIES: Mapping[str, str] = MappingProxyType(
    {
        "displacement_ratio": "part",
        "displacement": "displacement",
        "speed": "speed",
        "pressure": "pressure",
        "flow": "flow",
        "flow_loss": "flow",
        "torque": "torque",
        "torque_loss": "torque",
        "volumetric_efficiency": "part",
        "mechanical_efficiency": "part",
        "overall_efficiency": "part",
        "oil_temperature": "temperature",
        "drain_flow": "flow",
        "electric_power": "power",
        "inlet_pressure": "pressure",
        "outlet_pressure": "pressure",
    }
)
"""Quantities of a unit's table and what their units measure."""
_EFFICIENCIES = ("volumetric_efficiency", "mechanical_efficiency")
_MEASURED = ("flow", "torque")
_WITH_OVERALL = ("volumetric_efficiency", "overall_efficiency")
_FLOW_WITH_OVERALL = ("flow", "overall_efficiency")
_PAIRS = (
    LOSSES,
    _EFFICIENCIES,
    _MEASURED,
    _WITH_OVERALL,
    _FLOW_WITH_OVERALL,
    ("flow", "mechanical_efficiency"),
    ("volumetric_efficiency", "torque"),
    ("flow_loss", "torque"),
    ("flow", "torque_loss"),
)
"""Pairs of columns that give both losses, the first whole one is taken."""
_FLOW_COLUMNS = ("flow", "flow_loss", "volumetric_efficiency")
_TORQUE_COLUMNS = ("torque", "torque_loss", "mechanical_efficiency")
"""Columns of which one suffices, where the other loss is not read."""
_PORTS = ("inlet_pressure", "outlet_pressure")
_OPTIONAL = ("displacement_ratio", "oil_temperature", "drain_flow", "electric_power")
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
            for name in (*_EFFICIENCIES, "overall_efficiency")
        ),
        Range("inlet_pressure", -1.1e5, 1e8, "Pa", "against the atmosphere"),
        Range("outlet_pressure", -1.1e5, 1e8, "Pa", "against the atmosphere"),
        Range("electric_power", 0.0, 1e6, "W", "is it in kW? (electric_power_kW)"),
        Range("noise", 1e-6, 0.2, "-", "a part of flow and torque"),
        OIL_TEMPERATURE,
    )
}
_SIZED_SPEED = (
    15.0  # m/s, speed x displacement^(1/3): makers' limits lie between 3 and 10
)
_MIN_PRESSURE = 1e6  # Pa: no unit's tests end below
_AGREEMENT = 0.05
"""Fraction by which flow and torque may differ from those of the efficiencies in the median:
class A meters differ by 1 %, and a wrong unit or displacement by more."""
_SAME_DISPLACEMENT = 1e-6
"""Fraction by which the displacements of one unit at full stroke differ between rows at most."""
_ABOVE_PLATE = 0.03
"""Fraction by which a displacement found by test (Toet, ISO 8426) may exceed that of the plate;
makers allow 2 to 3 %."""


def read_unit(
    path: str | os.PathLike[str],
    *,
    kind: str | None = None,
    unit: str | None = None,
    displacement: str | None = None,
    noise: float | None = None,
) -> UnitSamples:
    """Read the tests of one unit from CSV, or a maker's table; its columns are in docs/units.md.

    A flow or a drain flow is needed; a torque and an electric power may be missing.

    Args:
        path: CSV file, as `read_bench` takes it.
        kind: `pump` or `motor`, where no column says so.
        unit: which one, of several.
        displacement: at full stroke, with its unit, as `"56 cm3"`; a column of displacements
            that differ then gives the stroke.
        noise: standard deviation of flow and torque, as a part.

    Raises:
        InputError: the file cannot be read, a column is missing, or a value is no number, outside
            its range, in another unit, in percent, or the efficiencies are swapped.
    """
    if noise is not None:
        noise = float(_RANGES["noise"].check(noise))
    cells, units = _read(path)
    cells = _of_unit(cells, unit)
    given = {cell.strip().lower() for cell in cells.columns.get("kind", [])}
    if kind is not None:
        given.add(kind)
    concluded = []
    if not given:
        concluded = _kinds_that_agree(cells, units)
    if len(concluded) == 1:
        given.update(concluded)
    if len(given) != 1 or not given <= set(KINDS):
        stated = " and ".join(sorted(given)) or "missing"
        raise InputError(
            f"{cells.source}: kind is {stated}; needs one of {', '.join(KINDS)}, "
            "in a column or by --kind"
        )
    notes = _take_agreeing_units(cells, units, sign_of(next(iter(given))))
    if concluded:
        notes.append(
            f"taken as a {concluded[0]}: only so flow and torque agree with the efficiencies"
        )
    if displacement is not None:
        cells = _with_stroke(cells, units, displacement, notes)
    values = _numbers(cells, units)
    not_used = _not_used(cells)
    if not_used:
        notes.append(f"columns not used: {', '.join(not_used)}")
    nothing = np.zeros(len(cells.rows))
    samples = UnitSamples(
        given.pop(),
        float(values["displacement"][0]),
        values.get("displacement_ratio", nothing + 1.0),
        values["speed"],
        values["pressure"],
        nothing,
        nothing,
        values.get("oil_temperature"),
        noise=noise,
        source=cells.source,
        sha256=cells.sha256,
        drain_flow=values.get("drain_flow"),
        electric_power=values.get("electric_power"),
        notes=tuple(notes),
    )
    if set(_EFFICIENCIES) <= values.keys():
        _require_in_place(samples, *(values[name] for name in _EFFICIENCIES))
    flow_loss = torque_loss = None
    if not values.keys().isdisjoint(_FLOW_COLUMNS):
        flow_loss = _flow_loss(samples, values)
    if not values.keys().isdisjoint((*_TORQUE_COLUMNS, "overall_efficiency")):
        torque_loss = _torque_loss(samples, values, flow_loss)
    samples = replace(samples, flow_loss=flow_loss, torque_loss=torque_loss)
    if flow_loss is not None and torque_loss is not None:
        _refuse_other_routes(samples, cells, units)
    return samples


def _take_agreeing_units(cells: Table, units: dict[str, str], sign: float) -> list[str]:
    """Complete the units of a table that states none where its quantities show them.

    Args:
        cells: of the table.
        units: of its columns, `""` where none is stated; changed in place.
        sign: 1 for a pump, -1 for a motor.

    Returns:
        A note on the units taken; none where the table states its units or leaves them open.
    """
    stated = any(units.get(name) for name in _QUANTITIES)
    if stated or not set(NEEDED) <= cells.columns.keys():
        return []
    readings = {name: cells.numbers(name) for name in NEEDED}
    sets = agreeing_units(readings, sign, _AGREEMENT)
    if len(sets) != 1:
        return []
    taken = sets[0]
    for name, kind in _QUANTITIES.items():
        if name in cells.columns and kind in taken:
            units[name] = taken[kind]
    listed = ", ".join(f"{kind} in {unit}" for kind, unit in taken.items())
    return [
        f"no column states its unit; flow and torque agree with the efficiencies only with "
        f"{listed}"
    ]


def _kinds_that_agree(cells: Table, units: Mapping[str, str]) -> list[str]:
    """Return the kinds of unit for which flow and torque agree with the efficiencies.

    Args:
        cells: of the table; empty where a quantity of both is missing.
        units: of its columns, `""` where none is stated.
    """
    if not set(NEEDED) <= cells.columns.keys():
        return []
    kinds = []
    for kind in KINDS:
        if any(units.get(name) for name in NEEDED):
            values = {name: _in_si(name, cells, units) for name in NEEDED}
            agreeing = agree(values, sign_of(kind), _AGREEMENT)
        else:
            readings = {name: cells.numbers(name) for name in NEEDED}
            agreeing = bool(agreeing_units(readings, sign_of(kind), _AGREEMENT))
        if agreeing:
            kinds.append(kind)
    return kinds


def _with_stroke(
    cells: Table, units: dict[str, str], displacement: str, notes: list[str]
) -> Table:
    """Return the table with the full displacement, and with the stroke where it differs.

    Args:
        cells: of the table.
        units: of its columns; changed in place.
        displacement: at full stroke, with its unit.
        notes: on what was concluded; extended in place.
    """
    full = _full_displacement(displacement)
    columns = dict(cells.columns)
    if "displacement" in columns and "displacement_ratio" not in columns:
        strokes = _in_si("displacement", cells, units) / full
        largest = float(strokes.max(initial=0.0))
        if largest > 1.0 + _ABOVE_PLATE:
            raise InputError(
                f"{cells.source}: column displacement reaches {largest:.4g} times "
                f"--displacement {displacement}, which is full stroke: add --displacement "
                f"{_largest_displacement(cells, units)}"
            )
        if largest > 1.0:
            above = int(np.sum(strokes > 1.0))
            notes.append(
                f"{above} rows state a displacement of up to {100.0 * (largest - 1.0):.2g} % "
                f"above --displacement {displacement}; taken as full stroke"
            )
            strokes = np.minimum(strokes, 1.0)
        columns["displacement_ratio"] = [repr(stroke) for stroke in strokes.tolist()]
        units["displacement_ratio"] = ""
    elif "displacement" in columns:
        stated = _in_si("displacement", cells, units)
        if np.any(abs(stated / full - 1.0) > _SAME_DISPLACEMENT):
            raise InputError(
                f"{cells.source}: --displacement {displacement} differs from column "
                "displacement, and column displacement_ratio states the stroke"
            )
    columns["displacement"] = [repr(full)] * len(cells.rows)
    units["displacement"] = ""
    return replace(cells, columns=columns)


def _full_displacement(text: str) -> float:
    """Return a displacement with its unit, as `56 cm3`, in m3/rad."""
    match = re.fullmatch(r"\s*([\d.]+(?:[eE][+-]?\d+)?)[\s:]*(\S+)\s*", text)
    unit = unit_of(match[2]) if match is not None else None
    if match is None or unit is None or unit.kind != "displacement":
        raise InputError(
            f"displacement is {text!r}; it needs a number and its unit, as in 56:cm3"
        )
    size, _ = to_si("displacement", unit.name)
    try:
        return size * float(match[1])
    except ValueError:
        raise InputError(
            f"displacement is {text!r}: {match[1]!r} is no number"
        ) from None


def _refuse_other_routes(
    samples: UnitSamples, cells: Table, units: Mapping[str, str]
) -> None:
    """Compare measured flow and torque with those that the efficiencies give.

    Raises:
        InputError: the two differ in the median by more than `_AGREEMENT`.
    """
    present = cells.columns.keys()
    if set(_MEASURED).isdisjoint(present):
        return
    sign = sign_of(samples.kind)
    loaded = samples.pressure > MIN_TORQUE_PRESSURE
    flow, torque = samples.ideal + np.array([[-sign], [sign]]) * samples.losses
    power = flow * samples.pressure
    shaft_power = torque * samples.speed
    second = {
        "flow": flow,
        "torque": torque,
        "volumetric_efficiency": (flow / samples.ideal[0]) ** sign,
        "mechanical_efficiency": _efficiency(samples.ideal[1], torque, sign),
        "overall_efficiency": _efficiency(power, shaft_power, sign),
    }
    for name, values in second.items():
        if name not in present or any(not cell for cell in cells.columns[name]):
            continue
        stated = _in_si(name, cells, units)
        usable = loaded & (stated > 0.0) & (values > 0.0)
        if not usable.any():
            continue
        ratio = float(np.median(stated[usable] / values[usable]))
        if abs(np.log(ratio)) > _AGREEMENT:
            raise InputError(
                f"{cells.source}: {name} is {ratio:.3g} times that by the other columns: "
                "a column, a unit, or the displacement is wrong"
            )


def _efficiency(useful: Array, spent: Array, sign: float) -> Array:
    """Return the efficiency of a pump (sign 1), whose motor works the other way."""
    ratio = np.divide(
        useful, spent, out=np.full_like(useful, np.nan), where=spent > 0.0
    )
    return np.asarray(ratio**sign)


def _in_si(name: str, cells: Table, units: Mapping[str, str]) -> Array:
    size = 1.0
    zero = 0.0
    if units[name]:
        size, zero = to_si(_QUANTITIES[name], units[name])
    return np.asarray(size * (cells.numbers(name) - zero))


def _read(path: str | os.PathLike[str]) -> tuple[Table, dict[str, str]]:
    """Return the table under names of `_QUANTITIES`, and the unit of each column or `""`."""
    units: dict[str, str] = {}

    def name_of(cell: str) -> str:
        name, unit = column_of_unit_table(cell)
        units[name] = unit
        return name

    cells = read_plain(path, name_of=name_of)
    columns = cells.columns
    if not cells.rows or not holds_units([column[0] for column in columns.values()]):
        return cells, units
    for name, column in columns.items():
        below = unit_of(column[0])
        kind = _QUANTITIES.get(name)
        if kind is None or not column[0]:
            continue
        if below is None or (below.kind != kind and below.name != "-"):
            raise InputError(
                f"{cells.source}: row {cells.rows[0]}: {column[0]!r} is no unit of {name}"
            )
        if units[name] and below.name not in ("-", units[name]):
            raise InputError(
                f"{cells.source}: row {cells.rows[0]}: {name} is in {units[name]} by the "
                f"header and in {below.name} by the row of units"
            )
        units[name] = units[name] or below.name
    rest = {name: column[1:] for name, column in columns.items()}
    return replace(cells, rows=cells.rows[1:], columns=rest), units


def column_of_unit_table(cell: str) -> tuple[str, str]:
    """Return the quantity that a header cell names, else the cell, and its unit or `""`.

    Args:
        cell: such as `pressure_bar`, `flow [L/min]` or `Drehzahl (1/min)`.
    """
    plain = re.sub(r"[\s()\[\]:]+", "_", cell.strip()).strip("_").lower()
    if plain in ("kind", "unit"):
        return plain, ""
    names = sorted((*_QUANTITIES, *_SHORT), key=len, reverse=True)
    for name in names:
        if plain == name:
            return _SHORT.get(name, name), ""
        if not plain.startswith(f"{name}_"):
            continue
        quantity = _SHORT.get(name, name)
        unit = unit_of(plain[len(name) + 1 :].replace("_", " "))
        if unit is not None and unit.kind == _QUANTITIES[quantity]:
            return quantity, unit.name
    name, known = unit_bench_meaning(cell)
    if name in _QUANTITIES and (
        known is None or known.kind in ("part", _QUANTITIES[name])
    ):
        return name, known.name if known is not None else ""
    return cell.strip(), ""


def _flow_loss(samples: UnitSamples, values: Mapping[str, Array]) -> Array:
    """Return the flow that is lost [m3/s], against the ideal one."""
    if "flow_loss" in values:
        return values["flow_loss"]
    sign = sign_of(samples.kind)
    ideal = samples.ideal[0]
    if "flow" in values:
        return np.asarray(sign * (ideal - values["flow"]))
    return np.asarray(sign * ideal * (1.0 - values["volumetric_efficiency"] ** sign))


def _torque_loss(
    samples: UnitSamples, values: Mapping[str, Array], flow_loss: Array | None
) -> Array:
    """Return the torque that is lost [N m], against the ideal one."""
    if "torque_loss" in values:
        return values["torque_loss"]
    sign = sign_of(samples.kind)
    ideal = samples.ideal[1]
    if "torque" in values:
        return np.asarray(sign * (values["torque"] - ideal))
    if "mechanical_efficiency" in values:
        mechanical = values["mechanical_efficiency"]
    else:
        # ISO 4409: the overall efficiency is the product of the two others.
        assert (
            flow_loss is not None
        )  # `_PAIRS` has the overall efficiency with a flow only
        flow = samples.ideal[0] - sign * flow_loss
        volumetric = (flow / samples.ideal[0]) ** sign
        mechanical = values["overall_efficiency"] / volumetric
        mechanical = np.where(samples.pressure < MIN_TORQUE_PRESSURE, 1.0, mechanical)
    return np.asarray(sign * ideal * (mechanical**-sign - 1.0))


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


def _numbers(cells: Table, units: Mapping[str, str]) -> dict[str, Array]:
    """Return the quantities that the losses are made of, in SI units."""
    present = set(cells.columns)
    pressure: tuple[str, ...] = ("pressure",)
    if "pressure" not in present and set(_PORTS) <= present:
        pressure = _PORTS
    needed = ["displacement", "speed", *pressure, *_readings(present)]
    missing = [name for name in needed if name not in present]
    if missing:
        raise InputError(
            f"{cells.source}: column {', '.join(missing)} is missing; there is "
            f"{', '.join(cells.columns)} (a unit may stand behind the name: pressure_bar)"
        )
    optional = [name for name in _OPTIONAL if name in present]
    values: dict[str, Array] = {}
    for name in (*needed, *optional):
        values[name] = _in_si(name, cells, units)
        if name in ("mechanical_efficiency", "overall_efficiency"):
            # Without pressure it is 0 or whatever the maker prints.
            idle = values["pressure"] < MIN_TORQUE_PRESSURE
            values[name] = np.where(idle, 1.0, values[name])
        limits = _RANGES.get(name) or _sized(name, values)
        cells.require_range(values[name], limits)
        if name == "outlet_pressure":
            values["pressure"] = np.abs(values[name] - values["inlet_pressure"])
    if np.ptp(values["displacement"]) > _SAME_DISPLACEMENT * values["displacement"][0]:
        raise InputError(
            f"{cells.source}: displacement differs between rows: one unit at a time. Where "
            "they are strokes of one unit, state its displacement at full stroke: add "
            f"--displacement {_largest_displacement(cells, units)}"
        )
    if (highest := values["pressure"].max()) < _MIN_PRESSURE:
        raise InputError(
            f"{cells.source}: the highest pressure is {highest:g} Pa, below "
            f"{_MIN_PRESSURE:g}: is it in bar or MPa? (pressure_bar)"
        )
    return values


def _not_used(cells: Table) -> list[str]:
    """Return the columns of which neither a loss nor a comparison is made."""
    used = {*_QUANTITIES, "kind", "unit"}
    if "pressure" in cells.columns:
        used -= set(_PORTS)
    return [name for name in cells.columns if name not in used]


def _largest_displacement(cells: Table, units: Mapping[str, str]) -> str:
    """Return the largest displacement of a table, rounded up, as an option takes it."""
    largest = float(cells.numbers("displacement").max())
    digits = 3 - int(np.floor(np.log10(largest)))
    rounded = np.ceil(largest * 10.0**digits) / 10.0**digits
    return f"{rounded:.6g}:{units['displacement'] or 'm3/rad'}"


def _readings(present: set[str]) -> tuple[str, ...]:
    """Return the columns of flow and torque that are read.

    The first whole pair of columns gives both losses. Otherwise a flow alone suffices, or a drain
    flow; without them the pair is returned that should be completed.
    """
    for pair in _PAIRS:
        if set(pair) <= present:
            return pair
    of_flow = [name for name in _FLOW_COLUMNS if name in present]
    of_torque = [name for name in _TORQUE_COLUMNS if name in present]
    if of_flow:
        return (*of_flow[:1], *of_torque[:1])
    if "drain_flow" in present:
        return tuple(of_torque[:1])
    if set(LOSSES) & present:
        return LOSSES
    if set(_MEASURED) & present:
        return _MEASURED
    return _EFFICIENCIES


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
        "flow": ("speed", "m3/s", "L/min"),
        "flow_loss": ("speed", "m3/s", "L/min"),
        "drain_flow": ("speed", "m3/s", "L/min"),
        "torque": ("pressure", "N m", "lb ft"),
        "torque_loss": ("pressure", "N m", "lb ft"),
    }[name]
    most = displacement * float(read[driver].max())
    if name in _MEASURED:  # with the losses on top
        most = 1.3 * most + (10.0 if name == "torque" else 0.0)
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
    loaded = samples.pressure > MIN_TORQUE_PRESSURE
    drivers = [
        driver[loaded] / driver.max() for driver in (samples.pressure, samples.speed)
    ]
    columns = np.stack([np.ones(int(loaded.sum())), *drivers], axis=1)
    (_, gained, lost), _, rank, _ = np.linalg.lstsq(
        columns, (mechanical - volumetric)[loaded], rcond=None
    )
    if rank == columns.shape[1] and gained < lost:
        raise InputError(
            f"{samples.source}: volumetric_efficiency gains on mechanical_efficiency "
            "with pressure, and loses with speed: are the two columns swapped?"
        )
