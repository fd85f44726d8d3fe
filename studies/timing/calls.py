# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every documented call of `efficiency`, from one point to many, with the exported C and SciPy."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

import hmcvt_core as hmcvt
import hmcvt_tools
from studies.page import Goal, spread, table
from tests.export.c_library import COMPILER, Library

from .timing import Section, Times, at_most, in_turns, ratio

SIZES = (1, 10, 100, 100_000)
MAX_RATIO = 1.5
"""Of the best documented call of its size."""
MAX_LOOKUPS = 10
"""Time of `predict` and `breakdown` at a point, in lookups."""
_REPEATS = {1: 1000, 10: 200, 100: 40, 100_000: 1}
"""Calls of one turn."""
_STAGE = "HM3"
_SCIPY = "SciPy's table"
_C = "exported C, one call"
_SHOWN = ("floats", "float64 arrays", _SCIPY, _C)
"""Calls with a row in the table; the goals count every call."""

Calls = Mapping[str, Callable[[], Any]]


def section(quick: bool) -> Section:
    """Time all of it."""
    turns = 3 if quick else 21
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    rows = []
    goals: list[Goal] = []
    with tempfile.TemporaryDirectory() as folder:
        library = _library(tractor, Path(folder))
        for calls, size in [(_scalars(tractor), 0)] + [
            (_arrays(tractor, size, library), size) for size in SIZES
        ]:
            times = _timed(turns, calls, _REPEATS[max(size, 1)], max(size, 1))
            label = f"array of {size:,}" if size else "scalar"
            rows += _rows(label, times)
            goals.append(_worst(label, times))
    goals += _points(turns)
    head = ("points", "call", "us a point", "times the best documented call")
    return Section(goals, {"calls": table(head, rows)})


def _library(model: hmcvt.EfficiencyModel, folder: Path) -> Library | None:
    """Return the exported model as a library; None without a compiler."""
    if COMPILER is None:
        return None
    hmcvt_tools.export_c(model, folder / "c")
    return Library(folder / "c", model)


def _timed(turns: int, calls: Calls, repeats: int, size: int) -> Times:
    def repeated(call: Callable[[], Any]) -> Callable[[], None]:
        def run() -> None:
            for _ in range(repeats):
                call()

        return run

    looped = {name: repeated(call) for name, call in calls.items()}
    return in_turns(turns, looped, repeats * size)


def _scalars(tractor: hmcvt.EfficiencyModel) -> Calls:
    """Return calls at one point that is given by numbers."""
    stage = tractor.stages[_STAGE]
    doubles = [np.float64(value) for value in (0.3, 150.0, 200.0)]
    singles = [np.float32(value) for value in (0.3, 150.0, 200.0)]
    return {
        "floats": lambda: stage.efficiency(0.3, 150.0, 200.0),
        "ints": lambda: stage.efficiency(0, 150, 200),
        "NumPy float64": lambda: stage.efficiency(*doubles),
        "NumPy float32": lambda: stage.efficiency(*singles),
        "floats, stage named": lambda: tractor.efficiency(
            0.3, 150.0, 200.0, stage=_STAGE
        ),
        "floats, oil temperature": lambda: stage.efficiency(0.3, 150.0, 200.0, 60.0),
    }


def _arrays(
    tractor: hmcvt.EfficiencyModel, size: int, library: Library | None
) -> Calls:
    """Return calls at several points."""
    rng = np.random.default_rng(size)
    stage = tractor.stages[_STAGE]
    point = (
        rng.uniform(-1.0, 1.0, size),
        rng.uniform(80.0, 230.0, size),
        rng.uniform(20.0, 300.0, size),
    )
    integers = (np.zeros(size, dtype=int), *(axis.astype(int) for axis in point[1:]))
    lists = [axis.tolist() for axis in point]
    names = np.full(size, _STAGE)
    axes = (
        np.linspace(-1.0, 1.0, 41),
        np.linspace(78.5, 230.0, 31),
        np.linspace(20.0, 400.0, 31),
    )
    interpolated = RegularGridInterpolator(axes, stage.efficiency_map(*axes).efficiency)
    rows = np.stack(point, axis=-1)
    calls: dict[str, Callable[[], Any]] = {
        "float64 arrays": lambda: stage.efficiency(*point),
        "int arrays": lambda: stage.efficiency(*integers),
        "stage named": lambda: tractor.efficiency(*point, stage=_STAGE),
        "stage named for each": lambda: tractor.efficiency(*point, stage=names),
        _SCIPY: lambda: interpolated(rows),
    }
    if size <= 100:
        calls["lists"] = lambda: stage.efficiency(*lists)
    if library is not None:
        number = list(tractor.stages).index(_STAGE)
        calls[_C] = lambda: library.predict(number, *point)
    return calls


def _documented(times: Times) -> list[str]:
    return [name for name in times if name not in (_SCIPY, _C)]


def _best(times: Times) -> str:
    return min(_documented(times), key=lambda name: np.median(times[name]))


def _rows(label: str, times: Times) -> list[tuple[str, ...]]:
    best = _best(times)
    rows = []
    for name in _SHOWN:
        if name not in times:
            continue
        micro = spread([1e6 * value for value in times[name]]).median
        rows.append(
            (label, name, f"{micro:.3g}", f"{ratio(times, name, best).median:.2f}")
        )
    return rows


def _worst(label: str, times: Times) -> Goal:
    best = _best(times)
    found = {name: ratio(times, name, best) for name in _documented(times)}
    worst = max(found, key=lambda name: found[name].median)
    what = f"{label}: slowest documented call ({worst}) / fastest ({best})"
    return at_most(what, found[worst], MAX_RATIO)


def _points(turns: int) -> list[Goal]:
    """Return what `predict` and `breakdown` take at a point, in lookups."""
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    point = (0.3, 150.0, 200.0)
    calls = {
        "lookup": lambda: model.efficiency(*point),
        "predict": lambda: model.predict(*point),
        "breakdown": lambda: model.breakdown(*point),
    }
    times = _timed(turns, calls, 200, 1)
    goals = []
    for name in ("predict", "breakdown"):
        what = f"{name} at a point, in lookups"
        goals.append(at_most(what, ratio(times, name, "lookup"), MAX_LOOKUPS))
    return goals
