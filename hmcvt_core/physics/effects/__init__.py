# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that the base model leaves out, each acting at its place in the power balance.

base        the class of an effect, with the hooks that it overrides
hydraulic   pump and motor: leakage, friction, ports, oil
mechanical  drag on shafts, of open clutches and of a unit alone; mesh losses
clutches    clutches and brakes at fault: closed ones that slip, open ones that grip
actuator    errors of the stroke
sensor      errors of torque meters, of the pressure gauge and of the stated displacement
wear        changes since a sound state: leakage, damping, oil temperature, air in the oil
empirical   a loss without a known cause, as a smooth function
trial       an effect that you define, tried at a few points
by_row      several sets of effects in one solution of the balance

To add one, write a class in a module of your own: see `docs/add-an-effect.md`. It is known once its
module is imported: by your program, by `load_effects`, or, in an installed package, through the
entry-point group `hmcvt.effects`, name = module.
"""

import importlib
import importlib.util
import os
import pkgutil
import sys
import zlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...transmission.mapping import quantity
from ...transmission.ranges import Range
from .base import Effect, EffectParameter, ShaftState
from .trial import trial

__all__ = [
    "Effect",
    "EffectParameter",
    "ShaftState",
    "effect_from_mapping",
    "effect_to_mapping",
    "import_source",
    "library",
    "load_effects",
]

GROUP = "hmcvt.effects"
_LARGEST = 120.0
"""Displacement of a single unit / that of the paper's, by which sizes grow."""
_WAYS = (
    "one of your own comes with --effects MODULE_OR_FILE.py (effects_file of the node), or "
    f"from an installed package through the entry-point group {GROUP}"
)


def library(units: bool = False, changes: bool = False) -> tuple[type[Effect], ...]:
    """Return every effect class known, sorted by name and form.

    Classes without a size, and subclasses that define neither a name nor a form, are left out. A
    class that is defined again, as when a notebook cell is run twice, replaces the earlier one.

    Args:
        units: whether those that only the bench of a single unit shows are included.
        changes: whether those that only a comparison with a sound machine shows are included.

    Raises:
        InputError: two classes have the same name and form.
    """
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")
    _plug_ins()
    classes = [
        effect
        for effect in _subclasses(Effect)
        if effect.name and effect.sizes() and _is_own(effect)
    ]
    latest = {(effect.__module__, effect.__qualname__): effect for effect in classes}
    by_form: dict[tuple[str, str], type[Effect]] = {}
    for effect in latest.values():
        other = by_form.setdefault((effect.name, effect.form), effect)
        if other is not effect:
            raise InputError(
                f"effect {effect.name}: {_place(other)} and {_place(effect)} have the same name "
                f"and form = {effect.form!r}: give yours another form"
            )
    return tuple(
        by_form[key]
        for key in sorted(by_form)
        if (units or not by_form[key].unit_only)
        and (changes or not by_form[key].change_only)
    )


def _is_own(effect: type[Effect]) -> bool:
    """Whether a class states a name or a form of its own."""
    return not {"name", "form"}.isdisjoint(vars(effect))


def _place(effect: type[Effect]) -> str:
    return f"{effect.__module__}.{effect.__qualname__}"


@cache
def _plug_ins() -> tuple[str, ...]:
    """Import the effects of installed packages; return why some cannot be loaded."""
    complaints = []
    for entry in entry_points(group=GROUP):
        try:
            entry.load()
        except (Exception, SystemExit) as error:  # whatever another's module may raise
            complaints.append(f"{entry.value} ({type(error).__name__}: {error})")
    return tuple(complaints)


def load_effects(source: str) -> None:
    """Import effects of your own, which is to run the file; a second time does nothing.

    Args:
        source: name of a module, or path of a Python file.

    Raises:
        InputError: there is none, it cannot be imported, it holds no effect, or one of them
            cannot be used (`trial`).
    """
    module = import_source(source)
    found = [
        item
        for item in vars(module).values()
        if isinstance(item, type)
        and issubclass(item, Effect)
        and item.name
        and not item.__module__.startswith(f"{__name__}.")
    ]
    if not any(_is_own(kind) for kind in found):
        raise InputError(
            f"{source}: holds no effect: no class of Effect with a name or form of its own"
        )
    try:
        for kind in found:
            if kind.sizes():  # others derive from one without; it is no effect itself
                trial(kind)
        library()
    except InputError as error:
        # What is refused is no candidate, and the file can be loaded again once it is mended.
        for refused in found:
            refused.name = ""
        sys.modules.pop(module.__name__, None)
        raise InputError(f"{source}: {error}") from error


def import_source(source: str) -> Any:
    """Import a module by its name or the path of its Python file.

    Raises:
        InputError: there is none, or it cannot be imported.
    """
    try:
        if source.endswith(".py"):
            return _import_file(Path(source).resolve())
        return importlib.import_module(source)
    except (
        Exception,
        SystemExit,
    ) as error:  # whatever somebody else's module may raise
        raise InputError(
            f"{source}: cannot be loaded: {type(error).__name__}: {error}"
        ) from error


def _import_file(path: Path) -> Any:
    for known in list(sys.modules.values()):
        file = getattr(known, "__file__", None)
        if file and Path(str(file)).resolve() == path:
            return known
    name = f"hmcvt_effects_{path.stem}_{zlib.crc32(os.fsencode(path)):08x}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # it ends with .py
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _subclasses(base: type[Effect]) -> list[type[Effect]]:
    classes = []
    for child in base.__subclasses__():
        classes += [child, *_subclasses(child)]
    return classes


def effect_to_mapping(effect: Effect) -> dict[str, Any]:
    """Return an effect as plain data."""
    words = {
        "effect": effect.name,
        "form": effect.form,
        "part": effect.part,
        "stage": effect.stage,
    }
    return {
        **{key: word for key, word in words.items() if word},
        "parameters": {
            item.name: {"value": effect.values()[item.name], "unit": item.unit}
            for item in effect.parameters()
        },
    }


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
    part = str(data.get("part", ""))
    if part not in ("", "pump", "motor"):
        raise InputError(f"{where}.part = {part!r} is not pump or motor")
    fields = {parameter.name: parameter for parameter in kind.parameters()}
    values = {}
    for key, entry in parameters.items():
        if key not in fields:
            raise InputError(
                f"{where}.parameters.{key} is not known; there is "
                f"{', '.join(sorted(fields))}"
            )
        limits = fields[key].times(_LARGEST if part else 1.0)
        value, place = quantity(entry, limits.unit, f"{where}.parameters.{key}")
        values[key] = float(
            Range(place, limits.low, limits.high, limits.unit).check(value)
        )
    stage = data.get("stage", "")
    if not isinstance(stage, str):
        raise InputError(f"{where}.stage = {stage!r} is not the name of a stage")
    return kind(**values, part=part, stage=stage)


def _known(name: str, form: str, where: str) -> type[Effect]:
    every = library(units=True, changes=True)
    found = [effect for effect in every if (effect.name, effect.form) == (name, form)]
    if not found:
        raise InputError(
            f"{where}: effect = {name!r}, form = {form!r} is not known; "
            f"there is {', '.join(sorted({effect.name for effect in every}))}; {_WAYS}"
            + "".join(f"; cannot be loaded: {each}" for each in _plug_ins())
        )
    return found[0]
