# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.soak`: run the whole endurance trial and write the document."""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from studies.page import Run, busy_cores

from . import processes, report, trial

QUICK = trial.Plan(
    seconds=3.0,
    turns=2,
    refit_turns=1,
    rates=(300.0, 1000.0, 2000.0),
    rising_seconds=2.0,
    fuzz=10_000,
)
_say = partial(print, flush=True)


def main() -> int:
    """Run it; 0 when every goal is met."""
    parser = argparse.ArgumentParser(prog="python -m studies.soak", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/studies/soak.md"))
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a minute before the kills, to try the trial itself",
    )
    parser.add_argument(
        "--kills", type=int, default=60, help="random moments to kill the node"
    )
    given = parser.parse_args()
    # As Ctrl-C does: the processes that were started end, too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    plan = QUICK if given.quick else trial.Plan()
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hmcvt-soak-") as name:
        folder = Path(name)
        processes.loopback_only(folder)
        others = busy_cores()
        loaded = trial.under_load(plan, folder, _say)
        fuzzed = trial.nonsense(plan, folder, _say)
        kills = _kill_trials(given.kills)
        edits = _output_of("studies.soak.edit_log")
        faults = folder / "faults.md"
        _output_of("studies.soak.faults", "--out", str(faults))
        command = " ".join(["python -m studies.soak", *sys.argv[1:]])
        run = Run(command, time.monotonic() - start, others)
        given.out.write_text(
            report.text(run, plan, loaded, fuzzed, kills, edits, faults.read_text())
        )
    missed = [
        goal for goal in report.goals(loaded, fuzzed, kills, plan) if not goal.met
    ]
    for goal in missed:
        _say(f"missed: {goal.what}: {goal.measured}; goal: {goal.goal}")
    _say(f"Written to {given.out} after {run.seconds:.0f} s.")
    return 1 if missed else 0


def _output_of(module: str, *arguments: str) -> str:
    """Run a further trial and return what it prints."""
    _say(f"{module} ...")
    return subprocess.run(
        [sys.executable, "-m", module, *arguments],
        stdout=subprocess.PIPE,
        text=True,
        cwd=processes.ROOT,
        check=False,
    ).stdout


def _kill_trials(count: int) -> report.Process:
    _say(f"{count} kills at random moments, and one before every line that writes ...")
    return subprocess.run(
        [
            sys.executable,
            "-m",
            "studies.soak.kill_trials",
            "--trials",
            str(count),
            "--seed",
            "0",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=processes.ROOT,
    )


if __name__ == "__main__":
    sys.exit(main())
