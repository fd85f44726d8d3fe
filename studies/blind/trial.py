# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The blind trial: campaigns of the twin, diagnosed through the public command alone.

Each case makes a campaign and gives its CSV file to `hmcvt diagnose` in a process of its own, which
is the blinding: the command sees contract columns and nothing else. What the plant hides is held
against the answer afterwards.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import hmcvt_core as hmcvt
from studies.blind.campaign import Campaign, fresh, make_campaign
from studies.blind.catalogue import UNKNOWN_EFFECTS
from studies.blind.effect import FloatArray

DETECTABLE = 18.0
"""Squared deviations that an effect must leave after the refit to count as detectable."""

_FRESH_SEED = 900_000
_ALIASES = {"bearing_seal_drag": "bearing_drag"}
"""Names of the twin that the library spells otherwise."""
# log10 of the leakage, dampings: mean and deviation before any bench, and bounds.
_MEAN, _SPREAD = np.array([-10.8, 0.15, 0.20]), np.array([0.6, 0.25, 0.40])
_BOUNDS = np.array([[-13.0, -9.0], [0.0, 3.0], [0.0, 3.0], [-6.0, 6.0], [-6.0, 6.0]])
_METER_GAIN, _GEAR_LOSS = 0.0015, 0.0005  # one deviation of each
_SPEED_NOISE = 0.001  # relative
_STALLED = 100.0  # deviations charged where the model has no answer
_TRUST = np.array([8.0, 1.0])  # samples that the stated noise of efficiency and speed is worth
_ROUNDS = 8


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose.

    Attributes:
        condition: name of the conditions it is measured under.
        seed: of plant, plan and noise.
        effects: (name, shift of the efficiency wanted) of each effect switched on.
        options: keyword arguments of `make_campaign`.
    """

    condition: str
    seed: int
    effects: tuple[tuple[str, float], ...]
    options: tuple[tuple[str, Any], ...]

    @property
    def key(self) -> str:
        """A name that no other case has."""
        names = "_".join(name for name, _ in self.effects) or "none"
        return f"{self.condition}-{names}-{self.seed}"


def score(case: Case) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and say how the answer compares with the truth."""
    campaign = make_campaign(case.seed, case.effects, **dict(case.options))
    columns: dict[str, Any] = dict(campaign.samples)
    samples = hmcvt.BenchSamples(**columns)
    with tempfile.TemporaryDirectory(prefix="hmcvt-blind-") as folder:
        answer, model = _diagnose(samples, Path(folder))
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    noise = campaign.label.options.efficiency_noise
    base, _ = refitted(served, samples, noise, known=False)
    # The real noise, not the stated one, tells what could be seen in readings without any.
    _, left = refitted(served, _without_noise(campaign, samples), noise, known=True)
    return {
        "condition": case.condition,
        "seed": case.seed,
        "truth": [_ALIASES.get(name, name) for name, _ in case.effects],
        "known": not any(name in UNKNOWN_EFFECTS for name, _ in case.effects),
        "options": dict(case.options),
        "verdict": answer["verdict"],
        "p_value": answer["gap"]["p_value"],
        "causes": [{"effect": cause["effect"], "probability": cause["probability"],
                    "set": [cause["effect"], *cause["indistinguishable_from"]]}
                   for cause in answer["causes"]],
        "promised": answer["shrinkage"]["fraction"],
        "interval": answer["shrinkage"]["interval"],
        "where": answer["where"][:1],
        "left": left,
        "met": _met(campaign, base, model) if case.effects and model is not None else None,
        "place_found": _place_found(campaign, answer["where"][:1]),
    }


def _diagnose(
    samples: hmcvt.BenchSamples, folder: Path
) -> tuple[dict[str, Any], hmcvt.EfficiencyModel | None]:
    bench, saved = folder / "campaign.csv", folder / "diagnosed.yaml"
    hmcvt.write_bench(bench, samples)
    command = [sys.executable, "-m", "hmcvt_core.cli", "diagnose", str(bench), "--json",
               "--save-model", str(saved)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise hmcvt.HmcvtError(f"{' '.join(command)} failed: {done.stderr.strip()}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer, hmcvt.load_model(saved) if saved.exists() else None


def _without_noise(campaign: Campaign, samples: hmcvt.BenchSamples) -> hmcvt.BenchSamples:
    speed = None if samples.output_speed is None else campaign.truth["output_speed"]
    return replace(samples, efficiency=campaign.truth["efficiency"], output_speed=speed)


def _met(
    campaign: Campaign, base: hmcvt.EfficiencyModel, model: hmcvt.EfficiencyModel
) -> float | None:
    """Shrinkage on a fresh campaign of the same plant, against its readings without noise."""
    there = fresh(campaign, _FRESH_SEED + campaign.label.plant_seed)
    s = there.samples
    at = (s["displacement_ratio"], s["engine_speed"], s["load_torque"], s.get("oil_temperature"))
    errors = [there.truth["efficiency"] - each.efficiency(*at) for each in (base, model)]
    usable = np.isfinite(errors[0]) & np.isfinite(errors[1])
    before, after = (float(np.mean(error[usable] ** 2)) for error in errors)
    return 1.0 - after / before if before > 0.0 else None


def _place_found(campaign: Campaign, where: Sequence[dict[str, Any]]) -> bool | None:
    """Whether the first region holds the middle of the true place, axis by axis."""
    boxes = [sized.effect.box for sized in campaign.label.effects if sized.effect.box is not None]
    if not boxes:
        return None
    if not where:
        return False
    box, region = asdict(boxes[0]), where[0]
    for axis in ("displacement_ratio", "engine_speed", "load_torque"):
        low, high = box[axis]
        values = campaign.samples[axis]
        inside = values[(values >= low) & (values <= high)]
        if len(inside) in (0, len(values)):
            continue
        middle = (max(low, values.min()) + min(high, values.max())) / 2.0
        if not region[axis][0] <= middle <= region[axis][1]:
            return False
    return True


def refitted(
    model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples, noise: float, known: bool
) -> tuple[hmcvt.EfficiencyModel, float]:
    """Refit the base parameters of a model without effects: what remains can be detected.

    Written apart from the diagnosis that is on trial: SciPy's least squares on the served model,
    with the shared errors that no bench is free of (gain of the torque meters, gear efficiency).

    Args:
        model: where stage and gear efficiency come from.
        samples: to be met; output speed counts where it is there.
        noise: standard deviation of the efficiency [-].
        known: whether the noise is what is told; else it is what the residuals say as well.

    Returns:
        The refitted model, and the squared deviations that it leaves, over all channels.
    """
    at: Any = (samples.displacement_ratio, samples.engine_speed, samples.load_torque)
    gear = model.stage.gear_pairs[0].efficiency
    worse = model.stage.with_gear_efficiency(gear - _GEAR_LOSS)

    def at_base(base: FloatArray, stage: hmcvt.Stage) -> hmcvt.EfficiencyModel:
        return replace(model, stage=stage, parameters=hmcvt.HydraulicParameters(
            float(10.0 ** base[0]), float(base[1]), float(base[2])))

    def deviations(theta: FloatArray) -> FloatArray:
        there = at_base(theta[:3], model.stage)
        efficiency = there.efficiency(*at)
        loss = at_base(theta[:3], worse).efficiency(*at) - efficiency
        shared = theta[3] * _METER_GAIN * efficiency + theta[4] * loss
        rows = [(samples.efficiency - efficiency - shared) / noise]
        if samples.output_speed is not None:
            rows.append((samples.output_speed - there.output_speed(*at))
                        / (_SPEED_NOISE * samples.output_speed))
        return np.nan_to_num(np.array(rows), nan=_STALLED)

    def penalised(theta: FloatArray, scale: FloatArray) -> FloatArray:
        prior = np.concatenate([(theta[:3] - _MEAN) / _SPREAD, theta[3:]])
        return np.concatenate([(deviations(theta) / scale).ravel(), prior])

    theta, scale = np.concatenate([_MEAN, np.zeros(2)]), np.ones((1, 1))
    for _ in range(1 if known else _ROUNDS):
        theta = least_squares(penalised, theta, bounds=_BOUNDS.T, x_scale="jac", args=(scale,)).x
        left = np.sum(deviations(theta) ** 2, axis=1)
        trust, free = _TRUST[:len(left)], len(samples) - len(theta) / len(left)
        scale = np.sqrt((trust + left) / (trust + free))[:, None]
    return at_base(theta[:3], model.stage), float(np.sum(left))
