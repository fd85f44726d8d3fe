# SPDX-License-Identifier: Apache-2.0
"""Effects that the base model leaves out, each acting at its place in the power balance.

To add one, write a class in a module of this folder (or anywhere that is imported): see
`docs/add-an-effect.md`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from .base import Effect, EffectParameter, ShaftState

__all__ = ["Effect", "EffectParameter", "ShaftState", "effect_from_mapping", "effect_to_mapping",
           "library"]


def library() -> tuple[type[Effect], ...]:
    """Return every effect class known, sorted by name and form."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    found = [effect for effect in _subclasses(Effect) if effect.name]
    return tuple(sorted(found, key=lambda effect: (effect.name, effect.form)))


def _subclasses(base: type[Effect]) -> list[type[Effect]]:
    return [item for child in base.__subclasses__() for item in (child, *_subclasses(child))]


def effect_to_mapping(effect: Effect) -> dict[str, Any]:
    """Return an effect as plain data."""
    entry: dict[str, Any] = {"effect": effect.name}
    if effect.form:
        entry["form"] = effect.form
    entry["parameters"] = {
        parameter.name: {"value": effect.values()[parameter.name], "unit": parameter.unit}
        for parameter in effect.parameters()
    }
    return entry


def effect_from_mapping(data: object, where: str = "effect") -> Effect:
    """Read what `effect_to_mapping` gives.

    Raises:
        InputError: the effect, form or a parameter is unknown or wrong; the field is named.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{where} = {data!r} is not a mapping")
    name, form = str(data.get("effect")), str(data.get("form", ""))
    known = {(effect.name, effect.form): effect for effect in library()}
    if (name, form) not in known:
        names = sorted({known_name for known_name, _ in known})
        raise InputError(f"{where}: effect = {name!r}, form = {form!r} is not known; "
                         f"there is {', '.join(names)}")
    kind = known[(name, form)]
    fields = {parameter.name for parameter in kind.parameters()}
    values = {}
    parameters = data.get("parameters") or {}
    if not isinstance(parameters, Mapping):
        raise InputError(f"{where}.parameters = {parameters!r} is not a mapping")
    for key, entry in parameters.items():
        if key not in fields:
            raise InputError(f"{where}.parameters.{key} is not known; there is "
                             f"{', '.join(sorted(fields))}")
        value = entry.get("value") if isinstance(entry, Mapping) else entry
        if isinstance(value, bool) or not isinstance(value, (int, float)) \
                or not abs(value) < 1e300:
            raise InputError(f"{where}.parameters.{key} = {value!r} is not a finite number")
        values[key] = float(value)
    return kind(**values)
