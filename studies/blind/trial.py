# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign of the twin, diagnosed, and the answer held against what the plant hides.

The diagnosis is handed the contract columns of the campaign and nothing else, as `BenchSamples`:
that is the blinding.
"""

import time
from typing import Any

import numpy as np
import numpy.typing as npt

import hmcvt_core as hmcvt
from studies.blind.campaign import Campaign, fresh
from studies.blind.conditions import LISTED, STRANGE, Case, draw
from studies.blind.effect import FloatArray
from studies.blind.visible import beyond_others, visible

AXES = ("displacement_ratio", "engine_speed", "load_torque")
_FRESH_SEED, _FRESH_SAMPLES = 2**42, 300


def at_hand(campaign: Campaign) -> tuple[hmcvt.EfficiencyModel, hmcvt.BenchSamples]:
    """Return all that the product gets to see: the model served, and what the bench shows."""
    columns: dict[str, Any] = campaign.samples
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    return model, hmcvt.BenchSamples(**columns)


def score(case: Case) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and say how the answer compares with the truth."""
    campaign = draw(case)
    model, samples = at_hand(campaign)
    start = time.process_time()
    found = hmcvt.diagnose(model, samples)
    seconds, answer = time.process_time() - start, found.to_dict()
    told = answer["delivered"]["rmse_before"]
    return {
        **hidden(case, campaign),
        "left": visible(campaign).left,
        "beyond": beyond_others(campaign)
        if case.group in (*LISTED, *STRANGE)
        else None,
        "seconds": seconds,
        "verdict": answer["verdict"],
        "unlisted": answer["unlisted_probability"],
        "sets": [
            (sorted(each["effects"]), each["probability"])
            for each in answer["sets"][:5]
        ],
        "alternatives": [
            [cause["effect"], *cause["indistinguishable_from"]]
            for cause in answer["causes"][:1]
        ],
        "promised": answer["shrinkage"]["fraction"],
        "told_gap": max(0.0, told**2 - campaign.bench.options.efficiency_noise**2)
        ** 0.5,
        **_place(campaign, found, answer["where"]),
        **_elsewhere(campaign, found, case.seed),
    }


def hidden(case: Case, campaign: Campaign) -> dict[str, Any]:
    """Return what a record says of the truth."""
    options = campaign.bench.options
    return {
        "condition": case.condition,
        "kind": case.kind,
        "group": case.group,
        "seed": case.seed,
        "truth": sorted(campaign.bench.names),
        "variants": [effect.variant for effect in campaign.bench.effects],
        "columns": [
            name
            for name in ("output_speed", "oil_temperature", "pressure")
            if name in campaign.samples
        ],
        "misfit": options.misfit,
    }


def left_over(campaign: Campaign, model: hmcvt.EfficiencyModel) -> FloatArray:
    """What the meters would show without noise, less what a model says; shape (n,)."""
    stroke, speed, torque = (campaign.samples[axis] for axis in AXES)
    said = model.efficiency(
        stroke, speed, torque, campaign.samples.get("oil_temperature")
    )
    return np.asarray(campaign.truth["efficiency"] - said)


def _place(
    campaign: Campaign, found: hmcvt.Diagnosis, where: list[Any]
) -> dict[str, Any]:
    """Hold the samples in the regions told against those where much is left over."""
    left = np.nan_to_num(np.abs(left_over(campaign, found.base)))
    much = left > np.sqrt(np.mean(left**2))
    told = np.zeros(len(much), dtype=bool)
    for region in where:
        inside = [
            (campaign.samples[axis] >= region[axis][0])
            & (campaign.samples[axis] <= region[axis][1])
            for axis in AXES
        ]
        told |= np.all(inside, axis=0)
    both, larger = int(np.sum(told & much)), max(int(np.sum(told)), int(np.sum(much)))
    return {
        "f1": _f1(told, much),
        "f1_everything": _f1(np.ones_like(much), much),
        "place_found": 2 * both >= larger > 0,
    }


def _f1(told: npt.NDArray[np.bool_], much: npt.NDArray[np.bool_]) -> float:
    return float(2.0 * np.sum(told & much) / max(1, int(np.sum(told) + np.sum(much))))


def _elsewhere(campaign: Campaign, found: hmcvt.Diagnosis, seed: int) -> dict[str, Any]:
    """Ask on a fresh campaign of the same plant, against its readings without noise."""
    there = fresh(campaign, _FRESH_SEED + seed, samples=_FRESH_SAMPLES)
    before, after = left_over(there, found.base), left_over(there, found.model)
    recorded = {
        name: there.samples[name]
        for name in ("oil_temperature",)
        if name in there.samples
    }
    told, _ = found.gap_at(*(there.samples[axis] for axis in AXES), **recorded)
    usable = np.isfinite(before) & np.isfinite(after) & np.isfinite(told)
    before, after, told = before[usable], after[usable], told[usable]
    with np.errstate(invalid="ignore"):  # nothing told is a correlation of zero
        correlation = float(np.nan_to_num(np.corrcoef(told, before)[0, 1]))
    return {
        "correlation": correlation,
        "true_gap": float(np.sqrt(np.mean(before**2))),
        "met": 1.0 - float(np.mean(after**2) / np.mean(before**2)),
    }
