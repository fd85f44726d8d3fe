# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Rows that hold no test of a transmission at work, beyond doubt: they need no consent.

A map of a machine has rows at standstill, without load, in overrun and beyond what a tractor turns.
Such rows are left out and named. A single value out of range is none of them: it may be mistyped.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...transmission.ranges import Array
from .header import RawTable
from .proposal import RANGES, Column, unit_is_stated
from .rules import meaning_of
from .units import to_si

_SHAFT = ("engine_speed", "engine_torque", "load_torque")
"""Quantities of which a map has settings, and in which a row may be beyond a tractor."""
_FEWEST_AT_SETTING = 3
"""Rows of a setting from which its value is not mistyped."""
_FEWEST_SETTINGS = 3
"""Settings that are left at least, so that the unit of the column is right."""
_FEWEST_LEFT = 8
_NO_LOAD = 0.01
"""Part of the largest torque of a map below which a setting is one without load."""
_MOST_WITHOUT_POWER = 0.5
"""Share of rows without power from which a meter may be dead instead."""
_SAME_POWER = 0.02
"""Part by which torque x speed differs from the power of a row at most, by rounding."""


def rows_without_test(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> dict[int, str]:
    """Return rows that hold no test beyond doubt, by position, each with the reason.

    Args:
        values: SI values by quantity, measured and computed, shape (n,) each.
        columns: where the measured ones stand.
        table: as text.
    """
    reasons = _blank(columns, table)
    reasons |= _without_power(values, columns)
    reasons |= _beyond_settings(values, columns, table)
    confirmed = confirmed_power(values, columns, table)
    if confirmed is not None:
        for quantity in ("engine_speed", "load_torque"):
            limits = RANGES[quantity]
            beyond = confirmed.rows & ~limits.contains(values[quantity])
            for index in np.flatnonzero(beyond).tolist():
                reasons.setdefault(
                    index,
                    f"{quantity} is outside {limits}, and torque and power of the row agree",
                )
    return reasons


def _blank(columns: Mapping[str, Column], table: RawTable) -> dict[int, str]:
    """Return rows in which no quantity has a cell."""
    measured = [table.columns[column.name] for column in columns.values()]
    variable = [cells for cells in measured if len(set(cells)) > 1]
    if not variable:
        return {}
    reasons = {}
    for index, row in enumerate(zip(*variable, strict=True)):
        if not any(row):
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
        if np.mean(zero) > _MOST_WITHOUT_POWER:
            continue
        for index in np.flatnonzero(zero).tolist():
            reasons.setdefault(index, f"{quantity} is 0: no power passes")
    if "torque_loss" in columns and "engine_torque" in columns:
        torque = values["engine_torque"]
        used_up = (torque > 0.0) & (values["torque_loss"] >= torque)
        if np.mean(used_up) <= _MOST_WITHOUT_POWER:
            for index in np.flatnonzero(used_up).tolist():
                reasons.setdefault(index, "the loss takes the whole torque")
    return reasons


def _beyond_settings(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> dict[int, str]:
    """Return the rows of settings of a map that are out of range as a whole."""
    reasons: dict[int, str] = {}
    left = np.ones(len(table.rows), dtype=bool)
    limited = [name for name in _SHAFT if name in columns]
    for quantity in limited:
        setting = values[quantity]
        for value in _repeated(setting):
            rows = setting == value
            reason = _beyond(quantity, value, setting, columns[quantity], table)
            if not reason and quantity == "engine_torque":
                reason = _load_beyond(values, rows, columns[quantity], table)
            if not reason:
                continue
            left &= ~rows
            for index in np.flatnonzero(rows).tolist():
                reasons.setdefault(index, reason)
    if left.sum() < _FEWEST_LEFT:
        return {}
    for quantity in limited:
        settings = np.unique(values[quantity][left])
        if len(settings) < _FEWEST_SETTINGS:
            return {}
    return reasons


def _repeated(setting: Array) -> Sequence[float]:
    """Return the values that stand in several rows of a column."""
    known, counts = np.unique(setting[np.isfinite(setting)], return_counts=True)
    if len(known) > len(setting) / _FEWEST_AT_SETTING:
        return []
    return [float(value) for value in known[counts >= _FEWEST_AT_SETTING]]


def _beyond(
    quantity: str, value: float, setting: Array, column: Column, table: RawTable
) -> str:
    """Say how a setting is beyond the range of a tractor's transmission; `""` if it is not."""
    limits = RANGES[quantity]
    largest = float(np.nanmax(np.abs(setting)))
    if value < 0.0:
        return f"{quantity} is {value:g} {limits.unit}, a setting in overrun or backward"
    if value < min(limits.low, _NO_LOAD * largest):
        return f"{quantity} is {value:g} {limits.unit}, a setting without power"
    if limits.contains(value) or not _unit_is_sure(quantity, column, table):
        return ""
    return f"{quantity} is {value:g} {limits.unit}, a setting outside {limits}"


def _load_beyond(
    values: Mapping[str, Array],
    rows: NDArray[np.bool_],
    column: Column,
    table: RawTable,
) -> str:
    """Say that the load torques of a setting of the engine are beyond the range of a load."""
    limits = RANGES["load_torque"]
    loads = values["load_torque"][rows]
    if not np.all(loads > limits.high) or not unit_is_stated(column.name, table):
        return ""
    return f"load_torque is outside {limits} at one engine torque and all speeds"


def _unit_is_sure(quantity: str, column: Column, table: RawTable) -> bool:
    """Return whether a value out of range cannot come from a wrong unit.

    The size of speeds tells rad/s from r/min; a torque without a unit is only assumed in N m.
    """
    return quantity == "engine_speed" or unit_is_stated(column.name, table)


class ConfirmedPower:
    """Rows in which torque x speed of an unused column of torque is the power at the output.

    Attributes:
        name: of that column.
        rows: in which the two agree, shape (n,).
        whole: whether they agree in all rows with power.
    """

    def __init__(self, name: str, rows: NDArray[np.bool_], with_power: int) -> None:
        self.name = name
        self.rows = rows
        self.whole = int(rows.sum()) == with_power > 0


@np.errstate(divide="ignore", invalid="ignore")  # a shaft may stand
def confirmed_power(
    values: Mapping[str, Array], columns: Mapping[str, Column], table: RawTable
) -> ConfirmedPower | None:
    """Return the rows whose output power another torque confirms; None without such a torque.

    Args:
        values: SI values by quantity, shape (n,) each.
        columns: where the measured ones stand.
        table: as text; a torque without a side that is not used is compared.
    """
    if "output_power" not in columns or "output_speed" in columns:
        return None
    used = {column.name for column in columns.values()}
    for name in table.columns:
        meaning = meaning_of(name, table.units.get(name, ""))
        if name in used or meaning.quantity != "any_torque" or meaning.unit is None:
            continue
        size, zero = to_si("torque", meaning.unit.name)
        torque = size * (table.numbers(name).values - zero)
        power = values["output_power"]
        with_power = power > 0.0
        ratio = torque * values["engine_speed"] / power
        agree = with_power & (np.abs(ratio - 1.0) < _SAME_POWER)
        if 2 * agree.sum() > with_power.sum():
            return ConfirmedPower(name, agree, int(with_power.sum()))
    return None
