# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.soak.kill_trials`: kill -9 at many moments, and look what is left.

Exits with 1 when anything acknowledged was lost, or a file cannot be read.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from studies.page import table

from . import kill_lines, processes


def main() -> int:
    """Run the trials and print a table; 0 when nothing was lost."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.soak.kill_trials", description=__doc__
    )
    parser.add_argument(
        "--trials",
        type=int,
        default=60,
        help="kills of a node over DDS at random moments",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--lines",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="a kill before every line of the code that writes, besides",
    )
    parser.add_argument(
        "--changes-only",
        action="store_true",
        help="of those lines, only the ones before which the files have changed",
    )
    given = parser.parse_args()
    start = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="hmcvt-kill-"))
    processes.loopback_only(folder)
    # What forks comes first: the threads of DDS would not bear it.
    problems = _lines(folder, given.changes_only) if given.lines else []
    if given.trials:
        problems += _random(given.trials, folder, given.seed)
    for problem in problems:
        print(f"* {problem}")
    print(
        f"\nSeed {given.seed}, {time.monotonic() - start:.0f} s, {len(problems)} problems"
        + (f"; the files are in {folder}" if problems else "")
        + "."
    )
    if not problems:
        shutil.rmtree(folder)
    return 1 if problems else 0


def _lines(folder: Path, changes_only: bool) -> list[str]:
    rows, problems = [], []
    for name in kill_lines.STEPS:
        count, found = kill_lines.kill_everywhere(
            name, folder / name.replace(" ", "-"), changes_only
        )
        rows.append((name, count, len(found)))
        problems += found
    print("Kills before every line of the code that writes:\n")
    print(table(("killed", "kills", "problems"), rows), flush=True)
    return problems


def _random(count: int, folder: Path, seed: int) -> list[str]:
    from . import kill_node

    found = list(kill_node.trials(count, folder, np.random.default_rng(seed)))
    problems = [problem for outcome in found for problem in outcome.problems]
    print("\nKills at random moments:\n")
    print(
        table(
            (
                "killed",
                "kills",
                "amid an operation",
                "temporary files left",
                "acknowledged",
                "problems",
            ),
            [
                (
                    "node that logs, refits and reverts",
                    count,
                    sum(outcome.midway for outcome in found),
                    sum(outcome.leftovers > 0 for outcome in found),
                    sum(outcome.acknowledged for outcome in found),
                    len(problems),
                )
            ],
        )
    )
    return problems


if __name__ == "__main__":
    sys.exit(main())
