# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A work cycle: what the driver asks for, second by second, at the output shaft.

A row of a cycle file holds until the next one. A file that is finer than the step of the mission is
averaged. Rows that miss a value, and gaps between rows, are left out and named; the rest goes on.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.errors import InputError
from hmcvt_core.files import data_path
from hmcvt_core.files.table import Table, read_plain
from hmcvt_core.transmission.quantities import real_numbers
from hmcvt_core.transmission.ranges import OUTPUT_SPEED, Array, Range
from hmcvt_core.transmission.units import KIND_UNITS, plain_text

from ..tables.rules import meaning_of
from ..tables.units import to_si, unit_of
from .vehicle import Vehicle

CYCLES = ("ploughing", "rotary_tilling", "transport", "sowing", "loader")
"""Names of the shipped cycles, `data/cycle_<name>.csv`."""

STEP = 1.0
"""Step of a mission when none is given [s]."""

MAX_STEPS = 10_800
"""Longest cycle: three hours at 1 s; its tables take about 1 GB of memory."""

_GRAVITY = 9.81
_GAP = 5.0  # median steps between two rows: more is a gap
_CREEPING = 0.05
"""Part of the highest output speed below which a change of direction counts as from standstill."""
_PARTS_OF_A_STEP = 10  # at which a fine file is averaged

_COLUMNS: dict[str, tuple[Range, str]] = {
    "time": (Range("time", 0.0, 1e12, "s"), "time"),
    "output_speed": (
        Range("output_speed", -1000.0, 1000.0, "rad/s", "is it in r/min?"),
        "speed",
    ),
    "ground_speed": (
        Range("ground_speed", -20.0, 20.0, "m/s", "is it in km/h?"),
        "velocity",
    ),
    "output_power": (Range("output_power", -1e6, 1e6, "W"), "power"),
    "output_torque": (Range("output_torque", -1e5, 1e5, "N m"), "torque"),
    "drawbar_force": (Range("drawbar_force", -5e5, 5e5, "N"), "force"),
    "pto_power": (Range("pto_power", 0.0, 1e6, "W"), "power"),
    "auxiliary_power": (Range("auxiliary_power", 0.0, 1e6, "W"), "power"),
    "lowest_engine_speed": (
        Range("lowest_engine_speed", 0.0, 320.0, "rad/s", "is it in r/min?"),
        "speed",
    ),
    "slope": (Range("slope", -0.5, 0.5, "-", "rise / distance"), "part"),
    "rolling_resistance": (Range("rolling_resistance", 0.0, 0.6, "-"), "part"),
    "slip": (Range("slip", 0.0, 0.6, "-", "a fraction, not percent"), "part"),
}
"""Range of each column, and what its unit measures, a key of `KIND_UNITS`."""
_OTHER_NAMES: Mapping[str, str] = MappingProxyType(
    {
        "time": "stamp cyc_secs cyc_time second seconds elapsed_time total_elapsed_time "
        "zeit t temps tiempo tempo \u65f6\u95f4",
        "ground_speed": "speed vehicle_speed velocity v v_ist v_act v_veh cyc_mps mps gps_speed "
        "actual_speed speed_actual driving_speed travel_speed fahrgeschwindigkeit "
        "geschwindigkeit vitesse velocidad velocita \u8f66\u901f",
        "drawbar_force": "drawbar drawbar_pull f_drawbar draft draft_force draught "
        "draught_force pull zugkraft effort_de_traction fuerza_de_tiro tiro "
        "\u7275\u5f15\u529b",
        "pto_power": "pto p_pto power_pto zapfwellenleistung zapfwelle pto_leistung "
        "puissance_pdf potencia_tdf",
        "auxiliary_power": "auxiliary auxiliaries aux aux_power p_aux power_aux "
        "nebenverbraucher padd",
        "lowest_engine_speed": "min_engine_speed minimum_engine_speed engine_speed_min",
        "slope": "grade gradient cyc_grade road_grade road_gradient road_slope steigung "
        "grad pente pendiente pendenza \u5761\u5ea6",
        "rolling_resistance": "rolling_coeff rolling_coefficient rollwiderstand "
        "rolling_resistance_coefficient",
        "slip": "wheel_slip schlupf slippage patinage",
    }
)
"""Other names of columns: of `hmcvt estimate`, FASTSim, WLTP and of tables in six languages."""
_ALIASES = {
    name: column for column, names in _OTHER_NAMES.items() for name in names.split()
}
_STATES_UNIT = frozenset(
    {"stamp", "cyc_secs", "seconds", "cyc_mps", "mps", "cyc_grade"}
)
"""Names that state their unit, which is that of SI."""
_BRACKET = re.compile(r"(.*?)[\s_]*[\[(](.*)[\])]\s*")
_OF_ESTIMATE = frozenset({"output_torque_low", "output_torque_high"})
"""Columns of a series of `hmcvt estimate` that begin like others but are bounds of them."""
_OTHER_UNITS: Mapping[str, tuple[float, str]] = MappingProxyType(
    {"power": (500.0, "kW"), "force": (200.0, "kN")}
)
"""Largest size of a column by kind up to which it may be in another unit than that of SI: 0.5 kW is
less than a hydraulic pump takes at no pressure, 200 N less than an empty trailer pulls."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """Demand over a uniform time; arrays of shape (n,), NaN where the file does not say.

    Attributes:
        name: of the file or of the shipped cycle.
        time: beginning of each step [s].
        step: length of each [s].
        output_speed: of the output shaft [rad/s]; negative backward.
        output_power: at the output shaft [W]; never negative, the brakes take the rest.
        pto_power: at the PTO shaft [W].
        auxiliary_power: of pumps and fans at the engine [W].
        lowest_engine_speed: that the work needs [rad/s].
        ground: where the output power goes [W], for demands at the ground: `drawbar`,
            `acceleration`, `slope` (all three useful), `rolling_resistance`, `wheel_slip`,
            `final_drive`, `brakes`. Their sum is `output_power`.
        remarks: what was left out or changed, in words.
    """

    name: str
    time: Array
    step: float
    output_speed: Array
    output_power: Array
    pto_power: Array
    auxiliary_power: Array
    lowest_engine_speed: Array
    ground: Mapping[str, Array] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.time)

    def first(self, steps: int) -> Cycle:
        """Return the first steps of the cycle."""
        ground = {name: power[:steps] for name, power in self.ground.items()}
        return replace(
            self,
            time=self.time[:steps],
            output_speed=self.output_speed[:steps],
            output_power=self.output_power[:steps],
            pto_power=self.pto_power[:steps],
            auxiliary_power=self.auxiliary_power[:steps],
            lowest_engine_speed=self.lowest_engine_speed[:steps],
            ground=ground,
        )

    @property
    def standing(self) -> NDArray[np.bool_]:
        """Steps at which the output stands, shape (n,)."""
        return np.abs(self.output_speed) < OUTPUT_SPEED.low

    @property
    def known(self) -> NDArray[np.bool_]:
        """Steps whose demand the file states, shape (n,)."""
        demand = (
            self.output_speed,
            self.output_power,
            self.pto_power,
            self.auxiliary_power,
            self.lowest_engine_speed,
        )
        return np.asarray(np.isfinite(demand).all(axis=0))


def read_cycle(
    path: str | os.PathLike[str], vehicle: Vehicle | None = None, step: float = STEP
) -> Cycle:
    """Read a work cycle from CSV, or a shipped one by its name (`CYCLES`).

    Columns, each with a unit behind it where that is not SI (`ground_speed [km/h]`): `time`;
    `output_speed` or `ground_speed`; `output_power` (or `output_torque` with an output speed), or
    `drawbar_force` with a ground speed.
    Optional are `pto_power`, `auxiliary_power`, `lowest_engine_speed` (for the flow of hydraulic
    pumps), and for demands at the ground `slope`, `rolling_resistance` and `slip`, which replace
    those of the vehicle. A ground speed without a load is a cycle without a drawbar force. Case and
    blanks of names do not count; columns that are not used are named in the remarks. A series that
    `hmcvt estimate` writes is read as it is.

    Args:
        path: of the file, or a name of `CYCLES`.
        vehicle: tyres and masses for demands at the ground; the usual one when left out.
        step: of the mission [s]; finer rows are averaged.

    Raises:
        InputError: the file is missing or damaged, a column is missing, a value is no number or
            out of range, or the time does not rise; file and row are named.
    """
    name = str(path)
    if name in CYCLES:
        path = data_path(f"data/cycle_{name}.csv")
    table = read_plain(path)
    headers = _known_headers(table)
    columns = {}
    for column, header in headers.items():
        columns[column] = _numbers(table, header, column)
    source = Path(name).name
    remarks = []
    has_load = not columns.keys().isdisjoint(_LOADS)
    if "ground_speed" in columns and not has_load:
        columns["drawbar_force"] = np.zeros(len(table.rows))
        remarks.append(
            "no column states a load: a drawbar force of 0 N is taken, so that it follows "
            "from mass, rolling resistance, slope and acceleration"
        )
    if {"output_speed", "output_torque"} <= columns.keys():
        power = columns["output_speed"] * columns["output_torque"]
        columns.setdefault("output_power", power)
    _require_columns(columns, table)
    not_used = _not_used(table, headers)
    if not_used:
        remarks.append(f"columns not used: {', '.join(not_used)}")
    time = columns.pop("time")
    _require_rising(time, table)
    _complete_speed(columns, table)
    grid = _Grid.of(time, step, source)
    sampled = {column: grid.sample(values) for column, values in columns.items()}
    cycle = _cycle(source, grid, sampled, vehicle or Vehicle())
    remarks += [*cycle.remarks, *_without_units(headers)]
    return replace(cycle, remarks=tuple(remarks))


_LOADS = ("drawbar_force", "output_power", "output_torque")
"""Columns that state a load."""


def _known_headers(table: Table) -> dict[str, str]:
    """Return the header cell of each known column.

    Raises:
        InputError: two cells name one column, or a cell begins like a known one and is not.
    """
    headers: dict[str, str] = {}
    named = {_name_and_unit(header)[0] for header in table.columns}
    for header in table.columns:
        name, _ = _name_and_unit(header)
        if name in _COLUMNS:
            if name in headers:
                raise InputError(
                    f"{table.source}: columns {headers[name]!r} and {header!r} state the "
                    "same"
                )
            headers[name] = header
            continue
        alike = _begins_like(name)
        if alike and _measures_another(header, alike) and alike in named:
            continue  # such as the speed of a PTO whose power is there
        if alike:
            raise InputError(
                f"{table.source}: column {header!r} is not known, but begins like {alike}: "
                f"call it {alike} [{next(iter(KIND_UNITS[_COLUMNS[alike][1]]))}] if it "
                "holds that, else leave it out"
            )
    return headers


def _plain_name(text: str) -> str:
    """Return a name without accents, case, blanks and hyphens, its words parted by underscores.

    VECTO writes names in angle brackets.
    """
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", plain_text(text.strip(" <>")))
    return re.sub(r"[\s_-]+", "_", words).strip("_").lower()


def _name_and_unit(header: str) -> tuple[str, str]:
    """Return the column that a header cell names, or its words, and the text of its unit.

    Case, blanks and hyphens do not count; the unit may stand in brackets or behind the name. Speed,
    torque and power of the output shaft have the names that `hmcvt import` takes.

    Args:
        header: such as `PTO Power [kW]` or `speed_kmh`.
    """
    text = header.strip()
    unit = ""
    bracket = _BRACKET.fullmatch(text)
    if bracket is not None:
        text = bracket[1]
        unit = bracket[2].strip()
    name = _plain_name(text)
    known = _ALIASES.get(name, name)
    if known in _COLUMNS:
        return known, unit
    meaning = meaning_of(header, "")
    if meaning.quantity in _OF_THE_SHAFT and not meaning.unknown:
        if meaning.unit is not None and not unit:
            unit = meaning.unit.name
        return meaning.quantity, unit
    if bracket is not None:
        return known, unit
    for split in (at.start() for at in re.finditer("_", name)):
        first = _ALIASES.get(name[:split], name[:split])
        behind = name[split + 1 :].replace("_per_", "/").replace("_", " ")
        of_unit = unit_of(behind)
        kind = "" if of_unit is None else of_unit.kind
        if first in _COLUMNS and kind == _COLUMNS[first][1]:
            return first, behind
    return name, ""


_OF_THE_SHAFT = ("output_speed", "output_power", "output_torque")
"""Columns that are quantities of a bench, too."""


def _begins_like(name: str) -> str:
    """Return the column with the same first word as a name that is not known; `""` for none."""
    first = name.partition("_")[0]
    if name in _OF_ESTIMATE or len(first) < 3:
        return ""
    for column in _COLUMNS:
        if column != "time" and column.partition("_")[0] == first:
            return column
    return ""


def _measures_another(header: str, column: str) -> bool:
    """Return whether the unit of a header cell measures another kind than a column."""
    known = unit_of(_name_and_unit(header)[1])
    return known is not None and known.kind != _COLUMNS[column][1]


def _not_used(table: Table, headers: Mapping[str, str]) -> list[str]:
    """Return the header cells of a table that no demand is made of.

    Args:
        table: of the cycle.
        headers: cell of each known column.
    """
    used = set(headers)
    has_power = "output_power" in headers
    if has_power:
        used -= {"slope", "rolling_resistance"}
        if "output_speed" in headers or "ground_speed" not in headers:
            used.discard("slip")
    if "drawbar_force" in headers or (has_power and _has_speed(headers)):
        used.discard("output_torque")
    cells = {headers[name] for name in used}
    return [header for header in table.columns if header not in cells]


def _has_speed(columns: Collection[str]) -> bool:
    """Return whether a column states the speed."""
    return "output_speed" in columns or "ground_speed" in columns


def _without_units(headers: Mapping[str, str]) -> list[str]:
    """Return a remark on columns whose header states no unit, which are taken in SI."""
    listed = []
    for column, header in headers.items():
        limits, kind = _COLUMNS[column]
        is_usual = kind == "time" or (kind == "part" and header.strip() == column)
        if is_usual or _name_and_unit(header)[1]:
            continue
        if _plain_name(header) not in _STATES_UNIT:
            listed.append(f"{header} [{limits.unit}]")
    if not listed or "stamp" in headers.values():
        return []  # `hmcvt estimate` writes SI
    return [f"without a unit, taken as: {', '.join(listed)}"]


def _numbers(table: Table, header: str, column: str) -> Array:
    """Return a column in SI; NaN for an empty cell.

    Args:
        table: as text.
        header: cell of the column.
        column: that it names, a key of `_COLUMNS`.

    Raises:
        InputError: the unit is not known or is open, or a value is no number or out of range.
    """
    limits, kind = _COLUMNS[column]
    _, text = _name_and_unit(header)
    usual = [unit for unit in KIND_UNITS[kind] if "@" not in unit]
    is_respelt = header.strip() != column and _plain_name(header) not in _STATES_UNIT
    if not text and is_respelt and kind not in ("time", "part"):
        raise InputError(
            f"{table.source}: column {header!r} states no unit: call it "
            f"{header.strip()} [UNIT], one of {', '.join(usual)}"
        )
    size = 1.0
    if text:
        known = unit_of(text)
        try:
            size, _ = to_si(kind, text if known is None else known.name)
        except KeyError:
            reason = f"is no unit of {column}; there is {', '.join(usual)}"
            if known is not None and known.name == "1/s":
                reason = "may count radians or turns: write rad/s or rpm"
            raise InputError(
                f"{table.source}: column {header!r}: {text!r} {reason}"
            ) from None
    filled = ["nan" if cell == "" else cell for cell in table.columns[header]]
    values = size * replace(table, columns={header: filled}).numbers(header)
    present = [cell != "" for cell in table.columns[header]]
    table.require_range(np.where(present, values, limits.low), limits)
    if not text:
        _require_size(values, header, kind, table)
    return values


def _require_size(values: Array, header: str, kind: str, table: Table) -> None:
    """Raise an `InputError` where numbers without a unit are too small for that of SI."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    up_to, other = _OTHER_UNITS.get(kind, (0.0, ""))
    if 1.0 < largest <= up_to:
        unit = next(iter(KIND_UNITS[kind]))
        raise InputError(
            f"{table.source}: column {header!r} is at most {largest:g} and states no unit: "
            f"call it {header} [{other}] or {header} [{unit}]"
        )


def _require_columns(columns: Mapping[str, Array], table: Table) -> None:
    has_speed = _has_speed(columns)
    from_torque = {"output_torque", "output_power"} <= columns.keys()
    has_load = {"output_power", "drawbar_force"} & columns.keys()
    if "time" not in columns or not (has_speed or from_torque) or not has_load:
        raise InputError(
            f"{table.source}: needs the columns time, output_speed or ground_speed, and "
            "output_power or drawbar_force (0 where nothing is pulled); there is "
            f"{', '.join(table.columns)}"
        )
    if "drawbar_force" in columns and "output_power" in columns:
        raise InputError(
            f"{table.source}: columns drawbar_force and output_power both state the load: "
            "leave one out"
        )
    if {"output_speed", "ground_speed"} <= columns.keys():
        raise InputError(
            f"{table.source}: columns output_speed and ground_speed both state the speed: "
            "leave one out"
        )
    if "drawbar_force" in columns and "ground_speed" not in columns:
        raise InputError(
            f"{table.source}: a drawbar_force needs the column ground_speed"
        )


def _require_rising(time: Array, table: Table) -> None:
    """Raise an `InputError` that names the first row at which the time does not rise."""
    if len(time) < 2:
        raise InputError(f"{table.source}: one row is no cycle; needs two or more")
    missing = np.flatnonzero(np.isnan(time))
    if len(missing):
        raise InputError(f"{table.source}: row {table.rows[missing[0]]}: has no time")
    backward = np.flatnonzero(np.diff(time) <= 0.0)
    if len(backward):
        row = table.rows[backward[0] + 1]
        raise InputError(
            f"{table.source}: row {row}: time = {time[backward[0] + 1]:g} s does not rise"
        )


def _complete_speed(columns: dict[str, Array], table: Table) -> None:
    """Add the output speed to a series that holds torque and power only."""
    if "output_speed" in columns or "ground_speed" in columns:
        return
    torque = columns["output_torque"]
    stands = torque == 0.0
    speed = np.where(
        stands, 0.0, columns["output_power"] / np.where(stands, 1.0, torque)
    )
    table.require_range(np.nan_to_num(speed), _COLUMNS["output_speed"][0])
    columns["output_speed"] = speed


@dataclass(frozen=True, eq=False)
class _Grid:
    """Steps of a mission, and how the rows of a file become them.

    Attributes:
        time: beginning of each step [s].
        step: length of a step [s].
        rows: times of the file [s].
        gaps: beginning and end of what no row covers [s].
    """

    time: Array
    step: float
    rows: Array
    gaps: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, rows: Array, step: float, source: str) -> _Grid:
        if not real_numbers(step, "step") > 0.0:
            raise InputError(f"step = {step:g} s; needs a positive one")
        distances = np.diff(rows)
        usual = float(np.median(distances))
        length = float(rows[-1] - rows[0]) + usual
        if step > length:
            raise InputError(
                f"{source}: step = {step:g} s is longer than the cycle, {length:g} s"
            )
        count = round(length / step)
        if count > MAX_STEPS:
            raise InputError(
                f"{source}: {length:.0f} s are {count} steps of {step:g} s; at most "
                f"{MAX_STEPS}: give a longer step, or cut it"
            )
        gaps = []
        for i in np.flatnonzero(distances > _GAP * usual):
            gaps.append((float(rows[i] + usual), float(rows[i + 1])))
        time = rows[0] + step * np.arange(count)
        return cls(time, step, rows, tuple(gaps))

    def sample(self, values: Array) -> Array:
        """Return a column at the steps: the row that holds, or the mean of fine rows."""
        parts = (np.arange(_PARTS_OF_A_STEP) + 0.5) / _PARTS_OF_A_STEP
        at = self.time[:, None] + self.step * parts
        row = np.searchsorted(self.rows, at, side="right") - 1
        sampled = values[row]
        for start, end in self.gaps:
            sampled = np.where((at >= start) & (at < end), np.nan, sampled)
        # The mean of equal numbers is rounded: a step that one row covers keeps its value.
        one_row = (sampled == sampled[:, :1]).all(axis=1)
        return np.where(one_row, sampled[:, 0], sampled.mean(axis=1))


def _cycle(
    source: str, grid: _Grid, columns: Mapping[str, Array], vehicle: Vehicle
) -> Cycle:
    """Return the cycle at the output shaft."""
    zero = np.zeros(len(grid.time))
    ground: dict[str, Array] = {}
    if "drawbar_force" in columns:
        speed = _ground_speed(columns, vehicle)
        ground = _ground_powers(columns, vehicle, grid.step)
        asked = sum(ground.values(), zero)
        ground["brakes"] = np.maximum(-asked, 0.0)
        power = np.maximum(asked, 0.0)
    else:
        if "output_speed" in columns:
            speed = columns["output_speed"]
        else:
            speed = _ground_speed(columns, vehicle)
        asked = columns["output_power"]
        power = np.maximum(asked, 0.0)
    cycle = Cycle(
        source,
        grid.time,
        grid.step,
        speed,
        power,
        columns.get("pto_power", zero),
        columns.get("auxiliary_power", zero),
        columns.get("lowest_engine_speed", zero),
        ground,
    )
    return replace(cycle, remarks=_remarks(cycle, asked, grid))


def _remarks(cycle: Cycle, asked: Array, grid: _Grid) -> tuple[str, ...]:
    """Return what was left out or changed, in words."""
    remarks = []
    for start, end in grid.gaps:
        remarks.append(f"{start:g} s to {end:g} s: no rows; left out")
    unknown = np.flatnonzero(~cycle.known)
    if len(unknown) and not grid.gaps:
        remarks.append(
            f"{len(unknown)} steps miss a value, first at {cycle.time[unknown[0]]:g} s: "
            "left out"
        )
    braked = np.flatnonzero(asked < 0.0)
    if len(braked):
        remarks.append(
            f"the demand is negative at {len(braked)} steps, first at "
            f"{cycle.time[braked[0]]:g} s: the service brakes take it"
        )
    turned = _reversed_at_speed(cycle)
    if len(turned):
        first = int(turned[0])
        remarks.append(
            f"the direction changes without standstill at {len(turned)} steps, first at "
            f"{cycle.time[first]:g} s, from {cycle.output_speed[first - 1]:.1f} to "
            f"{cycle.output_speed[first]:.1f} rad/s at the output: no limit of the vehicle covers "
            "that, and clutches that slip are not modelled"
        )
    return tuple(remarks)


def _reversed_at_speed(cycle: Cycle) -> NDArray[np.intp]:
    """Return the steps that begin in the other direction than the one before ended."""
    speed = np.where(cycle.known, cycle.output_speed, 0.0)
    low = _CREEPING * float(np.abs(speed).max(initial=0.0))
    sense = np.where(np.abs(speed) > low, np.sign(speed), 0.0)
    return np.flatnonzero(sense[1:] * sense[:-1] < 0.0) + 1


def _slip(columns: Mapping[str, Array], vehicle: Vehicle) -> Array:
    return columns.get("slip", np.full_like(columns["ground_speed"], vehicle.slip))


def _ground_speed(columns: Mapping[str, Array], vehicle: Vehicle) -> Array:
    """Return the output speed that a ground speed takes [rad/s]."""
    speed = vehicle.output_speed(columns["ground_speed"], _slip(columns, vehicle))
    return np.asarray(speed)


def _ground_powers(
    columns: Mapping[str, Array], vehicle: Vehicle, step: float
) -> dict[str, Array]:
    """Return where the power of a demand at the ground goes [W], without the brakes."""
    speed = columns["ground_speed"]
    distance = np.abs(speed)  # per second; a drawbar force acts against the motion
    weight = vehicle.mass * _GRAVITY
    zero = np.zeros_like(speed)
    rolling = columns.get("rolling_resistance", zero + vehicle.rolling_resistance)
    powers = {
        "drawbar": columns["drawbar_force"] * distance,
        "acceleration": _kinetic_power(speed, vehicle.mass, step),
        "slope": weight * columns.get("slope", zero) * speed,
        "rolling_resistance": rolling * weight * distance,
    }
    pull = np.maximum(sum(powers.values(), zero), 0.0)
    slip = _slip(columns, vehicle)
    at_wheels = pull / (1.0 - slip)
    powers["wheel_slip"] = at_wheels - pull
    powers["final_drive"] = at_wheels / vehicle.final_drive_efficiency - at_wheels
    return powers


def _kinetic_power(speed: Array, mass: float, step: float) -> Array:
    """Return the power that has gone into the motion since the step before [W]."""
    kinetic = 0.5 * mass * speed**2
    change = np.diff(kinetic, prepend=kinetic[0])
    # Next to a gap the change is not known.
    return np.nan_to_num(change) / step
