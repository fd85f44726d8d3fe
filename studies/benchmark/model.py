# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The served model at its refit, and what every effect changes in its readings.

Every method may use these tables, so that none needs a simulator of the transmission.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects import library
from hmcvt_core.transmission.ranges import OperatingPoints
from studies.benchmark.case import (
    NUISANCE,
    Case,
    FloatArray,
    read_columns,
    write_columns,
)
from studies.benchmark.methods.linear import linear

AXES = ("displacement_ratio", "engine_speed", "load_torque", "oil_temperature")
CHANNELS = ("efficiency", "output_speed", "pressure")
PARAMETERS = ("leakage", "motor_damping", "pump_damping")
REFITS = 3
"""Gauss-Newton steps of the base from its refit to the efficiency; it settles within two."""
STEP_LIMITS = (0.3, 3.0)
"""Of the factor by which a step changes a parameter."""
STEP_PARTS = (1.0, 0.5, 0.25)
"""Parts of a step that are tried."""
BASE_STEP = 0.3
"""Relative change of a base parameter in its column: what a base may be off before a fit."""
GEAR_STEP = 0.0005
"""Change of the efficiency of every gear pair in its column."""
SIZE = 0.5
"""Size of an effect in its column, against the typical one of the library."""
_METERS = {
    "engine_zero": "zero of the engine meter",
    "output_zero": "zero of the output meter",
    "engine_gain": "gain of the engine meter",
    "output_gain": "gain of the output meter",
}

Changed = dict[str, tuple[hmcvt.EfficiencyModel, float]]
"""A model by the column it gives, and the factor of its change in the column."""


def refitted_base(
    model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples
) -> hmcvt.EfficiencyModel:
    """Return the served model with its three parameters refitted to the efficiency."""
    stages = [model.stages[name].stage for name in model.stages]
    return hmcvt.identify(samples, stage=stages).model


def write_tables(folder: Path, card: dict[str, Any]) -> None:
    """Write model_tests.csv and model_points.csv of a case that has the other files."""
    model = hmcvt.load_model(folder / "stage.yaml")
    samples = hmcvt.read_bench(folder / "bench.csv")
    tests: dict[str, Any] = {
        name: values for name, values in samples.columns.items() if name in AXES
    }
    if "stage" in samples.extra:
        tests["stage"] = samples.extra["stage"]
    points = read_columns(folder / "points.csv")
    channels = ["efficiency"]
    for name in ("output_speed", "pressure"):
        if getattr(samples, name) is not None:
            channels.append(name)
    base = refitted_base(model, samples)
    linear_base = base

    # One solution at tests and points together costs little more than one at either.
    everywhere: dict[str, Any] = {}
    for name, values in tests.items():
        everywhere[name] = np.concatenate([values, points[name]])

    def write(models: Changed) -> None:
        unchanged = readings(linear_base, everywhere)
        changes = {"base": readings(base, everywhere), "linear": unchanged}
        for name, (changed, factor) in models.items():
            change = factor * (readings(changed, everywhere) - unchanged)
            # Where the changed model stalls it says nothing of the effect.
            changes[name] = np.nan_to_num(change)
        count = len(tests["engine_speed"])
        at_tests = {name: values[:, :count] for name, values in changes.items()}
        at_points = {name: values[:, count:] for name, values in changes.items()}
        _write(folder / "model_tests.csv", at_tests, channels)
        for name in ("base", "linear"):
            # Points at which the base stalls do not count: see the scorer.
            at_points[name] = np.nan_to_num(at_points[name])
        _write(folder / "model_points.csv", at_points, ["efficiency"])

    for _ in range(REFITS):
        write(nuisance_models(linear_base, card))
        linear_base = stepped(linear_base, Case(folder), everywhere)
    effects = effect_models(linear_base, "oil_temperature" in tests)
    write({**nuisance_models(linear_base, card), **effects})


def stepped(
    base: hmcvt.EfficiencyModel, case: Case, everywhere: dict[str, Any]
) -> hmcvt.EfficiencyModel:
    """Return the base after a Gauss-Newton step to all channels, meter errors adapting.

    The step is shortened where the model would stall at more tests and points, or left out.
    """
    problem = linear(case)
    steps = dict(zip(PARAMETERS, problem.fit(()).nuisance, strict=False))
    stalls = np.sum(np.isnan(readings(base, everywhere)))
    for part in STEP_PARTS:
        values = {}
        for name, step in steps.items():
            factor = float(np.clip(1.0 + BASE_STEP * part * step, *STEP_LIMITS))
            values[name] = factor * getattr(base.parameters, name)
        changed = replace(base, parameters=replace(base.parameters, **values))
        if np.sum(np.isnan(readings(changed, everywhere))) <= stalls:
            return changed
    return base


def nuisance_models(base: hmcvt.EfficiencyModel, card: dict[str, Any]) -> Changed:
    """Return the base with each parameter and each error of the meters changed."""
    models = {}
    for name in PARAMETERS:
        value = (1.0 + BASE_STEP) * getattr(base.parameters, name)
        parameters = replace(base.parameters, **{name: value})
        models[f"{NUISANCE}{name}"] = (replace(base, parameters=parameters), 1.0)
    kinds = {(kind.name, kind.form): kind for kind in library()}
    gear = kinds["gear_mesh", "constant"](loss=GEAR_STEP)
    models[f"{NUISANCE}gear_loss"] = (replace(base, effects=(gear,)), 1.0)
    for error, form in _METERS.items():
        kind = kinds["torque_sensor", form]
        (size,) = kind.parameters()
        deviation = card["meters"][error]
        effect = kind(**{size.name: size.typical})
        changed = replace(base, effects=(effect,))
        models[f"{NUISANCE}{error}"] = (changed, deviation / size.typical)
    return models


def effect_models(base: hmcvt.EfficiencyModel, has_oil: bool) -> Changed:
    """Return the base with each effect in each form."""
    models = {}
    for kind in library():
        if kind.needs_oil_temperature and not has_oil:
            continue
        for label, effect in _effects(kind):
            models[label] = (replace(base, effects=(effect,)), 1.0)
    return models


def _effects(kind: Any) -> list[tuple[str, Any]]:
    """Return a form of an effect with its usual shape, and with each shape at its ends."""
    sizes = {p.name: SIZE * p.typical for p in kind.parameters() if p.is_size}
    name = f"{kind.name}:{kind.form}" if kind.form else kind.name
    effects = [(name, kind(**sizes))]
    for shape in kind.parameters():
        for value in shape.grid:
            if not shape.is_size and value != shape.typical:
                changed = kind(**sizes, **{shape.name: value})
                effects.append((f"{name}/{shape.name}={value:g}", changed))
    return effects


def _write(path: Path, columns: dict[str, FloatArray], channels: Sequence[str]) -> None:
    """Write a table; the columns have shape (3, n), a row a channel."""
    count = columns["base"].shape[1]
    table: dict[str, Any] = {
        "channel": [name for name in channels for _ in range(count)],
        "row": [float(row) for _ in channels for row in range(count)],
    }
    rows = [CHANNELS.index(name) for name in channels]
    for name, values in columns.items():
        table[name] = values[rows].ravel()
    write_columns(path, table)


def readings(model: hmcvt.EfficiencyModel, points: dict[str, Any]) -> FloatArray:
    """Return efficiency, output speed and pressure at points, shape (3, n)."""
    stage = points["stage"] if len(model.stages) > 1 else None
    axes = [points[name] for name in AXES[:3]]
    at = OperatingPoints.checked(axes, points.get("oil_temperature"), stage)
    read = model.readings_at(at)
    return np.stack([read[name] for name in CHANNELS])
