# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.timing.compiled`: what a compiled core would gain, on top of the exported C.

The first table compares single calls. The second measures whole tasks, and how much of their time
is spent where a compiled core would answer: at points of the balance without effects, and in the
search for the best displacement ratio.
"""

from __future__ import annotations

import ctypes
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.model import optimum
from hmcvt_core.physics import balance
from hmcvt_tools.mission import Drive, Planned, Vehicle, read_cycle
from studies.page import spread, table
from studies.road.bus import encode, faults_of, write_trace
from studies.road.drive import drive, machine_of
from studies.road.scoring import well_known
from tests.export.c_library import COMPILER, Library

from .timing import Section, in_turns, ratio

_SIZES = (1, 10, 100, 1_000, 100_000)
_STAGE = "HM3"
_POINT = (0.3, 150.0, 200.0)


class _Prediction(ctypes.Structure):
    """`hmcvt_prediction` of the exported header."""

    _fields_ = [
        ("efficiency", ctypes.c_double),
        ("output_speed", ctypes.c_double),
        ("engine_torque", ctypes.c_double),
        ("power_loss", ctypes.c_double),
        ("inside_domain", ctypes.c_int),
    ]


def _scalar_calls(library: Library, number: int) -> dict[str, Callable[[], float]]:
    """Return one lookup and one optimum through `ctypes`, with their arguments declared."""
    real = ctypes.c_double
    predict = library.library.hmcvt_predict
    predict.argtypes = [ctypes.c_int, real, real, real, ctypes.c_void_p]
    prediction = _Prediction()
    to_prediction = ctypes.addressof(prediction)
    stroke = library.library.hmcvt_optimal_displacement_ratio
    stroke.argtypes = [ctypes.c_int, real, real, ctypes.c_void_p]
    best = (real * 3)()
    to_best = ctypes.addressof(best)

    def lookup() -> float:
        predict(number, *_POINT, to_prediction)
        return float(prediction.efficiency)

    def optimal() -> float:
        stroke(number, *_POINT[1:], to_best)
        return float(best[0])

    return {"lookup": lookup, "optimum, engine speed held": optimal}


def call_table(turns: int, tractor: hmcvt.EfficiencyModel, library: Library) -> str:
    """Return the table of single calls."""
    stage = tractor.stages[_STAGE]
    number = list(tractor.stages).index(_STAGE)
    compiled = _scalar_calls(library, number)
    ours: dict[str, Callable[[], Any]] = {
        "lookup": lambda: stage.efficiency(*_POINT),
        "optimum, engine speed held": lambda: stage.optimal_displacement_ratio(
            *_POINT[1:]
        ),
    }
    rows = [_row(turns, name, ours[name], compiled[name], 500) for name in ours]
    rng = np.random.default_rng(0)
    for size in _SIZES:
        point = (
            rng.uniform(-1.0, 1.0, size),
            rng.uniform(80.0, 230.0, size),
            rng.uniform(20.0, 300.0, size),
        )
        rows.append(
            _row(
                turns,
                f"array of {size:,}",
                lambda point=point: stage.efficiency(*point),
                lambda point=point: library.predict(number, *point),
                max(1, 2_000 // size),
            )
        )
    return table(("call", "hmcvt, us", "C by ctypes, us", "hmcvt / C"), rows)


def _row(
    turns: int,
    name: str,
    ours: Callable[[], Any],
    compiled: Callable[[], Any],
    repeats: int,
) -> tuple[str, ...]:
    def repeated(call: Callable[[], Any]) -> None:
        for _ in range(repeats):
            call()

    times = in_turns(
        turns,
        {"ours": lambda: repeated(ours), "C": lambda: repeated(compiled)},
        repeats,
    )
    micro = [f"{1e6 * spread(times[key]).median:.3g}" for key in ("ours", "C")]
    return (name, *micro, ratio(times, "ours", "C").text(".3g"))


class _Meter:
    """Time within functions that a compiled core would replace; nested calls count once.

    Attributes:
        seconds: spent in them.
        calls: how many.
        points: of all calls.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.calls = 0
        self.points = 0
        self._depth = 0

    def metered(
        self, function: Callable[..., Any], points_of: Callable[..., int]
    ) -> Callable[..., Any]:
        """Return a function that is metered."""

        def run(*arguments: Any, **named: Any) -> Any:
            self._depth += 1
            start = time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                self._depth -= 1
                if not self._depth:
                    self.seconds += time.process_time() - start
                    self.calls += 1
                    self.points += points_of(*arguments)

        return run


def _install(meter: _Meter) -> None:
    """Meter the closed form at arrays and points, and the search for the best stroke."""
    solver = balance.BalanceSolver
    solve = meter.metered(solver.solve, lambda _, points: points.engine_speed.size)
    held = meter.metered(solver.held, lambda _, speed, *rest: np.size(speed))
    search = meter.metered(optimum._best_stroke, lambda *_: 1)
    solver.solve = solve  # type: ignore[method-assign]
    solver.held = held  # type: ignore[method-assign]
    optimum._best_stroke = search
    of_quadrant = balance.point_solver

    def point_solver(quadrant: Any) -> Any:
        return meter.metered(of_quadrant(quadrant), lambda *_: 1)

    balance.point_solver = point_solver


def tasks(folder: Path) -> dict[str, Callable[[], Any]]:
    """Return whole tasks as users run them."""
    tractor = well_known()
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    vehicle = Vehicle()
    given = Drive(tractor, engine, vehicle)
    sowing = read_cycle("sowing", vehicle)
    rng = np.random.default_rng(0)
    machine = machine_of(tractor, rng)
    driven = drive(machine, 60.0, rng)
    trace = folder / "drive.log"
    write_trace(trace, encode(driven, machine, faults_of(rng), False))
    bench = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    few = bench.select(np.arange(0, 96, 4))
    hm4 = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    work: dict[str, Callable[[], Any]] = {
        "mission: sowing, causal, with its bound": lambda: Planned.of(
            given, sowing
        ).mission("causal"),
        "estimate of a minute of bus": lambda: hmcvt_tools.estimate(trace, tractor),
        "identify 24 tests": lambda: hmcvt.identify(few),
        "optimum, output speed held": lambda: hm4.optimal_displacement_ratio(
            150.0, 200.0, hold="output_speed", displacement_ratio=0.3
        ),
    }
    answer = _node_answer(hm4)
    if answer is not None:
        work["answer of the node on its topics"] = answer
    return work


def _node_answer(model: hmcvt.EfficiencyModel) -> Callable[[], Any] | None:
    """Return what a node does at a new operating point; None without ROS."""
    try:
        import rclpy
    except ImportError:
        return None
    from hmcvt_ros.inputs import OperatingPoint
    from hmcvt_ros.outputs import Outputs, Served
    from hmcvt_ros.parameters import declare

    rclpy.init()
    node = rclpy.create_node("compiled_study")
    outputs = Outputs(node.create_publisher)
    served = Served(model, model, None)
    settings = declare(node)
    speeds = np.linspace(100.0, 200.0, 10_000).tolist()

    def answer() -> None:
        # Another point each time: the node remembers the optimum of the last one.
        point = OperatingPoint(0.3, speeds.pop(), 200.0)
        outputs.answer(served, point, settings)

    return answer


def task_table(turns: int, folder: Path) -> str:
    """Return the table of whole tasks."""
    meter = _Meter()
    _install(meter)
    rows = []
    for name, task in tasks(folder).items():
        task()
        seconds, shares = [], []
        for _ in range(turns):
            meter.seconds = 0.0
            meter.calls = 0
            meter.points = 0
            start = time.process_time()
            task()
            seconds.append(time.process_time() - start)
            shares.append(meter.seconds / seconds[-1])
        share = float(np.median(shares))
        rows.append(
            (
                name,
                f"{1e3 * np.median(seconds):.3g} ms",
                f"{100.0 * share:.0f} %",
                f"{meter.calls:,}",
                f"{meter.points / max(meter.calls, 1):,.0f}",
                f"{1.0 / (1.0 - share):.2f}",
            )
        )
    head = (
        "task",
        "time",
        "in calls that C would answer",
        "such calls",
        "points a call",
        "faster if these took no time",
    )
    return table(head, rows)


def section(quick: bool) -> Section:
    """Measure both tables; the second one without ROS has no row of the node."""
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    if COMPILER is None:
        return Section([], {"compiled_calls": "", "compiled_tasks": ""})
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hmcvt_tools.export_c(tractor, folder / "c")
        library = Library(folder / "c", tractor)
        calls = call_table(3 if quick else 21, tractor, library)
        tasks = task_table(1 if quick else 7, folder)
    return Section([], {"compiled_calls": calls, "compiled_tasks": tasks})


if __name__ == "__main__":
    for printed in section(quick=False).values.values():
        print(printed)
