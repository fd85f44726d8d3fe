# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Rows that hold no test of a transmission at work, beyond doubt: they need no consent.

A map of a machine has rows at standstill, without load, in overrun and beyond what a tractor turns.
Such rows are left out and named. A single value out of range is no such row: it may be
mistyped.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.transmission.quantities import BY_NAME
from hmcvt_core.transmission.ranges import Array

from .header import RawTable
from .proposal import Column, unit_is_stated
from .rules import meaning_of
from .units import to_si

_SHAFT = ("engine_speed", "engine_torque", "load_torque")
"""Quantities of which a map has settings, and in which a row may be beyond a tractor."""
_FEWEST_AT_SETTING = 3
"""Rows of a setting from which its value is not mistyped."""
_FEWEST_SETTINGS = 2
"""Settings that are left at least, so that the unit of the column is right."""
_FEWEST_LEFT = 8
_WITHOUT_GAP = 1.5
"""Factor between neighbouring speeds of a map at most: digits that are exchanged or added, and
other units, make larger ones."""
_FASTEST = 1500.0
"""Speed of the fastest usual machine, an electric one of a vehicle [rad/s]."""
_NO_LOAD = 0.01
"""Fraction of the largest torque of a map below which a setting is one without load."""
_MAX_WITHOUT_POWER = 0.5
"""Share of rows without power from which a meter may be dead instead."""
_SAME_POWER = 0.02
"""Fraction by which a torque differs from power / speed of its row at most, by rounding."""


def rows_without_test(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> dict[int, str]:
    """Return rows that hold no test beyond doubt, by position, each with the reason.

    Args:
        values: SI values by quantity, measured and computed, shape (n,) each.
        columns: where the measured ones stand.
        table: as text.
    """
    if not table.rows:
        return {}
    confirmed = confirmed_torque(values, columns, table)
    if confirmed is not None and confirmed.in_all_rows:
        values = {**values, "load_torque": confirmed.torque}
        columns = {**columns, "load_torque": Column(confirmed.name, confirmed.unit)}
    reasons = _blank(columns, table)
    reasons |= _without_power(values, columns)
    reasons |= _beyond_settings(values, columns, table)
    if confirmed is None:
        return reasons
    for quantity in ("engine_speed", "load_torque"):
        limits = BY_NAME[quantity]
        beyond = confirmed.rows & ~limits.contains(values[quantity])
        for index in np.flatnonzero(beyond).tolist():
            reasons.setdefault(
                index,
                f"{quantity} is outside {limits}, and torque and power of the row agree",
            )
    return reasons


def _blank(columns: Mapping[str, Column], table: RawTable) -> dict[int, str]:
    """Return rows in which no quantity has a cell."""
    measured = []
    for column in columns.values():
        cells = table.columns[column.name]
        if cells[0] != column.name:  # a number for all rows is in every row
            measured.append(cells)
    reasons: dict[int, str] = {}
    if not measured:
        return reasons
    for index, cell in enumerate(measured[0]):
        if not cell and not any(cells[index] for cells in measured):
            reasons[index] = "is empty in every column that is used"
    return reasons


def _without_power(
    values: Mapping[str, Array], columns: Mapping[str, Column]
) -> dict[int, str]:
    """Return rows at standstill, without load, or whose loss takes the whole torque.

    A meter that reads zero in most rows may be dead, so that these rows stay doubtful.
    """
    reasons: dict[int, str] = {}
    for quantity in (*_SHAFT, "output_torque", "output_power", "engine_power"):
        if quantity not in columns:
            continue
        zero = values[quantity] == 0.0
        if np.mean(zero) > _MAX_WITHOUT_POWER:
            continue
        for index in np.flatnonzero(zero).tolist():
            reasons.setdefault(index, f"{quantity} is 0: no power passes")
    if "torque_loss" in columns and "engine_torque" in columns:
        torque = values["engine_torque"]
        used_up = (torque > 0.0) & (values["torque_loss"] >= torque)
        if np.mean(used_up) <= _MAX_WITHOUT_POWER:
            for index in np.flatnonzero(used_up).tolist():
                reasons.setdefault(index, "the loss takes the whole torque")
    return reasons


def _beyond_settings(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> dict[int, str]:
    """Return the rows of settings of a map that are out of range as a whole."""
    reasons: dict[int, str] = {}
    limited = [name for name in _SHAFT if name in columns]
    for quantity in limited:
        masks = _beyond(quantity, values[quantity], columns[quantity], table)
        if quantity == "engine_torque" and unit_is_stated(
            columns[quantity].name, table
        ):
            masks.append(_load_beyond(values["load_torque"], values[quantity]))
        for reason, rows in masks:
            for index in np.flatnonzero(rows).tolist():
                reasons.setdefault(index, reason)
    left = np.ones(len(table.rows), dtype=bool)
    left[list(reasons)] = False
    if left.sum() < _FEWEST_LEFT:
        return {}
    for quantity in limited:
        if len(np.unique(values[quantity][left])) < _FEWEST_SETTINGS:
            return {}
    return reasons


_Mask = tuple[str, NDArray[np.bool_]]
"""Reason why rows are left out, and which rows."""


def _repeated(setting: Array) -> NDArray[np.bool_]:
    """Return which rows share their value with others, as in a map; none where few values do."""
    known, position, counts = np.unique(
        setting, return_inverse=True, return_counts=True
    )
    if len(known) > len(setting) / _FEWEST_AT_SETTING:
        return np.zeros(len(setting), dtype=bool)
    return np.asarray(counts[position] >= _FEWEST_AT_SETTING)


def _beyond(
    quantity: str, setting: Array, column: Column, table: RawTable
) -> list[_Mask]:
    """Return the rows of settings that are beyond the range of a tractor's transmission.

    Where a map has settings in overrun, or beyond the highest value, all rows there are left out,
    also those of a setting of few points.
    """
    limits = BY_NAME[quantity]
    repeated = _repeated(setting)
    masks: list[_Mask] = []
    backward = setting < 0.0
    if np.any(backward & repeated):
        masks.append(
            (
                f"{quantity} is negative at a whole setting: overrun or backward",
                backward,
            )
        )
    if not _of_a_machine(quantity, setting):
        return masks
    if quantity == "engine_speed":
        masks.append((f"{quantity} goes on beyond {limits}", _faster(setting)))
    if not repeated.any():
        return masks
    least = min(limits.low, _NO_LOAD * float(np.nanmax(np.abs(setting))))
    idle = repeated & ~backward & (setting < least)
    masks.append((f"{quantity} is about 0 at a whole setting: no power passes", idle))
    outside = repeated & ~backward & ~idle & ~limits.contains(setting)
    outside &= np.isfinite(setting)
    if outside.any() and _unit_is_sure(quantity, column, table):
        above = setting[outside & (setting > limits.high)]
        outside |= setting >= np.min(above, initial=np.inf)
        masks.append((f"{quantity} is outside {limits} at a whole setting", outside))
    return masks


def _faster(speed: Array) -> NDArray[np.bool_]:
    """Return which rows are faster than a tractor's engine in a map that goes on without a gap.

    A mistyped speed, and rows in another unit, stand apart from the others.
    """
    limit = BY_NAME["engine_speed"].high
    faster = speed > limit
    slower = speed[(speed > 0.0) & (speed <= limit)]
    if faster.sum() < _FEWEST_AT_SETTING or not len(slower):
        return np.zeros(len(speed), dtype=bool)
    settings = np.unique(np.append(speed[faster], slower.max()))
    if np.max(settings[1:] / settings[:-1]) > _WITHOUT_GAP:
        return np.zeros(len(speed), dtype=bool)
    return np.asarray(faster)


def _load_beyond(load: Array, setting: Array) -> _Mask:
    """Return the rows of settings of the engine at which every load torque is too large."""
    limits = BY_NAME["load_torque"]
    _, position = np.unique(setting, return_inverse=True)
    within = np.bincount(position, weights=load <= limits.high)
    rows = _repeated(setting) & (within[position] == 0)
    return f"load_torque is outside {limits} at a whole setting of engine torque", rows


def _unit_is_sure(quantity: str, column: Column, table: RawTable) -> bool:
    """Return whether a value out of range cannot come from a wrong unit.

    The size of speeds distinguishes rad/s from r/min; a torque without a unit is only assumed to
    be in N m.
    """
    return quantity == "engine_speed" or unit_is_stated(column.name, table)


def _of_a_machine(quantity: str, setting: Array) -> bool:
    """Return whether the largest value is one of a machine, and not of a wrong unit."""
    return quantity != "engine_speed" or float(np.nanmax(setting)) <= _FASTEST


class ConfirmedTorque(NamedTuple):
    """A torque without a side that agrees with the load torque by power and speed.

    Attributes:
        name, unit: of its column.
        torque: shape (n,) [N m].
        rows: in which the two agree, shape (n,).
        in_all_rows: whether they agree in all rows in which power passes forward.
    """

    name: str
    unit: str
    torque: Array
    rows: NDArray[np.bool_]
    in_all_rows: bool


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def confirmed_torque(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> ConfirmedTorque | None:
    """Return the unused torque that confirms a computed load torque; None without one.

    Args:
        values: SI values by quantity, measured and computed, shape (n,) each.
        columns: where the measured ones stand.
        table: as text; the torque states its unit.
    """
    if "load_torque" in columns or "output_speed" in columns:
        return None
    used = {column.name for column in columns.values()}
    for name in table.columns:
        meaning = meaning_of(name, table.units.get(name, ""))
        if name in used or meaning.quantity != "any_torque":
            continue
        if meaning.unit is None or meaning.unit.kind != "torque":
            continue
        unit = meaning.unit.name
        size, zero = to_si("torque", unit)
        torque = np.asarray(size * (table.numbers(name).values - zero))
        load = values["load_torque"]
        forward = (torque > 0.0) & (load > 0.0) & (values["engine_speed"] > 0.0)
        agree = forward & (np.abs(torque / load - 1.0) < _SAME_POWER)
        if 2 * agree.sum() > forward.sum() > 0:
            in_all_rows = bool(agree.sum() == forward.sum())
            return ConfirmedTorque(name, unit, torque, agree, in_all_rows)
    return None
