# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Parameter files: a model as YAML that a person can read, with units and provenance."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InputError
from ..files.atomic import free_name, write_atomically
from ..files.checks import require_path
from ..files.plain_yaml import named, read_tree, require_known
from ..physics.effects import effect_from_mapping
from ..physics.effects.base import Effect
from ..transmission.mapping import Section, number, quantity
from ..transmission.parameters import (
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    HydraulicParameters,
)
from ..transmission.ranges import Array
from ..transmission.stage import Stage, stages_from_mapping
from .checks import require_model
from .domain import AXES, AXES_WITH_OIL, Domain
from .intervals import MIN_DEGREES
from .measured_unit import measured_units
from .model import SCHEMA, EfficiencyModel

TRANSMISSION_SCHEMA = "hmcvt-transmission/1"
_KIND_HINT = "bench samples are read by read_bench"
_ROUNDED = 1e-5  # a matrix in a file has six digits

# The keys of each section; None where any key may follow. "*" is every other name.
_PATH = dict.fromkeys(("gear_pairs", "direction", "member"))
_QUANTITY = dict.fromkeys(("value", "unit", "standard_error"))
_GEAR_TRAIN = {
    "gear_pairs": None,
    "gear_efficiency": None,
    "planetary_rows": None,
    "pump_motor": dict.fromkeys(
        (
            "pump_displacement_cm3_per_rev",
            "motor_displacement_cm3_per_rev",
            "pump_friction",
            "motor_friction",
        )
    ),
    "stages": {
        "*": {
            **dict.fromkeys(("layout", "reverse", "planetary_row", "open_clutches")),
            **dict.fromkeys(("mechanical", "pump", "motor", "output"), _PATH),
        }
    },
    "clutches": {"*": dict.fromkeys(("between", "closed"))},
}
_KNOWN: Mapping[str, Mapping[str, Any]] = {
    TRANSMISSION_SCHEMA: {"schema": None, "name": None, **_GEAR_TRAIN},
    SCHEMA: {
        **dict.fromkeys(
            (
                "schema",
                "checksum",
                "formulation",
                "correlation",
                "degrees_of_freedom",
                "misfit",
                "remainder_deviation",
                "provenance",
            )
        ),
        "served": None,  # what a node adds on its topic ~/model
        "parameters": dict.fromkeys(PARAMETER_NAMES, _QUANTITY),
        "interval_90": dict.fromkeys(PARAMETER_NAMES),
        "effects": dict.fromkeys(("effect", "form", "part", "stage", "parameters")),
        "domain": dict.fromkeys(AXES_WITH_OIL),
        "transmission": _GEAR_TRAIN,
    },
}


def load_model(path: str | os.PathLike[str]) -> EfficiencyModel:
    """Read a parameter file.

    Raises:
        InputError: the file is missing, damaged, of another schema or version, or a field is
            missing, unknown or out of range; file and field are named.
    """
    require_path(path, "path", "a parameter file", _KIND_HINT)
    with named(path):
        data, tree = read_tree(path, SCHEMA)
        stated = data.pop("checksum", None)
        if stated is not None and stated != (_checksum(data) or None):
            raise InputError(
                "checksum does not match: the file is damaged or was edited; "
                "if edited on purpose, remove the line 'checksum'"
            )
        model = _from_mapping(data)
        require_known(tree, _KNOWN[SCHEMA])
        return model


def save_model(model: EfficiencyModel, path: str | os.PathLike[str]) -> None:
    """Write a parameter file, whole or not at all.

    A file that is there already and holds anything else is kept in the same folder, as
    `name.previous-1.yaml` and so on.

    Raises:
        OSError: the folder cannot be written; an existing file is untouched.
    """
    import yaml

    require_model(model)
    require_path(path, "path", "a parameter file")
    path = Path(path)
    data = model.to_mapping()
    # Above all that can be cut off: a file that has lost its end has not lost its checksum.
    sealed = {"schema": data["schema"], "checksum": _checksum(data), **data}
    text = yaml.safe_dump(sealed, sort_keys=False, default_flow_style=None, width=96)
    if path.is_file() and not _holds(path, model):
        write_atomically(free_name(path, "previous"), path.read_bytes())
    write_atomically(path, text)


def load_stage(path: str | os.PathLike[str], name: str | None = None) -> Stage:
    """Read one stage of a transmission file (see `params/transmission.yaml`).

    Raises:
        InputError: the file or a field is wrong; both are named.
    """
    require_path(path, "path", "a transmission file")
    with named(path):
        data, tree = read_tree(path, TRANSMISSION_SCHEMA)
        stage = Stage.from_mapping(data, name)
        require_known(tree, _KNOWN[TRANSMISSION_SCHEMA])
        return stage


def load_stages(path: str | os.PathLike[str]) -> tuple[Stage, ...]:
    """Read every stage of a transmission file, in its order.

    Raises:
        InputError: the file or a field is wrong; both are named.
    """
    require_path(path, "path", "a transmission file")
    with named(path):
        data, tree = read_tree(path, TRANSMISSION_SCHEMA)
        stages = stages_from_mapping(data)
        require_known(tree, _KNOWN[TRANSMISSION_SCHEMA])
        return stages


def _holds(path: Path, model: EfficiencyModel) -> bool:
    """Whether a file holds the same, but for its date."""
    try:
        saved = load_model(path)
    except InputError:
        return False
    return _undated(saved) == _undated(model)


def _undated(model: EfficiencyModel) -> dict[str, Any]:
    data = model.to_mapping()
    return {**data, "provenance": {**data["provenance"], "date": ""}}


def _from_mapping(data: Mapping[str, Any]) -> EfficiencyModel:
    file = Section(data)
    parameters = file.section("parameters")
    values = []
    errors = {}
    for name in PARAMETER_NAMES:
        entry = parameters.section(name)
        place = f"parameters.{name}"
        values.append(quantity(entry.data, PARAMETER_UNITS[name], place)[0])
        if "standard_error" in entry.data:
            errors[name] = entry.number("standard_error", low=0.0)
    effects = data.get("effects", [])
    if not isinstance(effects, list):
        raise InputError(f"effects = {effects!r} is not a list")
    stage, *others = stages_from_mapping(file.section("transmission").data)
    provenance = {}
    if "provenance" in data:
        provenance = dict(file.section("provenance").data)
    units = provenance.pop("units", None)
    return EfficiencyModel(
        stage=stage,
        other_stages=tuple(others),
        parameters=HydraulicParameters(*values),
        formulation=str(file.get("formulation")),
        effects=_effects(effects, [stage.name, *(item.name for item in others)]),
        standard_errors=errors if len(errors) == len(PARAMETER_NAMES) else {},
        correlation=_correlation(file),
        degrees_of_freedom=_number(file, "degrees_of_freedom", None, MIN_DEGREES),
        domain=_domain(file.section("domain")) if "domain" in data else None,
        provenance=provenance,
        units={} if units is None else measured_units(units),
        intervals=_intervals(file, values),
        misfit=_number(file, "misfit", 0.0),
        remainder_deviation=_number(file, "remainder_deviation", 0.0),
    )


_Default = TypeVar("_Default")


def _number(
    file: Section, key: str, default: _Default, low: float = 0.0
) -> float | _Default:
    """Return a number of at least `low` that a file may lack."""
    return file.number(key, low=low) if key in file.data else default


def _effects(entries: Sequence[object], stages: Sequence[str]) -> tuple[Effect, ...]:
    """Read the effects of a file, each of which acts in all stages or in one of them."""
    effects = []
    for i, entry in enumerate(entries):
        effect = effect_from_mapping(entry, f"effects[{i}]")
        if effect.stage and effect.stage not in stages:
            raise InputError(
                f"effects[{i}].stage = {effect.stage!r} is none of the stages: "
                f"{', '.join(stages)}"
            )
        effects.append(effect)
    return tuple(effects)


def _checksum(data: Mapping[str, Any]) -> str:
    try:
        # As text keys: YAML reads the key 2 as a number, which does not sort among text.
        plain = json.loads(json.dumps(data, default=str))
    except (TypeError, ValueError, RecursionError):
        return ""  # a list within itself, a date for a key: not what `save_model` wrote
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def _domain(entry: Section) -> Domain:
    oil = None
    if "oil_temperature" in entry.data:
        oil = _pair(entry, "oil_temperature")
    stroke, speed, load = (_pair(entry, axis) for axis in AXES)
    return Domain(stroke, speed, load, oil)


def _intervals(
    file: Section, values: Sequence[float]
) -> dict[str, tuple[float, float]]:
    """Read the interval of each parameter, which holds its value; empty where none is stated.

    Args:
        file: with the section `interval_90`, if it has one.
        values: of the parameters, in the order of their names.
    """
    if "interval_90" not in file.data:
        return {}
    entry = file.section("interval_90")
    intervals = {name: _pair(entry, name) for name in PARAMETER_NAMES}
    for (name, (low, high)), value in zip(intervals.items(), values, strict=True):
        field = f"{entry.where}{name} = [{low!r}, {high!r}]"
        if low > high:
            raise InputError(f"{field}: low is above high")
        if not low <= value <= high:
            raise InputError(
                f"{field} does not hold parameters.{name} = {value!r}; remove interval_90 if the "
                "parameter was changed on purpose"
            )
    return intervals


def _pair(entry: Section, key: str) -> tuple[float, float]:
    """Return a field that holds [low, high]."""
    value = entry.data.get(key)
    field = f"{entry.where}{key}"
    if not (isinstance(value, list) and len(value) == 2):
        raise InputError(f"{field} = {value!r} is not [low, high]")
    return number(value[0], field), number(value[1], field)


def _correlation(file: Section) -> Array | None:
    """Read the correlation of the parameters; None where none is stated."""
    if "correlation" not in file.data:
        return None
    value = file.data["correlation"]
    n = len(PARAMETER_NAMES)
    try:
        matrix = np.asarray(value, dtype=float)
        # With these three no entry is beyond -1 and 1.
        sound = (
            matrix.shape == (n, n)
            and np.allclose(matrix, matrix.T, rtol=0.0, atol=_ROUNDED)
            and np.allclose(np.diag(matrix), 1.0, rtol=0.0, atol=_ROUNDED)
            and np.linalg.eigvalsh(matrix).min() >= -_ROUNDED
        )
    except (TypeError, ValueError, OverflowError):  # LinAlgError is a ValueError
        sound = False
    if not sound:
        raise InputError(
            f"correlation = {value!r} is not a {n} x {n} matrix of -1 to 1 that is "
            "symmetric, 1 on the diagonal, without a negative eigenvalue"
        )
    return matrix
