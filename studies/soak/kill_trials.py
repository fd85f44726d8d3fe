# SPDX-License-Identifier: Apache-2.0
"""`python -m studies.soak.kill_trials`: kill -9 at many moments, and look what is left.

Exits with 1 when anything acknowledged was lost, or a file cannot be read.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from . import kill_lines, kill_storage
from .kill_storage import Outcome

NODE_KINDS = ("node that logs", "node that refits", "node that reverts")
_NODE_SHARE = 0.3


def main() -> int:
    """Run the trials and print a table; 0 when nothing was lost."""
    parser = argparse.ArgumentParser(prog="python -m studies.soak.kill_trials", description=__doc__)
    parser.add_argument("--trials", type=int, default=200, help="kills at random moments")
    parser.add_argument("--node-trials", type=int, help="how many of them on the node over DDS")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--lines", action=argparse.BooleanOptionalAction, default=True,
                        help="a kill before every line of the code that writes, besides")
    given = parser.parse_args()
    node = given.node_trials
    if node is None:
        node = round(_NODE_SHARE * given.trials)
    start = time.monotonic()
    folder = Path(tempfile.mkdtemp(prefix="hmcvt-kill-"))
    os.environ["ROS_LOG_DIR"] = str(folder / "ros-log")
    # What forks comes first: the threads of DDS would not bear it.
    problems = _lines(folder) if given.lines else []
    if given.trials:
        problems += _random(given.trials - node, node, folder, given.seed)
    for problem in problems:
        print(f"* {problem}")
    if given.trials > node:
        print("\nAbout every other start finds a bench log that was torn by hand, as a power cut "
              "may do; a kill\ncannot, since a row is one write.")
    print(f"\nSeed {given.seed}, {time.monotonic() - start:.0f} s, {len(problems)} problems"
          + (f"; the files are in {folder}" if problems else "") + ".")
    if not problems:
        shutil.rmtree(folder)
    return 1 if problems else 0


def _random(storage: int, node: int, folder: Path, seed: int) -> list[str]:
    print("\nKills at random moments:\n")
    _row("killed", "kills", "amid an operation", "temporary files left", "acknowledged",
         "problems")
    _row(*["---"] * 6)
    rng = np.random.default_rng(seed)
    problems: list[str] = []
    for kind, count in zip(kill_storage.TRIALS, _shares(storage, len(kill_storage.TRIALS)),
                           strict=True):
        if count:
            problems += _tell(kind, count, _storage_outcomes(kind, count, folder, rng))
    for kind, count in zip(NODE_KINDS, _shares(node, len(NODE_KINDS)), strict=True):
        if count:
            from . import kill_node

            problems += _tell(kind, count, kill_node.trials(kind, count, folder, rng))
    return problems


def _lines(folder: Path) -> list[str]:
    print("Kills before every line of the code that writes:\n")
    _row("killed", "kills", "problems")
    _row(*["---"] * 3)
    problems: list[str] = []
    for name in kill_lines.STEPS:
        count, found = kill_lines.kill_everywhere(name, folder / name.replace(" ", "-"))
        _row(name, count, len(found))
        problems += found
    return problems


def _storage_outcomes(
    kind: str, count: int, folder: Path, rng: np.random.Generator
) -> Iterator[Outcome]:
    for i in range(count):
        name = kind.replace(" ", "-") + ("" if kind in kill_storage.CHAINED else f"-{i + 1}")
        yield kill_storage.run(kind, folder / name, rng)


def _tell(kind: str, count: int, outcomes: Iterator[Outcome]) -> list[str]:
    found = list(outcomes)
    problems = [problem for outcome in found for problem in outcome.problems]
    _row(kind, count, sum(outcome.midway for outcome in found),
         sum(outcome.leftovers > 0 for outcome in found),
         sum(outcome.acknowledged for outcome in found), len(problems))
    return problems


def _shares(total: int, parts: int) -> list[int]:
    return [total // parts + (i < total % parts) for i in range(parts)]


def _row(*cells: object) -> None:
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
