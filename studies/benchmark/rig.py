# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Measured cases: windows of a rig with known faults, in the folders of the benchmark.

The machine is one pump at one speed; its efficiency is the volumetric one, flow / ideal flow. The
load torque is the ideal one, pressure x displacement. `baseline.csv` holds windows of the sound
pump, `bench.csv` windows of another state, and `points.csv` further windows of that state, where
the prediction is compared with the reading.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.benches.unit.sound import SoundUnit, fit_sound_unit, varied_axes
from hmcvt_core.benches.unit.system import points_of
from studies.benchmark.case import NUISANCE, RIG, FloatArray, effects, write_columns
from studies.real.__main__ import SHIPPED
from studies.real.rig import SOUND_COOLER, Mask, Rig, read_rig

TABLE = SHIPPED / "zema_pump.csv"
HALVES = 3
"""Divisions of the sound windows, in which nothing is hidden."""
HELD_OUT = 1.0 / 3.0
"""Fraction of the windows of a state that are points."""
DIRECTIONS = 6
"""Principal errors of the sound base that are columns: what its fit leaves uncertain."""
SIZE = 0.5
"""Size of an effect in its column, against the typical one, as for simulated cases."""
PUMP_LEAKS = ["orifice_leakage", "laminar_leakage", "pressure_leakage"]
"""One class: over the narrow range of pressure of one setting no test distinguishes them."""
BYPASS = ("orifice_leakage",)
"""The bypass of the rig is an orifice."""


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured case before it is written.

    Attributes:
        name: of the case.
        kind: `single` or `nothing`.
        effects: that are known to be present.
        baseline: windows of the sound pump.
        changed: windows to be explained.
        what: the state, in words.
    """

    name: str
    kind: str
    effects: tuple[str, ...]
    baseline: Mask
    changed: Mask
    what: str


def measured_cases(rig: Rig) -> list[Measured]:
    """Return the cases of a rig: leaks, poor coolers, and sound halves."""
    cases = []
    for fault in sorted(set(rig.fault.tolist()) - {0.0}):
        faulty = rig.fault == fault
        for cooler in sorted(set(rig.cooler.tolist()), reverse=True):
            at = rig.cooler == cooler
            name = f"{RIG}-leak{fault:g}-cooler{cooler:g}"
            what = f"bypass {fault:g} at cooler {cooler:g} %"
            cases.append(
                Measured(name, "single", BYPASS, rig.sound & at, faulty & at, what)
            )
    cold = rig.sound & (rig.cooler == SOUND_COOLER)
    for cooler in sorted(set(rig.cooler.tolist()) - {SOUND_COOLER}, reverse=True):
        warm = rig.sound & (rig.cooler == cooler)
        name = f"{RIG}-warm-cooler{cooler:g}"
        what = f"sound pump, oil warmed by cooler {cooler:g} %"
        cases.append(Measured(name, "single", ("oil_temperature",), cold, warm, what))
    for seed in range(HALVES):
        rows = np.random.default_rng(seed).permutation(np.flatnonzero(rig.sound))
        half = np.zeros(len(rig.flow), dtype=bool)
        half[rows[: len(rows) // 2]] = True
        name = f"{RIG}-sound{seed}"
        what = "sound pump, half of the windows"
        cases.append(Measured(name, "nothing", (), rig.sound & ~half, half, what))
    return cases


def rig_names() -> list[str]:
    """Return the names of the measured cases."""
    return [case.name for case in measured_cases(read_rig(TABLE))]


def write_rig_case(folder: Path, truth: Path, name: str) -> None:
    """Write a measured case and its truth, unless they are there.

    Args:
        folder: of all cases.
        truth: folder of the truth of all cases.
        name: of the case.
    """
    done = truth / f"{name}.yaml"
    if done.is_file():
        return
    rig = read_rig(TABLE)
    (case,) = [item for item in measured_cases(rig) if item.name == name]
    rows = np.random.default_rng(0).permutation(np.flatnonzero(case.changed))
    points = np.zeros(len(rig.flow), dtype=bool)
    points[rows[: round(HELD_OUT * len(rows))]] = True
    baseline = rig.samples(case.baseline)
    tests = rig.samples(case.changed & ~points)
    fresh = rig.samples(points)
    sound = fit_sound_unit(baseline, ("flow_loss",), varied_axes(tests))
    noise = _noise(sound)
    own = folder / name
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir(parents=True)
    for file, samples in (("baseline.csv", baseline), ("bench.csv", tests)):
        columns = {**axes_of(samples), "efficiency": efficiency_of(samples)}
        columns["efficiency_std"] = np.full(len(samples), noise)
        write_columns(own / file, columns)
    write_columns(own / "points.csv", axes_of(fresh))
    _write_tables(own, sound, tests, fresh)
    card = _card(case, len(tests))
    text = yaml.safe_dump(card, sort_keys=False)
    (own / "card.yaml").write_text(text, encoding="utf-8")
    truth.mkdir(parents=True, exist_ok=True)
    write_columns(truth / f"{name}.csv", {"efficiency": efficiency_of(fresh)})
    verdict = "listed" if case.effects else "no_gap"
    classes = ["pump leak" if e in PUMP_LEAKS else e for e in case.effects]
    known = {
        "case": name,
        "kind": case.kind,
        "verdict": verdict,
        "hidden": list(case.effects),
        "effects": list(case.effects),
        "classes": classes,
    }
    done.write_text(yaml.safe_dump(known), encoding="utf-8")


def axes_of(samples: UnitSamples) -> dict[str, FloatArray]:
    """Return the columns of a case that state the operating points of a pump."""
    assert samples.oil_temperature is not None
    return {
        "displacement_ratio": samples.displacement_ratio,
        "engine_speed": samples.speed,
        "load_torque": samples.pressure * samples.displacement,
        "oil_temperature": samples.oil_temperature,
    }


def ideal_flow(samples: UnitSamples) -> FloatArray:
    """Return the flow without losses [m3/s], shape (n,)."""
    return samples.displacement * samples.displacement_ratio * samples.speed


def efficiency_of(samples: UnitSamples) -> FloatArray:
    """Return the volumetric efficiency [-], shape (n,)."""
    assert samples.flow_loss is not None
    return 1.0 - samples.flow_loss / ideal_flow(samples)


def samples_of(columns: dict[str, Any], displacement: float) -> UnitSamples:
    """Return the columns of a case as samples of a pump; the inverse of `efficiency_of`."""
    ideal = displacement * columns["displacement_ratio"] * columns["engine_speed"]
    efficiency = columns.get("efficiency", np.ones_like(ideal))
    return UnitSamples(
        kind="pump",
        displacement=displacement,
        displacement_ratio=columns["displacement_ratio"],
        speed=columns["engine_speed"],
        pressure=columns["load_torque"] / displacement,
        flow_loss=ideal * (1.0 - efficiency),
        torque_loss=None,
        oil_temperature=columns["oil_temperature"],
    )


def _noise(sound: SoundUnit) -> float:
    """Return the standard deviation of the efficiency about the sound base [-]."""
    samples = sound.samples
    mean, _ = sound.sound_at(points_of(samples))
    error = (samples.flow_loss - mean[0]) / ideal_flow(samples)
    return float(np.std(error))


def _write_tables(
    own: Path, sound: SoundUnit, tests: UnitSamples, fresh: UnitSamples
) -> None:
    """Write what the sound base, its errors and each effect say at tests and points."""
    count = len(tests)
    points = {
        name: np.concatenate([values, points_of(fresh)[name]])
        for name, values in points_of(tests).items()
    }
    ideal = np.concatenate([ideal_flow(tests), ideal_flow(fresh)])
    mean, covariance = sound.sound_at(points)
    base = 1.0 - mean[0] / ideal
    columns = {"base": base, "linear": base}
    variance, directions = np.linalg.eigh(covariance[0] / np.outer(ideal, ideal))
    for i in range(1, DIRECTIONS + 1):
        error = directions[:, -i] * np.sqrt(max(variance[-i], 0.0))
        columns[f"{NUISANCE}sound_{i}"] = error
    names, errors = sound.meter_errors(points, mean)
    for name, change in zip(names, errors, strict=True):
        columns[f"{NUISANCE}{name}"] = -change[0] / ideal
    for effect in sound.library:
        if effect.name in effects():
            size = effect.sizes()[0]
            changed = effect.with_values({size.name: SIZE * size.typical})
            label = f"{effect.name}:{effect.form}" if effect.form else effect.name
            columns[label] = -sound.changed_by((changed,), points)[0] / ideal
    for file, rows in (
        ("model_tests.csv", slice(None, count)),
        ("model_points.csv", slice(count, None)),
    ):
        values = {name: row[rows] for name, row in columns.items()}
        n = len(values["base"])
        table: dict[str, Any] = {
            "channel": ["efficiency"] * n,
            "row": [float(row) for row in range(n)],
        }
        write_columns(own / file, {**table, **values})


def _card(case: Measured, tests: int) -> dict[str, Any]:
    return {
        "case": case.name,
        "machine": {
            "plant": RIG,
            "layout": "one pump; efficiency is volumetric, load torque is ideal",
            "displacement": float(read_rig(TABLE).samples(case.changed).displacement),
        },
        "tests": tests,
        "meters": {},
        "classes": {"pump leak": PUMP_LEAKS},
        "licence": "CC BY 4.0, see data/README.md",
        "truth": f"from the record of the rig: {case.what}",
    }
