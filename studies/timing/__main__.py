# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.timing`: time everything and write docs/studies/timings.md."""

import argparse
import os
import sys
import time
from importlib.metadata import version
from pathlib import Path

# The matrices are small. NumPy reads these when it is imported.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"))

import hmcvt_core as hmcvt
from studies.page import Run, busy_cores, goal_table, machine, render

from . import calls, compiled, drive_line, fitting, point


def main() -> int:
    """Run them; 0 when they all ran, whether or not a goal is met."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.timing", description=__doc__
    )
    parser.add_argument("--out", type=Path, default=Path("docs/studies/timings.md"))
    parser.add_argument(
        "--quick",
        action="store_true",
        help="few turns of everything, to try the benchmarks themselves",
    )
    given = parser.parse_args()
    others, start = busy_cores(), time.monotonic()
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    sections = [
        point.section(model, given.quick),
        calls.section(given.quick),
        drive_line.section(*[8] if given.quick else []),
        fitting.section(given.quick),
        # Last: it meters functions of the core.
        compiled.section(given.quick),
    ]
    goals = [goal for section in sections for goal in section.goals]
    run = Run(
        " ".join(["python -m studies.timing", *sys.argv[1:]]),
        time.monotonic() - start,
        others,
    )
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy"))
    values = {
        name: value for section in sections for name, value in section.values.items()
    }
    given.out.write_text(
        render(
            "report.md.j2",
            Path(__file__).parent,
            run=run,
            machine=machine(),
            libraries=libraries,
            goals=goal_table(goals),
            **values,
        ),
        encoding="utf-8",
    )
    for goal in goals:
        if not goal.met:
            print(f"missed: {goal.what}: {goal.measured}; goal: {goal.goal}")
    print(f"Written to {given.out} after {run.seconds / 60:.1f} minutes.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
