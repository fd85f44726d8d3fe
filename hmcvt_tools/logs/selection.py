# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which channels of a log hold which quantities, and their values in SI units.

Channels of a public standard say what they are. The others are proposed from their names, units and
values by the same rules as the columns of a table (`tables.proposal`), on a preview of the log.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.ranges import Array, Range
from hmcvt_core.transmission.units import UNITS, kind_of

from ..tables.header import RawTable
from ..tables.numbers import Style
from ..tables.proposal import (
    BY_RANGE,
    Column,
    Proposal,
    Question,
    named_column,
    option,
    propose,
)
from ..tables.units import to_si
from . import j1939
from .joining import Joined, Joiner
from .series import FEWEST_READINGS, Log, Remarks, Series, listed_names

FUEL_DENSITY = 0.832
"""Of diesel at 15 deg C [kg/L], middle of EN 590 (0.820 to 0.845)."""
FUEL_UNITS: Mapping[str, float] = {
    "kg/s": 1.0,
    "kg/h": 1.0 / 3600.0,
    "g/h": 1e-3 / 3600.0,
    "g/s": 1e-3,
    "L/h": FUEL_DENSITY / 3600.0,
    "l/h": FUEL_DENSITY / 3600.0,
}
"""Size of the units of the fuel rate in kg/s."""
PREVIEW_ROWS = 3000
"""Joined rows of a log that are shown to the rules of tables."""
_PREVIEW_STEP = 0.2  # s
_FUEL_RATE = re.compile(r"fuel.?(rate|flow|consumption)|kraftstoff|verbrauch", re.I)
_STAMP = "stamp"
_ACTUAL = f"{j1939.PREFIX}EngineActualTorque"
_FRICTION = f"{j1939.PREFIX}EngineFrictionTorque"
_PARASITIC = f"{j1939.PREFIX}EngineParasiticTorque"
ENGAGED = f"{j1939.PREFIX}DrivelineEngaged"
GEAR = f"{j1939.PREFIX}CurrentGear"
TAKE_OFFS = (f"{j1939.PREFIX}RearPtoSpeed", f"{j1939.PREFIX}FrontPtoSpeed")
_IMPOSSIBLE_SHARE = 0.1
"""Share of readings out of range, or of jumps, from which a channel is not what it is taken for."""
_SUSPECTED = "another channel or unit, or swapped byte order in the DBC"
_LIMITS: Mapping[str, tuple[float, float]] = {
    "engine_speed": (0.0, 400.0),
    "output_speed": (-1000.0, 1000.0),
    "engine_torque": (-5000.0, 5000.0),
    "output_torque": (-20_000.0, 20_000.0),
    "displacement_ratio": (-1.1, 1.1),
    "fuel_rate": (0.0, 0.1),
}
"""What a sensor of a tractor can show, in SI units."""
_FASTEST: Mapping[str, float] = {"engine_speed": 500.0, "output_speed": 1000.0}
"""Accelerations that no shaft of a drive line reaches [rad/s2]; an engine without load reaches
half of it."""
_NOISE = 3.0
"""Change of a speed between two readings that noise makes [rad/s]: 29 r/min."""


class BusTorque(NamedTuple):
    """Engine torque of J1939: percent of a reference torque, with the engine's friction in it.

    Attributes:
        reference: torque of 100 % [N m].
        friction: nominal friction [%]; None where the bus states it.
        has_parasitic: whether the bus states parasitic losses.
    """

    reference: float
    friction: float | None
    has_parasitic: bool

    @property
    def resolution(self) -> float:
        """Step of the torque [N m]: of 1 % of the reference."""
        return 0.01 * self.reference

    @property
    def names(self) -> list[str]:
        """Channels that are read."""
        names = [_ACTUAL]
        if self.friction is None:
            names.append(_FRICTION)
        if self.has_parasitic:
            names.append(_PARASITIC)
        return names

    def torque(self, values: Mapping[str, Array]) -> Array:
        """Return the torque at the flywheel [N m]."""
        friction: Any = self.friction
        if friction is None:
            friction = values[_FRICTION]
        percent = values[_ACTUAL] - friction
        if self.has_parasitic:
            # Losses that are not stated are part of the friction (J1939-71, SPN 2978).
            percent = percent - np.nan_to_num(values[_PARASITIC])
        return np.asarray(0.01 * self.reference * percent)


@dataclass(frozen=True)
class Selection:
    """Channels of a log by quantity.

    Attributes:
        columns: channel and unit by quantity; `fuel_rate` too.
        torque: engine torque from a bus, where no channel holds it in N m.
        stage_names: stage by the text or number in its channel; empty takes the text.
        proposal: with questions and notes.
        resolution: step of the values by quantity, SI; 0 where it is not known.
        extra: channels that are read as they are, such as the gear and the power take-off.
    """

    columns: Mapping[str, Column]
    torque: BusTorque | None = None
    stage_names: Mapping[str, str] = field(default_factory=dict)
    proposal: Proposal = field(default_factory=lambda: Proposal({}, {}, (), ()))
    resolution: Mapping[str, float] = field(default_factory=dict)
    extra: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """Channels to read."""
        names = [column.name for column in self.columns.values()]
        if self.torque is not None:
            names += self.torque.names
        return list(dict.fromkeys([*names, *self.extra]))

    @property
    def clock(self) -> str:
        """Channel whose times are taken: that of the engine speed."""
        return self.columns["engine_speed"].name

    @property
    def quantities(self) -> set[str]:
        """Quantities that are known."""
        known = set(self.columns)
        if self.torque is not None:
            known.add("engine_torque")
        return known

    def values(self, joined: Joined) -> dict[str, Any]:
        """Return SI values by quantity, shape (n,) each; stages are texts."""
        values: dict[str, Any] = {}
        for quantity, column in self.columns.items():
            raw = joined.values[column.name]
            if quantity == "stage":
                values[quantity] = self._stages(raw)
            else:
                size, zero = _size_of(quantity, column.unit)
                values[quantity] = size * (np.asarray(raw, dtype=float) - zero)
        if self.torque is not None:
            values["engine_torque"] = self.torque.torque(joined.values)
        if GEAR in self.extra and "output_speed" in values:
            # The output speed of J1939 has no sign; a gear below zero is a reverse one.
            backward = joined.values[GEAR] < 0.0
            speed = np.abs(values["output_speed"])
            values["output_speed"] = np.where(backward, -speed, values["output_speed"])
        return values

    def _stages(self, raw: Any) -> Any:
        """Return the names of stages; empty where none is known."""
        texts = raw
        if np.asarray(raw).dtype.kind == "f":
            codes = np.asarray(raw)
            texts = np.array(
                ["" if math.isnan(code) else f"{code:g}" for code in codes], dtype=str
            )
        if not self.stage_names or not len(texts):
            return texts
        codes, index = np.unique(texts, return_inverse=True)
        names = [self.stage_names.get(str(code), "") for code in codes]
        return np.array(names, dtype=str)[index]


def _size_of(quantity: str, unit: str) -> tuple[float, float]:
    """Return size and zero of a unit, see `to_si`."""
    if quantity == "fuel_rate":
        return FUEL_UNITS[unit], 0.0
    return to_si(kind_of(quantity), unit)


_TORQUE_RANGES = (
    Range("reference_torque", 10.0, 20000.0, "N m"),
    Range("friction_torque", 0.0, 90.0, "%", "of the reference torque"),
)


@dataclass(frozen=True)
class Stated:
    """What the user states of a log.

    Attributes:
        columns: `CHANNEL` or `CHANNEL:UNIT` by quantity.
        reference_torque: torque of 100 % [N m]; None for that of the bus.
        friction_torque: friction of the engine [% of the reference]; None for that of the bus.
        stage_names: stage by what stands in its channel.
        group: group, run or bus that is read where several hold the same channels.

    Raises:
        InputError: a torque is no number or out of range.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    reference_torque: float | None = None
    friction_torque: float | None = None
    stage_names: Mapping[str, str] = field(default_factory=dict)
    group: str = ""

    def __post_init__(self) -> None:
        for limits in _TORQUE_RANGES:
            value = getattr(self, limits.name)
            if value is not None:
                limits.check(value)


def select(log: Log, stated: Stated) -> Selection:
    """Choose the channels of a log.

    Args:
        log: to be read.
        stated: what the user names goes before what is proposed.

    Raises:
        InputError: a channel or the group that is named is missing, a unit is not one of its
            quantity, or a bus torque lacks its reference or its friction.
    """
    _require_known(stated.columns)
    log.take_group(stated.group)
    by_quantity = _standard_channels(log)
    for quantity in stated.columns:
        by_quantity.pop(quantity, None)
    short = _short_names(log)
    table = _preview(log, short)
    given: dict[str, Column] = {}
    for quantity, text in stated.columns.items():
        given[quantity] = _named(quantity, text, log, short, table)
    for quantity, name in by_quantity.items():
        given[quantity] = Column(name, _standard_unit(log, quantity, name), "standard")
    torque = None
    if "engine_torque" not in given and _ACTUAL in log.channels:
        has_parasitic = _is_filled(_PARASITIC, short, table)
        torque = _bus_torque(log, stated, has_parasitic)
    known = {**given}
    if torque is not None:
        known["engine_torque"] = Column(_ACTUAL, "N m")
    proposal = _proposed(log, table, known, short)
    columns = {}
    for quantity, column in proposal.columns.items():
        name = short.get(column.name, column.name)
        why = column.why.replace("row of units", "name and unit")
        columns[quantity] = Column(name, column.unit, why)
    columns.update(given)
    columns.pop(_STAMP, None)
    if torque is not None:
        columns.pop("engine_torque", None)
    fuel = None if "fuel_rate" in columns else _fuel_channel(log)
    if fuel is not None:
        columns["fuel_rate"] = fuel
    if "engine_speed" not in columns:
        raise InputError(_no_engine_speed(log, proposal))
    proposal = _with_log_questions(log, proposal, columns, torque, set(stated.columns))
    selection = Selection(
        columns,
        torque,
        dict(stated.stage_names),
        proposal,
        extra=_extra_channels(short, table),
    )
    return replace(selection, resolution=_resolutions(log, selection))


def _with_log_questions(
    log: Log,
    proposal: Proposal,
    columns: Mapping[str, Column],
    torque: BusTorque | None,
    named: Set[str],
) -> Proposal:
    """Return a proposal with the questions that only logs raise.

    Args:
        log: to be read.
        proposal: by the rules of tables.
        columns: chosen channels by quantity.
        torque: from a bus, or None.
        named: quantities that the user named.
    """
    questions = list(proposal.questions)
    for quantity, column in columns.items():
        # A part without a unit is a fraction or in percent by its size.
        is_guessed = column.why.startswith(BY_RANGE) and kind_of(quantity) != "part"
        if is_guessed and quantity not in named:
            questions.append(_unit_question(quantity, column))
    open_names = [column.name for name, column in columns.items() if name not in named]
    if torque is not None:
        open_names += torque.names
    groups: dict[str, None] = {}
    shared = []
    for name in open_names:
        several = log.groups_of(name)
        if len(several) > 1:
            shared.append(name)
            groups.update(dict.fromkeys(several))
    if shared:
        hints = tuple(f"--group {shlex.quote(group)}" for group in groups)
        listed = " and ".join(map(repr, groups))
        shown = ", ".join(map(repr, shared))
        text = f"{listed} hold the same channels ({shown})"
        # Which channel is meant is asked once, by its group.
        questions = [
            question
            for question in questions
            if not any(repr(name) in question.text for name in shared)
        ]
        questions.append(Question(text, hints))
    clocks = log.clock_problem([column.name for column in columns.values()])
    if clocks:
        questions.append(Question(clocks))
    return replace(proposal, questions=tuple(questions))


def _unit_question(quantity: str, column: Column) -> Question:
    """Ask for the unit of a channel that states none."""
    other = {"speed": "rad/s", "torque": "lb ft", "power": "kW"}
    units = [column.unit]
    if other.get(kind_of(quantity), column.unit) != column.unit:
        units.append(other[kind_of(quantity)])
    elif kind_of(quantity) == "speed":
        units.append("rpm")
    answers = tuple(option(quantity, column.name, unit) for unit in units)
    return Question(f"channel {column.name!r} states no unit", answers)


def _proposed(
    log: Log, table: RawTable, known: Mapping[str, Column], short: Mapping[str, str]
) -> Proposal:
    """Propose channels; a stroke whose stated range reaches below zero has its neutral there."""
    given = _in_table(known, short)
    proposal = propose(table, given)
    stroke = proposal.columns.get("displacement_ratio")
    if stroke is None or not stroke.unit or "displacement_ratio" in given:
        return proposal
    low = log.channel(short[stroke.name]).low
    if not -math.inf < low < 0.0:
        return proposal
    return propose(table, {**given, "displacement_ratio": stroke})


def _require_known(columns: Mapping[str, str]) -> None:
    known = (*UNITS, "stage", "fuel_rate")
    for quantity in columns:
        if quantity not in known:
            raise InputError(
                f"{quantity} is no quantity of a log; there is {', '.join(known)}"
            )


def _no_engine_speed(log: Log, proposal: Proposal) -> str:
    hints = "; ".join([*map(str, proposal.questions), *proposal.notes])
    text = (
        f"{log.path}: no channel is the engine speed: name it by --engine-speed; there is "
        f"{listed_names(log.channels)}"
    )
    return f"{text}; {hints}" if hints else text


def _standard_channels(log: Log) -> dict[str, str]:
    """Return the channels whose quantity a public standard states."""
    chosen: dict[str, str] = {}
    for name, channel in log.channels.items():
        if channel.quantity and channel.quantity != "reference_torque":
            chosen.setdefault(channel.quantity, name)
    return chosen


def _standard_unit(log: Log, quantity: str, name: str) -> str:
    unit = log.channel(name).unit
    return {"oil_temperature": "deg C"}.get(quantity, unit)


def _extra_channels(short: Mapping[str, str], table: RawTable) -> tuple[str, ...]:
    wanted = (ENGAGED, GEAR, *TAKE_OFFS)
    return tuple(name for name in wanted if _is_filled(name, short, table))


def _fuel_channel(log: Log) -> Column | None:
    for name, channel in log.channels.items():
        if _FUEL_RATE.search(name) and channel.unit in FUEL_UNITS:
            return Column(name, channel.unit, "name")
    return None


def _short_names(log: Log) -> dict[str, str]:
    """Return the channels by the part of their name that says what they are.

    A signal of a bus is `MESSAGE.Signal`: the message is left out where that is unique.
    """
    lasts = [name.rpartition(".")[2] for name in log.channels]
    short = {}
    for name, last in zip(log.channels, lasts, strict=True):
        key = last if lasts.count(last) == 1 and last else name
        short[key] = name
    return short


def _in_table(columns: Mapping[str, Column], short: Mapping[str, str]) -> Any:
    """Return columns by the names that they have in the preview."""
    names = {name: key for key, name in short.items()}
    renamed = {}
    for quantity, column in columns.items():
        renamed[quantity] = column._replace(name=names.get(column.name, column.name))
    return renamed


def _named(
    quantity: str, text: str, log: Log, short: Mapping[str, str], table: RawTable
) -> Column:
    """Return the channel that the user names for a quantity."""
    names = {name: key for key, name in short.items()}
    whole = text.strip()
    name, _, unit = whole.rpartition(":")
    if whole in log.channels or whole in short or not name:
        name = whole
        unit = ""
    full = short.get(name, name)
    channel = log.channel(full)
    if quantity == "fuel_rate":
        unit = unit or channel.unit
        if unit not in FUEL_UNITS:
            raise InputError(
                f"{log.path}: fuel_rate: {unit!r} of channel {full!r} is no unit of it; "
                f"there is {', '.join(FUEL_UNITS)}"
            )
        return Column(full, unit)
    if names[full] not in table.columns:
        raise InputError(f"{log.path}: channel {full!r} is empty")
    key = names[full]
    column = named_column(quantity, f"{key}:{unit}" if unit else key, table)
    if not column.unit and quantity != "stage":
        raise InputError(
            f"{log.path}: {quantity}: channel {full!r} has no unit: write {full}:UNIT"
        )
    return column._replace(name=full)


def _preview(log: Log, short: Mapping[str, str]) -> RawTable:
    """Return the first rows of a log as a table of text, for the rules of tables."""
    rows, texts = _first_rows(log)
    columns: dict[str, Sequence[str]] = {}
    units = {}
    for key, name in short.items():
        cells = texts.get(name)
        if cells is None or not any(cells):
            continue
        columns[key] = cells
        unit = log.channels[name].unit
        if unit:
            units[key] = unit
    return RawTable(
        columns,
        units,
        list(range(1, rows + 1)),
        {},
        dict.fromkeys(columns, Style(False)),
        str(log.path),
        "",
        "",
        1,
    )


def _first_rows(log: Log) -> tuple[int, dict[str, list[str]]]:
    """Return the cells of all channels at common times, as text."""
    names = list(log.channels)
    if not names:
        return 0, {}
    first = _first_pieces(log, names)
    clock = max(first, key=lambda name: len(first[name].time), default="")
    if not clock:
        return 0, {}
    joiner = Joiner(names, clock, _PREVIEW_STEP, Remarks())
    cells: dict[str, list[str]] = {name: [] for name in names}
    rows = 0
    for joined in joiner.rows([first]):
        rows += len(joined.time)
        for name in names:
            values = joined.values[name]
            if values.dtype.kind == "U":
                cells[name] += values.tolist()
            else:
                cells[name] += _number_texts(values)
    return rows, cells


def _number_texts(values: Array) -> list[str]:
    texts = []
    for value in values.tolist():
        texts.append("" if math.isnan(value) else f"{value:.9g}")
    return texts


_PREVIEW_PIECES = 50
_PREVIEW_READING = 0.02  # s, at most one reading of a channel; a tenth of the step


def _first_pieces(log: Log, names: Sequence[str]) -> dict[str, Series]:
    """Return the first readings of each channel; remarks on them are dropped."""
    kept = log.remarks
    log.remarks = Remarks()
    parts: dict[str, list[Series]] = {}
    span = PREVIEW_ROWS * _PREVIEW_STEP
    start = math.inf
    for piece in islice(log.pieces(names), _PREVIEW_PIECES):
        latest = -math.inf
        for name, series in piece.items():
            if len(series.time):
                part = series.thinned(_PREVIEW_READING)
                parts.setdefault(name, []).append(part)
                start = min(start, float(series.time[0]))
                latest = max(latest, float(series.time[-1]))
        if latest - start > span:
            break
    log.remarks = kept
    first = {}
    for name, several in parts.items():
        times = np.concatenate([series.time for series in several])
        values = np.concatenate([series.values for series in several])
        # The whole preview where it is short, else its beginning.
        count = int(np.searchsorted(times, start + span))
        first[name] = Series(times[:count], values[:count])
    return first


def _is_filled(name: str, short: Mapping[str, str], table: RawTable) -> bool:
    """Whether a channel holds readings in the preview."""
    return any(full == name and key in table.columns for key, full in short.items())


def _bus_torque(log: Log, stated: Stated, has_parasitic: bool) -> BusTorque:
    """Return how the percent torque of the bus becomes a torque.

    Args:
        log: to be read.
        stated: what the user states goes first.
        has_parasitic: whether the bus states parasitic losses.

    Raises:
        InputError: neither the bus nor the user states reference torque or friction.
    """
    reference = stated.reference_torque
    if reference is None:
        reference = _first_value(log, j1939.REFERENCE_TORQUE)
    if reference is None:
        raise InputError(
            f"{log.path}: the engine torque is in percent of a reference torque, and the "
            "bus does not state it (message EC1): add --reference-torque 800Nm"
        )
    if stated.friction_torque is None and _first_value(log, _FRICTION) is None:
        reason = "does not state it (message EEC3)"
        if _FRICTION in log.channels:
            reason = "states it as 'not available' all the time (message EEC3)"
        raise InputError(
            f"{log.path}: the engine torque of the bus holds the friction of the engine, "
            f"and the bus {reason}: add --friction-torque 8%"
        )
    friction = stated.friction_torque
    return BusTorque(reference, friction, has_parasitic and friction is None)


def _first_value(log: Log, name: str) -> float | None:
    """Return the first reading of a channel; None where there is no channel, or none of it."""
    if name not in log.channels:
        return None
    kept = log.remarks
    log.remarks = Remarks()
    first = None
    for piece in log.pieces([name]):
        series = piece.get(name)
        if series is None:
            continue
        known = np.flatnonzero(np.isfinite(series.values))
        if len(known):
            first = float(series.values[known[0]])
            break
    log.remarks = kept
    return first


def _resolutions(log: Log, selection: Selection) -> dict[str, float]:
    """Return the steps of the values by quantity, in SI units."""
    steps = {}
    for quantity, column in selection.columns.items():
        if quantity == "stage":
            continue
        if not column.unit:
            continue  # it is asked
        size, _ = _size_of(quantity, column.unit)
        steps[quantity] = abs(size) * log.channel(column.name).resolution
    if selection.torque is not None:
        steps["engine_torque"] = selection.torque.resolution
    return steps


def read_rows(
    log: Log, selection: Selection, step: float
) -> Iterator[tuple[Joined, dict[str, Any]]]:
    """Yield joined rows of a log, and their SI values by quantity.

    Args:
        log: to be read.
        selection: of its channels.
        step: least distance of two rows [s].

    Raises:
        InputError: a channel holds values that its quantity cannot have.
    """
    _require_answers(log, selection)
    joiner = Joiner(selection.names, selection.clock, step, log.remarks)
    checks = {name: _Check(name, log, selection) for name in _LIMITS}
    for joined in joiner.rows(log.pieces(selection.names)):
        _require_stated_range(log, selection)
        values = selection.values(joined)
        for quantity, check in checks.items():
            if quantity in values:
                check.clean(values, joined.time)
        yield joined, values
    for quantity, check in checks.items():
        if quantity in selection.quantities:
            check.require_readings()


def _require_answers(log: Log, selection: Selection) -> None:
    """Raise an `InputError` where the unit, group or clock of a channel that is read is open."""
    asked = concerning(selection)
    if asked:
        raise InputError(f"{log.path}: {'; '.join(map(str, asked))}")


def concerning(selection: Selection) -> list[Question]:
    """Return the questions that concern a channel that is read."""
    names = set(selection.names)
    names |= {name.rpartition(".")[2] for name in names}
    asked = []
    for question in selection.proposal.questions:
        if any(repr(name) in question.text for name in names):
            asked.append(question)
    return asked


def _require_stated_range(log: Log, selection: Selection) -> None:
    """Raise an `InputError` where many readings are outside the range that the DBC states."""
    for quantity, column in selection.columns.items():
        share, first = log.remarks.share_outside(column.name)
        if share > _IMPOSSIBLE_SHARE:
            raise InputError(
                f"{log.path}: channel {column.name!r} from {first:.3f} s: "
                f"{100 * share:.0f} % of its values are outside the range that the DBC "
                f"states, as the {quantity.replace('_', ' ')} cannot be: {_SUSPECTED}"
            )


class _Check:
    """Removes values that no sensor shows, and refuses a channel that is mostly such values."""

    def __init__(self, quantity: str, log: Log, selection: Selection) -> None:
        self._quantity = quantity
        self._log = log
        self._readings = 0
        self._channel = _ACTUAL
        if quantity in selection.columns:
            self._channel = selection.columns[quantity].name

    def clean(self, values: dict[str, Any], time: Array) -> None:
        """Replace impossible values of a piece by NaN.

        Raises:
            InputError: too many are impossible: the channel is another one.
        """
        quantity = self._quantity
        column = values[quantity]
        known = np.isfinite(column)
        count = int(known.sum())
        self._readings += count
        if not count:
            return
        low, high = _LIMITS[quantity]
        with np.errstate(invalid="ignore"):
            outside = known & ((column < low) | (column > high))
        jumps = np.zeros(len(column), dtype=bool)
        if quantity in _FASTEST:
            steps = np.diff(time, prepend=time[0])
            change = np.abs(np.diff(column, prepend=column[0]))
            with np.errstate(invalid="ignore"):
                jumps = change > _NOISE + _FASTEST[quantity] * steps
        impossible = outside | jumps
        if count >= FEWEST_READINGS and impossible.sum() > _IMPOSSIBLE_SHARE * count:
            first = float(time[int(np.argmax(impossible))])
            worst = float(column[int(np.argmax(impossible))])
            raise InputError(
                f"{self._log.path}: channel {self._channel!r} from {first:.3f} s: "
                f"{100 * impossible.sum() / count:.0f} % of its values cannot be the "
                f"{quantity.replace('_', ' ')} (such as {worst:.4g} in SI): {_SUSPECTED}"
            )
        reason = f"values that no {quantity.replace('_', ' ')} has left out"
        self._log.remarks.add_readings(self._channel, reason, time, outside)
        values[quantity] = np.where(outside, np.nan, column)

    def require_readings(self) -> None:
        """Remark a channel that is empty."""
        if not self._readings:
            self._log.remarks.add(self._channel, "is empty", count=0)
