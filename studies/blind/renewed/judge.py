# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One campaign of the renewed plant, diagnosed and put to the oracle."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from hmcvt_core.physics.effects import library
from studies.blind.bench.classes import classes_of
from studies.blind.bench.judge import predicted
from studies.blind.bench.scores import DETECTABLE
from studies.blind.effect import FloatArray
from studies.blind.renewed.campaign import (
    VERSION,
    Campaign,
    fresh_state,
    make_campaign,
)
from studies.blind.renewed.look import Look, Visibility
from studies.blind.renewed.oracle import ask
from studies.blind.renewed.unlisted import Accessory

#: Squared cosine above which two effects of one set have the same signature.
_SAME = 0.9
#: Fresh tests with which promises are compared.
FRESH_TESTS = 200
_ATTEMPTS = 24
_GROWTH = 1.4
#: Campaigns of one seed are drawn from this many seeds.
_SEEDS = 1000


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose.

    Attributes:
        kind: of what it hides.
        seed: of everything.
        oracle: whether the oracle is asked too.
        without: columns that are left out.
    """

    kind: str
    seed: int
    oracle: bool = True
    without: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """A name that no other case of a run has."""
        return f"{self.kind}/{self.seed}"


@lru_cache(maxsize=8)
def draw(kind: str, seed: int) -> tuple[Campaign, Look, Visibility]:
    """Draw campaigns from the seed on; return the first whose effects can all be seen.

    Effects grow with every second attempt, so that one that hardly shows ends as well.

    Raises:
        InputError: none of the attempts is usable.
    """
    for attempt in range(_ATTEMPTS):
        growth = _GROWTH ** (attempt % 3)
        try:
            campaign = make_campaign(kind, _SEEDS * seed + attempt // 3, growth)
        except InputError:
            continue
        look = Look(campaign)
        seen = look.visibility()
        if not seen.left or (min(seen.left) >= DETECTABLE and seen.alike < _SAME):
            return campaign, look, seen
    raise InputError(f"{kind}/{seed}: no campaign of {_ATTEMPTS} is usable")


def served(
    campaign: Campaign, without: Sequence[str] = ()
) -> tuple[hmcvt.EfficiencyModel, hmcvt.BenchSamples]:
    """Return all that the product receives: the served model and the bench's columns.

    Args:
        campaign: to serve.
        without: columns to leave out.
    """
    model = hmcvt.load_model(hmcvt.data_path(campaign.layout.model_file))
    columns: dict[str, Any] = {
        name: values for name, values in campaign.columns.items() if name not in without
    }
    return model, hmcvt.BenchSamples(**columns, extra=campaign.texts)


def judge(case: Case) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and return how the answer compares with the truth."""
    campaign, look, seen = draw(case.kind, case.seed)
    model, samples = served(campaign, case.without)
    start = time.process_time()
    found = hmcvt.diagnose(model, samples)
    seconds = time.process_time() - start
    record = {
        **_hidden(case, campaign, seen),
        **_answer(found.to_dict(), campaign.layout.output_coupled),
        "seconds": seconds,
        **_elsewhere(campaign, found, model),
    }
    if case.oracle:
        record.update(ask(campaign, look).to_dict())
    return record


def _hidden(case: Case, campaign: Campaign, seen: Visibility) -> dict[str, Any]:
    """Return what a record says of the truth."""
    truth = campaign.truth
    variants = {effect.name: effect.variant for effect in truth.effects}
    classes = classes_of(list(truth.names), variants, campaign.layout.output_coupled)
    listed = {kind.name for kind in library()} & set(Accessory.listed_as)
    return {
        "version": VERSION,
        "kind": case.kind,
        "seed": case.seed,
        "layout": campaign.layout.name,
        "columns": sorted(set(campaign.columns) - set(case.without)),
        "tests": len(campaign.programme),
        "truth": list(truth.names),
        "variants": variants,
        "sizes": {effect.name: float(effect.size) for effect in truth.effects},
        "base_errors": {error.name: float(error.size) for error in truth.errors},
        "true_classes": sorted(listed) if case.kind == "accessory" else classes,
        "oracle_classes": classes,
        "left": list(seen.left),
        "sessions": int(np.max(campaign.programme.session)) + 1,
        "noise": float(np.sqrt(np.mean(campaign.noise**2))),
    }


def _answer(answer: dict[str, Any], output_coupled: bool) -> dict[str, Any]:
    """Return what a record says of the verdict, with sets of one class merged."""
    forms = {cause["effect"]: cause.get("form") or "" for cause in answer["causes"]}
    merged: dict[tuple[str, ...], float] = {}
    for item in answer["sets"]:
        key = tuple(classes_of(item["effects"], forms, output_coupled))
        merged[key] = merged.get(key, 0.0) + item["probability"]
    ranked = sorted(merged.items(), key=lambda entry: -entry[1])
    members = [
        [classes_of(item["effects"], forms, output_coupled), item["probability"]]
        for item in answer["members"]
    ]
    return {
        "verdict": answer["verdict"],
        "unlisted": answer["unlisted_probability"],
        "forms": forms,
        "classes": [[list(classes), p] for classes, p in ranked[:5]],
        "members": members,
        "gap": answer["gap"],
        "promised": answer["shrinkage"]["fraction"],
        "interval": answer["shrinkage"]["interval"],
    }


def _elsewhere(
    campaign: Campaign, found: hmcvt.Diagnosis, model: hmcvt.EfficiencyModel
) -> dict[str, Any]:
    """Compare with the machine itself at fresh tests, on a bench without errors."""
    programme, settings, state = fresh_state(campaign, FRESH_TESTS)
    engine, output = state.engine_torque, state.output_torque
    for effect in campaign.truth.effects:
        engine, output = effect.read(engine, output)
    power = output * state.output_speed
    efficiency = power / (engine * settings.engine_speed)
    points: dict[str, FloatArray] = {
        "displacement_ratio": settings.displacement_ratio,
        "engine_speed": settings.engine_speed,
        "load_torque": power / settings.engine_speed,
    }
    if "oil_temperature" in campaign.columns:
        points["oil_temperature"] = settings.oil_temperature
    names = [campaign.layout.trains[number].name for number in programme.stage]
    before = efficiency - predicted(found.base, points, names)
    after = efficiency - predicted(found.model, points, names)
    recorded = dict(points)
    stages = list(model.stages)
    if len(stages) > 1 and len(campaign.layout.trains) > 1:
        recorded["stage"] = np.array([float(stages.index(name)) for name in names])
    gap, _ = found.gap_at(**recorded)
    usable = np.isfinite(before) & np.isfinite(after) & np.isfinite(gap)
    before, after, gap = before[usable], after[usable], gap[usable]
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(np.corrcoef(gap, before)[0, 1])
    return {
        "met": 1.0 - float(np.mean(after**2) / np.mean(before**2)),
        "true_gap": float(np.sqrt(np.mean(before**2))),
        "left_gap": float(np.sqrt(np.mean(after**2))),
        "correlation": float(correlation),
    }
