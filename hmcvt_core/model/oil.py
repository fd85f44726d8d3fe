# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Remarks on effects that need the oil temperature, where it is not known."""

from collections.abc import Iterable, Sequence

from ..files.bench import BenchSamples
from ..physics.effects import Effect
from ..physics.effects.hydraulic import REFERENCE_TEMPERATURE
from .model import EfficiencyModel


def without_oil_temperature(effects: Iterable[Effect]) -> list[str]:
    """Return what effects do without an oil temperature, as clauses; empty if none reads it.

    Example: `["effect bearing_drag is taken at 60 deg C", "effect fan_drive is off"]`.
    """
    assumed = []
    off = []
    for effect in effects:
        if not effect.depends_on_oil():
            continue
        if effect.needs_oil_temperature and not effect.assumes_oil_temperature:
            off.append(effect.name)
        else:
            assumed.append(effect.name)
    clauses = []
    if assumed:
        clauses.append(f"{_named(assumed)} taken at {REFERENCE_TEMPERATURE:g} deg C")
    if off:
        clauses.append(f"{_named(off)} off")
    return clauses


def _named(names: Sequence[str]) -> str:
    distinct = list(dict.fromkeys(names))
    if len(distinct) == 1:
        return f"effect {distinct[0]} is"
    return f"effects {', '.join(distinct)} are"


def oil_remarks(model: EfficiencyModel, samples: BenchSamples) -> list[str]:
    """Return a sentence where a model reads the oil temperature and samples do not state it."""
    clauses = without_oil_temperature(model.effects)
    if samples.oil_temperature is not None or not clauses:
        return []
    return [f"without column oil_temperature, {', '.join(clauses)}"]
