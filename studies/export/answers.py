# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Answers of exported C against those of Python, at random points of every stage."""

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.transmission.ranges import (
    ENGINE_SPEED_LIMITS,
    OperatingPoints,
    Solution,
)
from tests.export.c_library import Library
from tests.export.effect_cases import CASES, affected_model, points_of_tables
from tests.export.points import bits_differ, random_outputs, random_points

FILES = ("hm4", "hydrostatic", "output_coupled", "tractor")
"""Shipped parameter files; together they have nine stages."""

TIMED_POINTS = 20_000
TIMED_RUNS = 20
"""The fastest run counts: other programs only add to it."""


class ExportedModel(NamedTuple):
    """A shipped model and its C in both precisions."""

    name: str
    model: hmcvt.EfficiencyModel
    double: Library
    single: Library


class StageFigures(NamedTuple):
    """What was measured in one stage.

    Attributes:
        differing_bits: answers that differ from Python's in double precision.
        single_error: largest error of the efficiency in single precision [-].
        single_status: points with an answer in single precision or in Python, not in both.
        stroke_error: largest error of the efficiency of the best displacement ratio [-].
        speed_error: largest error of the efficiency of the best engine speed [-].
        optimum_status: demands with an optimum in C or in Python, not in both.
        nanoseconds: of one point on this machine, in double precision.
    """

    name: str
    differing_bits: int
    single_error: float
    single_status: int
    stroke_error: float
    speed_error: float
    optimum_status: int
    nanoseconds: float


class EffectFigures(NamedTuple):
    """What tables of effects keep at fresh points.

    Attributes:
        error: of the efficiency at 99 % of the points [-].
        largest: error of the efficiency [-].
        differing: part of the points at which the model or the tables alone have an answer [-].
        kilobytes: of the tables.
    """

    name: str
    error: float
    largest: float
    differing: float
    kilobytes: float


def exported_models(folder: Path) -> list[ExportedModel]:
    """Export and build every shipped model."""
    models = []
    for name in FILES:
        model = hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
        libraries = {}
        for precision in ("double", "single"):
            target = folder / f"{name}_{precision}"
            hmcvt_tools.export_c(model, target, precision)
            libraries[precision] = Library(target, model, precision)
        models.append(ExportedModel(name, model, **libraries))
    return models


def stage_figures(
    exported: ExportedModel, stage: str, points: int, demands: int
) -> StageFigures:
    """Compare one stage at random points and demands."""
    bits, nanoseconds = _double(exported, stage, points)
    single_error, single_status = _single(exported, stage, points)
    stroke_error, strokes_alone = _strokes(exported, stage, demands)
    speed_error, speeds_alone = _speeds(exported, stage, demands)
    return StageFigures(
        f"{exported.name} {stage}",
        bits,
        single_error,
        single_status,
        stroke_error,
        speed_error,
        strokes_alone + speeds_alone,
        nanoseconds,
    )


def _number(exported: ExportedModel, stage: str) -> int:
    return list(exported.model.stages).index(stage)


def _double(exported: ExportedModel, stage: str, count: int) -> tuple[int, float]:
    """Return answers that differ in a bit, and nanoseconds of a point."""
    points = random_points(11, count)
    number = _number(exported, stage)
    answer, status = exported.double.predict(number, *points)
    solution = exported.model.stages[stage].solution_at(OperatingPoints(*points))
    differing = 0
    for name in Solution._fields:
        differing += bits_differ(answer[name], getattr(solution, name))
    loss = points[1] * (solution.engine_torque - points[2])
    differing += bits_differ(answer["power_loss"], loss)
    differing += int(((status == 1) != np.isnan(solution.efficiency)).sum())
    timed = [column[:TIMED_POINTS] for column in points]
    seconds = []
    for _ in range(TIMED_RUNS):
        began = time.perf_counter()
        exported.double.predict(number, *timed)
        seconds.append(time.perf_counter() - began)
    return differing, 1e9 * min(seconds) / len(timed[0])


def _single(exported: ExportedModel, stage: str, count: int) -> tuple[float, int]:
    """Return the largest error, and points that only one answers."""
    points = random_points(12, count, np.float32)
    answer, status = exported.single.predict(_number(exported, stage), *points)
    efficiency = exported.model.stages[stage].efficiency(*points)
    error = float(np.nanmax(np.abs(answer["efficiency"] - efficiency)))
    return error, int(((status == 1) != np.isnan(efficiency)).sum())


def _strokes(exported: ExportedModel, stage: str, count: int) -> tuple[float, int]:
    """Compare the best displacement ratio at a held engine speed."""
    rng = np.random.default_rng(13)
    speed = rng.uniform(10.0, 320.0, count)
    load = np.exp(rng.uniform(0.0, np.log(5000.0), count))
    answer, _ = exported.double.stroke(_number(exported, stage), speed, load)
    best = exported.model.optimal_displacement_ratio(speed, load, stage=stage)
    return _compared(answer["efficiency"], best.efficiency)


def _speeds(exported: ExportedModel, stage: str, count: int) -> tuple[float, int]:
    """Compare the best engine speed at a held output speed."""
    part = exported.model.stages[stage]
    speed, power = random_outputs(14, count, part.stage)
    answer, _ = exported.double.speed(
        _number(exported, stage), speed, power, limits=ENGINE_SPEED_LIMITS
    )
    expected = []
    for output, watts in zip(speed.tolist(), power.tolist(), strict=True):
        expected.append(part.optimal_drive(output, watts).efficiency)
    return _compared(answer["efficiency"], np.array(expected))


def _compared(got: np.ndarray, expected: np.ndarray) -> tuple[float, int]:
    error = float(np.nanmax(np.abs(got - expected), initial=0.0))
    return error, int((np.isnan(got) != np.isnan(expected)).sum())


def effect_figures(case: str, count: int) -> EffectFigures:
    """Export a model with effects, and compare its C at fresh points of all stages."""
    model = affected_model(case)
    errors = []
    alone = []
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "c"
        accuracy = hmcvt_tools.export_c(model, folder)
        library = Library(folder, model)
        share = -(-count // len(model.stages))
        for number, part in enumerate(model.stages.values()):
            points = points_of_tables(500 + number, share)
            answer, _ = library.predict(number, *points)
            solution = part.solution_at(OperatingPoints(*points))
            errors.append(np.abs(answer["efficiency"] - solution.efficiency))
            alone.append(
                np.isnan(answer["engine_torque"]) != np.isnan(solution.engine_torque)
            )
    together = np.concatenate(errors)
    return EffectFigures(
        case,
        float(np.nanquantile(together, 0.99)),
        float(np.nanmax(together)),
        float(np.mean(np.concatenate(alone))),
        accuracy.kilobytes,
    )


def all_effect_figures(count: int) -> list[EffectFigures]:
    """Compare every case of `tests/export/effect_cases.py`."""
    return [effect_figures(case, count) for case in CASES]
