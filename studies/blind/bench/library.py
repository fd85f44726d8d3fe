# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The list of effects that the diagnosis has, and the same without some of them."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from unittest import mock

from hmcvt_core.benches.transmission import system
from hmcvt_core.physics.effects import library
from hmcvt_core.physics.effects.base import Effect as ListedEffect
from studies.blind.bench.unlisted_losses import UnlistedLoss
from studies.blind.effect import Effect

#: Losses of the twin that a list may have too.
_OF_THE_TWIN = {"clutch_microslip": ("clutch_slip",)}


def listed_name(effect: Effect) -> str | None:
    """Return the name under which the diagnosis lists a loss of the bench; None if it does not."""
    names = {kind.name for kind in library()}
    for name in _possible_names(effect):
        if name in names:
            return name
    return None


@contextmanager
def without_effects(effects: Sequence[Effect]) -> Iterator[None]:
    """Let diagnoses run without the effects under which losses of the bench are listed."""
    hidden = {name for effect in effects for name in _possible_names(effect)}

    def remaining(units: bool = False) -> tuple[type[ListedEffect], ...]:
        return tuple(kind for kind in library(units) if kind.name not in hidden)

    with mock.patch.object(system, "library", remaining):
        yield


def _possible_names(effect: Effect) -> tuple[str, ...]:
    if isinstance(effect, UnlistedLoss):
        return effect.listed_as
    return _OF_THE_TWIN.get(effect.name, ())
