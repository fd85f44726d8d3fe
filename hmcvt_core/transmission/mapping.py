# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Fields of plain mappings, as YAML gives them: what is missing or wrong is named."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import InputError

_HUGE = 1e300  # an integer in a file may be too large for a float


def number(value: object, place: str, low: float = -math.inf) -> float:
    """Return a finite number of at least `low`; an `InputError` names the place of another."""
    # YAML 1.1 reads 3e-11 without a dot as text; a person may well write it so.
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    limit = ""
    if math.isfinite(low):
        limit = f" of at least {low:g}"
    error = InputError(f"{place} = {value!r} is not a finite number{limit}")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise error
    if not abs(value) < _HUGE or value < low:
        raise error
    return float(value)


def quantity(entry: object, unit: str, where: str) -> tuple[float, str]:
    """Return a number stated alone or as `{value, unit}`, and the place of it; see `number`.

    Raises:
        InputError: the unit is another one, or the value no finite number.
    """
    if not isinstance(entry, Mapping):
        return number(entry, where), where
    stated = entry.get("unit", unit)
    if stated != unit:
        raise InputError(f"{where}.unit = {stated!r}; needs {unit!r}")
    return Section(entry, f"{where}.").number("value"), f"{where}.value"


@dataclass(frozen=True)
class Section:
    """A mapping within a file.

    Attributes:
        data: the mapping.
        where: its place, to be named in errors, with a dot at its end.
    """

    data: Mapping[Any, Any]
    where: str = ""

    def get(self, key: object) -> Any:
        """Return a field; an `InputError` names one that is missing."""
        if not isinstance(key, (str, int, float)):
            raise InputError(f"{self.where}{key!r} is not a name")
        # YAML reads the name 2 of a gear pair as a number; a file may write it either way.
        by_text = {str(existing): value for existing, value in self.data.items()}
        if str(key) not in by_text:
            raise InputError(
                f"{self.where}{key} is missing; there is "
                f"{', '.join(by_text) or 'nothing'}"
            )
        return by_text[str(key)]

    def section(self, key: object) -> Section:
        """Return a field that is a mapping itself; see `get`."""
        value = self.get(key)
        if not isinstance(value, Mapping):
            raise InputError(f"{self.where}{key} = {value!r} is not a mapping")
        return Section(value, f"{self.where}{key}.")

    def number(self, key: object, low: float = -math.inf) -> float:
        """Return a field that is a number; see `get` and the function `number`."""
        return number(self.get(key), f"{self.where}{key}", low)
