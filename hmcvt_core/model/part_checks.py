# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Checks that the parts of a model are what they are taken for: stages, effects, parameters."""

from collections.abc import Iterable
from typing import Any

from ..files.checks import wrong_type
from ..physics.effects.base import Effect
from ..transmission.parameters import HydraulicParameters
from ..transmission.stage import Stage


def require_parameters(value: Any, argument: str = "parameters") -> None:
    """Raise an `InputError` where an argument is not the hydraulic parameters."""
    if not isinstance(value, HydraulicParameters):
        raise wrong_type(argument, "HydraulicParameters", value)


def require_stages(value: Any, argument: str = "stage") -> None:
    """Raise an `InputError` where an argument is neither a stage nor stages."""
    if isinstance(value, Stage):
        return
    if isinstance(value, str):
        raise wrong_type(
            argument, "a Stage", value, "read it by load_stage(path, name)"
        )
    if isinstance(getattr(value, "stage", None), Stage):
        raise wrong_type(argument, "a Stage", value, "take its attribute stage")
    if not isinstance(value, Iterable):
        raise wrong_type(argument, "a Stage, or a list of stages", value)
    for i, item in enumerate(value):
        if not isinstance(item, Stage):
            raise wrong_type(f"{argument}[{i}]", "a Stage", item)


def require_effects(value: Any, argument: str = "effects") -> None:
    """Raise an `InputError` where an argument is not a list of effects."""
    if isinstance(value, Effect):
        raise wrong_type(
            argument, "a list of effects", value, f"write {argument}=[...]"
        )
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise wrong_type(argument, "a list of Effect objects", value)
    for i, item in enumerate(value):
        if isinstance(item, Effect):
            continue
        hint = ""
        if isinstance(item, str):
            hint = "a name is not enough: an effect has a size, see hmcvt_core.physics.effects"
        raise wrong_type(f"{argument}[{i}]", "an Effect object", item, hint)
