# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The engine before the transmission: full-load curve and fuel map, from a table."""

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..files import picture, plain
from ..files.checks import require_path
from ..files.numbers import is_number
from ..files.plain_yaml import named, read_tree, require_known
from ..files.table import Table, read_plain
from ..transmission.mapping import Section
from ..transmission.quantities import real_numbers
from ..transmission.ranges import ENGINE_SPEED, RPM, Array, Range
from ..transmission.units import KIND_UNITS, Unit, usual_unit
from ..transmission.words import meanings_of, words_of

SCHEMA = "hmcvt-engine/1"
_KNOWN = dict.fromkeys(("schema", "name", "source", "map"))
_KINDS = {
    "engine_speed": ("speed",),
    "torque": ("torque",),
    "fuel": ("mass_flow", "specific_fuel"),
}
"""What the unit of a column measures, keys of `KIND_UNITS`."""
_LETTERS = {"engine_speed": frozenset("n"), "torque": frozenset("mt")}
"""Symbols that name a quantity where its unit stands behind them."""
_ENGINE_WORDS = frozenset(
    {
        *("engine", "eng", "e", "motor", "moteur", "motore", "crankshaft", "shaft"),
        "brake",
        *("actual", "measured", "mean", "average", "avg", "rotational"),
    }
)
"""Words that change nothing: an engine has one shaft. Any other word makes the name another one."""
_FUEL = re.compile(
    r"fuel|\bfc\b|bsfc|kraftstoff|verbrauch|carburant|combustible", re.IGNORECASE
)
_NO_FLOW = re.compile(r"temp|pressure|druck|density|dichte|rail", re.IGNORECASE)
"""Words of columns that measure something else of the fuel."""
_TORQUE = Range("torque", 0.0, 5000.0, "N m")
_SPECIFIC = Range("fuel at full load", 150.0, 500.0, "g/kWh", "are the units mixed up?")
_SAME_SPEED = 10.0 * RPM
"""Distance of two measured speeds of one setting [rad/s]; a test bench holds 1 % of 1,000 r/min
(ISO 8178-1)."""
_WIDEST_SETTING = 20.0 * RPM
"""Spread of the measured speeds of one setting [rad/s]."""
_PART_LOAD = Range(
    "fuel at part load", 140.0, 1000.0, "g/kWh", "is a number of this row wrong?"
)
"""From `_LOADED` on: 140 g/kWh is an efficiency of 60 %; without load an engine burns up to a
quarter of its fuel at full load, which makes 2.25 times the fuel per energy at a fifth of it."""
_LOADED = 0.2
"""Fraction of the full-load torque from which the fuel per energy is checked."""
_GRAMS_PER_KWH = 3.6e9
"""Fuel per energy: kg/J to g/kWh."""
_HOLE = 0.5  # of the full-load torque: wider apart, two rows leave a hole


@dataclass(frozen=True, eq=False)
class Engine:
    """Full-load curve and fuel map of an engine; NaN beyond.

    Fuel per revolution is interpolated linearly over torque, then over speed at equal torque.

    Attributes:
        speed: shape (n,), rising [rad/s].
        full_load: torque at full load at these speeds, shape (n,) [N m].
        load: torque / full-load torque, shape (m,), from 0 to 1.
        fuel: shape (n, m) [kg/s].
        remarks: what of the table was not used, in words.
    """

    speed: Array
    full_load: Array
    load: Array
    fuel: Array
    remarks: tuple[str, ...] = ()

    def full_load_torque(self, engine_speed: ArrayLike) -> Any:
        """Highest torque at engine speeds [rad/s], as they are shaped [N m]; NaN beyond."""
        speed = real_numbers(engine_speed, "engine_speed")
        torque = np.interp(speed, self.speed, self.full_load, left=np.nan, right=np.nan)
        return torque if np.ndim(torque) else float(torque)

    def fuel_rate(self, engine_speed: ArrayLike, torque: ArrayLike) -> Any:
        """Fuel at engine speeds [rad/s] and torques [N m] that broadcast [kg/s].

        NaN above the full-load curve, below no torque and beyond the speeds of the table.
        """
        speed, asked = _broadcast(engine_speed, torque)
        with np.errstate(invalid="ignore"):
            load = asked / self.full_load_torque(speed)
            known = (load >= 0.0) & (load <= 1.0 + 1e-12)
        fuel = self._interpolated(speed, np.where(known, asked, 0.0))
        rate = np.where(known, fuel, np.nan)
        return rate if rate.ndim else float(rate)

    def interpolation_error(self, engine_speed: ArrayLike, torque: ArrayLike) -> Any:
        """Return what fuel between the rows of the table changes by with half of the rows [kg/s].

        Linear interpolation errs with the square of the distance of its rows, so that the fuel of
        the full table is off by about a third of this. It is 0 where the table is too small to be
        halved.

        Args:
            engine_speed: within the table [rad/s].
            torque: up to full load [N m]; broadcasts.
        """
        speed, asked = _broadcast(engine_speed, torque)
        rows = _every_second(len(self.speed))
        loads = _every_second(len(self.load))
        halved = Engine(
            self.speed[rows],
            self.full_load[rows],
            self.load[loads],
            self.fuel[np.ix_(rows, loads)],
        )
        change = halved._interpolated(speed, asked) - self._interpolated(speed, asked)
        return change if change.ndim else float(change)

    def to_dict(self) -> dict[str, Any]:
        """Return the tables of the engine as plain data for JSON."""
        tables = {}
        for field in fields(self):
            if field.name != "remarks":
                tables[field.name] = plain(getattr(self, field.name))
        return tables

    def report(self) -> str:
        """Return speeds, full load, highest power and best point of the engine as text."""
        power = self.speed * self.full_load
        strongest = int(power.argmax())
        turning = int(self.full_load.argmax())
        specific = self.specific_fuel
        row, column = np.unravel_index(int(np.nanargmin(specific)), specific.shape)
        torque = self.load[column] * self.full_load[row]
        return "\n".join(
            [
                f"{self.speed[0] / RPM:.0f} to {self.speed[-1] / RPM:.0f} r/min",
                f"full load at most {self.full_load[turning]:.1f} N m, at "
                f"{self.speed[turning] / RPM:.0f} r/min",
                f"power at most {power[strongest] / 1e3:.1f} kW, at "
                f"{self.speed[strongest] / RPM:.0f} r/min",
                f"least fuel {specific[row, column]:.1f} g/kWh, at "
                f"{self.speed[row] / RPM:.0f} r/min and {torque:.1f} N m",
            ]
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw the specific fuel over engine speed and torque, up to full load.

        Args:
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        return picture(self, ax=ax)

    @property
    def specific_fuel(self) -> Array:
        """Fuel per energy at the points of the map, shape (n, m) [g/kWh]; NaN without torque."""
        power = self.speed[:, None] * self.full_load[:, None] * self.load
        positive = np.where(power > 0.0, power, np.nan)
        return np.asarray(_GRAMS_PER_KWH * self.fuel / positive)

    def _interpolated(self, speed: Array, torque: Array) -> Array:
        """Return fuel between the two speeds of the table next to each point, at equal torque.

        A line of equal load would curve the Willans line of an engine between its speeds. Fuel per
        revolution curves less over speed than fuel does: friction torque grows with the square of
        the speed, the power that it takes with the cube.

        Args:
            speed: any shape [rad/s]; one beyond the table counts as its end.
            torque: same shape [N m].
        """
        within = np.clip(speed, self.speed[0], self.speed[-1])
        last = len(self.speed) - 2
        row = np.clip(np.searchsorted(self.speed, within, side="right") - 1, 0, last)
        below = self._fuel_of_row(row, torque) / self.speed[row]
        above = self._fuel_of_row(row + 1, torque) / self.speed[row + 1]
        part = (within - self.speed[row]) / (self.speed[row + 1] - self.speed[row])
        return np.asarray(within * (below + part * (above - below)))

    def _fuel_of_row(self, row: NDArray[np.intp], torque: Array) -> Array:
        """Return fuel at speeds of the table, above full load along the last of its lines."""
        load = torque / self.full_load[row]
        last = len(self.load) - 2
        left = np.clip(np.searchsorted(self.load, load, side="right") - 1, 0, last)
        width = self.load[left + 1] - self.load[left]
        part = (load - self.load[left]) / width
        start = self.fuel[row, left]
        return np.asarray(start + part * (self.fuel[row, left + 1] - start))


def _every_second(count: int) -> NDArray[np.intp]:
    """Return every second position of an axis, its last one among them."""
    return np.unique(np.append(np.arange(0, count, 2), count - 1))


def load_engine(path: str | os.PathLike[str]) -> Engine:
    """Read an engine: a table, or a YAML file that names one in its folder (`params/engine.yaml`).

    The table is CSV with the columns `engine_speed`, `torque` and `fuel`, each with its unit as in
    `engine_speed [r/min]`; fuel in kg/s, kg/h, g/s, g/h or g/kWh. Other names are taken where each
    says all, as `fuel consumption [g/h]` or `bsfc_g_per_kWh`, and units in a row below the names.
    At every speed the highest torque is that of full load. Below the lowest the fuel goes on as a
    straight line (Willans). Rows in which the engine is driven (torque below zero) are not used;
    the remarks of the engine count them and name columns that are not used.

    Raises:
        InputError: the file is missing or damaged, a unit is unknown, a value is out of range, or
            rows leave a hole; file and row are named.
    """
    require_path(path, "path", "an engine file")
    table = _with_row_of_units(read_plain(_table_of(path), name_of=_plain))
    cells = _driving(table)
    speed, _ = _column(cells, "engine_speed")
    torque, _ = _column(cells, "torque")
    fuel, is_specific = _column(cells, "fuel")
    cells.require_range(speed, ENGINE_SPEED)
    cells.require_range(torque, _TORQUE)
    if is_specific:
        fuel = fuel * speed * torque
    speed = _grouped(speed)
    speeds = np.unique(speed)
    if len(speeds) < 2:
        raise InputError(
            f"{cells.source}: one engine speed is no map; needs two or more"
        )
    curves = []
    for value in speeds:
        rows = np.flatnonzero(speed == value)
        rows = rows[np.argsort(torque[rows], kind="stable")]
        where = f"{cells.source}: row {cells.rows[rows[-1]]}: {value / RPM:.0f} r/min"
        curves.append(_willans_line(torque[rows], fuel[rows], value, where))
    full_load = np.array([torques[-1] for torques, _ in curves])
    loads = np.concatenate([torques / torques[-1] for torques, _ in curves])
    load = np.unique(loads.round(9))
    grid = [np.interp(load * torques[-1], torques, rates) for torques, rates in curves]
    return Engine(speeds, full_load, load, np.array(grid), _remarks(table, cells))


def _broadcast(engine_speed: ArrayLike, torque: ArrayLike) -> tuple[Array, ...]:
    """Return engine speeds and torques of one shape."""
    return np.broadcast_arrays(
        real_numbers(engine_speed, "engine_speed"), real_numbers(torque, "torque")
    )


def _remarks(table: Table, driving: Table) -> tuple[str, ...]:
    """Return which rows and columns of a table are not used.

    Args:
        table: as it was read.
        driving: its rows that are used.
    """
    source = Path(table.source).name
    remarks = []
    left_out = len(table.rows) - len(driving.rows)
    if left_out:
        remarks.append(
            f"{source}: {left_out} rows in which the engine gives no power are not used"
        )
    used = {_column_of(table, quantity)[0] for quantity in _KINDS}
    others = [name for name in table.columns if name not in used]
    if others:
        remarks.append(f"{source}: columns not used: {', '.join(others)}")
    return tuple(remarks)


def _grouped(speed: Array) -> Array:
    """Return measured speeds with those of one setting at their mean [rad/s].

    Args:
        speed: of each row [rad/s].
    """
    order = np.argsort(speed, kind="stable")
    rising = speed[order]
    setting = np.append(0, np.cumsum(np.diff(rising) > _SAME_SPEED))
    grouped = np.empty_like(speed)
    for number in range(int(setting[-1]) + 1):
        rows = order[setting == number]
        if np.ptp(speed[rows]) > _WIDEST_SETTING:
            # Settings are so near each other that none can be distinguished.
            return speed
        grouped[rows] = speed[rows].mean() if np.ptp(speed[rows]) else speed[rows]
    return grouped


def _plain(cell: str) -> str:
    """Return a cell of a header without a mark of the program that wrote it.

    VECTO begins its comments with `c`, ADVISOR the names of the engine (fuel converter) with `fc_`.
    """
    return re.sub(r"^(c\s+|fc_)(?=\S)", "", cell.strip())


def _with_row_of_units(cells: Table) -> Table:
    """Return the table with a row of units below the names as part of the names."""
    if not cells.rows:
        return cells
    below = {name: _plain(column[0]) for name, column in cells.columns.items()}
    if not _holds_units(below.values()):
        return cells
    columns = {}
    for name, column in cells.columns.items():
        unit = below[name].strip("[]()")
        columns[f"{name} [{unit}]"] = column[1:]
    return replace(cells, columns=columns, rows=cells.rows[1:])


def _holds_units(cells: Iterable[str]) -> bool:
    """Return whether a row holds no number, and a unit of an engine's table."""
    known = [kind for kinds in _KINDS.values() for kind in kinds]
    bare = [cell.strip("[]() ") for cell in cells]
    units = [usual_unit(cell) for cell in bare if cell]
    has_unit = any(unit is not None and unit.kind in known for unit in units)
    return has_unit and not any(map(is_number, bare))


def _driving(cells: Table) -> Table:
    """Return the rows in which the engine drives, and whose fuel is known.

    Raises:
        InputError: in no row the torque is positive.
    """
    torque, _ = _column(cells, "torque")
    _, is_specific = _column(cells, "fuel")
    used = torque >= 0.0
    if is_specific:
        used = torque > 0.0  # no power, so that fuel per energy says nothing there
    kept = np.flatnonzero(used).tolist()
    if not np.any(torque > 0.0):
        raise InputError(f"{cells.source}: no torque is positive")
    columns = {}
    for name, column in cells.columns.items():
        columns[name] = [column[row] for row in kept]
    return replace(cells, columns=columns, rows=[cells.rows[row] for row in kept])


def _table_of(path: str | os.PathLike[str]) -> Path:
    """Return the table itself, or the one that a YAML file names."""
    table = Path(path)
    if table.suffix.lower() not in (".yaml", ".yml"):
        return table
    with named(path):
        data, tree = read_tree(path, SCHEMA)
        require_known(tree, _KNOWN)
        return table.parent / str(Section(data).get("map"))


def _willans_line(
    torques: Array, rates: Array, speed: float, where: str
) -> tuple[Array, Array]:
    """Return torques from zero to full load, and the fuel at them.

    Args:
        torques: at one engine speed, rising [N m].
        rates: fuel at them [kg/s].
        speed: of the engine [rad/s].
        where: file and row, for messages.
    """
    if torques[-1] > 0.0:
        specific = rates[-1] / (torques[-1] * speed) * _GRAMS_PER_KWH
        _SPECIFIC.check(specific, where)
        loaded = torques >= _LOADED * torques[-1]
        parts = rates[loaded] / (torques[loaded] * speed) * _GRAMS_PER_KWH
        for torque, part in zip(torques[loaded], parts, strict=True):
            _PART_LOAD.check(part, f"{where}, {torque:g} N m")
    gaps = np.diff(torques)
    complete = len(torques) >= 2 and (gaps > 0.0).all()
    if not complete or max(gaps.max(), torques[0]) > _HOLE * torques[-1]:
        listed = ", ".join(f"{torque:g}" for torque in torques)
        raise InputError(
            f"{where}: torques {listed} N m leave a hole: each speed needs rows "
            "from low to full load, none twice and none further apart than "
            f"{_HOLE:g} of full load"
        )
    if torques[0] > 0.0:
        idle = rates[0] - torques[0] * (rates[1] - rates[0]) / gaps[0]
        torques = np.append(0.0, torques)
        rates = np.append(max(idle, 0.0), rates)
    return torques, rates


def _column(cells: Table, quantity: str) -> tuple[Array, bool]:
    """Return a column of a quantity in SI, and whether it is fuel per energy [kg/J].

    Raises:
        InputError: the column is missing, two name the quantity, or the unit is not known.
    """
    column, unit = _column_of(cells, quantity)
    return _in_si(cells, column, unit, quantity)


def _column_of(cells: Table, quantity: str) -> tuple[str, str]:
    """Return the column of a quantity and the text of its unit; see `_column`."""
    for column in cells.columns:
        match = re.fullmatch(rf"{quantity} *\[(.*)\]", column)
        if match is not None:
            return column, match[1]
    named = [column for column in cells.columns if _names(column, quantity)]
    if len(named) > 1:
        raise InputError(
            f"{cells.source}: columns {' and '.join(named)} both name {quantity}: call "
            f"one {quantity} [unit]"
        )
    if not named:
        raise InputError(
            f"{cells.source}: column {quantity} [unit] is missing; there is "
            f"{', '.join(cells.columns)}"
        )
    (column,) = named
    _, unit = _name_and_unit(column, quantity)
    if not unit:
        raise InputError(
            f"{cells.source}: column {quantity} [unit] is missing: {column!r} states no "
            f"unit, one of {_listed_units(quantity)}"
        )
    return column, unit


def _name_and_unit(column: str, quantity: str) -> tuple[str, str]:
    """Return the name of a column and its unit, `""` without one.

    The unit stands in brackets or behind the name, as in `bsfc_g_per_kWh`.
    """
    match = re.search(r"[\[(]([^\[(]*)[\])]\s*$", column)
    if match is not None:
        return column[: match.start()], match[1].strip()
    for at in re.finditer("[_ ]", column):
        behind = column[at.end() :].replace("_per_", "/")
        for written in (behind, behind.replace("_", "/"), behind.replace("_", " ")):
            if _unit_of(written, quantity) is not None:
                return column[: at.start()], written
    if _unit_of(column, quantity) is not None:
        return column, column  # such as `rpm`
    return column, ""


def _unit_of(text: str, quantity: str) -> Unit | None:
    """Return the unit of a quantity that a text names; None for any other text."""
    unit = usual_unit(text)
    if unit is None or unit.kind not in _KINDS[quantity]:
        return None
    return unit if unit.name in KIND_UNITS[unit.kind] else None


def _listed_units(quantity: str) -> str:
    """Return the units of a quantity as text."""
    return ", ".join(name for kind in _KINDS[quantity] for name in KIND_UNITS[kind])


def _in_si(cells: Table, column: str, text: str, quantity: str) -> tuple[Array, bool]:
    """Return a column in SI, and whether its unit is that of fuel per energy."""
    unit = _unit_of(text, quantity)
    if unit is None:
        raise InputError(
            f"{cells.source}: {text!r} is no unit of {quantity}; there is "
            f"{_listed_units(quantity)}"
        )
    size = KIND_UNITS[unit.kind][unit.name]
    return cells.numbers(column) * size, unit.kind == "specific_fuel"


def _names(column: str, quantity: str) -> bool:
    """Return whether a column by another name holds a quantity of an engine's map."""
    if quantity == "fuel":
        return _FUEL.search(column) is not None and not _NO_FLOW.search(column)
    name, unit = _name_and_unit(column, quantity)
    (kind,) = _KINDS[quantity]
    is_named = False
    for word in map(str.lower, words_of(name)):
        meanings = set(meanings_of(word))
        says_kind = kind in meanings and meanings <= {kind, "engine"}
        is_symbol = unit != "" and word in _LETTERS[quantity]
        if says_kind or is_symbol:
            is_named = True
        elif word not in _ENGINE_WORDS:
            return False
    return is_named
