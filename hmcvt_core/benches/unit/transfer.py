# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a unit lost on its bench, put into the model of a transmission."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import InputError
from ...model.measured_unit import MeasuredUnit
from ...model.model import EfficiencyModel
from ...physics.effects.base import OIL_HOOKS, Effect, EffectParameter
from ...transmission.parameters import PARAMETER_NAMES, PRIOR_SPREAD
from .diagnosis import UnitDiagnosis

STROKE_HOOKS = ("true_displacement_ratio", "stroke_lag")
"""Hooks of effects that change the stroke, which is the pump's."""


def put_into(model: EfficiencyModel, unit: UnitDiagnosis) -> EfficiencyModel:
    """Return a transmission with a unit in it; its standard errors are the prior of a refit.

    The losses of a unit grow with its displacement. While one of the two units is not tested, it is
    assumed to leak like the other, within the spread of units.

    Args:
        model: formulation `power_balance`.
        unit: diagnosis of its pump or motor, of any displacement.

    Raises:
        InputError: the transmission is not of formulation `power_balance`.
    """
    if model.formulation != "power_balance":
        raise InputError(
            f"a unit needs formulation power_balance, not {model.formulation!r}"
        )
    kind = unit.model.system.kind
    displacements = _displacements(model)
    scale = displacements[kind] / unit.model.system.displacement
    tested = {**model.units, kind: _tested(unit)}
    leakage, leakage_error = _pair_leakage(tested, kind, displacements)
    _, damping_error = unit.errors
    errors = dict(zip(PARAMETER_NAMES, PRIOR_SPREAD.tolist(), strict=True))
    errors.update(model.standard_errors)
    errors[f"{kind}_damping"] = damping_error * scale
    errors["leakage"] = leakage_error
    parameters = replace(
        model.parameters,
        leakage=leakage,
        **{f"{kind}_damping": unit.model.parameters["damping"] * scale},
    )
    of_the_other = tuple(effect for effect in model.effects if effect.part != kind)
    return replace(
        model.with_errors(errors, np.eye(len(PARAMETER_NAMES))),
        parameters=parameters,
        effects=(*of_the_other, *_effects_of_the_pair(model, unit, scale)),
        units=tested,
        provenance={**model.provenance, "source": "hmcvt unit"},
    )


def _displacements(model: EfficiencyModel) -> dict[str, float]:
    """Full displacement of pump and motor [m3/rad]."""
    pair = model.stage.pump_motor
    return {"pump": pair.pump_displacement, "motor": pair.motor_displacement}


def _tested(unit: UnitDiagnosis) -> MeasuredUnit:
    samples = unit.diagnosis.samples
    decades, _ = unit.errors
    leakage = unit.model.parameters["leakage"]
    return MeasuredUnit(
        leakage_per_displacement=leakage / unit.model.system.displacement,
        decades=decades,
        data=os.path.basename(samples.source),
        data_sha256=samples.sha256,
    )


def _pair_leakage(
    tested: dict[str, MeasuredUnit], kind: str, displacements: dict[str, float]
) -> tuple[float, float]:
    """Leakage of pump and motor together and its standard error [m3/(s Pa)].

    Args:
        tested: results by kind; one kind may be missing.
        kind: a kind that is tested, like which the other leaks.
        displacements: of both [m3/rad].
    """
    like_it = replace(tested[kind], decades=float(PRIOR_SPREAD[0]))
    leakages = []
    errors = []
    for name, displacement in displacements.items():
        result = tested.get(name, like_it)
        leakage = displacement * result.leakage_per_displacement
        leakages.append(leakage)
        errors.append(leakage * (np.log(10.0) * result.decades))
    return float(np.sum(leakages)), float(np.linalg.norm(errors))


def _effects_of_the_pair(
    model: EfficiencyModel, unit: UnitDiagnosis, scale: float
) -> list[Effect]:
    """Effects of a unit as they act in the pair.

    Args:
        model: the transmission.
        unit: diagnosis of one of its units.
        scale: displacement in the transmission / displacement of the unit tested.
    """
    kind = unit.model.system.kind
    displacements = _displacements(model)
    share_of_larger = displacements[kind] / max(displacements.values())
    present = {effect.name for effect in model.effects if effect.part != kind}
    effects = []
    for effect in unit.model.effects:
        if not _acts_in_the_pair(effect, kind, present):
            continue
        sizes: dict[str, Any] = {
            item.name: _size_in_the_pair(effect, item, scale, share_of_larger)
            for item in effect.sizes()
        }
        effects.append(replace(effect, part=kind, **sizes))
    return effects


def _acts_in_the_pair(effect: Effect, kind: str, present: set[str]) -> bool:
    """Whether an effect of a unit acts in a transmission, where some effects are present."""
    if effect.component == "sensor":
        return False
    if effect.acts_at(*STROKE_HOOKS) and kind == "motor":
        return False  # the stroke is the pump's
    # One oil serves both units.
    return not (effect.acts_at(*OIL_HOOKS) and effect.name in present)


def _size_in_the_pair(
    effect: Effect, size: EffectParameter, scale: float, share_of_larger: float
) -> float:
    """Size of an effect in the pair; its hooks refer to the larger of the two displacements."""
    value = effect.values()[size.name]
    if effect.acts_at(*STROKE_HOOKS, *OIL_HOOKS):
        return value
    if size.grows:
        return scale * value
    return share_of_larger * value
