# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Several sets of effects in one solution of the balance, one for each row of the points.

A call at a hundred points takes barely longer than one at a single point. Cases that differ in
their effects are therefore rows of arrays of shape (..., rows, n), and are solved together.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .base import Array, Effect, ShaftState, Value

_Part = tuple[slice, Effect]
"""Rows, and the effect that acts in them."""


@dataclass(frozen=True)
class EffectByRow(Effect):
    """One effect of each row of arrays of shape (..., rows, n).

    Attributes:
        parts: rows, and the effect that acts in them.
    """

    parts: tuple[_Part, ...] = ()

    @cached_property
    def _acting(self) -> dict[str, list[_Part]]:
        """The parts that act at a hook, of the hooks asked for so far."""
        return {}

    def _acting_at(self, hook: str) -> list[_Part]:
        """Return the parts that override a hook, which each iteration asks for."""
        if hook not in self._acting:
            self._acting[hook] = [
                (rows, effect) for rows, effect in self.parts if effect.acts_at(hook)
            ]
        return self._acting[hook]

    def acts_at(self, *hooks: str) -> bool:  # type: ignore[override]
        """Whether an effect of a row overrides one of these hooks."""
        return any(self._acting_at(hook) for hook in hooks)

    def at(self, hook: str, state: ShaftState) -> Value:
        value = np.zeros_like(state.pressure)
        for rows, effect in self._acting_at(hook):
            value[..., rows, :] = effect.at(hook, _rows_of_state(state, rows))
        return value

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        return self._by_row(
            "true_displacement_ratio", displacement_ratio, displacement_ratio
        )

    def viscosity_ratio(self, oil_temperature: Array) -> Value:
        ones = np.ones_like(oil_temperature)
        return self._by_row("viscosity_ratio", ones, oil_temperature)

    def film_viscosity_ratio(self, oil_temperature: Array) -> Value:
        # A film follows the viscosity where an effect does not say otherwise.
        ratio = np.ones_like(oil_temperature)
        for rows, effect in self.parts:
            of_rows = oil_temperature[..., rows, :]
            ratio[..., rows, :] = effect.film_viscosity_ratio(of_rows)
        return ratio

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        return self._by_row("true_load_power", load_power, load_power, output_speed)

    def output_slip(self, torque: Array) -> Value:
        return self._by_row("output_slip", np.zeros_like(torque), torque)

    def mechanical_slip(self, torque: Array) -> Value:
        return self._by_row("mechanical_slip", np.zeros_like(torque), torque)

    def gear_loss(self, power: Array, speed: Array) -> Value:
        return self._by_row("gear_loss", np.zeros_like(power), power, speed)

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        return self._by_row("reading", efficiency, efficiency, state)

    def output_speed_reading(self, output_speed: Array) -> Array:
        return self._by_row("output_speed_reading", output_speed, output_speed)

    def pressure_reading(self, pressure: Array) -> Array:
        return self._by_row("pressure_reading", pressure, pressure)

    def _by_row(self, hook: str, unchanged: Array, *arguments: Any) -> Array:
        """Return the value of a hook in each row.

        Args:
            hook: its name.
            unchanged: its value where no effect acts, shape (..., rows, n).
            arguments: of the hook, of the same shape.
        """
        value = np.array(unchanged)
        for rows, effect in self._acting_at(hook):
            of_rows = [_rows_of(argument, rows) for argument in arguments]
            value[..., rows, :] = getattr(effect, hook)(*of_rows)
        return value


def by_row(sets: Sequence[Sequence[Effect]]) -> tuple[Effect, ...]:
    """Return effects that act as one set in each row.

    Args:
        sets: of effects, one for each row; effects of one position are evaluated once where they
            are equal in successive rows.
    """
    combined: list[Effect] = []
    for effects in itertools.zip_longest(*sets):
        parts = []
        end = 0
        for effect, equal_effects in itertools.groupby(effects):
            start = end
            end += len(list(equal_effects))
            if effect is not None:
                parts.append((slice(start, end), effect))
        if parts == [(slice(0, len(sets)), effects[0])]:
            combined.append(effects[0])
        else:
            combined.append(EffectByRow(tuple(parts)))
    return tuple(combined)


def _rows_of(argument: Any, rows: slice) -> Any:
    """Return rows of an array or of a state."""
    if isinstance(argument, ShaftState):
        return _rows_of_state(argument, rows)
    return argument[..., rows, :]


def _rows_of_state(state: ShaftState, rows: slice) -> ShaftState:
    """Return rows of all arrays of a state."""
    of_rows = ShaftState._make(_rows_if_array(value, rows) for value in state)
    clutches = []
    for engine, output in state.open_clutches:
        clutches.append((engine, _rows_if_array(output, rows)))
    return of_rows._replace(open_clutches=clutches)


def _rows_if_array(value: Any, rows: slice) -> Any:
    """Return rows of an array; a value that all rows share is no array."""
    return value[..., rows, :] if isinstance(value, np.ndarray) else value
