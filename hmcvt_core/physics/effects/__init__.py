# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that the base model leaves out, each acting at its place in the power balance.

To add one, write a class in a module of this folder (or anywhere that is imported): see
`docs/add-an-effect.md`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from typing import Any

from ...errors import InputError
from ...transmission.mapping import number
from ...transmission.ranges import Range
from .base import Effect, EffectParameter, ShaftState

__all__ = ["Effect", "EffectParameter", "ShaftState", "effect_from_mapping", "effect_to_mapping",
           "library"]


def library(units: bool = False) -> tuple[type[Effect], ...]:
    """Return every effect class known, sorted by name and form; with `units` those of units too.

    A class without a size, or a subclass with neither a name nor a form of its own, is none.
    """
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    found = [effect for effect in _subclasses(Effect)
             if effect.name and effect.sizes() and (units or not effect.unit_only)
             and not {"name", "form"}.isdisjoint(vars(effect))]
    return tuple(sorted(found, key=lambda effect: (effect.name, effect.form)))


def _subclasses(base: type[Effect]) -> list[type[Effect]]:
    return [item for child in base.__subclasses__() for item in (child, *_subclasses(child))]


def effect_to_mapping(effect: Effect) -> dict[str, Any]:
    """Return an effect as plain data."""
    entry: dict[str, Any] = {"effect": effect.name}
    if effect.form:
        entry["form"] = effect.form
    if effect.part:
        entry["part"] = effect.part
    entry["parameters"] = {
        parameter.name: {"value": effect.values()[parameter.name], "unit": parameter.unit}
        for parameter in effect.parameters()
    }
    return entry


def effect_from_mapping(data: object, where: str = "effect") -> Effect:
    """Read what `effect_to_mapping` gives.

    Raises:
        InputError: the effect, form or a parameter is unknown, of another unit or out of its
            range; the field is named.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{where} = {data!r} is not a mapping")
    kind = _known(str(data.get("effect")), str(data.get("form", "")), where)
    parameters = data.get("parameters") or {}
    if not isinstance(parameters, Mapping):
        raise InputError(f"{where}.parameters = {parameters!r} is not a mapping")
    fields = {parameter.name: parameter for parameter in kind.parameters()}
    values = {}
    for key, entry in parameters.items():
        if key not in fields:
            raise InputError(f"{where}.parameters.{key} is not known; there is "
                             f"{', '.join(sorted(fields))}")
        values[key] = _value(fields[key], entry, f"{where}.parameters.{key}")
    part = str(data.get("part", ""))
    if part not in ("", "pump", "motor"):
        raise InputError(f"{where}.part = {part!r} is not pump or motor")
    return kind(**values, part=part)


def _known(name: str, form: str, where: str) -> type[Effect]:
    every = library(units=True)
    found = [effect for effect in every if (effect.name, effect.form) == (name, form)]
    if not found:
        raise InputError(f"{where}: effect = {name!r}, form = {form!r} is not known; "
                         f"there is {', '.join(sorted({effect.name for effect in every}))}")
    if len(found) > 1:
        classes = ", ".join(f"{effect.__module__}.{effect.__qualname__}" for effect in found)
        raise InputError(f"{where}: effect = {name!r}, form = {form!r} is the name of several "
                         f"classes: {classes}")
    return found[0]


def _value(parameter: EffectParameter, entry: object, where: str) -> float:
    place = where
    if isinstance(entry, Mapping):
        unit, place = entry.get("unit", parameter.unit), f"{where}.value"
        if unit != parameter.unit:
            raise InputError(f"{where}.unit = {unit!r}; needs {parameter.unit!r}")
        entry = entry.get("value")
    limits = Range(place, parameter.low, parameter.high, parameter.unit)
    return float(limits.check(number({place: entry}, place)))
