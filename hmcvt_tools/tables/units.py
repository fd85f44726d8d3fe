# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Units of tables: the usual ones of `hmcvt_core.transmission.units`, and any other by Pint.

Pint is imported only for units beyond the usual ones.
"""

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.units import KIND_UNITS, ZERO, Unit, usual_unit

_BASE_UNITS = {
    "torque": "N*m",
    "power": "W",
    "speed": "rad/s",
    "pressure": "Pa",
    "temperature": "degC",
    "time": "s",
    "flow": "m**3/s",
    "mass_flow": "kg/s",
    "velocity": "m/s",
    "force": "N",
}
_ENERGIES = re.compile(r"joule|watt|calorie|electron_volt|british_thermal", re.I)
_FOR_PINT = re.compile(
    r"[A-Za-z\u00b5\u03bc][A-Za-z\u00b5\u03bc\d /*^.\u00b7-]{0,18}|/[a-z]{1,4}"
)


_SCALED_KINDS = ("speed", "torque", "power")
_POWER_OF_TEN = re.compile(
    r"[x\u00d7]? ?(?P<before>10|100|1000|10\^3)[ x\u00d7*]+(?P<unit>[A-Za-z].*)"
    r"|(?P<first>[A-Za-z].*?) ?[x\u00d7] ?(?P<behind>10|100|1000|10\^3)"
)
"""A power of ten in front of a unit, or behind it after a sign of multiplication."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    try:
        import pint
    except ImportError:
        raise InputError(
            'units beyond the usual ones need pint: pip install ".[tools]"'
        ) from None
    registry: Any = pint.UnitRegistry()
    registry.define("daN = 10 * newton")
    return registry


@lru_cache(maxsize=1024)  # of the cells of a long table
def unit_of(text: str) -> Unit | None:
    """Return the unit that a text names; None where it names none."""
    known = usual_unit(text)
    if known is not None:
        return known
    bare = text.strip(" []()<>{}")
    power, base = _power_of_ten(bare)
    if power == 1.0:
        return _unit_by_pint(bare)
    known = unit_of(base)
    if known is None or known.kind not in _SCALED_KINDS or known.name == "1/s":
        return None
    return Unit(known.kind, f"{power:.0f} {known.name}")


def _power_of_ten(unit: str) -> tuple[float, str]:
    """Return the power of ten in a unit such as `x1000 rpm`, and the rest of it."""
    hit = _POWER_OF_TEN.fullmatch(unit)
    if hit is None:
        return 1.0, unit
    digits = hit["before"] or hit["behind"]
    power = 1000.0 if digits == "10^3" else float(digits)
    return power, hit["unit"] or hit["first"]


def _unit_by_pint(text: str) -> Unit | None:
    if not _FOR_PINT.fullmatch(text):
        return None
    written = re.sub(r"(?<=[A-Za-z])[ \u00b7.-]+(?=[A-Za-z])", "*", text)
    written = re.sub(r"(?<=[a-z])(?=\d)", "**", written)
    registry = _registry()
    try:
        unit = registry.parse_units(written)
    except Exception:  # pint raises errors of many kinds for what is no unit
        return None
    kind = _kind_by_dimension(unit)
    if kind == "torque" and _ENERGIES.search(str(unit)):
        kind = "other"
    return Unit(kind, text)


def _kind_by_dimension(unit: Any) -> str:
    """Return what a unit of pint measures; a torque has the dimension of an energy."""
    for kind, base in _BASE_UNITS.items():
        if _registry().parse_units(base).dimensionality == unit.dimensionality:
            return kind
    return "other"


@lru_cache(maxsize=256)
def to_si(kind: str, unit: str) -> tuple[float, float]:
    """Return size [SI per unit] and zero [unit] of a unit: SI value = size * (reading - zero).

    Raises:
        KeyError: the unit does not measure that kind.
    """
    if unit in KIND_UNITS[kind]:
        return KIND_UNITS[kind][unit], ZERO.get(unit, 0.0)
    power, base = _power_of_ten(unit)
    if power != 1.0 and kind in _SCALED_KINDS:
        return power * to_si(kind, base)[0], 0.0
    known = unit_of(unit)
    if known is None or known.kind != kind or kind not in _BASE_UNITS:
        raise KeyError(unit)
    if known.name in KIND_UNITS[kind]:
        return to_si(kind, known.name)
    if known.name == "1/s":
        raise KeyError(unit)
    registry = _registry()
    written = re.sub(r"(?<=[A-Za-z])[ \u00b7.-]+(?=[A-Za-z])", "*", known.name)
    written = re.sub(r"(?<=[a-z])(?=\d)", "**", written)
    if kind == "temperature":
        at_zero = registry.Quantity(0.0, "degC").to(written).magnitude
        at_one = registry.Quantity(1.0, "degC").to(written).magnitude
        return 1.0 / (at_one - at_zero), float(at_zero)
    size = registry.Quantity(1.0, written).to(_BASE_UNITS[kind]).magnitude
    return float(size), 0.0


_NUMERIC = re.compile(r"[+-]?([.,]?\d|nan|inf)", re.IGNORECASE)


def holds_units(cells: Sequence[str]) -> bool:
    """Return whether a row holds only words, with units among them."""
    units = [cell for cell in cells if cell and usual_unit(cell) is not None]
    others = [cell for cell in cells if cell and unit_of(cell) is None]
    return bool(units) and not any(_NUMERIC.match(cell) for cell in others)
