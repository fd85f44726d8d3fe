# SPDX-License-Identifier: Apache-2.0
"""The blind trial: sealed campaigns of the twin, diagnosed through the public command alone.

Each case makes a campaign, seals its label away, hands the CSV to `hmcvt diagnose` in a process of
its own, and only then opens the seal to score. Results go to a file line by line, so that an
interrupted trial goes on where it stopped.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.hypothesis import Hypothesis, refit
from hmcvt_core.errors import HmcvtError
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.files.resources import data_path
from hmcvt_core.fleet.threads import ONE_BLAS_THREAD
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import load_model
from studies.blind.campaign import Campaign, fresh, make_campaign
from studies.blind.catalogue import UNKNOWN_EFFECTS
from studies.blind.seal import open_seal, seal

DETECTABLE = 18.0
"""Squared deviations that an effect must leave after the refit to count as detectable."""

_FRESH_SEED = 900_000
_ALIASES = {"bearing_seal_drag": "bearing_drag"}
"""Names of the twin that the library spells otherwise."""


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


def run(cases: Sequence[Case], results: Path, jobs: int) -> Iterator[dict[str, Any]]:
    """Diagnose and score cases; yields each record once it is on disk.

    Args:
        cases: what to run; cases whose record is in `results` already are not run again.
        results: file of JSON lines, appended to.
        jobs: processes side by side.
    """
    done = {record["key"]: record for record in read_results(results)}
    results.parent.mkdir(parents=True, exist_ok=True)
    yield from (done[case.key] for case in cases if case.key in done)
    todo = [case for case in cases if case.key not in done]
    pool = ThreadPoolExecutor(jobs)
    try:
        with results.open("a", encoding="utf-8") as file:
            for record in pool.map(_score_case, todo):
                file.write(json.dumps(record) + "\n")
                file.flush()
                yield record
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def read_results(path: Path) -> list[dict[str, Any]]:
    """Read the records of a results file; a torn last line is left out."""
    if not path.exists():
        return []
    records = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return records


def _score_case(case: Case) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="hmcvt-blind-") as name:
        folder = Path(name)
        campaign = make_campaign(case.seed, case.effects, **dict(case.options))
        sealed = seal(campaign, "campaign", folder / "bench", folder / "labels")
        model_path = folder / "diagnosed.yaml"
        answer = _diagnose(sealed.bench, model_path)
        label = open_seal(sealed)
        model = load_model(model_path) if model_path.exists() else None
        samples = read_bench(sealed.bench)
    record: dict[str, Any] = {
        "key": case.key,
        "condition": case.condition,
        "seed": case.seed,
        "truth": [_ALIASES.get(name, name) for name, _ in case.effects],
        "known": not any(name in UNKNOWN_EFFECTS for name, _ in case.effects),
        "options": dict(case.options),
        "label": label,
        "verdict": answer["verdict"],
        "p_value": answer["gap"]["p_value"],
        "causes": [
            {
                "effect": cause["effect"],
                "probability": cause["probability"],
                "set": [cause["effect"], *cause["indistinguishable_from"]],
            }
            for cause in answer["causes"]
        ],
        "promised": answer["shrinkage"]["fraction"],
        "interval": answer["shrinkage"]["interval"],
        "where": answer["where"][:1],
    }
    base = _base(samples)
    record["left"] = _left(campaign, samples)
    record["met"] = _met(campaign, base, model) if case.effects and model is not None else None
    record["place_found"] = _place_found(campaign, answer["where"][:1])
    return record


def _diagnose(bench: Path, model_path: Path) -> dict[str, Any]:
    command = [
        sys.executable,
        "-m",
        "hmcvt_core.cli",
        "diagnose",
        str(bench),
        "--json",
        "--save-model",
        str(model_path),
    ]
    environment = {**os.environ, **ONE_BLAS_THREAD}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        raise HmcvtError(f"{' '.join(command)} failed: {done.stderr.strip()}")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


# --- scoring: what the seal and the plant tell ------------------------------------------------


def _served() -> EfficiencyModel:
    return load_model(data_path("params/hm4.yaml"))


def _base(samples: BenchSamples) -> EfficiencyModel:
    """The served model refitted to a campaign, no effect added."""
    system = Transmission(_served())
    found = refit(Hypothesis(system), observe(samples))
    return system.model_of(found.base, (), samples)


def _left(campaign: Campaign, samples: BenchSamples) -> float:
    """Squared deviations that the effect leaves after a refit to readings without noise."""
    values: dict[str, Any] = dict(campaign.samples)
    values["efficiency"] = campaign.truth["efficiency"]
    if "output_speed" in values:
        values["output_speed"] = campaign.truth["output_speed"]
    # The real noise, not the stated one, tells what could be seen.
    values["efficiency_std"] = np.full(len(samples), campaign.label.options.efficiency_noise)
    observed = observe(BenchSamples(**values))
    found = refit(Hypothesis(Transmission(_served())), observed,
                  noise=np.ones(len(observed.readings)))
    return float(np.sum(found.whitened**2))


def _met(campaign: Campaign, base: EfficiencyModel, model: EfficiencyModel) -> float | None:
    """Shrinkage on a fresh campaign of the same plant, against its readings without noise."""
    there = fresh(campaign, _FRESH_SEED + campaign.label.plant_seed)
    s = there.samples
    errors = [
        there.truth["efficiency"]
        - each.efficiency(
            s["displacement_ratio"], s["engine_speed"], s["load_torque"], s.get("oil_temperature")
        )
        for each in (base, model)
    ]
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
