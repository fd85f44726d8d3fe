# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A trial of somebody's effect at a few points, whose errors name the hook."""

from collections.abc import Sequence
from difflib import get_close_matches
from inspect import signature
from types import FunctionType
from typing import Any

import numpy as np

from ...errors import InputError
from .base import Effect, ShaftState

_POINTS = 3
NEARLY = 0.8
"""Similarity of names (difflib) from which a method is taken for a misspelt hook; chosen."""


def trial(kind: type[Effect]) -> None:
    """Call every hook that an effect overrides, with its sizes as they are typical.

    Raises:
        InputError: a hook fails, changes the state that it is given, gives neither one number
            nor one for each point, or is misspelt, or the effect overrides none; the effect and the
            hook are named.
    """
    _require_hooks(kind)
    effect = kind().with_values({item.name: item.typical for item in kind.sizes()})
    known = _arguments(_state())
    for hook, default in vars(Effect).items():
        if not isinstance(default, FunctionType):
            continue
        names = list(signature(default).parameters)[1:]
        # What takes something else is no hook.
        if names and known.keys() >= set(names) and kind.acts_at(hook):
            _call(effect, hook, names)


def _call(effect: Effect, hook: str, names: Sequence[str]) -> None:
    """Call a hook; errors as of `trial`.

    Args:
        effect: at its typical sizes.
        hook: name of the method.
        names: of its arguments.
    """
    where = f"effect {effect.name}: {hook}"
    state = _state()
    values = _arguments(state)
    try:
        value = getattr(effect, hook)(*(values[name] for name in names))
        answer = np.asarray(value, dtype=np.float64)
    except Exception as error:  # whatever somebody else's code may raise
        raise InputError(f"{where}: {type(error).__name__}: {error}") from error
    if answer.shape not in ((), (1,), (_POINTS,)):
        raise InputError(
            f"{where} gives an array of shape {answer.shape} for {_POINTS} "
            f"points; allowed: one number, or an array of shape ({_POINTS},)"
        )
    if not np.isfinite(answer).any():
        raise InputError(f"{where} gives {answer.flat[0]} at every point tried")
    if "state" not in names:
        return
    fields: list[tuple[str, Any, Any]] = list(
        zip(state._fields, _state(), state, strict=True)
    )
    for field, before, after in fields:
        if not np.array_equal(before, after):
            raise InputError(
                f"{where} changes {field} of the state; make a new array instead"
            )


def _arguments(state: ShaftState) -> dict[str, Any]:
    """Return what hooks are given at a state, by the names of their arguments."""
    return {
        **state._asdict(),
        "state": state,
        "efficiency": state.displacement_ratio,
        "power": state.load_power,
        "speed": state.output_speed,
        "torque": state.sun_torque,
    }


def _require_hooks(kind: type[Effect]) -> None:
    """Refuse an effect that overrides no hook, and a method whose name is nearly that of one."""
    hooks = _public_methods(Effect)
    for owner in kind.__mro__:
        if owner in (Effect, object):
            continue
        for name in _public_methods(owner):
            meant = get_close_matches(name, hooks, n=1, cutoff=NEARLY)
            if name not in hooks and meant:
                raise InputError(
                    f"effect {kind.name}: method {name} is no hook; {meant[0]} is: rename it, or "
                    f"begin its name with _"
                )
    if not kind.acts_at(*hooks):
        raise InputError(
            f"effect {kind.name}: overrides no hook; there is {', '.join(sorted(hooks))}"
        )


def _public_methods(kind: type) -> list[str]:
    """Return the names of the methods that a class itself defines."""
    methods = []
    for name, item in vars(kind).items():
        if isinstance(item, FunctionType) and not name.startswith("_"):
            methods.append(name)
    return methods


def _state() -> ShaftState:
    """Points as on a bench, an engine that pulls through the hydraulic path."""
    part = np.linspace(0.5, 1.0, _POINTS)
    return ShaftState(
        200.0 * part,
        180.0 * part,
        150.0 * part,
        160.0 * part,
        0.9 * part,
        3e7 * part,
        np.ones(_POINTS),
        120.0 * part,
        90.0 * part,
        5e4 * part,
        1e-5,
        oil_temperature=np.linspace(30.0, 90.0, _POINTS),
    )
