# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cases of the benchmark and their truth, from the plants of studies/blind.

Frozen: a change of anything that moves a case raises VERSION, and the page states the SHA-256 of
all cases. Seeds below TABLE_SEEDS are for development.
"""

import hashlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import hmcvt_core as hmcvt
from studies.benchmark.case import RIG, read_columns, write_columns
from studies.benchmark.case import effects as listed_effects
from studies.benchmark.model import write_tables
from studies.blind.bench import judge as bench_judge
from studies.blind.bench.campaign import fresh_state
from studies.blind.bench.classes import class_of
from studies.blind.bench.properties import Bench
from studies.blind.campaign import fresh
from studies.blind.catalogue import KNOWN_EFFECTS, TURNED_EFFECTS, UNKNOWN_EFFECTS
from studies.blind.conditions import Case as TwinCase
from studies.blind.conditions import draw as draw_twin
from studies.blind.effect import Effect
from studies.blind.trial import AXES, at_hand

VERSION = 3
"""Until 29 November 2026 a closed clutch slipped by the power of the load, not by its torque."""
DEVELOPMENT_SEEDS = 96_100_000
TABLE_SEEDS = 96_500_000
POINTS = 200
"""Fresh operating points of a case."""
TWIN_KINDS = (
    "single", "pair", "single", "unlisted", "nothing", "single", "pair", "single",
    "base_off", "triple", "single", "wrong_sign",
)  # fmt: skip
"""Kinds of campaigns of the twin, in the order in which they come."""
BENCH_KINDS = (
    "single", "pair", "nothing", "unlisted", "single", "base_off", "single", "pair",
    "newly_listed", "wrong_sign", "single", "triple",
)  # fmt: skip
_OTHER_NAMES = {"clutch_microslip": ("clutch_slip",)}
"""Losses of the twin that effects.yaml has under another name."""
_TRIES = 50
_FRESH_SEED = 2**43
_TWIN_METERS = {
    "output_speed": 0.001,
    "pressure": 0.005,
    "pressure_floor": 4e4,
    "engine_zero": 0.0,
    "output_zero": 0.0,
    "engine_gain": 0.0015,
    "output_gain": 0.0,
}
"""Errors of the meters of the twin, as `card.yaml` states them: see `card_of`."""
_SHARED_ERROR = 0.001
"""Largest zero, of full scale, and gain of a torque meter in a session on the bench."""


@dataclass(frozen=True)
class Simulated:
    """A simulated case before it is written.

    Attributes:
        model_file: parameter file that is served.
        samples: what the bench shows.
        points: fresh operating points by column.
        efficiency: true efficiency at the points [-].
        truth: what is hidden, for the truth file.
        card: of the case.
    """

    model_file: str
    samples: hmcvt.BenchSamples
    points: dict[str, Any]
    efficiency: np.ndarray
    truth: dict[str, Any]
    card: dict[str, Any]


def names_of(count: int) -> list[tuple[str, str, int]]:
    """Return name, kind and number of so many cases, of either plant in turn."""
    names = []
    for number in range(count):
        plant = ("twin", "bench")[number % 2]
        kinds = TWIN_KINDS if plant == "twin" else BENCH_KINDS
        kind = kinds[number // 2 % len(kinds)]
        names.append((f"{plant}-{number:03d}", kind, number))
    return names


def write_case(folder: Path, truth: Path, name: str, kind: str, seed: int) -> None:
    """Write a case and its truth, unless they are there.

    Args:
        folder: of all cases.
        truth: folder of the truth of all cases.
        name: of the case; begins with the plant.
        kind: of what it hides.
        seed: of everything.
    """
    done = truth / f"{name}.yaml"
    if done.is_file():
        return
    make = simulated_twin if name.startswith("twin") else simulated_bench
    case = make(kind, seed)
    own = folder / name
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    hmcvt.write_bench(own / "bench.csv", case.samples)
    # Nine digits in every file of a case.
    write_columns(own / "bench.csv", read_columns(own / "bench.csv"))
    write_columns(own / "points.csv", case.points)
    shutil.copyfile(hmcvt.data_path(case.model_file), own / "stage.yaml")
    card = {"case": name, **case.card}
    text = yaml.safe_dump(card, sort_keys=False, allow_unicode=True)
    (own / "card.yaml").write_text(text, encoding="utf-8")
    write_tables(own, card)
    truth.mkdir(parents=True, exist_ok=True)
    write_columns(truth / f"{name}.csv", {"efficiency": case.efficiency})
    text = yaml.safe_dump({"case": name, "kind": kind, "seed": seed, **case.truth})
    done.write_text(text, encoding="utf-8")


def simulated_twin(kind: str, seed: int) -> Simulated:
    """Return a campaign of the twin."""
    rng = np.random.default_rng([seed, 53])
    condition = str(rng.choice(["0.4 %", "0.1 %"]))
    campaign = draw_twin(TwinCase(condition, _twin_kind(kind, rng), seed))
    _, samples = at_hand(campaign)
    there = fresh(campaign, _FRESH_SEED + seed, samples=POINTS)
    points = {axis: there.samples[axis] for axis in AXES}
    if "oil_temperature" in campaign.samples:
        points["oil_temperature"] = there.samples["oil_temperature"]
    variants = {effect.name: effect.variant for effect in campaign.bench.effects}
    names = sorted(campaign.bench.names)
    return Simulated(
        model_file="params/hm4.yaml",
        samples=samples,
        points=points,
        efficiency=there.truth["efficiency"],
        truth=truth_of(kind, names, variants, False),
        card=card_of("twin", "HM4", samples, dict(_TWIN_METERS), False),
    )


def _twin_kind(kind: str, rng: np.random.Generator) -> str:
    """Return the word of the twin for a kind of case."""
    words = {"nothing": "none", "base_off": "base off"}
    several = {
        "single": KNOWN_EFFECTS,
        "unlisted": [name for name in UNKNOWN_EFFECTS if name != "clutch_microslip"],
        "wrong_sign": list(TURNED_EFFECTS),
    }
    if kind in several:
        return str(rng.choice(several[kind]))
    return words.get(kind, kind)


def simulated_bench(kind: str, seed: int) -> Simulated:
    """Return a campaign of the bench; an unlisted loss is one that no list has."""
    for number in range(_TRIES):
        case = bench_judge.Case(kind, _TRIES * seed + number, Bench())
        try:
            campaign, _ = bench_judge.draw(case)
        except hmcvt.InputError:
            continue
        known = [listed_name(effect) for effect in campaign.truth.effects]
        if kind != "unlisted" or known == [None]:
            break
    else:
        raise RuntimeError(f"{kind}/{seed}: no campaign is usable")
    _, samples = bench_judge.served(campaign)
    programme, settings, state = fresh_state(campaign, POINTS)
    efficiency, points = bench_judge.true_efficiency(campaign, settings, state)
    usable = np.isfinite(efficiency)
    columns: dict[str, Any] = {axis: v[usable] for axis, v in points.items()}
    layout = campaign.layout
    if layout.names_stages:
        stages = [layout.trains[i].name for i in programme.stage[usable]]
        columns["stage"] = stages
    names = list(campaign.truth.names)
    variants = {effect.name: effect.variant for effect in campaign.truth.effects}
    if kind == "newly_listed":
        names = sorted(name for name in known if name)
        variants = {}
    meters = {
        "output_speed": float(np.sqrt(2.0) * campaign.meters.speed_scatter),
        "pressure": 0.005,
        "pressure_floor": 4e4,
        "engine_zero": float(_SHARED_ERROR * campaign.meters.engine.full_scale),
        "output_zero": float(_SHARED_ERROR * campaign.meters.output.full_scale),
        "engine_gain": _SHARED_ERROR,
        "output_gain": _SHARED_ERROR,
    }
    output_coupled = layout.output_coupled
    return Simulated(
        model_file=layout.model_file,
        samples=samples,
        points=columns,
        efficiency=efficiency[usable],
        truth=truth_of(kind, names, variants, output_coupled),
        card=card_of("bench", layout.name, samples, meters, output_coupled),
    )


def listed_name(effect: Effect) -> str | None:
    """Return the name under which effects.yaml lists a loss of the bench, or None."""
    names = getattr(effect, "listed_as", ()) or _OTHER_NAMES.get(effect.name, ())
    for name in (effect.name, *names):
        if name in listed_effects():
            return str(name)
    return None


def truth_of(
    kind: str, names: list[str], variants: dict[str, str], output_coupled: bool
) -> dict[str, Any]:
    """Return what a truth file holds.

    Args:
        kind: of the case.
        names: of the hidden effects.
        variants: of their forms.
        output_coupled: whether every stage tested is output-coupled.
    """
    verdict = "listed"
    if kind in ("nothing", "base_off"):
        verdict = "no_gap"
    if kind in ("unlisted", "wrong_sign"):
        verdict = "unlisted"
    listed = list(names) if verdict == "listed" else []
    classes = {
        class_of(name, variants.get(name, ""), output_coupled) for name in listed
    }
    return {
        "verdict": verdict,
        "hidden": list(names),
        "effects": listed,
        "forms": {name: form for name, form in variants.items() if form},
        "classes": sorted(classes),
    }


def card_of(
    plant: str,
    layout: str,
    samples: hmcvt.BenchSamples,
    meters: dict[str, float],
    output_coupled: bool,
) -> dict[str, Any]:
    """Return the card of a simulated case.

    Meters are standard deviations. `output_speed` is relative; `pressure` is relative with
    `pressure_floor` [Pa] in quadrature; the zeros [N m] and gains [-] of the torque meters are
    shared by the tests of a session. The scatter of the efficiency is the column efficiency_std.
    """
    zero = "torque_sensor:zero of the engine meter"
    classes = {
        class_of("charge_pump", "", False): ["charge_pump", "bearing_drag", zero],
    }
    if output_coupled:
        classes[class_of("gear_mesh", "", True)] = [
            "gear_mesh",
            "planetary_mesh",
            "torque_sensor:gain of the engine meter",
            "torque_sensor:gain of the output meter",
        ]
    return {
        "generator": VERSION,
        "machine": {"plant": plant, "layout": layout},
        "tests": len(samples.efficiency),
        "meters": meters,
        "classes": classes,
        "licence": "Apache-2.0",
        "truth": "known in full: simulated by studies/blind",
    }


def files(folder: Path, truth: Path) -> Iterator[Path]:
    """Yield the frozen files: of simulated cases without model tables, and their truth."""
    for path in sorted(folder.glob("*/*")):
        is_table = path.name.startswith("model_")
        if not (is_table or path.parent.name.startswith(RIG)):
            yield path
    for path in sorted(truth.glob("*")):
        if not path.name.startswith(RIG):
            yield path


def digest(folder: Path, truth: Path) -> str:
    """Return the SHA-256 over name and content of all frozen files."""
    total = hashlib.sha256()
    for path in files(folder, truth):
        total.update(f"{path.parent.name}/{path.name}\n".encode())
        total.update(path.read_bytes())
    return total.hexdigest()


def seed_of(first: int, number: int) -> int:
    """Return the seed of a case."""
    return first + number
