# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Campaigns in which one quantity varied that nothing recorded, and controls.

    python -m studies.driver --campaigns 200 --seed 95000000

The noise of the efficiency is stated. The quantity varies anew at each test, warms up, or differs
between sessions; its changes make the readings scatter 1.5 to 6 times their statement. Controls
hide nothing, or state the noise 1.5 times too small.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.physics.effects.hydraulic import CompressibilityAir, OilTemperature
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.physics.effects.sensor import EngineTorqueZero
from hmcvt_core.transmission.ranges import OperatingPoints
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.judge import CLASS_ZERO
from studies.blind.effect import FloatArray
from studies.page import table

TESTS = 96
SPACING = 300.0
"""Time between two tests [s]."""
NIGHT = 50_000.0
"""Pause between two sessions [s]."""
COURSES = {
    "random": ("tests",),
    "warming": ("minutes", "hours"),
    "session": ("sessions",),
}
"""Courses of time, and the time scales that are right for each."""
UNDERSTATED = 1.5
WITHIN_CLASS = 2.0
"""Zeros of six sessions within so many deviations are counted apart: few looks can tell them."""
RATIOS = (1.5, 6.0)


def _oil(course: FloatArray) -> tuple[Effect, FloatArray]:
    return OilTemperature(strength=1.0), 60.0 + course


QUANTITIES: dict[str, Callable[[float], Effect] | None] = {
    "oil temperature": None,
    "charge pressure": lambda size: ChargePump(torque=size),
    "air in the oil": lambda size: CompressibilityAir(compliance=size),
    "torque meter": lambda size: EngineTorqueZero(zero=size),
}
ZEROS = ("charge pressure", "torque meter")
"""Quantities that are a torque."""
CONTROLS = ("nothing", "understated")


@dataclass(frozen=True)
class Case:
    """One campaign: what varies, over which course of time, and whether samples have stamps."""

    quantity: str
    course: str
    stamped: bool
    seed: int


def cases(campaigns: int, seed: int) -> list[Case]:
    """Return so many campaigns with a quantity, and half as many controls of each kind."""
    drawn = []
    names = list(QUANTITIES)
    courses = list(COURSES)
    for i in range(campaigns):
        course = courses[i // len(names) % len(courses)]
        # Sessions are told by their stamps or by their names.
        drawn.append(Case(names[i % len(names)], course, i % 5 != 4, seed + i))
    for i in range(campaigns // 2):
        first = seed + campaigns + 2 * i
        drawn += [
            Case(name, "random", True, first + j) for j, name in enumerate(CONTROLS)
        ]
    return drawn


def judge(case: Case) -> dict[str, Any]:
    """Diagnose a campaign and return what was said of it."""
    samples, true_ratio, zero_ratio = measured(case)
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    found = hmcvt.diagnose(model, samples)
    scatter = found.scatter
    return {
        "case": case,
        "true_ratio": true_ratio,
        "zero_ratio": zero_ratio,
        "verdict": found.verdict,
        "ratio": found.agreement.ratio,
        "time_scale": None if scatter is None else scatter.time_scale,
        "quantities": () if scatter is None else scatter.quantities,
        "leading": found.sets[0].effects if found.sets else (),
    }


def measured(case: Case) -> tuple[hmcvt.BenchSamples, float, float]:
    """Return readings, their scatter / the noise that is stated, and the ratio of a zero.

    A torque that is constant within each session reads as the zero of a meter. The ratio is its
    root mean square / the standard deviation of such a zero; infinite for anything else.
    """
    rng = np.random.default_rng(case.seed)
    base = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    stroke = rng.uniform(-1.0, 1.0, TESTS)
    speed = rng.uniform(80.0, 210.0, TESTS)
    load = rng.uniform(80.0, 400.0, TESTS)
    noise = float(rng.uniform(0.001, 0.004))
    stamp, session = _times(case.course)
    course = _course(case.course, stamp, session, rng)
    ratio = float(np.exp(rng.uniform(*np.log(RATIOS))))
    points = OperatingPoints(stroke, speed, load)
    efficiency, output_speed, size = _readings(
        base, points, case, course, ratio * noise
    )
    nominal = base.readings_at(points)["efficiency"]
    usable = np.isfinite(efficiency) & (nominal > 0.2)
    efficiency = efficiency + noise * rng.standard_normal(TESTS)
    output_speed = output_speed * (1.0 + 0.001 * rng.standard_normal(TESTS))
    changed = float(np.sqrt(np.mean((efficiency - nominal)[usable] ** 2)))
    stated = noise / UNDERSTATED if case.quantity == "understated" else noise
    extra = {}
    if case.course == "session":
        extra = {"session": [f"day {number}" for number in session[usable]]}
    samples = hmcvt.BenchSamples(
        stroke[usable],
        speed[usable],
        load[usable],
        efficiency[usable],
        output_speed=output_speed[usable],
        efficiency_std=np.full(int(usable.sum()), stated),
        stamp=stamp[usable] if case.stamped else None,
        source=f"{case.quantity}, {case.course}",
        extra=extra,
    )
    zero_ratio = np.inf
    if case.course == "session" and case.quantity in ZEROS:
        engine_torque = load[usable] / nominal[usable]
        zero_ratio = size / (CLASS_ZERO * float(engine_torque.max()))
    return samples, changed / stated, zero_ratio


def _times(course: str) -> tuple[FloatArray, FloatArray]:
    """Return stamps and the number of the session of each test."""
    per_session = TESTS if course != "session" else TESTS // 6
    session = np.arange(TESTS) // per_session
    return SPACING * np.arange(TESTS) + NIGHT * session, session


def _course(
    course: str, stamp: FloatArray, session: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Return a course of time with mean 0 and root mean square 1."""
    values = rng.standard_normal(TESTS)
    if course == "session":
        values = rng.standard_normal(int(session.max()) + 1)[session]
    elif course == "warming":
        constant = float(np.exp(rng.uniform(*np.log((1800.0, 7200.0)))))
        values = -np.exp(-stamp / constant)
    values = values - values.mean()
    return np.asarray(values / np.sqrt(np.mean(values**2)))


def _readings(
    base: hmcvt.EfficiencyModel,
    points: OperatingPoints,
    case: Case,
    course: FloatArray,
    wanted: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Return efficiency, output speed and size; the changes of the first are sized to a scatter."""
    size = 1.0
    readings = _read(base, points)
    if case.quantity in CONTROLS:
        return readings[0], readings[1], 0.0
    for _ in range(6):  # nearly linear in the size
        readings = _with_quantity(base, points, case, size * course)
        change = readings[0] - base.readings_at(points)["efficiency"]
        scatter = float(np.sqrt(np.nanmean((change - np.nanmean(change)) ** 2)))
        size *= wanted / max(scatter, 1e-9)
    readings = _with_quantity(base, points, case, size * course)
    return readings[0], readings[1], size


def _with_quantity(
    base: hmcvt.EfficiencyModel, points: OperatingPoints, case: Case, course: FloatArray
) -> FloatArray:
    """Return efficiency and output speed with the quantity at its value in each test."""
    effect_of = QUANTITIES[case.quantity]
    if effect_of is None:
        oil, temperature = _oil(course)
        warm = points._replace(oil_temperature=np.clip(temperature, 0.0, 110.0))
        truth = replace(base, effects=(oil,))
        return _read(truth, warm)
    columns = []
    for i, value in enumerate(course.tolist()):
        truth = replace(base, effects=(effect_of(value),))
        one = points.map(lambda row, i=i: row[i : i + 1])
        columns.append(_read(truth, one))
    return np.concatenate(columns, axis=1)


def _read(model: hmcvt.EfficiencyModel, points: OperatingPoints) -> FloatArray:
    """Return efficiency and output speed as read, shape (2, n)."""
    read = model.readings_at(points)
    return np.stack([read["efficiency"], read["output_speed"]])


def report(records: Sequence[dict[str, Any]]) -> str:
    """Return the table of a run."""
    driven = [r for r in records if r["case"].quantity in QUANTITIES]
    above = [r for r in driven if r["true_ratio"] > 1.5]
    distinct = [r for r in above if r["zero_ratio"] > WITHIN_CLASS]
    scattered = [r for r in above if r["case"].stamped or r["case"].course == "session"]
    named = ("cause_found", "class_found", "other_form", "ambiguous")
    right = [_is_time_scale_right(r) for r in scattered]
    right_distinct = [
        _is_time_scale_right(r) for r in scattered if r["zero_ratio"] > WITHIN_CLASS
    ]
    nothing = [r for r in records if r["case"].quantity == "nothing"]
    understated = [r for r in records if r["case"].quantity == "understated"]
    rows = [
        ("no gap, scatter above 1.5 times its statement", "at most 5 %",
         _share([r["verdict"] == "no_gap" for r in above])),
        ("the same, unless it is the zero of a meter within twice its class", "at most 5 %",
         _share([r["verdict"] == "no_gap" for r in distinct])),
        ("a cause named there", "", _share([r["verdict"] in named for r in above])),
        ("time scale right, where stamps or sessions tell it", "at least 80 %", _share(right)),
        ("the same, without zeros of meters within twice their class", "at least 80 %",
         _share(right_distinct)),
        ("control: alarm", "at most 5 %", _share([r["verdict"] != "no_gap" for r in nothing])),
        ("noise stated 1.5 times too small: a cause named", "0 %",
         _share([r["verdict"] in named for r in understated])),
        ("noise stated 1.5 times too small: no gap", "",
         _share([r["verdict"] == "no_gap" for r in understated])),
    ]  # fmt: skip
    lines = [table(("campaigns", "goal", "measured"), rows)]
    lines.append(str(dict(Counter(r["verdict"] for r in above))))
    return "\n\n".join(lines)


def _is_time_scale_right(record: dict[str, Any]) -> bool:
    return record["time_scale"] in COURSES[record["case"].course]


def _share(answers: Sequence[bool]) -> str:
    if not answers:
        return "-"
    return f"{sum(answers)} of {len(answers)} = {100.0 * np.mean(answers):.0f} %"


def main() -> None:
    """Print the table of a run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    with Processes(options.jobs) as pool:
        futures = [
            pool.submit(judge, c) for c in cases(options.campaigns, options.seed)
        ]
        print(report([future.result() for future in futures]))


if __name__ == "__main__":
    main()
