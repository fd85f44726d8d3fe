# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One campaign of the bench, diagnosed, and the answer compared with the truth.

The diagnosis receives the columns that the bench shows and nothing else.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from studies.blind.bench.campaign import Campaign, fresh_state, make_campaign
from studies.blind.bench.classes import classes_of
from studies.blind.bench.confusion import Confusion, confusion_of
from studies.blind.bench.layouts import Layout
from studies.blind.bench.library import listed_name, without_effects
from studies.blind.bench.plant import Settings, State
from studies.blind.bench.programme import Programme
from studies.blind.bench.properties import Bench
from studies.blind.bench.scores import DETECTABLE
from studies.blind.effect import Effect, FloatArray

#: Squared cosine above which two effects of one set have the same signature.
SAME = 0.9
#: Fresh tests with which promises are compared.
FRESH_TESTS = 200
#: Campaigns that are drawn until one is usable, and the growth of effects meanwhile.
ATTEMPTS = 24
GROWTH = 1.4
#: Campaigns of one seed are drawn from this many seeds.
SEEDS = 1000
#: Deviation of the zero of a torque meter of class 0.1 whose range is 1.5 times the largest torque,
#: as a part of that torque; and of its gain.
CLASS_ZERO = 0.0015 / 3.0**0.5
CLASS_GAIN = 0.001 / 3.0**0.5


class Hidden(Protocol):
    """What a machine hides."""

    @property
    def effects(self) -> Sequence[Effect]:
        """The effects."""


class Measured(Protocol):
    """A campaign, as far as it is compared with fresh tests."""

    @property
    def layout(self) -> Layout:
        """The transmission."""

    @property
    def truth(self) -> Hidden:
        """What is hidden."""

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """What the meters show, by column."""


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose.

    Attributes:
        kind: of what it hides.
        seed: of everything.
        bench: properties of the bench.
    """

    kind: str
    seed: int
    bench: Bench

    @property
    def key(self) -> str:
        """A name that no other case of a run has."""
        return f"{self.kind}/{self.seed}"


@lru_cache(maxsize=64)
def draw(case: Case) -> tuple[Campaign, Confusion]:
    """Draw campaigns from the seed on; return the first whose effects can all be seen.

    Effects grow with every second attempt, so that one that hardly shows ends as well.

    Raises:
        InputError: none of the attempts is usable.
    """
    for attempt in range(ATTEMPTS):
        growth = GROWTH ** (attempt % 3)
        seed = SEEDS * case.seed + attempt // 3
        try:
            campaign = make_campaign(case.kind, seed, case.bench, growth=growth)
        except InputError:
            continue
        confusion = confusion_of(campaign)
        if not campaign.truth.effects:
            return campaign, confusion
        if min(confusion.left) >= DETECTABLE and confusion.alike < SAME:
            return campaign, confusion
    raise InputError(f"{case.key}: no campaign of {ATTEMPTS} is usable")


def served(campaign: Campaign) -> tuple[hmcvt.EfficiencyModel, hmcvt.BenchSamples]:
    """Return all that the product receives: the served model and the bench's columns."""
    columns: dict[str, Any] = campaign.columns
    model = hmcvt.load_model(hmcvt.data_path(campaign.layout.model_file))
    samples = hmcvt.BenchSamples(**columns, extra=campaign.texts)
    return model, samples


def judge(case: Case) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and return how the answer compares with the truth."""
    campaign, confusion = draw(case)
    model, samples = served(campaign)
    start = time.process_time()
    # An unlisted loss stays unlisted, whatever the list has learnt.
    unlisted = campaign.truth.effects if case.kind == "unlisted" else ()
    with without_effects(unlisted):
        found = hmcvt.diagnose(model, samples)
    seconds = time.process_time() - start
    answer = found.to_dict()
    fresh = fresh_state(campaign, FRESH_TESTS)
    return {
        **_hidden(case, campaign, confusion),
        **answered(answer, campaign.layout.output_coupled),
        "seconds": seconds,
        "level": level_of_meters(campaign, *fresh[1:]),
        **compared(campaign, fresh, found, model),
    }


def level_of_meters(campaign: Campaign, settings: Settings, state: State) -> float:
    """Return how well two torque meters of class 0.1 fix the mean of the efficiency [-].

    The standard deviation of that mean, after as many sessions as the campaign has. No analysis of
    the readings knows it better: a mean is what zeros and gains in common to the sessions leave.

    Args:
        campaign: with its sessions.
        settings: of the tests over which the mean is.
        state: of these.
    """
    efficiency = np.abs(state.efficiency(settings.engine_speed))
    variance = 0.0
    for torque in (np.abs(state.engine_torque), np.abs(state.output_torque)):
        of_zero = CLASS_ZERO * np.nanmax(torque) * np.nanmean(efficiency / torque)
        of_gain = CLASS_GAIN * np.nanmean(efficiency)
        variance += of_zero**2 + of_gain**2
    sessions = len(np.unique(campaign.programme.session))
    return float(np.sqrt(variance / sessions))


def _hidden(case: Case, campaign: Campaign, confusion: Confusion) -> dict[str, Any]:
    """Return what a record says of the truth."""
    variants = {effect.name: effect.variant for effect in campaign.truth.effects}
    sizes = {effect.name: float(effect.size) for effect in campaign.truth.effects}
    names = list(campaign.truth.names)
    return {
        "kind": case.kind,
        "seed": case.seed,
        "layout": campaign.layout.name,
        "columns": sorted(campaign.columns),
        "truth": names,
        "variants": variants,
        "sizes": sizes,
        "true_classes": _true_classes(case, campaign),
        "left": list(confusion.left),
        "beyond": confusion.beyond,
        "sessions": len(np.unique(campaign.programme.session)),
        "noise": float(np.sqrt(np.mean(campaign.noise**2))),
    }


def _true_classes(case: Case, campaign: Campaign) -> list[str]:
    """Return the classes that a right answer names."""
    if case.kind == "newly_listed":
        names = []
        for effect in campaign.truth.effects:
            names.append(listed_name(effect) or effect.name)
        return sorted(names)
    variants = {effect.name: effect.variant for effect in campaign.truth.effects}
    output_coupled = campaign.layout.output_coupled
    return classes_of(list(campaign.truth.names), variants, output_coupled)


def answered(answer: dict[str, Any], output_coupled: bool) -> dict[str, Any]:
    """Return what a record says of the verdict, with sets of one class merged.

    Args:
        answer: `Diagnosis.to_dict()`.
        output_coupled: whether every stage tested is.
    """
    forms = {cause["effect"]: cause.get("form") or "" for cause in answer["causes"]}
    merged: dict[tuple[str, ...], float] = {}
    for item in answer["sets"]:
        key = tuple(classes_of(item["effects"], forms, output_coupled))
        merged[key] = merged.get(key, 0.0) + item["probability"]
    ranked = sorted(merged.items(), key=lambda entry: -entry[1])
    shrinkage = answer["shrinkage"]
    return {
        "verdict": answer["verdict"],
        "unlisted": answer["unlisted_probability"],
        "sets": [
            [sorted(item["effects"]), item["probability"]]
            for item in answer["sets"][:5]
        ],
        "forms": forms,
        "classes": [[list(classes), p] for classes, p in ranked[:5]],
        "members": [
            [classes_of(item["effects"], forms, output_coupled), item["probability"]]
            for item in answer["members"]
        ],
        "gap": answer["gap"],
        "promised": shrinkage["fraction"],
        "interval": shrinkage["interval"],
    }


def compared(
    campaign: Measured,
    fresh: tuple[Programme, Settings, State],
    found: hmcvt.Diagnosis,
    model: hmcvt.EfficiencyModel,
) -> dict[str, Any]:
    """Compare with the machine itself at fresh tests, on a bench without errors.

    Args:
        campaign: that is diagnosed.
        fresh: random tests of the same machine, without meters.
        found: the diagnosis.
        model: the model that is served.
    """
    programme, settings, state = fresh
    efficiency, points = true_efficiency(campaign, settings, state)
    names = [campaign.layout.trains[number].name for number in programme.stage]
    before = efficiency - predicted(found.base, points, names)
    after = efficiency - predicted(found.model, points, names)
    recorded = dict(points)
    stages = list(model.stages)
    if len(stages) > 1 and len(campaign.layout.trains) > 1:
        numbers = [float(stages.index(name)) for name in names]
        recorded["stage"] = np.array(numbers)
    gap, deviation = found.gap_at(**recorded)
    usable = np.isfinite(before) & np.isfinite(after) & np.isfinite(gap)
    before = before[usable]
    after = after[usable]
    gap = gap[usable]
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(np.corrcoef(gap, before)[0, 1])
        pull = (gap - before) / deviation[usable]
    return {
        "met": 1.0 - float(np.mean(after**2) / np.mean(before**2)),
        "true_gap": float(np.sqrt(np.mean(before**2))),
        "left_gap": float(np.sqrt(np.mean(after**2))),
        "correlation": float(correlation),
        "within_two": float(np.mean(np.abs(np.nan_to_num(pull, nan=9.0)) < 2.0)),
    }


def true_efficiency(
    campaign: Measured, settings: Settings, state: State
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the efficiency of the machine on a bench without errors, and the points by axis.

    Args:
        campaign: with the machine.
        settings: true settings of tests, n of them.
        state: true state of these.
    """
    engine = state.engine_torque
    output = state.output_torque
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
    return np.asarray(efficiency), points


def predicted(
    model: Any, points: dict[str, FloatArray], names: list[str]
) -> FloatArray:
    """Efficiency that a model predicts at tests of several stages."""
    predicted = np.full(len(names), np.nan)
    for name in sorted(set(names)):
        index = np.array([i for i, other in enumerate(names) if other == name])
        stage = model.stages.get(name, model)
        at = [
            points[axis][index]
            for axis in ("displacement_ratio", "engine_speed", "load_torque")
        ]
        oil = None
        if "oil_temperature" in points:
            oil = points["oil_temperature"][index]
        predicted[index] = stage.efficiency(*at, oil)
    return predicted
