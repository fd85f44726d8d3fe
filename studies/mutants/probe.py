# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Answers of the core, as one JSON document: `python -m studies.mutants.probe [REFERENCE]`.

A mutant that leaves all of them as they are changes no answer. Everything goes through public
names, so that what is asked stays the same however the core is built.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.files import plain
from hmcvt_core.physics.effects import library
from studies.blind.campaign import make_campaign

STROKES = np.array([-1.0, -0.62, -0.2, 0.0, 1e-3, 0.31, 0.7, 1.0])[:, None, None]
SPEEDS = np.array([60.0, 105.0, 160.0, 230.0])[:, None]
LOADS = np.array([5.0, 60.0, 180.0, 350.0, 600.0])
TWINS = ("charge_pump", "stroke_leakage", "oil_temperature", "torque_sensor")


def answers() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Names, and what gives the answer; an error is an answer, too."""
    hm4 = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    paper = hmcvt.load_model(hmcvt.data_path("params/paper.yaml"))
    table2 = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    simulated = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    for name, model in {"hm4": hm4, "paper": paper}.items():
        yield from _of_model(name, model)
    yield "refused", lambda: hm4.efficiency(2.0, 100.0, 100.0)
    yield "stage", lambda: hm4.stage.to_mapping()
    yield "gear efficiency", lambda: hm4.stage.with_gear_efficiency(1.2)
    five, three = table2.select(np.array([0, 1, 3, 4, 5])), table2.select(np.array([2, 6, 7]))
    for formulation in ("power_balance", "published"):
        yield f"identify {formulation}", lambda formulation=formulation: _identified(
            hmcvt.identify(five, validation=three, formulation=formulation))
    yield "identify simulated", lambda: _identified(hmcvt.identify(simulated, gear_efficiency=0.97))
    yield "identify one", lambda: _identified(hmcvt.identify(simulated.select(np.arange(1))))
    yield "diagnose simulated", lambda: _diagnosed(hm4, simulated)
    yield "separable", lambda: _separable(hm4, simulated)
    yield from _with_effects(hm4)


def _of_model(name: str, model: hmcvt.EfficiencyModel) -> Iterator[tuple[str, Callable[[], Any]]]:
    grid = STROKES, SPEEDS, LOADS
    yield f"{name} efficiency", lambda: model.efficiency(*grid)
    yield f"{name} speed", lambda: model.output_speed(*grid)
    yield f"{name} one by one", lambda: [
        (model.efficiency(*point), model.output_speed(*point), model.refusal(*point))
        for point in ((float(s), float(n), float(t)) for s in STROKES.ravel()
                      for n in SPEEDS.ravel() for t in LOADS)]
    yield f"{name} predict", lambda: list(model.predict(*grid))
    yield f"{name} breakdown", lambda: _breakdown(model)
    yield f"{name} optimum", lambda: vars(model.optimal_displacement_ratio(SPEEDS, LOADS))
    yield f"{name} optimum of one", lambda: vars(model.optimal_displacement_ratio(160.0, 180.0))
    yield f"{name} optimum, output held", lambda: vars(model.optimal_displacement_ratio(
        SPEEDS[1:], LOADS[1:4], hold="output_speed", output_speed=np.array([90.0, 190.0, 260.0])))
    yield f"{name} optimum, point held", lambda: vars(model.optimal_displacement_ratio(
        160.0, 180.0, hold="output_speed", displacement_ratio=-0.3))
    yield f"{name} map", lambda: vars(model.efficiency_map(
        STROKES.ravel(), SPEEDS.ravel(), LOADS))
    yield f"{name} file", lambda: _saved(model)


def _with_effects(model: hmcvt.EfficiencyModel) -> Iterator[tuple[str, Callable[[], Any]]]:
    at = np.array([0.3, -0.7, 0.0]), np.array([120.0, 200.0, 90.0]), np.array([200.0, 150.0, 40.0])
    for kind in library():
        effect = kind(**{parameter.name: parameter.typical for parameter in kind.parameters()})
        with_effect = replace(model, effects=(effect,))
        yield f"effect {kind.__name__}", lambda model=with_effect: [
            model.efficiency(*at, 75.0), model.output_speed(*at, 75.0), _breakdown(model, at),
            vars(model.optimal_displacement_ratio(150.0, 200.0)), _saved(model)]
    for seed, name in enumerate(TWINS):
        yield f"diagnose {name}", lambda seed=seed, name=name: _diagnosed(
            model, _campaign(seed, name))


def _campaign(seed: int, name: str) -> hmcvt.BenchSamples:
    found = make_campaign(seed, ((name, 0.015),), samples=32,
                          temperature_swing=25.0 if name == "oil_temperature" else None)
    return hmcvt.BenchSamples(**found.samples)


def _breakdown(model: hmcvt.EfficiencyModel, at: Any = (STROKES, SPEEDS, LOADS)) -> Any:
    found = model.breakdown(*at)
    return [found.input_power, found.output_power, found.losses]


def _identified(found: hmcvt.Identification) -> Any:
    return [found.to_dict(), found.report(), found.model.parameters.to_array(),
            found.model.predict(0.4, 150.0, 200.0)]


def _diagnosed(model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples) -> Any:
    found = hmcvt.diagnose(model, samples)
    return [found.to_dict(), found.report(), found.model.efficiency(0.4, 150.0, 200.0)]


def _separable(model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples) -> Any:
    found = hmcvt.separable(model, samples)
    return [found.to_dict(), found.report(matrix=True)]


def _saved(model: hmcvt.EfficiencyModel) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.yaml"
        hmcvt.save_model(model, path)
        return [path.read_text(encoding="utf-8"), hmcvt.load_model(path).fingerprint]


def document() -> Iterator[tuple[str, Any]]:
    """All answers by name."""
    for name, ask in answers():
        try:
            found = json.loads(json.dumps(plain(ask()), default=repr), object_hook=_undated)
        except Exception as error:
            found = f"{type(error).__name__}: {error}"
        yield name, found


def changed(reference: dict[str, Any]) -> str | None:
    """The first answer that is another than the one known; None when all agree."""
    return next((name for name, found in document() if not same(found, reference[name])), None)


def _undated(entries: dict[str, Any]) -> dict[str, Any]:
    """Leave out the date of a fit."""
    return {key: value for key, value in entries.items() if key != "date"}


def same(one: Any, other: Any) -> bool:
    """Tell whether two documents agree, numbers within a millionth."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, rtol=1e-6, atol=1e-12, equal_nan=True))
    return bool(one == other)


if __name__ == "__main__":
    if sys.argv[1:]:
        print(changed(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))) or "")
    else:
        print(json.dumps(dict(document())))
