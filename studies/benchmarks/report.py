# SPDX-License-Identifier: Apache-2.0
"""docs/benchmarks.md."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

from studies.soak.goals import Goal, goal_table, table
from studies.soak.processes import machine
from studies.soak.run import Run

from . import report_identify, report_node
from .bench_batch import COUNT
from .bench_diagnose import KINDS, LARGEST, USUAL
from .bench_diagnose import SIZES as CAMPAIGNS
from .bench_lookup import HOLDS, PIECES
from .limits import at_least, at_most
from .record import Record, Spread, short, spread
from .rivals import ACCURACY, LOAD_TORQUE_LIMITS, NODES

LIBRARIES = ("numpy", "scipy", "pymoo", "cma", "pytest-benchmark", "ros-rclpy")
_HELD = {"engine_speed": "engine speed held", "output_speed": "output speed and power held"}
_WHOLE = f"SciPy, {PIECES[0]} pieces"
_PIECES = f"SciPy, {PIECES[1]} pieces"


def goals(record: Record) -> list[Goal]:
    """Return what was aimed at and what was reached."""
    return [
        at_least("one lookup: table / ours", _lookup(record), 10.0),
        *(at_least(f"one optimum, {_HELD[hold]}: SciPy / ours",
                   _optimum(record, hold, _WHOLE), 10.0) for hold in HOLDS),
        at_least(f"batch of {COUNT:,} points: table / ours", _batch(record, "table", "hmcvt"), 1.0),
        at_most("memory per point, largest / smallest batch", _growth(record), 1.1),
        *report_identify.goals(record),
        *report_node.goals(record),
    ]


def text(run: Run, record: Record) -> str:
    """Return the document."""
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return "\n".join([
        "# Benchmarks", "",
        "    make bench", "",
        f"wrote this page in {run.seconds / 60:.1f} minutes (`{run.command}`).", "",
        f"Machine: {machine()}; {libraries}. Other programs used {run.others:.2f} cores before "
        "the start.", "",
        "Every figure without a unit is a ratio of two things that were timed in turns in this one "
        "run: each turn gives a ratio; told are the median and, in brackets, the quartiles. A "
        "goal is met when the median meets it. BLAS has one thread: the matrices are small.", "",
        *goal_table(goals(record)), "",
        *_one_point(record), "", *_many_points(record), "",
        *report_identify.section(record), "", *_diagnosis(record), "",
        *report_node.section(record), "",
        "The endurance trial of the node is in [soak.md](soak.md), a fleet of logs in "
        "[fleet.md](fleet.md).", ""])


# --- one point ------------------------------------------------------------------------------------


def _lookup(record: Record) -> Spread:
    return record.ratio("bench_lookup", {"contender": "table"}, {"contender": "hmcvt"})


def _optimum(record: Record, hold: str, other: str) -> Spread:
    return record.ratio("bench_optimum", {"contender": other, "hold": hold},
                        {"contender": "hmcvt", "hold": hold})


def _one_point(record: Record) -> list[str]:
    off = record.one("bench_table_error").told
    low, high = LOAD_TORQUE_LIMITS
    rows = [["lookup", _lookup(record).text(), "", ""]]
    for hold in HOLDS:
        rows.append([f"optimum, {_HELD[hold]}", *(
            _optimum(record, hold, other).text() for other in ("table", _WHOLE, _PIECES))])
    missed = [
        f"- With {_HELD[hold]}: tolerance {entry.told['tolerance']:g}, "
        f"{100 * entry.told['missed']:.0f} % of the points missed in one piece, "
        f"{100 * record.one('bench_optimum', hold=hold, contender=_PIECES).told['missed']:.0f} % "
        f"in {PIECES[1]}; the best point of the table loses {_percent(off['losses'][hold][0])} "
        f"(median) to {_percent(off['losses'][hold][1])} (largest) of efficiency."
        for hold in HOLDS
        for entry in [record.one("bench_optimum", hold=hold, contender=_WHOLE)]]
    times = ", ".join(
        f"{name} {short(1e6 * found.median)} us" for name, found in [
            ("lookup", record.spread("bench_lookup", contender="hmcvt")),
            *((f"optimum with {_HELD[hold]}", record.spread(
                "bench_optimum", contender="hmcvt", hold=hold)) for hold in HOLDS)])
    return [
        "## One point", "",
        "How many times the time of ours each takes:", "",
        *table(("", "table", "SciPy, one piece", f"SciPy, {PIECES[1]} pieces"), rows), "",
        f"- Ours: {times}.",
        "- Table: `scipy.interpolate.RegularGridInterpolator`, linear, on "
        f"{' x '.join(map(str, NODES))} values of the same model (load torque {low:g} to {high:g} "
        f"N m). It is off by up to {_percent(off['largest'])} of efficiency, "
        f"{_percent(off['rms'])} rms; ours has no such error.",
        "- Optimum on the table: the best of its strokes; with the output held, of its engine "
        "speeds, each with the stroke that a second table gives.",
        "- SciPy: `scipy.optimize.minimize_scalar(method=\"bounded\")` on our lookup, with the "
        f"coarsest tolerance that comes within {ACCURACY:g} of the best efficiency wherever the "
        "finest does. With the output held its variable is the engine speed, and `brentq` finds "
        "the stroke. The curve then has two tops and a step where the motor stands, often with the "
        "best point at its edge: bounded Brent can end on the wrong top, and is then less accurate "
        "than ours. The goal is measured against it all the same.",
        *missed,
    ]


def _percent(value: float) -> str:
    return f"{100 * value:.2g} points"


# --- many points ----------------------------------------------------------------------------------


def _batch(record: Record, over: str, under: str) -> Spread:
    return record.ratio("bench_batch", {"contender": over}, {"contender": under})


def _peaks(record: Record, contender: str) -> dict[int, float]:
    """Bytes per point, by the number of points."""
    return {entry.told["count"]: entry.told["peak"] / entry.told["count"]
            for entry in record.select("bench_memory", contender=contender)}


def _growth(record: Record) -> Spread:
    peaks = _peaks(record, "hmcvt")
    return spread([peaks[max(peaks)] / peaks[min(peaks)]])


def _many_points(record: Record) -> list[str]:
    done = record.one("bench_batch", contender="arithmetic alone").told["operations"]
    each = record.spread("bench_batch", contender="hmcvt")
    theirs = _peaks(record, "table")
    rows = [[f"{count:,}", short(peak), short(theirs[count]) if count in theirs else ""]
            for count, peak in _peaks(record, "hmcvt").items()]
    named = ", ".join(f"{count:g} `{name}`" for name, count in done.items())
    return [
        "## Many points", "",
        *table((f"{COUNT:,} points at once", "ratio of times"), [
            ["table / ours", _batch(record, "table", "hmcvt").text()],
            ["ours / its arithmetic alone", _batch(record, "hmcvt", "arithmetic alone").text()]]),
        "",
        f"Ours takes {short(1e9 * each.median)} ns a point for {sum(done.values()):.0f} array "
        f"operations, range checks included: {named}. They are counted while the batch runs, by "
        "an array that notes what is done with it (`studies/benchmarks/counting.py`). \"Alone\" "
        "means the same NumPy calls on arrays of the same lengths, and nothing else.", "",
        "Peak of memory beside the input, bytes a point (`tracemalloc`), the eight of the answer "
        "included:", "",
        *table(("points", "ours", "table"), rows),
    ]


# --- diagnosis ------------------------------------------------------------------------------------


def _diagnosis(record: Record) -> list[str]:
    usual = {"contender": "diagnose", "count": USUAL}
    rows = []
    for count in CAMPAIGNS:
        this = {"contender": "diagnose", "count": count}
        rows.append([
            f"{count:,}", record.ratio("bench_samples", this, usual).text(),
            record.ratio("bench_samples", this, {**this, "contender": "identify"}).text(),
            short(record.spread("bench_samples", **this).median)])
    largest = {entry.told["contender"]: entry.seconds for entry in record.select("bench_largest")}
    if largest:
        rows.append([
            f"{LARGEST:,} (one run)",
            short(largest["diagnose"] / record.spread("bench_samples", **usual).median),
            short(largest["diagnose"] / largest["identify"]), short(largest["diagnose"])])
    all_known = {"kinds": KINDS[-1]}
    kinds: Sequence[Sequence[str]] = [
        [str(count), record.ratio("bench_candidates", {"kinds": count}, all_known).text()]
        for count in KINDS]
    return [
        "## Diagnosis", "",
        "`hmcvt.diagnose` on a simulated campaign with a charge pump that the model does not know, "
        "efficiency and output speed:", "",
        *table(("samples", f"time / that of {USUAL} samples", "time / that of `hmcvt.identify`",
                "seconds"), rows), "",
        f"{USUAL} samples, by the number of candidates, effects in each of their forms:", "",
        *table(("candidates", f"time / that of all {KINDS[-1]}"), kinds), "",
        "A diagnosis runs in one process. `hmcvt fleet` diagnoses many logs in as many processes "
        "as there are cores.",
    ]
