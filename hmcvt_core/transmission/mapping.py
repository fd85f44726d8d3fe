# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Fields of plain mappings, as YAML gives them: what is missing or wrong is named."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from typing import Any

from ..errors import InputError

_HUGE = 1e300  # an integer in a file may be too large for a float


def get(data: Mapping[Any, Any], key: Any, where: str = "") -> Any:
    """Return a field, whether its key was written as text or as a number.

    Args:
        data: the mapping.
        key: a name; gear pairs have numbers for names.
        where: the place of the mapping, to be named in errors, with a dot at its end.

    Raises:
        InputError: the field is missing.
    """
    if not isinstance(key, (str, int, float)):
        raise InputError(f"{where}{key!r} is not a name")
    # YAML reads the pair name 2 as a number; a file may write it either way.
    by_text = {str(existing): value for existing, value in data.items()}
    if str(key) in by_text:
        return by_text[str(key)]
    raise InputError(f"{where}{key} is missing; there is {', '.join(by_text) or 'nothing'}")


def section(data: Mapping[Any, Any], key: Any, where: str = "") -> Mapping[Any, Any]:
    """Return a field that is a mapping itself; see `get`."""
    value = get(data, key, where)
    if not isinstance(value, Mapping):
        raise InputError(f"{where}{key} = {value!r} is not a mapping")
    return value


def number(
    data: Mapping[Any, Any], key: Any, where: str = "", low: float = -math.inf
) -> float:
    """Return a field that is a finite number of at least `low`; see `get`."""
    value = get(data, key, where)
    # YAML 1.1 reads 3e-11 without a dot as text; a person may well write it so.
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)) \
            or not abs(value) < _HUGE or value < low:
        raise InputError(f"{where}{key} = {value!r} is not a finite number"
                         + (f" of at least {low:g}" if math.isfinite(low) else ""))
    return float(value)


def quantity(entry: object, unit: str, where: str) -> tuple[float, str]:
    """Return a number stated alone or as `{value, unit}`, and the place of it; see `number`.

    Raises:
        InputError: the unit is another one, or the value no finite number.
    """
    place = where
    if isinstance(entry, Mapping):
        if (stated := entry.get("unit", unit)) != unit:
            raise InputError(f"{where}.unit = {stated!r}; needs {unit!r}")
        place = f"{where}.value"
        entry = get(entry, "value", f"{where}.")
    return number({place: entry}, place), place
